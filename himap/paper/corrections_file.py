"""The file of what corrections lead to: written whole, and read strictly."""

import json
from dataclasses import asdict
from pathlib import Path

from himap.errors import InputError
from himap.outputs import whole_file
from himap.paper.corrections import Correction

__all__ = ["read_corrections", "write_corrections"]

_FORMAT = 1
_DIGITS = 5  # of a number: far more than two machines agree on


def write_corrections(rows, path, about):
    """Write a list of `Correction` as JSON, one a line; `about` says what made it. Whole or not there."""
    lines = ",\n".join(json.dumps(_rounded(asdict(row)), allow_nan=False) for row in rows)
    head = f'"format": {_FORMAT},\n"about": {json.dumps(about)}'
    with whole_file(path) as temporary:
        temporary.write_text(f'{{{head},\n"corrections": [\n{lines}\n]}}\n')


def _rounded(row):
    return {
        name: float(f"{value:.{_DIGITS}g}") if isinstance(value, float) else value
        for name, value in row.items()
    }


def read_corrections(path):
    """(rows, about) of a file that `write_corrections` wrote: a list of `Correction`, and what made it.

    Raises
    ------
    InputError
        No such file, or another kind of file.
    """
    try:
        content = json.loads(Path(path).read_text())
        if content["format"] != _FORMAT:
            raise ValueError(f"format {content['format']!r}, not {_FORMAT}")
        rows, about = [Correction(**row) for row in content["corrections"]], dict(content["about"])
        if not rows:
            raise ValueError("no correction")
    except FileNotFoundError:
        raise InputError(
            f"there are no stored corrections {path}; `himap corrections` writes them."
        ) from None
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise InputError(f"{path} is not a file that `himap corrections` wrote ({error}).") from None
    return rows, about
