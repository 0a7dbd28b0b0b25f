"""Results that take hours and are stored with the book: readers, and numbers derived from them.

There are ledgers, the times of the steps at two sizes and how they grow, and folders of figures.
"""

import json
import math
from dataclasses import replace
from pathlib import Path

from himap.core.errors import InputError
from himap.core.memory import estimate
from himap.core.survey import PRESETS
from himap.paper.claims.entries import entries
from himap.paper.experiments import find_experiment
from himap.paper.readings import outcomes
from himap.paper.record import Record

RESULTS = Path(__file__).resolve().parents[2] / "book" / "results"
"""The folder of stored results, in a checkout."""

LEDGER = RESULTS / "claims_laptop.json"
"""The record of the claims that the book shows."""

_TIMES = {"HI light cone": 1, "observations, three beams": 1, "BeamSubspace": 0, "all measures": 3 * 6}
"""How often a step is done for Figs. 1 and 2, {step: times}; once for each of the three beams by default."""

_HELD = {"HI light cone": "HI light cone", "observations, three beams": "observing"}
_CORES = 2  # of the machine that the steps were measured on


def read_stored(name, folder=None):
    """The content of a JSON file of stored results, such as ``steps_paper`` or ``paper_templates/figures``.

    Parameters
    ----------
    name
        Its path in the folder, without the ending.
    folder
        Default: `RESULTS`.

    Raises
    ------
    InputError
        No such file, or one that is no JSON.
    """
    path = Path(folder or RESULTS, f"{name}.json")
    try:
        return json.loads(path.read_text())
    except FileNotFoundError:
        raise InputError(
            f"there is no stored result {path}; the page on contributing says how to make it."
        ) from None
    except (OSError, ValueError) as error:
        raise InputError(f"{path} is not a stored result ({error}).") from None


def read_ledger(path=LEDGER):
    """The `himap.paper.claims.entries.Entry` of each claim in a record, and its provenance, (list, dict).

    A record of restarts, named so, is read in its first reading.

    Raises
    ------
    InputError
        No such file, or another kind of file.
    """
    if Path(path).stem.startswith("restarts_"):
        record = Record.load(find_experiment("restarts"), path)
        return [*next(iter(outcomes(record.rows).values())).entries.values()], record.about
    record = Record.load(find_experiment("claims"), path)
    return entries(record.rows), record.about


def stored_figures(results=None, folders=None):
    """{folder: {name: what is stored of a figure, a dict}} of figures among the results.

    Parameters
    ----------
    results
        As the folder of `read_stored`.
    folders
        Of figures; default all that there are.

    Raises
    ------
    InputError
        No such folder.
    """
    if folders is None:
        folders = sorted(path.parent.name for path in Path(results or RESULTS).glob("*/figures.json"))
    rows = {folder: read_stored(f"{folder}/figures", results)["figures"] for folder in folders}
    return {folder: {row["name"]: row for row in several} for folder, several in rows.items()}


def stored_figure(folder, name, results=None):
    """What is stored of one figure, a dict: where it is in the paper, its provenance, and its curves.

    Parameters
    ----------
    folder, name
        Folder of figures among the results, such as "paper_templates", and name of the figure.
    results
        As the folder of `read_stored`.

    Raises
    ------
    InputError
        No such folder or figure.
    """
    rows = stored_figures(results, [folder])[folder]
    if name not in rows:
        raise InputError(f"there is no stored figure {name} in {folder}; there are {', '.join(rows)}.")
    return rows[name]


def extrapolated(smaller, larger, scaling, *, n_realisations, **size):
    """What every step would cost at another size, for the paper's Figs. 1 and 2.

    The exponent with channels is that of the scaling, the one with nside follows from the rest of the growth
    between the two sizes: small maps, of which the scaling is made, grow more slowly than large ones.

    Parameters
    ----------
    smaller, larger
        The steps at two sizes, as ``python -m benchmarks`` wrote them.
    scaling
        What ``python -m benchmarks.scaling`` wrote.
    n_realisations
        How many of them.
    size
        Fields of the `Survey`: ``nside`` and ``n_channels``, and what else differs from the paper's preset.

    Returns
    -------
    list of dict
        Of each step its name ("step"), the time of one ("minutes"), how often a realisation does it
        ("times"), all of it ("core_hours"), and the memory that himap asks for ("gigabytes").
    """
    memory = estimate(replace(PRESETS["paper"], **size))
    before, after = smaller["about"]["size"], larger["about"]["size"]
    rows = []
    for small, large in zip(smaller["steps"], larger["steps"], strict=True):
        name = large["step"]
        times = _TIMES.get(name, 3)
        if not times:
            continue
        with_channels = scaling["found"]["n_channels"][name]["exponent"]
        growth = large["seconds"] / small["seconds"]
        growth /= (after["n_channels"] / before["n_channels"]) ** with_channels
        with_nside = math.log(growth) / math.log(after["nside"] / before["nside"])
        exponents = {"nside": with_nside, "n_channels": with_channels}
        factors = [(size[axis] / after[axis]) ** exponent for axis, exponent in exponents.items()]
        once = large["seconds"] * math.prod(factors)
        rows.append(
            {
                "step": name,
                "minutes": once / 60,
                "times": times,
                "core_hours": _CORES * n_realisations * times * once / 3600,
                "gigabytes": memory[_HELD.get(name, "cleaning")] / 1e9,
            }
        )
    return rows


def times_of_all(steps, about):
    """Time of light cone and of the ledger of one realisation, with its observations: {part: seconds}.

    Parameters
    ----------
    steps, about
        The steps, and the provenance of the ledger once the light cone was there, as they are stored.
    """
    first = steps["steps"][0]
    return {first["step"]: first["seconds"], "observations and the ledger": about["seconds"]}
