"""Linear algebra in the same arithmetic on every machine of a kind, unless somebody chose another."""

import os
import platform
import subprocess
import sys
from contextlib import nullcontext

import pytest

from himap.companion.kernels import kernel_environment
from himap.rounding import CHOICE, VARIABLE, same_everywhere

ARCHITECTURES = """
import numpy
from threadpoolctl import threadpool_info
print({one["architecture"] for one in threadpool_info() if one["internal_api"] == "openblas"})
"""
COMMAND = """
import sys
from himap.__main__ import start
sys.argv = ["himap", "--version"]
try:
    start()
except SystemExit:
    pass
"""


@pytest.fixture
def unchosen(monkeypatch):
    monkeypatch.delenv(CHOICE, raising=False)


@pytest.fixture
def modern(unchosen):
    """Skips where the processor of this machine has no such set, or does not say so."""
    if not same_everywhere():
        pytest.skip("no Linux on an x86-64 processor with AVX2: its arithmetic is its own")


@pytest.mark.parametrize(
    ("machine", "flags", "expected"),
    [
        ("x86_64", "flags : fpu sse2 fma avx avx2 avx512f", {VARIABLE: "Haswell"}),
        ("AMD64", "flags : avx2 fma", {VARIABLE: "Haswell"}),
        ("x86_64", "flags : fpu sse2 avx", {}),
        ("x86_64", "flags : avx2 fma4", {}),
        ("aarch64", "Features : avx2 fma", {}),
        ("x86_64", None, {}),
    ],
)
def test_only_where_the_processor_has_it(tmp_path, monkeypatch, unchosen, machine, flags, expected):
    monkeypatch.setattr(platform, "machine", lambda: machine)
    file = tmp_path / "cpuinfo"
    if flags is not None:
        file.write_text(f"vendor_id : Some\n{flags}\n")
    assert same_everywhere(file) == expected


def test_a_choice_stays(monkeypatch):
    monkeypatch.setenv(CHOICE, "Nehalem")
    assert same_everywhere() == {VARIABLE: "Nehalem"}


@pytest.mark.parametrize("place", ["command", "kernel"])
@pytest.mark.parametrize("chosen", [None, "Nehalem"])
def test_numpy_comes_with_it(modern, monkeypatch, place, chosen):
    monkeypatch.setenv(VARIABLE, "Sandybridge")  # as a machine may have it
    if chosen:
        monkeypatch.setenv(CHOICE, chosen)
    code = (COMMAND if place == "command" else "") + ARCHITECTURES
    with kernel_environment(None) if place == "kernel" else nullcontext():
        run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    if "set()" in run.stdout:
        pytest.skip("this numpy has another linear algebra than OpenBLAS")
    assert run.stdout.splitlines()[-1] == repr({chosen or "Haswell"})
    assert os.environ[VARIABLE] == "Sandybridge"
