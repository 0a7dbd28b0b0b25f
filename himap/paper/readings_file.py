"""The file of what readings lead to: written whole, and read strictly."""

import json
import math
from dataclasses import fields
from pathlib import Path

from himap.errors import InputError
from himap.outputs import whole_file
from himap.paper.claims import CLAIMS, VERDICTS
from himap.paper.readings import Judgement, Outcome, Run, readings

__all__ = ["read_readings", "write_readings"]

_FORMAT = 1
_DIGITS = 5  # of a number: far more than two machines agree on


def write_readings(outcomes, path, about):
    """Write {label: `Outcome`} as JSON, one reading a line; the file is whole or not there.

    `about` says what made it, {name: value}.
    """
    rows = [
        {
            "reading": label,
            "claims": {
                claim: {str(seed): _plain(one) for seed, one in by_seed.items()}
                for claim, by_seed in outcome.judged.items()
            },
            "runs": [_plain(run) for run in outcome.runs],
        }
        for label, outcome in outcomes.items()
    ]
    lines = ",\n".join(json.dumps(row, allow_nan=False) for row in rows)
    head = f'"format": {_FORMAT},\n"about": {json.dumps(about)}'
    with whole_file(path) as temporary:
        temporary.write_text(f'{{{head},\n"readings": [\n{lines}\n]}}\n')


def _plain(item):
    """{field: value} of a dataclass as JSON has it: numbers rounded, None for what is no number."""
    return {one.name: _rounded(getattr(item, one.name)) for one in fields(item)}


def _rounded(value):
    if isinstance(value, dict):
        return {name: _rounded(one) for name, one in value.items()}
    if isinstance(value, tuple):
        return [_rounded(one) for one in value]
    if isinstance(value, float):
        return float(f"{value:.{_DIGITS}g}") if math.isfinite(value) else None
    return value


def read_readings(path):
    """(outcomes, about) of a file that `write_readings` wrote.

    Returns
    -------
    (dict, dict)
        {label: `Outcome`}, in the order of `himap.paper.readings.readings`, and what made them. Readings and
        claims may be missing.

    Raises
    ------
    InputError
        No such file, another kind of file, or one with readings, claims or verdicts that himap does not have.
    """
    try:
        content = json.loads(Path(path).read_text())
        if content["format"] != _FORMAT:
            raise ValueError(f"format {content['format']!r}, not {_FORMAT}")
        found = {row["reading"]: _outcome(row) for row in content["readings"]}
        if len(found) != len(content["readings"]) or not found:
            raise ValueError("a reading twice, or none")
        about = dict(content["about"])
    except FileNotFoundError:
        raise InputError(f"there are no stored readings {path}; `himap readings` writes them.") from None
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise InputError(f"{path} is not a file that `himap readings` wrote ({error}).") from None
    _check_known(path, "readings", found, known := readings())
    _check_known(path, "claims", {claim for one in found.values() for claim in one.judged}, CLAIMS)
    return {label: found[label] for label in known if label in found}, about


def _check_known(path, what, names, known):
    unknown = [name for name in names if name not in known]
    if unknown:
        raise InputError(
            f"{path} has {what} of another version of himap, {', '.join(sorted(unknown))}; measure it anew "
            "with `himap readings`."
        )


def _outcome(row):
    judged = {
        claim: {int(seed): _judgement(one) for seed, one in by_seed.items()}
        for claim, by_seed in row["claims"].items()
    }
    runs = tuple(_run(one) for one in row["runs"])
    seeds = {run.seed for run in runs}
    if not runs or any(set(by_seed) != seeds for by_seed in judged.values()):
        raise ValueError(f"the claims and runs of {row['reading']!r} are not of the same seeds")
    return Outcome(judged=judged, runs=runs)


def _judgement(found):
    if found["verdict"] not in VERDICTS:
        raise ValueError(f"no verdict is {found['verdict']!r}")
    return Judgement(**found | {"value": _number(found["value"])})


_NUMBERS = ("noise_level", "bump", "mean_error", "largest_error", "flagged", "near_plane")
_CURVES = (("degrees", "angular_ratio"), ("k", "frequency_ratio"))


def _run(found):
    run = {name: _number(value) if name in _NUMBERS else value for name, value in found.items()}
    for band in ("angular", "frequency"):
        run[band] = {name: _number(value) for name, value in found[band].items()}
    for pair in _CURVES:
        run |= {name: tuple(_number(value) for value in found[name]) for name in pair}
        if len({len(run[name]) for name in pair}) > 1:
            raise ValueError(f"{' and '.join(pair)} are not of one length")
    return Run(**run)


def _number(value):
    return math.nan if value is None else float(value)
