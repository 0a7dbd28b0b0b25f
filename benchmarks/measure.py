"""A step in a process of its own: its time, the memory of the process and its children, its alternative."""

import json
import time
from contextlib import suppress
from dataclasses import dataclass
from multiprocessing import get_context

import click
import psutil

from himap.core.errors import InputError
from himap.core.files import atomic_files
from himap.core.survey import Survey
from himap.paper import cleaned, pipeline
from himap.removal.parametric import Parametric

_INTERVAL = 0.05  # s between looks at the memory
_LONGEST_LOOK = 0.02  # of the time: the pages of large processes are counted one by one, which holds them up


@dataclass(frozen=True, kw_only=True)
class Measured:
    """Seconds of a step, memory at its peak (bytes, mapped files included), what it needs at least.

    `alternatives` are names, seconds for the same work, and of how much of it they were measured.
    """

    seconds: float
    memory: int
    needs: object
    alternatives: list[tuple]


class Benchmark(click.Command):
    """A command whose users' errors end in one sentence."""

    def invoke(self, context):
        try:
            return super().invoke(context)
        except InputError as error:
            raise click.ClickException(str(error)) from None


def write_result(output, content):
    """Write what was measured as JSON, whole or not at all; nothing where there is no `output`."""
    if output:
        with atomic_files(output) as (temporary,):
            temporary.write_text(json.dumps(content, indent=1) + "\n")


def memory_of(pid):
    """Resident memory of a process and its children, bytes, mapped files included; 0 once one has ended.

    On Linux pages that several of them share, such as those of a file, count once (proportional set size).
    """
    with suppress(psutil.NoSuchProcess):
        root = psutil.Process(pid)
        several = [one.memory_full_info() for one in [root, *root.children(recursive=True)]]
        return sum(getattr(one, "pss", one.rss) for one in several)
    return 0


def peak_memory(pid, ended):
    """Largest `memory_of` a process until ``ended(seconds)``, which waits for so long at most, is true."""
    memory, is_done = 0, False
    while not is_done:
        started = time.perf_counter()
        memory = max(memory, memory_of(pid))
        is_done = ended(max(_INTERVAL, (time.perf_counter() - started) / _LONGEST_LOOK))
    return memory


def measured(step, case, *, alternatives=True):
    """Run `step` on `case`, and its alternatives unless these are not wanted; a `Measured`."""
    parent_end, child_end = get_context("spawn").Pipe()
    process = get_context("spawn").Process(target=_child, args=(step, case, alternatives, child_end))
    process.start()
    child_end.close()
    try:
        parent_end.recv()  # it has imported and compiled what it needs
        parent_end.send("go")
        memory = peak_memory(process.pid, parent_end.poll)
        seconds, needs = parent_end.recv()
        return Measured(seconds=seconds, memory=memory, needs=needs, alternatives=parent_end.recv())
    except EOFError:
        raise RuntimeError(f"the process of {step.name} ended before its work was done.") from None
    finally:
        process.join()


def _child(step, case, alternatives, pipe):
    tiny = pipeline.Case(survey=Survey(nside=8, n_channels=30, box_cells=16), beam=case.beam)
    pipeline.hi_of_sky.compute(tiny.survey.sky)  # compiles
    cleaned.separation.compute(tiny, Parametric())
    pipe.send("ready")
    pipe.recv()
    started = time.perf_counter()
    result = step.work(case)
    seconds = time.perf_counter() - started
    pipe.send((seconds, step.needs and step.needs(case.survey, result)))
    timed = []
    for name, work, times in step.alternatives(case, result) if alternatives and step.alternatives else ():
        started = time.perf_counter()
        work()
        timed.append((name, times * (time.perf_counter() - started), 1 / times))
    pipe.send(timed)
