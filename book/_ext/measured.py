"""Sphinx extension: what `python -m benchmarks` and `python -m benchmarks.scaling` measured, as tables.

``{measured-steps} steps_paper``: time, memory, floor and alternative of every step; ``{measured-growth}
scaling``: the exponents; ``{extrapolated-steps} steps_laptop steps_paper scaling``: what the steps would cost
at another size; ``{measured-whole} steps_paper claims_paper_synthetic paper_synthetic``: how long light cone,
ledger and figures took together. The arguments are names of JSON files and folders in ``book/results``.
"""

import json
import math
from dataclasses import replace
from itertools import groupby
from operator import itemgetter
from pathlib import Path

from docutils.parsers.rst import directives
from sphinx.util.docutils import SphinxDirective
from tables import parsed, table

from himap.products.memory import estimate
from himap.products.provenance import Provenance
from himap.survey import PRESETS

_TIMES = {"HI light cone": 1, "observations, three beams": 1, "both spectra": 3 * 6}
"""How often a step is done for Figs. 1 and 2, {step: times}; once for each of the three beams by default."""

_HELD = {"HI light cone": "HI light cone", "observations, three beams": "observing"}
_NO_BREAK = "\N{NO-BREAK SPACE}"
_CORES = 2  # of the machine that the steps were measured on


class Steps(SphinxDirective):
    """Its argument is the file of the steps."""

    required_arguments = 1

    def run(self):
        found = _read(self, self.arguments[0])
        head = ["Step", "Time", "Goal", "Memory", "Goal", "Floor", "Over it", "Beside it"]
        goals = found["about"]["preset"] == "paper"
        if not goals:
            head = [word for word in head if word != "Goal"]
        rows = [_step(row, goals) for row in found["steps"]]
        return parsed(self, [*table(head, rows), "", _machine(found["machine"]), "", _footer(found["about"])])


def _step(row, goals):
    beside = row.get("alternative")
    cells = [f"{_short(row['seconds'], 3)} s", f"{row['goal_seconds']} s"]
    cells += [f"{row['memory_gb']:.1f} GB", f"{row['goal_gb']} GB", f"{_short(row['floor_seconds'])} s"]
    cells.append(f"{_short(row['seconds'] / row['floor_seconds'])} ×")
    cells = [cell.replace(" ", _NO_BREAK) for cell in cells]
    if goals:
        cells[0] = f"**{cells[0]}**" if row["seconds"] > row["goal_seconds"] else cells[0]
        cells[2] = f"**{cells[2]}**" if row["memory_gb"] > row["goal_gb"] else cells[2]
    cells.append(f"{_short(beside['seconds'] / row['seconds'])} × {beside['name']}" if beside else "")
    return [row["step"], *(cells if goals else [cell for n, cell in enumerate(cells) if n not in (1, 3)])]


def _short(value, digits=2):
    """A number with that many digits, without an exponent."""
    return f"{float(f'{value:.{digits}g}'):,g}"


def _machine(machine):
    return (
        f"This machine moved {machine['bandwidth'] / 1e9:.3g} GB/s, did {machine['operations'] / 1e9:.3g} "
        f"GFlop/s in float64 ({machine['operations_single'] / 1e9:.3g} in float32), and took "
        f"{1e3 * machine['transform']:.3g} ms for a spherical harmonic transform "
        f"({1e3 * machine['transform_single']:.3g} in float32)."
    )


class Growth(SphinxDirective):
    """Its argument is the file of the scaling."""

    required_arguments = 1

    def run(self):
        found = _read(self, self.arguments[0])
        ways = found["found"]
        names = list(next(iter(ways.values())))
        rows = [[name, *(f"{way[name]['exponent']:.2f}" for way in ways.values())] for name in names]
        head = ["Step", "with $N_\\mathrm{side}$", "with channels"]
        return parsed(self, [*table(head, rows), "", _footer(found["about"])])


class Extrapolated(SphinxDirective):
    """Its arguments are files, of the steps at two sizes and of the scaling; its options the size asked for.

    The exponent with channels is that of the scaling, the one with nside what it leaves of the growth between
    the two sizes: small maps, of which the scaling is made, grow more slowly than large ones.
    """

    required_arguments = 3
    option_spec = {
        name: directives.positive_int for name in ("nside", "n_channels", "box_cells", "realisations")
    }

    def run(self):
        smaller, larger, scaling = (_read(self, name) for name in self.arguments)
        asked, many = dict(self.options), self.options["realisations"]
        del asked["realisations"]
        memory = estimate(replace(PRESETS["paper"], **asked))
        rows, total = [], 0
        for before, row in zip(smaller["steps"], larger["steps"], strict=True):
            name = row["step"]
            with_channels = scaling["found"]["n_channels"][name]["exponent"]
            sizes = smaller["about"]["size"], larger["about"]["size"], asked
            once = row["seconds"] * _growth(row["seconds"] / before["seconds"], with_channels, *sizes)
            times, held = _TIMES.get(name, 3), memory[_HELD.get(name, "cleaning")] / 1e9
            hours = _CORES * many * times * once / 3600
            total += hours
            rows.append(
                [
                    name,
                    f"{_short(once / 60)}{_NO_BREAK}min",
                    times,
                    f"{hours:,.0f}",
                    f"{held:.0f}{_NO_BREAK}GB",
                ]
            )
        rows.append(["all", "", "", f"{total:,.0f}", ""])
        head = ["Step", "Once, two cores", "Times", f"Core hours, {many} realisations", "Memory"]
        return parsed(self, table(head, rows))


def _growth(measured, with_channels, smaller, larger, asked):
    """Factor in time from `larger` to `asked`, given the one from `smaller` to `larger`."""
    first, second = _factors(smaller, larger), _factors(larger, asked)
    with_nside = math.log(measured / first["n_channels"] ** with_channels) / math.log(first["nside"])
    return second["nside"] ** with_nside * second["n_channels"] ** with_channels


def _factors(before, after):
    return {name: after[name] / before[name] for name in ("nside", "n_channels")}


class Whole(SphinxDirective):
    """Its arguments are the files of the steps and of a ledger, and a folder of figures."""

    required_arguments = 3
    option_spec = {"goal": directives.positive_int}  # minutes

    def run(self):
        steps, ledger, figures = (
            _read(self, name) for name in (*self.arguments[:2], f"{self.arguments[2]}/figures")
        )
        light_cone = steps["steps"][0]
        parts = {light_cone["step"]: light_cone["seconds"]}
        parts["the ledger, with its observations"] = ledger["about"]["seconds"]
        for seconds, papers in _chapters(figures["figures"]):
            parts[f"the chapter of Fig{'s' * (len(papers) > 1)}. {', '.join(papers)}"] = seconds
        total, goal = sum(parts.values()) / 60, self.options["goal"]
        whole = f"{total:.0f}{_NO_BREAK}min"
        rows = [[part, f"{_short(seconds / 60)}{_NO_BREAK}min", ""] for part, seconds in parts.items()]
        rows.append(["all", f"**{whole}**" if total > goal else whole, f"{goal}{_NO_BREAK}min"])
        return parsed(self, table(["Part", "Time", "Goal"], rows))


def _chapters(figures):
    """(seconds, numbers of the paper's figures) of each notebook; its figures stand together and share one
    execution."""
    for execution, several in groupby(figures, key=itemgetter("execution")):
        yield execution["seconds"], list(dict.fromkeys(figure["paper"] for figure in several))


def _read(directive, name):
    path = Path(directive.env.srcdir, "book", "results", f"{name}.json")
    directive.env.note_dependency(str(path))
    return json.loads(path.read_text())


def _footer(about):
    return f"*{Provenance.of_stored(about).footer()}*"


def setup(app):
    app.add_directive("measured-steps", Steps)
    app.add_directive("measured-growth", Growth)
    app.add_directive("extrapolated-steps", Extrapolated)
    app.add_directive("measured-whole", Whole)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
