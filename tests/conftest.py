"""Shared fixtures."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

import himap
from himap.cli.main import main

SHARED_SKY = Path(__file__).resolve().parents[2] / "shared" / "sky"


@pytest.fixture(autouse=True)
def private_cache(tmp_path_factory, monkeypatch):
    """No test reads or fills the user's cache."""
    monkeypatch.setenv("HIMAP_CACHE", str(tmp_path_factory.getbasetemp() / "himap-cache"))


@pytest.fixture
def rng():
    return np.random.default_rng(12345)


@pytest.fixture(scope="session")
def real_sky():
    """Folder of the real Galaxy templates (nside 64), which the project cannot ship."""
    if not SHARED_SKY.is_dir():
        pytest.skip("the real Galaxy templates (../shared/sky) are not on this machine")
    return SHARED_SKY


@pytest.fixture
def lab(tmp_path, monkeypatch, request):
    """A module of its own with products; tells what it `computed`, and can `start` code on it elsewhere."""
    name = "lab_" + request.node.name.partition("[")[0]
    shutil.copy(Path(__file__).with_name("product_lab.py"), tmp_path / f"{name}.py")
    monkeypatch.setenv("HIMAP_CACHE", str(tmp_path / "cache"))
    monkeypatch.setenv("NOTES", str(tmp_path / "notes"))
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(tmp_path), str(Path(himap.__file__).parents[1])]))
    monkeypatch.syspath_prepend(str(tmp_path))
    module = __import__(name)
    (tmp_path / "notes").touch()
    module.computed = lambda: (tmp_path / "notes").read_text().split()
    module.start = lambda code: subprocess.Popen([sys.executable, "-c", f"import {name} as lab\n{code}"])
    yield module
    del sys.modules[name]


@pytest.fixture
def himap_command(tmp_path, monkeypatch):
    """Call the command in an empty folder; gives exit code, stdout and stderr."""
    monkeypatch.chdir(tmp_path)

    def call(*arguments):
        result = CliRunner().invoke(main, arguments)
        return result.exit_code, result.stdout, result.stderr

    return call
