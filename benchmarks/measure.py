"""A step in a process of its own: its time, the memory of the process and its children, its alternative."""

import threading
import time
from dataclasses import dataclass
from multiprocessing import get_context

import psutil

from himap.core.survey import Survey
from himap.paper import cleaned, pipeline
from himap.removal.parametric import Parametric

_INTERVAL = 0.05  # s between looks at the memory


@dataclass(frozen=True, kw_only=True)
class Measured:
    """Seconds of a step, memory at its peak (bytes, mapped files included), what it needs at least.

    `alternatives` are names, seconds for the same work, and of how much of it they were measured.
    """

    seconds: float
    memory: int
    needs: object
    alternatives: list[tuple]


def measured(step, case, *, beside=True):
    """Run `step` on `case`, and its alternative unless told otherwise; a `Measured`."""
    parent_end, child_end = get_context("spawn").Pipe()
    process = get_context("spawn").Process(target=_child, args=(step, case, beside, child_end))
    process.start()
    child_end.close()
    try:
        parent_end.recv()  # it has imported and compiled what it needs
        with Peak(process.pid) as peak:
            parent_end.send("go")
            seconds, needs = parent_end.recv()
        parent_end.send("on")
        return Measured(seconds=seconds, memory=peak.memory, needs=needs, alternatives=parent_end.recv())
    except EOFError:
        raise RuntimeError(f"the process of {step.name} ended before its work was done.") from None
    finally:
        process.join()


def _child(step, case, beside, pipe):
    tiny = pipeline.Case(survey=Survey(nside=8, n_channels=30, box_cells=16), beam=case.beam)
    pipeline.hi_of_sky.compute(tiny.survey.sky)  # compiles
    cleaned.separation.compute(tiny, Parametric())
    pipe.send("ready")
    pipe.recv()
    started = time.perf_counter()
    result = step.work(case)
    seconds = time.perf_counter() - started
    pipe.send((seconds, step.needs and step.needs(case.survey, result)))
    pipe.recv()
    found = []
    for name, work, times in step.beside(case, result) if beside and step.beside else ():
        started = time.perf_counter()
        work()
        found.append((name, times * (time.perf_counter() - started), 1 / times))
    pipe.send(found)


class Peak:
    """The largest resident memory of a process and its children while the context lasts."""

    def __init__(self, pid):
        self.memory, self._pid, self._done = 0, pid, threading.Event()
        self._watcher = threading.Thread(target=self._watch, daemon=True)

    def __enter__(self):
        self._watcher.start()
        return self

    def __exit__(self, *error):
        self._done.set()
        self._watcher.join()

    def _watch(self):
        while True:
            try:
                root = psutil.Process(self._pid)
                tree = [root, *root.children(recursive=True)]
                self.memory = max(self.memory, sum(process.memory_info().rss for process in tree))
            except psutil.NoSuchProcess:
                pass  # one of them has just ended
            if self._done.wait(_INTERVAL):
                return
