"""Products to try the store with: `lab` of conftest.py imports a copy of this file under a new name."""

import os
import signal
import time
import warnings
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from himap.store.store import product

SCALE = 2.0


@dataclass(frozen=True)
class Pair:
    first: np.ndarray
    label: str


@dataclass(frozen=True)
class Method:
    n_sources: int = 3

    def clean(self):
        return 1


@dataclass(frozen=True)
class Template:
    path: str

    def digest(self):
        return Path(self.path).read_text()


def note(name):
    """Called when something is computed."""
    with open(os.environ["NOTES"], "a") as file:
        print(name, file=file)


def wait_for(condition):
    deadline = time.monotonic() + 60
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.01)


@product
def base(survey, *, scale=1.0, options=None):
    note("base")
    return np.arange(survey.n_channels, dtype=np.float32) * SCALE * scale


@product
def of_template(template):
    note("template")
    return np.array([len(template.digest())])


@product
def slow(size, gate=""):
    note("slow")
    while gate and not Path(gate).exists():
        time.sleep(0.01)
    return np.ones(size)


@dataclass(frozen=True)
class Odd:
    pairs: list
    table: dict
    shape: tuple
    nothing: None = None


@product
def odd():
    first = Pair(first=np.array([True, False]), label="é")
    second = Pair(first=np.empty((0, 3)), label="")
    table = {1: np.float64(np.inf), "a": np.array(3 + 4j)}
    return Odd(pairs=[first, second], table=table, shape=(2, (3,)))


@product
def pickled(what):
    @dataclass
    class Local:
        n: int = 1

    odd = {"object": np.array([{}], dtype=object), "set": {1}, "Local": Local()}
    return (odd | {"MaskedArray": np.ma.array([1.0])})[what]


@product
def threads(number):
    warnings.warn(f"this is number {number}", RuntimeWarning, stacklevel=1)
    return int(os.environ["DUCC0_NUM_THREADS"])


@product
def worker(number):
    time.sleep(0.2)  # so that others do some of it
    return os.getpid()


@product
def dying(number):
    os.kill(os.getpid(), signal.SIGKILL)
