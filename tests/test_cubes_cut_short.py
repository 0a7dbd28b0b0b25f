"""`himap clean` that is killed: its files are there together, or not at all."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from cube_files import power_law_maps, write_hdf5

import himap

KILLED = """
import os, signal

n_renamed = 0

def replace(source, target):
    global n_renamed
    n_renamed += 1
    if n_renamed > {after}:
        os.kill(os.getpid(), signal.SIGKILL)
    rename(source, target)

rename, os.replace = os.replace, replace
"""
COMMAND = "\nfrom himap.app.cli.main import main\nmain()\n"
FILES = {"c.fits", "c_foreground.fits", "c_mixing.txt", "c.html"}


@pytest.fixture
def clean(tmp_path, rng):
    """Run `himap clean` after some code; exit code, what it said, and the files that are there."""
    write_hdf5(tmp_path / "cube.h5", power_law_maps(rng), unit="mK", ordering="RING")

    def call(output, code=""):
        words = ["clean", "cube.h5", "--method", "pca", "-p", "n_sources=2", "-o", output]
        environment = os.environ | {"PYTHONPATH": str(Path(himap.__file__).parents[1])}
        done = subprocess.run(
            [sys.executable, "-c", code + COMMAND, *words],
            cwd=tmp_path,
            env=environment,
            capture_output=True,
            text=True,
        )
        return done.returncode, done.stderr, set(os.listdir(tmp_path)) - {"cube.h5"}

    return call


@pytest.mark.parametrize("after", [0, 1, 3])
def test_one_that_is_killed_between_its_files_can_be_run_again(clean, after):
    code, _, _ = clean("c.fits", KILLED.format(after=after))
    assert code == -signal.SIGKILL
    code, said, there = clean("c.fits")
    assert code == 0 and there == FILES, said
    assert clean("c.fits")[0] == 2
