"""Independent products computed in parallel: by processes of this machine, or by a Dask cluster."""

import asyncio
import logging
import os
import re
import threading
import time
import warnings
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from functools import cache as cache_calls
from unittest.mock import patch

import joblib
from joblib.externals.loky.process_executor import TerminatedWorkerError

from himap.core.errors import InputError
from himap.core.files import note_worker, run_folder
from himap.core.memory import cause_of_death, memory_kills
from himap.core.progress import progress
from himap.store import cache
from himap.store.store import MADE

JOBS_VARIABLE = "HIMAP_JOBS"
"""Environment variable with the number of processes; `himap run --jobs` sets it for its kernels."""

DASK_VARIABLE = "HIMAP_DASK"
"""Environment variable with the address of a Dask scheduler; `himap run --dask` sets it."""

_TRANSFORM_THREADS = "DUCC0_NUM_THREADS"
_CONNECT = 30  # s to reach the scheduler
_CHECK = 4  # s, the same before any work, for interactive use: enough for a scheduler that is starting
_LOOK = 1  # s between checks for the parent process
_RETRIES = 2  # for work that failed on a worker, such as one with a full disk


def n_jobs():
    """Number of parallel processes: 1, or HIMAP_JOBS, InputError if that is not a positive integer."""
    text = os.environ.get(JOBS_VARIABLE, "1")
    if not text.isdecimal() or int(text) < 1:
        raise InputError(f"{JOBS_VARIABLE} must be a positive number of processes, got {text!r}.")
    return int(text)


def dask_address():
    """Address of the Dask scheduler that the variable HIMAP_DASK names, or None."""
    return os.environ.get(DASK_VARIABLE) or None


def check_scheduler():
    """InputError, before any work, if no scheduler answers at the address in HIMAP_DASK."""
    if dask_address():
        with _client(_CHECK):
            pass


def make_all(work, description, *, at_once=None):
    """Make sure that results are in the cache: in `n_jobs()` parallel processes, or on the Dask cluster.

    Existing results are not recomputed, so interrupted work is resumed. Cubes are not transferred: each
    process stores results in the cache folder and reads them from there. Returns the number of results
    computed now.

    Parameters
    ----------
    work
        Pairs (`himap.store.store.Product`, tuple of its arguments), a list; started in this order, so
        prerequisites of others should come first.
    description
        A short label of the progress bar, which shows the remaining time.
    at_once
        Maximum number of processes of this machine that fit into memory; default: no limit.

    Raises
    ------
    InputError
        A killed process; a Dask scheduler that does not answer, or no longer answers; workers that die
        repeatedly, or that use another cache folder.
    """
    missing = [(product, call) for product, call in work if not product.is_cached(*call)]
    if not missing:
        return 0
    if dask_address():
        done = _on_cluster(missing)
    elif (jobs := min(n_jobs(), len(missing), at_once or len(missing))) > 1:
        done = _in_processes(missing, jobs)
    else:
        done = (_make(product, call, _settings()) for product, call in missing)
    for made, caught in progress(done, description, total=len(missing)):
        MADE.extend(made)
        for message, category in caught:
            warnings.warn(message, category, stacklevel=2)
    return len(missing)


def _in_processes(missing, jobs):
    """Yield the result of `_make` for each piece of work when finished; `jobs` processes share the cores."""
    kills = memory_kills()
    # joblib passes this to all packages with threads. New processes read it at their start.
    threads = os.environ.get(_TRANSFORM_THREADS) or str(max(1, joblib.cpu_count() // jobs))
    try:
        # Processes persist for the next call, so each piece of work includes the current settings.
        folder = run_folder()
        work = (joblib.delayed(_make)(*one, _settings(), folder, os.getpid()) for one in missing)
        options = {"temp_folder": str(folder), "return_as": "generator_unordered"}
        with patch.dict(os.environ, {_TRANSFORM_THREADS: threads}):
            yield from joblib.Parallel(n_jobs=jobs, **options)(work)
    except TerminatedWorkerError as error:
        cause = cause_of_death(map(int, re.findall(r"\((-?\d+)\)", str(error))), kills)
        more = " with fewer --jobs, or on a machine with more memory" if "memory" in cause else ""
        names = " or ".join(dict.fromkeys(product.name for product, _ in missing))
        raise InputError(
            f"one of {jobs} processes died of {cause} while computing {names}. Finished results are stored: "
            f"run the same again{more}."
        ) from None


@cache_calls
def _end_with(asking):
    """End this process when its parent, `asking`, has ended."""

    def watch():
        while os.getppid() == asking:
            time.sleep(_LOOK)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


@contextmanager
def _client(seconds):
    """A `distributed.Client` of the scheduler at `dask_address()`, which must answer within `seconds`.

    It logs no errors: they are reported by himap.
    """
    try:
        from distributed import Client, Security
        from distributed.comm import connect
    except ImportError:
        raise InputError("--dask needs the package `distributed`: pip install 'himap[cluster]'.") from None
    address = dask_address()

    async def greet():  # the client would wait forever, for example for a web server
        options = Security().get_connection_args("client")
        comm = await asyncio.wait_for(connect(address, timeout=seconds, **options), seconds)
        await comm.close()

    with patch.object(logging.getLogger("distributed.client"), "disabled", True):
        try:
            with ThreadPoolExecutor(1) as thread:  # in a notebook the current thread has a running event loop
                thread.submit(asyncio.run, greet()).result()
            client = Client(address, timeout=seconds)
        except Exception as error:  # anything may answer at this address
            said = str(error) or f"no answer to a greeting in {seconds:g} s"
            raise InputError(
                f"no Dask scheduler at {address} ({said}); start one with `dask scheduler` and give "
                "the address that it prints, such as tcp://host:8786."
            ) from None
        with client:
            yield client


def _on_cluster(missing):
    """Yield the result of `_make` for each finished piece of work; that of dead workers is reassigned."""
    address, settings = dask_address(), _settings() | {"HIMAP_CACHE": str(cache.cache_folder().absolute())}
    settings.pop(DASK_VARIABLE)
    with _client(_CONNECT) as client:
        from distributed import KilledWorker, as_completed

        futures = {client.submit(_make, *one, settings, pure=False, retries=_RETRIES): one for one in missing}
        for future in as_completed(futures):
            if future.cancelled():
                raise InputError(
                    f"the Dask scheduler at {address} is gone. Finished results are stored: start one, and "
                    "run the same again."
                )
            try:
                yield future.result()
            except KilledWorker as error:
                name = futures[future][0].name
                raise InputError(
                    f"{error.allowed_failures + 1} workers of {address} died one after the other while "
                    f"computing {name}; see their logs. Finished results are stored: run the same again."
                ) from None
    if not all(product.is_cached(*call) for product, call in missing):
        raise InputError(
            f"the workers of {address} do not share the cache folder {settings['HIMAP_CACHE']}, or run "
            "different code: set HIMAP_CACHE to a shared folder, and install the same himap on all machines."
        )


def _settings():
    """The environment variables of himap, {name: value}."""
    return {name: value for name, value in os.environ.items() if name.startswith("HIMAP_")}


def _make(product, call, settings, folder=None, asking=None):
    """Compute and store; returns [(name, key)] of the results, and the warnings, for the calling process.

    A parent process passes its `run_folder` and its process id, `asking`.
    """
    if folder is not None:
        note_worker(folder)
        _end_with(asking)
    for name in _settings().keys() - settings.keys():
        del os.environ[name]
    os.environ.update(settings)
    n_before = len(MADE)
    with warnings.catch_warnings(record=True, action="always") as caught:
        product(*call)
    return MADE[n_before:], [(str(warning.message), warning.category) for warning in caught]
