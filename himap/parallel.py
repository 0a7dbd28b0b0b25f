"""Independent products made several at a time."""

import os
import warnings

import joblib

from himap.errors import InputError
from himap.progress import progress

__all__ = ["JOBS_VARIABLE", "make_all", "n_jobs"]

JOBS_VARIABLE = "HIMAP_JOBS"
"""Environment variable with the number of processes; `himap run --jobs` sets it for its kernels."""


def n_jobs():
    """How many processes work at once, 1 unless the variable HIMAP_JOBS says otherwise.

    Raises
    ------
    InputError
        HIMAP_JOBS is no whole number above 0.
    """
    text = os.environ.get(JOBS_VARIABLE, "1")
    if not text.isdecimal() or int(text) < 1:
        raise InputError(f"{JOBS_VARIABLE} must be a whole number of processes above 0, got {text!r}.")
    return int(text)


def make_all(product, calls, description):
    """Make sure that products are in the cache, in `n_jobs()` processes at once.

    What is there already is not made again, so work that was interrupted goes on where it stopped.

    Parameters
    ----------
    product
        A `himap.store.Product`.
    calls
        The arguments of each call, a list of tuples.
    description
        A word or two in front of the bar, which shows the time left.

    Returns
    -------
    int
        How many were made now.
    """
    missing = [call for call in calls if not product.is_cached(*call)]
    jobs = min(n_jobs(), max(len(missing), 1))
    if jobs == 1:
        for call in progress(missing, description):
            product(*call)
    else:
        # Each process computes and keeps; cubes do not travel, and are read from the cache when needed.
        # They live on for the next call, so each piece of work brings the settings of this process.
        work = (joblib.delayed(_make)(product, call, _settings()) for call in missing)
        done = joblib.Parallel(n_jobs=jobs, return_as="generator_unordered")(work)
        for caught in progress(done, description, total=len(missing)):
            for message, category in caught:
                warnings.warn(message, category, stacklevel=2)
    return len(missing)


def _settings():
    """The variables of himap, {name: value}."""
    return {name: value for name, value in os.environ.items() if name.startswith("HIMAP_")}


def _make(product, call, settings):
    """Compute and keep; the warnings, for the process that asked and its filters."""
    for name in _settings().keys() - settings.keys():
        del os.environ[name]
    os.environ.update(settings)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        product(*call)
    return [(str(one.message), one.category) for one in caught]
