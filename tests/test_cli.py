"""The `himap` command."""

import os
import re
import time
from dataclasses import replace
from pathlib import Path

import pytest
from click.shell_completion import ShellComplete
from conftest import run_python

import himap
from himap.app import notebooks, reproduce
from himap.app.cli.main import main
from himap.core.errors import InputError
from himap.core.memory import LIMIT_VARIABLE
from himap.core.survey import PRESETS
from himap.store import cache
from himap.store.parallel import DASK_VARIABLE, JOBS_VARIABLE

TOY = """\
# %% [markdown]
# # The toy

# %% tags=["parameters"]
preset: str = "quick"  # ci, quick, laptop or paper
n_sources: int = 3  # components to remove
survey: dict = {}

# %%
from himap.core.errors import InputError

if n_sources > 10:
    raise InputError("too many sources.")
"""


@pytest.fixture
def himap_command(himap_command, tmp_path, monkeypatch):
    """The same, with two notebooks next to the empty folder."""
    (tmp_path / "notebooks").mkdir()
    for name in ("01_toy", "02_other"):
        (tmp_path / "notebooks" / f"{name}.py").write_text(TOY)
    (tmp_path / "work").mkdir()
    monkeypatch.chdir(tmp_path / "work")
    monkeypatch.setattr(notebooks, "_PACKAGE", tmp_path / "himap")
    monkeypatch.setenv("HIMAP_CACHE", str(tmp_path / "cache"))
    return himap_command


@pytest.fixture
def runs(monkeypatch):
    """The calls of `reproduce.run`, which only takes note of them."""
    calls = []

    def note(name, **options):
        calls.append((name, options))
        return Path("results") / f"{name}.ipynb", len(calls) > 1

    monkeypatch.setattr(reproduce, "run", note)
    return calls


@pytest.mark.parametrize("command", ["", *sorted(main.commands)])
def test_help_fits_a_screen_and_shows_an_example(himap_command, command):
    code, out, _ = himap_command(*command.split(), "--help")
    assert code == 0 and len(out.splitlines()) <= (30 if command else 24)
    assert re.search(rf"\n  +himap {command or 'run 04_pca --preset laptop -p n_sources=4'} ", out)
    assert command or all(f"\n  {name}" in out for name in main.commands)


def test_list(himap_command):
    code, out, _ = himap_command("list")
    assert code == 0 and [line.split()[0] for line in out.splitlines()] == ["notebook", "01_toy", "02_other"]
    code, out, _ = himap_command("list", "01")
    assert code == 0 and "n_sources: int = 3  components to remove" in out and "nside: int" in out


def test_run_all_gives_each_notebook_the_parameters_that_it_has(himap_command, runs, tmp_path):
    """And the preset to those that have one."""
    stored = "".join(line for line in TOY.splitlines(True) if not line.startswith(("preset:", "survey:")))
    (tmp_path / "notebooks" / "02_other.py").write_text(stored)
    code, out, _ = himap_command("run", "--all", "--preset", "ci", "-p", "n_sources=4", "-p", "seed=7")
    common = {"output": None, "again": False, "overwrite": False}
    given = {"01_toy": {"preset": "ci", "n_sources": 4, "seed": 7}, "02_other": {"n_sources": 4}}
    assert runs == [(name, common | {"parameters": one}) for name, one in given.items()]
    assert code == 0
    assert out.splitlines() == ["results/01_toy.ipynb  (done before)", "results/02_other.ipynb  (0 s)"]
    code, _, error = himap_command("run", "02_other", "--preset", "ci")
    assert code == 2 and "unknown parameter preset" in error


def test_run_all_goes_on_where_a_notebook_stops(himap_command, monkeypatch):
    """And says at the end which did; one that was named ends the command."""

    def run(name, **options):
        if name == "01_toy":
            raise InputError("too few channels.")
        return f"{name}.ipynb", False

    monkeypatch.setattr("himap.app.reproduce.run", run)
    code, out, error = himap_command("run", "--all")
    assert code and out == "02_other.ipynb  (done before)\n"
    assert "01_toy: too few channels." in error and "1 of 2 notebooks stopped: 01_toy." in error
    code, out, error = himap_command("run", "01_toy", "02_other")
    assert code == 2 and not out and "too few channels" in error


def test_who_does_the_work(himap_command, monkeypatch):
    """Kernels and workers find it in the environment, which is afterwards as it was."""
    variables = [JOBS_VARIABLE, DASK_VARIABLE, LIMIT_VARIABLE]
    for name in variables:
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv(JOBS_VARIABLE, "3")
    seen = []

    def run(name, **options):
        seen.append([os.environ.get(name) for name in variables])
        return Path("out.ipynb"), True

    monkeypatch.setattr(reproduce, "run", run)
    monkeypatch.setattr("himap.app.cli.shared.check_scheduler", lambda: None)
    options = ["--jobs", "2", "--dask", "tcp://host:8786", "--max-memory", "16GB"]
    assert himap_command("run", "01_toy", *options)[0] == 0
    assert himap_command("run", "01_toy")[0] == 0
    assert seen == [options[1::2], ["3", None, None]]
    assert [os.environ.get(name) for name in variables] == seen[1]


@pytest.mark.filterwarnings("default")  # an error inside the loop of the client would stop it for ever
def test_an_address_without_a_scheduler_is_refused_before_any_work(himap_command, runs, monkeypatch):
    """Given as an option or in the environment; whether anything is to be shared or not."""
    pytest.importorskip("distributed")
    monkeypatch.setattr("himap.store.parallel._CHECK", 0.3)
    for address in ("tcp://127.0.0.1:1", "nonsense://x"):
        code, _, error = himap_command("run", "01_toy", "--dask", address)
        assert code == 2 and f"no Dask scheduler at {address}" in " ".join(error.split())
    monkeypatch.setenv(DASK_VARIABLE, "tcp://127.0.0.1:2")
    code, _, error = himap_command("run", "01_toy")
    assert code == 2 and "tcp://127.0.0.1:2" in error and not runs
    monkeypatch.delenv(DASK_VARIABLE)
    assert himap_command("run", "01_toy")[0] == 0 and runs


def test_debug_shows_the_traceback(himap_command):
    for arguments in [["--debug", "list", "zz"], ["list", "zz", "--debug"]]:
        with pytest.raises(InputError):
            himap_command(*arguments, catch_exceptions=False)


def test_a_notebook_that_fails_ends_with_code_1(himap_command, monkeypatch):
    def fail(*args, **kwargs):
        raise reproduce.NotebookError("01_toy stopped in cell [3] with KeyError: 'x'")

    monkeypatch.setattr(reproduce, "run", fail)
    code, _, err = himap_command("run", "01_toy")
    assert code == 1 and "stopped in cell [3]" in err and "--debug" in err


def test_stale_notebooks_are_run_and_named(himap_command, monkeypatch):
    def refresh(names, report):
        for name in names or ():
            report(name, "its text changed")
        return names

    monkeypatch.setattr(reproduce, "refresh", refresh)
    assert himap_command("run", "--stale", "02_other")[:2] == (0, "02_other: its text changed\n")
    assert himap_command("run", "--stale")[:2] == (0, "every notebook is fresh\n")


def test_the_cache(himap_command, lab):
    code, out, _ = himap_command("cache", "info")
    assert code == 0 and out.strip().endswith("cache: 0.00B")
    lab.odd()
    for size in (100_000, 100_001):
        assert lab.slow(size).sum() == size
    first, *table = himap_command("cache", "info")[1].splitlines()
    assert first.endswith("cache: 1.60MB")
    assert [line.split()[:2] for line in table[1:]] == [["odd", "other"], ["slow", "other"]]
    assert "size: 100001}" in himap_command("cache", "info", "--all")[1]
    assert himap_command("cache", "clear", "slow")[:2] == (0, "freed 1.60MB\n")
    code, _, err = himap_command("cache", "clear", "slow")
    assert code == 2 and ", but odd" in err
    assert himap_command("cache", "clear", input="n\n")[0] == 1 and cache.cache_info()
    assert himap_command("cache", "clear", "--yes")[0] == 0 and not cache.cache_info()


def test_the_cache_by_preset_and_age(himap_command, lab):
    ci, laptop = PRESETS["ci"], PRESETS["laptop"]
    surveys = [replace(ci, seed=1), replace(ci, nside=16), laptop, replace(laptop, seed=1)]
    for survey in surveys:
        lab.base(survey)
    _, out, _ = himap_command("cache", "info")
    counts = [line.split()[1:3] for line in out.splitlines()[2:]]
    assert counts == [["ci", "1"], ["laptop", "2"], ["other", "1"]]
    for kept in cache.cache_info():
        if "seed=1" in kept.arguments:
            for file in kept.path.iterdir():
                os.utime(file, (time.time() - 3 * 86_400,) * 2)
    clear = ("cache", "clear", "--preset", "laptop", "--older-than")
    assert himap_command(*clear, "4")[:2] == (0, "freed 0.00B\n")
    assert himap_command(*clear, "2")[0] == 0
    assert [lab.base.is_cached(survey) for survey in surveys] == [True, True, True, False]
    assert himap_command("cache", "clear", "--preset", "ci")[0] == 0
    assert [lab.base.is_cached(survey) for survey in surveys] == [False, True, True, False]
    for days in ("-1", "nan", "inf", "1e400"):
        assert himap_command("cache", "clear", "--older-than", days)[0] == 2
    assert lab.base.is_cached(surveys[1])
    for file in cache.cache_folder().rglob("*.npy"):
        os.utime(file, (time.time() + 3 * 86_400,) * 2)  # by a clock that goes wrong
    assert himap_command("cache", "clear", "--older-than", "0", "--yes")[0] == 0 and not cache.cache_info()


def command_script(folder):
    """Code of a process that is the command, with the notebooks of `folder`."""
    return (
        "import pathlib; from himap.app.cli import main; from himap.app import notebooks; "
        f"notebooks._PACKAGE = pathlib.Path({str(folder / 'himap')!r}); main.main()"
    )


def test_from_the_shell(himap_command, tmp_path):
    """A process of its own, a kernel, an InputError inside it; what ends well is in the next test."""
    error, bad = "Error: too many sources.\n", ("run", "01_toy", "-p", "n_sources=11", "-o", "bad.ipynb")
    assert _python("-c", command_script(tmp_path), *bad) == (2, "", error)
    assert os.listdir() == []
    assert _python("-m", "himap", "--version") == (0, f"himap {himap.__version__}\n", "")


PACKAGES = ("json", "socket", "tempfile", "numpy", "healpy", "joblib", "papermill", "ipykernel_launcher")
WORK = """
import numpy as np
from himap.store.store import product

@product
def one(n):
    return np.ones(n)
"""
JOBS = """
from himap.app.cli import shared, main
from himap.store import parallel

@main.main.command()
@shared.workers
def work():
    from trapped_work import one
    print(parallel.make_all([(one, (1,)), (one, (2,))], "work"))

main.main(["work", "--jobs", "2"])
"""


def test_modules_in_the_current_folder_do_not_run(himap_command, tmp_path):
    """Neither in the command, nor in a kernel, nor in a process that shares the work: they leave no mark."""
    for name in PACKAGES:
        Path(f"{name}.py").write_text(f"open({str(tmp_path / 'mark')!r}, 'w')\n")
    script = command_script(tmp_path)
    toy = tmp_path / "notebooks" / "01_toy.py"
    toy.write_text(toy.read_text().replace("if n_sources", "import json, healpy, numpy\nif n_sources"))
    assert _python("-Pc", script, "run", "01_toy", "--preset", "ci", "-o", "out.ipynb") == (0, "out", "")
    assert {*os.listdir()} == {"out.ipynb", *(f"{name}.py" for name in PACKAGES)}
    assert _python("-m", "himap", "list")[0] in (0, 2) and not (tmp_path / "mark").exists()
    (tmp_path / "modules").mkdir()
    (tmp_path / "modules" / "trapped_work.py").write_text(WORK)
    more = f"import sys; sys.path.append({str(tmp_path / 'modules')!r})\n"
    assert _python("-Pc", more + JOBS)[:2] == (0, "2\n")
    assert not (tmp_path / "mark").exists()


def test_an_interruption_while_it_starts_is_one_word():
    """While any of these modules is imported; each as in a process that has none of himap."""
    code = """
import sys

class Interrupted:
    def find_spec(self, name, path=None, target=None):
        if name == module:
            raise KeyboardInterrupt

sys.meta_path.insert(0, Interrupted())
for module in ("numpy", "himap.app.cli.cubes", "himap.app.cli.main"):
    from himap.__main__ import start
    try:
        start()
    except SystemExit as end:
        print(end.code)
    for name in [name for name in sys.modules if name.startswith("himap")]:
        del sys.modules[name]
"""
    assert _python("-c", code, "list") == (0, "1\n1\n1\n", 3 * "\nAborted!\n")


def test_notebooks_without_their_packages(himap_command, tmp_path):
    """The library is installed without what only notebooks need; the rest of the command works."""
    everything = ["papermill", "jupytext", "nbclient", "jupyter_client", "nbformat", "ipykernel", "IPython"]
    code = f"""
import pathlib, sys
sys.modules |= dict.fromkeys({everything!r})
from click.testing import CliRunner
from himap.app import notebooks
from himap.app.cli.main import main
notebooks._PACKAGE = pathlib.Path({str(tmp_path / "himap")!r})
calls = [["--help"], ["--version"], ["cache", "info"], ["clean", "--help"]]
assert not any(CliRunner().invoke(main, words).exit_code for words in calls)
for there in ([], {everything[:-2]!r}):
    for name in there:
        del sys.modules[name]
    done = CliRunner().invoke(main, ["run", "01_toy"])
    assert done.exit_code == 2 and "pip install 'himap[notebooks]'" in done.output, done.output
"""
    assert _python("-c", code) == (0, "", "")


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        ("clean c.h5 --method pc", {"pca"}),
        ("suggest c.h5 --method g", {"gmca"}),
        ("clean c.h5 --beam osc", {"oscillating"}),
        ("run 10", {"10_results"}),
        ("list 27", {"27_restarts"}),
        ("run 04_pca --preset la", {"laptop"}),
        ("measure cl", {"claims"}),
        ("clean --beam widths.", {"widths."}),  # a file
    ],
)
def test_tab_completes_names(words, expected):
    *before, last = words.split()
    found = ShellComplete(main, {}, "himap", "_HIMAP_COMPLETE").get_completions(before, last)
    assert {one.value for one in found} == expected


def test_a_crash_names_its_signal():
    """Without a kernel to tell of it, such as in `himap clean`."""
    code = "import os, himap.__main__ as start, himap.app.cli.main as cli\n"
    code += "cli.main = lambda prog_name: os.kill(os.getpid(), 11)\nstart.start()"
    ended, _, errors = _python("-c", code)
    assert ended == -11 and "Segmentation fault" in errors


def _python(*arguments):
    """Exit code, stdout up to a file's extension, and stderr."""
    done = run_python(*arguments)
    return done.returncode, done.stdout.partition(".ipynb")[0], done.stderr


def test_what_is_slow_to_import_waits_until_it_is_needed():
    """`himap --help` would take seconds, and so would a line that imports a method."""
    for imports in (
        {
            "himap.removal": {"healpy", "sklearn", "numba"},
            "himap.cubes": {"sklearn", "camb", "numba", "himap.paper", "himap.store", "himap.sky"},
        },
        {"himap.app.cli.main": {"healpy", "sklearn", "camb", "numba"}},
    ):
        code = "import sys\n"
        code += "".join(f"import {one}; print({slow} & set(sys.modules))\n" for one, slow in imports.items())
        assert _python("-c", code) == (0, "set()\n" * len(imports), "")
