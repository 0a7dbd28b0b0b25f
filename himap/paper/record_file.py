"""The file of what was measured on many skies, rows of one kind: written whole, and read strictly."""

import json
from dataclasses import asdict
from pathlib import Path

from himap.errors import InputError
from himap.outputs import whole_file

__all__ = ["read_record", "write_record"]

_FORMAT = 1
_DIGITS = 5  # of a number: far more than two machines agree on


def write_record(rows, path, about):
    """Write rows of one kind as JSON, one a line; `about` says what made it. Whole or not there.

    Rows are dataclasses whose class says in `command` which command of `himap` measures them.
    """
    lines = ",\n".join(json.dumps(_rounded(asdict(row)), allow_nan=False) for row in rows)
    head = f'"format": {_FORMAT},\n"about": {json.dumps(about)}'
    with whole_file(path) as temporary:
        temporary.write_text(f'{{{head},\n"{_key(type(rows[0]))}": [\n{lines}\n]}}\n')


def _key(kind):
    return kind.command.replace("-", "_")


def _rounded(row):
    return {
        name: float(f"{value:.{_DIGITS}g}") if isinstance(value, float) else value
        for name, value in row.items()
    }


def read_record(kind, path):
    """(rows, about) of a file that `write_record` wrote: a list of `kind`, and what made it.

    Raises
    ------
    InputError
        No such file, or another kind of file.
    """
    try:
        content = json.loads(Path(path).read_text())
        if content["format"] != _FORMAT:
            raise ValueError(f"format {content['format']!r}, not {_FORMAT}")
        rows, about = [kind(**row) for row in content[_key(kind)]], dict(content["about"])
        if not rows:
            raise ValueError("no row")
    except FileNotFoundError:
        raise InputError(f"there is no stored record {path}; `himap {kind.command}` writes it.") from None
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise InputError(f"{path} is not a file that `himap {kind.command}` wrote ({error}).") from None
    return rows, about
