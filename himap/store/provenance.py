"""Provenance of figures: the line below them that states how to reproduce them."""

import math
import platform
import subprocess
import time
from contextlib import suppress
from dataclasses import asdict, dataclass, fields
from functools import lru_cache
from importlib.metadata import PackageNotFoundError
from importlib.metadata import version as package_version
from pathlib import Path

from himap import __version__
from himap.core.survey import PRESETS

PACKAGES = ("numpy", "scipy", "healpy", "ducc0", "camb", "astropy", "scikit-learn", "pysm3")
"""Packages whose version can change the last digits of numbers."""

VOLATILE = r", commit \w+( with edits)?( · [\d.]+ (s|min|h))?"
"""Regular expression of the part of a footer that differs between runs, commit and time."""

_HERE = Path(__file__).resolve().parents[1]
_STARTED = time.monotonic()


@dataclass(frozen=True, kw_only=True)
class Provenance:
    """Provenance of a result.

    Attributes
    ----------
    overrides
        Survey fields that differ from the preset, and the parameters that were passed to `of`.
    galaxy
        Which Galaxy: "synthetic", "templates (nside 64)", "pysm3", "none".
    commit, dirty
        Short git commit of himap ("unknown" outside a checkout); whether library or notebooks are modified.
    seconds
        Run time; NaN if unknown.
    version, packages
        Version of himap, and (name, version) of the installed packages among `PACKAGES`.
    """

    preset: str
    overrides: tuple[tuple[str, object], ...]
    galaxy: str
    seed: int
    commit: str
    dirty: bool
    seconds: float
    version: str
    packages: tuple[tuple[str, str], ...]

    @classmethod
    def of(cls, survey, *, galaxy, preset, parameters=None, started=None):
        """The provenance of a result computed now from `survey`, an override of the preset of that name.

        The Galaxy is a name, or an object with a `label`. Other parameters are {name: value} that differ from
        the defaults. `started` is the `time.monotonic()` at the start, default the first use of himap in this
        process.
        """
        base = asdict(PRESETS[preset]) | {"seed": survey.seed}
        changed = {name: value for name, value in asdict(survey).items() if value != base[name]}
        commit, dirty = _commit()
        return cls(
            preset=preset,
            overrides=(*changed.items(), *(parameters or {}).items()),
            galaxy=str(getattr(galaxy, "label", galaxy)),
            seed=survey.seed,
            commit=commit,
            dirty=dirty,
            seconds=time.monotonic() - (_STARTED if started is None else started),
            version=__version__,
            packages=_packages(),
        )

    @classmethod
    def of_stored(cls, about):
        """The provenance stored with a result by `asdict`, ignoring other keys.

        The time of a record that was grown in steps, in part from a cache, is unknown, NaN.
        """
        known = {item.name: about[item.name] for item in fields(cls)}
        return cls(**known | ({"seconds": math.nan} if "grown" in about else {}))

    def footer(self):
        """A line below a figure."""
        changed = [f"{name} = {value}" for name, value in self.overrides]
        edits = " with edits" if self.dirty else ""
        himap = f"himap {self.version}, commit {self.commit}{edits}"
        origin = [self.preset, *changed, f"{self.galaxy} Galaxy", f"seed {self.seed}"]
        took = [] if math.isnan(self.seconds) else [duration(self.seconds)]
        return " · ".join([*origin, himap, *took])

    __str__ = footer


def environment():
    """Environment of results of this process: {"himap", "commit", "dirty", "python", "packages"}."""
    commit, dirty = _commit()
    python, packages = platform.python_version(), dict(_packages())
    return {"himap": __version__, "commit": commit, "dirty": dirty, "python": python, "packages": packages}


def duration(seconds):
    """A readable time: 1.2 s, 35 s, 12 min, 2.3 h."""
    if seconds < 100:
        return f"{seconds:.1f} s" if seconds < 10 else f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 6000 else f"{seconds / 3600:.1f} h"


@lru_cache(maxsize=1)
def _packages():
    versions = {}
    for name in PACKAGES:
        with suppress(PackageNotFoundError):
            versions[name] = package_version(name)
    return tuple(versions.items())


@lru_cache(maxsize=1)
def _commit():
    """Short commit of the checkout that contains himap, and whether its code is modified."""
    if _git("ls-files", "--error-unmatch", "__init__.py") is None:  # installed inside another repository
        return "unknown", False
    commit = _git("rev-parse", "--short", "HEAD")
    edits = _git("status", "--porcelain", "--", ".", ":(top,glob)notebooks/*.py")
    return (commit, bool(edits)) if commit else ("unknown", False)


def _git(*arguments):
    """Output of a git command in the package's folder; None if it fails."""
    try:
        process = subprocess.run(["git", *arguments], cwd=_HERE, capture_output=True, text=True, check=False)
    except OSError:
        return None
    return process.stdout.strip() if process.returncode == 0 else None
