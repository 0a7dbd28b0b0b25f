"""The file of what was measured on many skies, rows of one kind: written whole, and read strictly."""

import json
from dataclasses import astuple, fields

from himap.errors import InputError
from himap.outputs import whole_file
from himap.paper.checking import marked, same
from himap.products.accepted import moved
from himap.reading import regular_file, there_is

__all__ = ["check_record", "grow_record", "lacking", "read_record", "write_record"]

_FORMAT = 2
_SKIES = "n_realisations"
_DIGITS = 4  # of a number: more than two machines agree on


def write_record(rows, path, about):
    """Write rows of one kind as JSON, one a line; `about` says what made it. Whole or not there.

    Rows are dataclasses whose class says in `command` which command of `himap record` measures them.
    """
    columns = [item.name for item in fields(rows[0])]
    lines = ",\n".join(
        json.dumps([_rounded(getattr(row, name)) for name in columns], allow_nan=False) for row in rows
    )
    head = f'"format": {_FORMAT},\n"about": {json.dumps(about)},\n"columns": {json.dumps(columns)}'
    with whole_file(path) as temporary:
        temporary.write_text(f'{{{head},\n"{_key(type(rows[0]))}": [\n{lines}\n]}}\n')


def _rounded(value):
    if isinstance(value, list):
        return [_rounded(one) for one in value]
    return float(f"{value:.{_DIGITS}g}") if isinstance(value, float) else value


def _key(kind):
    return kind.command.replace("-", "_")


def read_record(kind, path):
    """(rows, about) of a file that `write_record` wrote: a list of `kind`, and what made it.

    Raises
    ------
    InputError
        No such file, or another kind of file.
    """
    if not there_is(path):
        raise InputError(f"there is no stored record {path}; `himap record {kind.command}` writes it.")
    try:
        content = json.loads(regular_file(path, "record").read_text())
        if content["format"] != _FORMAT:
            raise ValueError(f"format {content['format']!r}, not {_FORMAT}")
        columns, about = content["columns"], dict(content["about"])
        rows = [kind(**dict(zip(columns, row, strict=True))) for row in content[_key(kind)]]
        if not rows:
            raise ValueError("no row")
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise InputError(
            f"{path} is not a file that `himap record {kind.command}` wrote ({error})."
        ) from None
    return rows, about


def check_record(rows, path, code):
    """Mark a record as what today's code gives, if the rows of one of its skies say so.

    Parameters
    ----------
    rows
        Of one sky of it, measured again.
    path
        Of the record; it gets "checked" beside what made it.
    code
        Fingerprint of the code that measured the rows.

    Raises
    ------
    InputError
        The record has other rows of that sky, or other numbers; it stays as it is.
    """
    stored, about = read_record(type(rows[0]), path)
    own = [row for row in stored if row.seed == rows[0].seed]
    if len(own) != len(rows):
        raise InputError(
            f"{path} has {len(own)} rows of the seed {rows[0].seed}, {len(rows)} were measured: give the "
            "parameters that it was made with."
        )
    other = [pair for pair in zip(own, rows, strict=True) if not same(*map(astuple, pair))]
    if other:
        raise InputError(
            f"{len(other)} of {len(rows)} rows of one sky are not those of {path} any more, such as "
            f"{other[0][1]} in the place of {other[0][0]}; measure all of it again."
        )
    write_record(stored, path, marked(about, code))


def lacking(kind, path, seeds, about):
    """The seeds of skies that a record of `kind` does not have yet, a list.

    Parameters
    ----------
    seeds
        Of all skies that it is to have.
    about
        What would make them, as of `write_record`.

    Raises
    ------
    InputError
        It was made with other parameters or by other code, so that its skies would not be alike.
    """
    rows, told = read_record(kind, path)
    differing = [name for name in ("preset", "galaxy", "seed") if about[name] != told[name]]
    ours, theirs = ({name: json.dumps(value) for name, value in one["overrides"]} for one in (about, told))
    names = (ours.keys() | theirs.keys()) - {_SKIES}
    differing += sorted(name for name in names if ours.get(name) != theirs.get(name))
    if differing:
        raise InputError(
            f"{path} was made with other parameters ({', '.join(differing)}): give those that it was made "
            "with, and more n_realisations."
        )
    if all(moved(made.get("code"), about["code"]) for made in (told, told.get("checked", {}))):
        raise InputError(f"{path} was made by other code; see with --check whether it gives the same.")
    there = {row.seed for row in rows}
    return [seed for seed in seeds if seed not in there]


def grow_record(rows, path, about):
    """Add rows of skies that a record lacks to it; see `lacking`. Whole, or left as it is.

    It keeps what it says of its beginning, with the number of skies as it is now, the time of all, and in
    "grown" the commits that added to it.
    """
    stored, told = read_record(type(rows[0]), path)
    rows = stored + rows
    n_skies = len({row.seed for row in rows})
    overrides = [[name, n_skies if name == _SKIES else value] for name, value in told["overrides"]]
    grown = told.get("grown", []) + [about["commit"]]
    seconds = told["seconds"] + about["seconds"]
    changed = {"overrides": overrides, "seconds": seconds, "grown": list(dict.fromkeys(grown))}
    write_record(rows, path, told | changed)
