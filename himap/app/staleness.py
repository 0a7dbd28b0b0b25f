"""Stored results, which took hours: what made each in ``book/results``, and whether today's code would.

Records and figures carry the fingerprint of the code that made them, without parameters, which are stored
with it; what only looks does not count, and accepted code is as good (`himap.store.verify`). Timings
carry none: they are those of one machine and one day. A stale result is reported, not made again.
"""

import json
from dataclasses import dataclass
from pathlib import Path

from himap.app.notebooks import notebooks
from himap.app.stored import RESULTS
from himap.paper.experiments import EXPERIMENTS
from himap.paper.record import measuring_code
from himap.store.fingerprint import ACCEPTED, PROBES, CodeTree, moved


@dataclass(frozen=True, kw_only=True)
class StoredResult:
    """One file of results.

    Attributes
    ----------
    path, name
        Of the JSON; the name of the file, or of the folder of figures.
    preset, galaxy
        What it was made with.
    commits
        {(short commit, whether there were edits)} that it was made at.
    seconds
        What it took.
    codes
        {what is in it: fingerprint of the code that made it}, None where that was not kept: of a record the
        name of its experiment, of a folder of figures their names, of timings nothing.
    checked
        Short commit at which one sky was measured again, with the same numbers; empty if it never was. The
        fingerprint is of that code then.
    """

    path: Path
    name: str
    preset: str
    galaxy: str
    commits: set[tuple[str, bool]]
    seconds: float
    codes: dict[str, dict | None]
    checked: str = ""


def read_result(path):
    """The `StoredResult` at `path`."""
    content = json.loads(path.read_text(encoding="utf-8"))
    if "figures" in content:
        name, rows, checked = path.parent.name, content["figures"], {}
        made = {"preset": "quick", "galaxy": "synthetic"} | rows[0]["parameters"]
        codes = {row["name"]: row.get("code") for row in rows}
        # Figures of a notebook share one execution.
        runs = {json.dumps(row["execution"]): row["execution"] for row in rows}.values()
    else:
        name, made = path.stem, content["about"]
        checked, runs = made.get("checked", {}), [made]
        code = checked.get("code", made.get("code"))
        codes = {content["experiment"]: code} if "experiment" in content else {}
    return StoredResult(
        path=path,
        name=name,
        preset=made["preset"],
        galaxy=made["galaxy"],
        commits={(run["commit"], run["dirty"]) for run in runs},
        seconds=sum(run["seconds"] for run in runs),
        codes=codes,
        checked=checked.get("commit", ""),
    )


def stored_results(folder=None):
    """All stored results by name, a list of `StoredResult`; `folder` defaults to ``book/results``."""
    folder = folder or RESULTS
    files = [*folder.glob("*.json"), *folder.glob("*/figures.json")]
    files = [path for path in files if path.name not in (ACCEPTED.name, PROBES.name)]
    return sorted(map(read_result, files), key=lambda result: result.name)


def stale_results(folder=None, notebooks_folder=None):
    """The stored results that today's code may not give: {name: why}.

    Parameters
    ----------
    folder, notebooks_folder
        Where the results and the notebooks are, if not in this checkout.
    """
    tree, states = CodeTree(), {}
    today = {name: measuring_code(name, tree) for name in EXPERIMENTS}
    for notebook in notebooks(notebooks_folder):
        today |= dict.fromkeys(notebook.captions, notebook.fingerprint(tree))
    for result in stored_results(folder):
        changes = {name: moved(code, today.get(name, "")) for name, code in result.codes.items()}
        changed = [name for name, parts in changes.items() if parts]
        others = dict.fromkeys(part for parts in changes.values() for part in parts if part != "code")
        if changed:
            which = f": {', '.join(others)}" if others else ""
            states[result.name] = f"the code behind {', '.join(changed)} changed{which}"
    return states
