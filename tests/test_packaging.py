"""What is built: an sdist that holds what its tests need, a wheel with the library alone."""

import email
import os
import re
import shutil
import subprocess
import sys
import tarfile
import zipfile

import pytest
from conftest import ROOT

from himap import __version__

BUILT = {"PKG-INFO", "setup.cfg"}

pytest.importorskip("setuptools", minversion="77", reason="an older one does not read our pyproject.toml")


def sources():
    """The files of the checkout, paths relative to its root."""
    done = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, text=True)
    if done.returncode or not done.stdout:
        pytest.skip("this is no checkout")
    return {name for name in done.stdout.split("\0") if name and (ROOT / name).exists()}


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    """Paths of an sdist, and of a wheel that is made of it."""
    folder = tmp_path_factory.mktemp("built")
    for name in sources():
        (folder / "project" / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(ROOT / name, folder / "project" / name)
    sdist = _build("sdist", folder / "project", folder)
    with tarfile.open(sdist) as archive:
        if hasattr(tarfile, "data_filter"):  # since Python 3.11.4
            archive.extraction_filter = tarfile.data_filter
        archive.extractall(folder)
    return sdist, _build("wheel", folder / f"himap-{__version__}", folder)


def _build(kind, project, folder):
    code = f"from setuptools import build_meta; print(build_meta.build_{kind}({str(folder)!r}))"
    environment = os.environ | {"PYTHONSAFEPATH": "1"}
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=project, env=environment, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    return folder / done.stdout.splitlines()[-1]


def test_an_sdist_holds_every_file_of_the_project(built):
    with tarfile.open(built[0]) as archive:
        names = {name.partition("/")[2] for name in archive.getnames() if archive.getmember(name).isfile()}
    ours = {name for name in names if "egg-info" not in name} - BUILT
    assert ours == sources()


def test_a_build_leaves_nothing_that_git_would_add(built):
    """As `pip install .` builds, in the tree."""
    project = built[0].parent / f"himap-{__version__}"
    files = {path.relative_to(project).as_posix() for path in project.rglob("*") if path.is_file()}
    new = files - sources() - BUILT
    assert any(name.startswith("build/") for name in new)
    check = ["git", "check-ignore", "--no-index", "--stdin"]
    done = subprocess.run(check, cwd=ROOT, input="\n".join(new), capture_output=True, text=True)
    assert set(done.stdout.split("\n")[:-1]) == new


def test_a_wheel_holds_the_library_alone(built):
    with zipfile.ZipFile(built[1]) as archive:
        names = archive.namelist()
        about = email.message_from_bytes(archive.read(f"himap-{__version__}.dist-info/METADATA"))
        commands = archive.read(f"himap-{__version__}.dist-info/entry_points.txt").decode()
    assert {name.partition("/")[0] for name in names} == {"himap", f"himap-{__version__}.dist-info"}
    assert {name for name in names if name.endswith(".py")} == {
        n for n in sources() if n.startswith("himap/")
    }
    assert "himap = himap.__main__:start" in commands
    needed = [
        re.match(r"[\w-]+", line)[0] for line in about.get_all("Requires-Dist") if "extra ==" not in line
    ]
    assert {"numpy", "click", "healpy"} <= set(needed)
    assert not {"jupyter-book", "papermill", "pytest", "ipykernel", "distributed"} & set(needed)
    assert set(about.get_all("Provides-Extra")) == {"book", "cluster", "notebooks", "test"}
