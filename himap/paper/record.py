"""Experiments on many skies, and records that store their numbers: one table, in one file format.

A record stores ids and numbers. Words come from the code that shows them, so rewording makes nothing stale.
The file is JSON with one line for each sky and key: if a column has several values there, such as those of
a curve, they are a list.
"""

import json
import math
import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np
import pandas as pd

from himap.core.errors import InputError
from himap.core.files import atomic_files
from himap.core.reading import regular_file
from himap.store.fingerprint import moved
from himap.store.parallel import dask_address
from himap.store.provenance import Provenance, environment

_FORMAT = 3
_DIGITS = 6  # of a number: far more than the agreement of two machines
_TOLERANCE = 1e-3  # of repeated measurements, relative to the number or to the median of its key
_SKIES, _RESTARTS = "n_realisations", "n_restarts"  # the amount measured, not the way
_FIRST = "first_sky"  # digest of all its inputs, including defaults and files


@dataclass(frozen=True, kw_only=True)
class Experiment:
    """A grid of runs and a measure, which give a table with rows for many skies."""

    name: str  # of its module in `himap.paper.experiments`, which defines `skies` and `measure`
    chapter: str  # the notebook that shows it and whose parameters are those of the experiment
    # {column: type of its values}, in order; an absent number is NaN, an absent text or bool None. Every
    # table has the column "seed", an int, before these.
    columns: Mapping
    key: tuple  # columns that identify a row on one sky; the others may have several values for a key
    # From the parameters to a list of skies: objects with `survey`, whose seed identifies them, and `galaxy`.
    skies: Callable
    measure: Callable  # product, from one of these to its rows, a list of dicts with a value for each column
    summary: Callable  # from the table of all rows to a summary for a terminal, a DataFrame of texts
    defaults: Mapping = field(default_factory=dict)  # {parameter: value}, if it differs from the chapter's
    without: tuple = ()  # parameters of the chapter that the experiment does not have
    stated: tuple = ()  # parameters that are always stored, besides the numbers of skies, restarts and mocks
    words: tuple = ()  # columns of text that are not compared if a sky is measured again
    remark: Callable = lambda sky: ""  # a text below the summary, e.g. what such maps cannot show
    # Computes products that skies need before the measure: in turn, or all at once on a cluster.
    prepare: Callable = lambda skies: None
    # From a sky and restarts to the sky without these, or None; None if restarts share a measure.
    other_restarts: Callable | None = None

    def table(self, skies):
        """Rows for some skies, a DataFrame with the columns of the experiment, "seed" first.

        Results in the cache are not computed again; observations made for others are deleted. InputError for
        no sky, or errors of the measure.
        """
        if not skies:
            raise InputError(f"the experiment {self.name} needs one sky or more, got none.")
        rows = []
        for several in [skies] if dask_address() else [[sky] for sky in skies]:
            self.prepare(several)
            rows += [{"seed": sky.survey.seed} | row for sky in several for row in self.measure(sky)]
        return self.frame(rows)

    @staticmethod
    def restarts_of(rows):
        """{"n_restarts": number of restarts of every sky in some rows}; {} for rows without restarts."""
        each = rows.groupby("seed")["restart"].nunique() if "restart" in rows else []
        return {_RESTARTS: int(min(each))} if len(each) else {}

    def frame(self, rows):
        """A DataFrame from rows, dicts with a value for each column.

        ValueError for other columns, or a value of another type.
        """
        types = {"seed": int, **self.columns}
        if any(row.keys() != types.keys() for row in rows):
            raise ValueError(f"the columns are not {', '.join(types)}")
        return pd.DataFrame(
            {name: _column([row[name] for row in rows], name, kind) for name, kind in types.items()}
        )


@dataclass(frozen=True, kw_only=True)
class Record:
    """The table of an experiment, with its provenance."""

    experiment: Experiment
    rows: pd.DataFrame  # with its columns
    # {name: value}: the fields of a `Provenance`; "code", the fingerprint of the measuring code;
    # "checked", {"code", "commit", "dirty"}, if a sky was measured again; "grown", commits of additions.
    about: Mapping

    @property
    def made(self):
        """The `Provenance`."""
        return Provenance.of_stored(self.about)

    @property
    def parameters(self):
        """{name: value} that repeat the measurement, without folders, which are specific to a machine."""
        named = {name: self.about[name] for name in ("preset", "seed")}
        named["galaxy"] = str(self.about["galaxy"]).partition(" ")[0]  # of "templates (nside 64)"
        return named | dict(self.about["overrides"])

    @property
    def seeds(self):
        """Seeds of its skies, a list."""
        return self.rows["seed"].unique().tolist()

    @property
    def codes(self):
        """Fingerprints of code known to give these numbers, a list."""
        return [made["code"] for made in (self.about, self.about.get("checked")) if made]

    def save(self, path):
        """Write it as JSON; the file is complete or absent."""
        groups = self.rows.groupby(["seed", *self.experiment.key], sort=False, dropna=False)
        lines = [[_cell(group[name].tolist()) for name in self.rows] for _, group in groups]
        head = {"format": _FORMAT, "experiment": self.experiment.name, "about": dict(self.about)}
        head = [f"{json.dumps(name)}: {json.dumps(value)}" for name, value in head.items()]
        rows = ",\n".join(json.dumps(line, allow_nan=False) for line in lines)
        head.append(f'"columns": {json.dumps(list(self.rows))}')
        with atomic_files(path) as (temporary,):
            temporary.write_text("{" + ",\n".join(head) + f',\n"rows": [\n{rows}\n]}}\n')

    @classmethod
    def load(cls, experiment, path):
        """Read the record of an experiment from a file written by `save`; InputError for any other file."""
        command = f"`himap measure {experiment.name}`"
        if not os.path.lexists(path):
            raise InputError(f"there is no record {path}; {command} writes it.")
        try:
            content = json.loads(regular_file(path, "record").read_text())
            if (content["format"], content["experiment"]) != (_FORMAT, experiment.name):
                raise ValueError(f"format {content['format']!r} of {content['experiment']!r}")
            rows = []
            for line in content["rows"]:
                cells = dict(zip(content["columns"], line, strict=True))
                lengths = {len(cell) for cell in cells.values() if isinstance(cell, list)} or {1}
                if len(lengths) > 1:
                    raise ValueError(f"lists of {' and '.join(map(str, sorted(lengths)))} values in one row")
                rows += [
                    {name: cell[n] if isinstance(cell, list) else cell for name, cell in cells.items()}
                    for n in range(*lengths)
                ]
            if not rows:
                raise ValueError("no row")
            record = cls(experiment=experiment, rows=experiment.frame(rows), about=dict(content["about"]))
            if not (record.made and all(isinstance(code, dict) for code in record.codes)):
                raise ValueError("nothing says what made it")
        except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
            raise InputError(f"{path} is not a record that {command} wrote ({error}).") from None
        return record

    def check(self, rows, about, *, drawn=np.False_):
        """This record, marked as confirmed by today's code, if that gives the same numbers for one sky.

        `rows` are those of that sky, measured again, and `about` is their provenance, in the form of the
        record; `drawn` rows are single draws, whose numbers are not compared. InputError if the record was
        made with other parameters, or has other numbers for that sky.
        """
        self.check_parameters(about)
        seed = int(rows["seed"].iloc[0])
        columns, key = [name for name in rows if name not in self.experiment.words], [*self.experiment.key]
        stored = self.rows[self.rows["seed"] == seed]
        if "restart" in rows:  # a sky may have more restarts than others
            stored = stored[stored["restart"].isin(rows["restart"])]
        stored, rows = (  # rows are in another order if restarts were added
            table.sort_values(key, kind="stable", ignore_index=True)
            for table in (stored, rows.assign(drawn=drawn))
        )
        if len(stored) != len(rows):
            raise InputError(
                f"the record has {len(stored)} rows of the seed {seed}, {len(rows)} were measured: give the "
                "parameters that it was made with."
            )
        named, drawn = {"seed", *self.experiment.key}, rows["drawn"].to_numpy()
        differing = [~_agree(name, stored, rows, key) & ~(drawn & (name not in named)) for name in columns]
        moved_rows = np.any(differing, axis=0)
        if moved_rows.any():
            first = moved_rows.argmax()
            raise InputError(
                f"{moved_rows.sum()} of {len(stored)} rows of the seed {seed} have changed, such as "
                f"{stored[columns].iloc[first].to_dict()}, now {rows[columns].iloc[first].to_dict()}; "
                "measure all of it again."
            )
        checked = {"code": about["code"]} | {name: environment()[name] for name in ("commit", "dirty")}
        return replace(self, about={**self.about, "checked": checked})

    def missing(self, skies, about):
        """Part of some skies missing in the record, a list: skies, and new restarts of its skies.

        InputError if the record was made with other parameters or by other code than in `about`, or with
        another number of restarts if these cannot be measured separately.
        """
        self.check_parameters(about)
        if all(moved(code, about["code"]) for code in self.codes):
            raise InputError("the record was made by other code; see with --check if that gives the same.")
        recorded, given = (dict(made["overrides"]).get(_RESTARTS) for made in (self.about, about))
        other_restarts = self.experiment.other_restarts
        if given != recorded and (other_restarts is None or given < recorded):
            more = " or more" if other_restarts else ""
            raise InputError(
                f"the record has {recorded} restarts of every sky: give n_restarts={recorded}{more}."
            )
        missing = []
        for sky in skies:
            known = self.rows[self.rows["seed"] == sky.survey.seed]
            if known.empty:
                missing.append(sky)
            elif other_restarts and (rest := other_restarts(sky, {*known["restart"]})):
                missing.append(rest)
        return missing

    def grow(self, rows, about):
        """This record with more rows, the total time, and the commits of the additions."""
        rows = pd.concat([self.rows, rows], ignore_index=True)
        overrides = dict(self.about["overrides"]) | {_SKIES: rows["seed"].nunique()}
        changed = {
            "overrides": [list(pair) for pair in (overrides | self.experiment.restarts_of(rows)).items()],
            "seconds": self.about["seconds"] + about["seconds"],
            "grown": list(dict.fromkeys([*self.about.get("grown", []), about["commit"]])),
        }
        return replace(self, rows=rows, about={**self.about, **changed})

    def check_parameters(self, about):
        """Refuse results made with other parameters than the record, except for amounts.

        InputError lists the parameters.
        """
        known = ["preset", "galaxy", "seed", *({"galaxy_files", _FIRST} & self.about.keys() & about.keys())]
        ours, theirs = (
            {name: made[name] for name in known} | dict(made["overrides"]) for made in (self.about, about)
        )
        names = sorted((ours.keys() | theirs.keys()) - {_SKIES, _RESTARTS})
        differing = [name for name in names if json.dumps(ours.get(name)) != json.dumps(theirs.get(name))]
        if differing:
            words = ", ".join(name for name in differing if name != _FIRST) or "defaults, or files it reads"
            raise InputError(f"the record was made with other parameters ({words}): give those.")


def _column(values, name, kind):
    """A Series of values of one type, or of one among several."""
    kinds = kind if isinstance(kind, tuple) else (kind,)
    values = [value.item() if isinstance(value, np.generic) else value for value in values]
    if float in kinds:
        kinds, values = (*kinds, int), [math.nan if value is None else value for value in values]
    for value in values:
        if type(value) not in kinds and (value is not None or int in kinds):
            raise ValueError(f"a value of {name} is {value!r}")
    return pd.Series(values, dtype={int: "int64", float: "float64"}.get(kind, "object"))


def _cell(values):
    """The values of one key in a file: one if they are all equal, otherwise the list."""
    floats = isinstance(values[0], float)
    plain = [float(f"{x:.{_DIGITS}g}") if math.isfinite(x) else None for x in values] if floats else values
    return plain[0] if all(value == plain[0] for value in plain) else plain


def _agree(name, stored, again, key):
    """Whether a column agrees, row by row: numbers to `_TOLERANCE`, everything else exactly."""
    one, other = stored[name].to_numpy(), again[name].to_numpy()
    if stored[name].dtype != "float64":
        return np.array([_cell([a]) == _cell([b]) for a, b in zip(one, other, strict=True)])
    groups = stored.groupby(key, sort=False, dropna=False)[name]
    size = groups.transform(lambda several: several.abs().median()).fillna(0).to_numpy()
    with np.errstate(invalid="ignore"):
        near = np.abs(one - other) <= _TOLERANCE * np.maximum(size, np.abs(one))
    return near | ~(np.isfinite(one) | np.isfinite(other))  # a file has no infinity
