"""Sphinx extension: what the head of a chapter says that was measured.

``{claim}`D1``` is a claim of the paper with the verdict of the stored ledger, and leads to its row there.
``{cost}`04_pca``` is what a chapter took when it was last executed, at the size of the book and, where its
figures are stored, at the paper's, the memory that himap asks for, and which stored results that it reads
are stale. ``{stale}`claims_laptop methods_*``` states the last of results by name. A pattern without a stored
result is an error. In Jupyter all read as their names.
"""

import fnmatch
from functools import cache
from pathlib import Path

from docutils import nodes
from sphinx.util.docutils import SphinxRole

from himap.app.notebook_files import STAMP, figure_options, read_notebook
from himap.app.notebooks import declared_parameters
from himap.app.stored import read_ledger, stale_results, stored_figures, stored_results
from himap.core.memory import estimate
from himap.core.survey import Survey
from himap.paper.claims import CLAIMS
from himap.paper.ledger_table import BADGES
from himap.store.provenance import duration

LEDGER = "notebooks/15_claims"
VERDICTS = "claims_laptop.json"  # the stored ledger
LARGE = "paper"  # the preset of the figures that are stored


class Claim(SphinxRole):
    """The role of one claim, by its id; its name alone where no ledger has it."""

    def run(self):
        path = Path(self.env.srcdir, "book", "results", VERDICTS)
        self.env.note_dependency(str(path))
        entries = _verdicts(path) if path.exists() else {}
        if self.text not in entries and (self.text in CLAIMS or not path.exists()):
            return [nodes.Text(self.text)], []
        if self.text not in entries:
            message = self.inliner.reporter.error(f"the ledger has no claim {self.text!r}", line=self.lineno)
            return [], [message]
        entry = entries[self.text]
        said = nodes.inline("", " ".join([BADGES[entry.verdict][0], entry.label]), classes=["himap-verdict"])
        return [self._name(entry), nodes.Text("\N{NO-BREAK SPACE}"), said], []

    def _name(self, entry):
        """The id, with what is claimed for those who point at it; it leads to the ledger where that is."""
        if LEDGER not in self.env.found_docs:
            return nodes.Text(self.text)
        page = self.env.app.builder.get_relative_uri(self.env.docname, LEDGER)
        row = f"{page}#claim-{self.text}"
        return nodes.reference("", self.text, internal=True, refuri=row, reftitle=entry.claim.statement)


@cache
def _verdicts(path):
    """{id: entry} of a ledger."""
    return {entry.claim.id: entry for entry in read_ledger(path)[0]}


class Cost(SphinxRole):
    """The role of what one chapter costs, by its name."""

    def run(self):
        path = Path(self.env.srcdir, "notebooks", f"{self.text}.ipynb")
        self.env.note_dependency(str(path))
        results = Path(self.env.srcdir, "book", "results")
        patterns = read_notebook(path).metadata.get("himap", {}).get("reads", [])
        files = [pattern.removeprefix("book/results/") for pattern in patterns]
        if any(claim.notebook == self.text for claim in CLAIMS.values()) and (results / VERDICTS).exists():
            files.append(VERDICTS)  # the head has its verdicts
        states, messages = _states(self, files)
        n_stale = sum(map(bool, states.values()))
        said = f"; stale stored results: {n_stale} of {len(states)} (page on status)" if n_stale else ""
        return [nodes.Text(cost(path, results) + said)], messages


class Stale(SphinxRole):
    """The role of stored results, by patterns of their names: which of them are stale, in a sentence."""

    def run(self):
        states, messages = _states(self, [f"{name}.json" for name in self.text.split()])
        old = [f"{name} (commit {commits})" for name, commits in states.items() if commits]
        said = f"Stale, measured with code that has changed since: {', '.join(old)}."
        said = said if old else "No stored result behind these numbers is stale."
        return [] if messages else [nodes.Text(said)], messages


def _states(role, patterns):
    """Of stored results whose files fit a pattern {name: its commits if stale, else ""}; and errors.

    The page of the role depends on them; a pattern that none fits is an error.
    """
    results = Path(role.env.srcdir, "book", "results")
    known = {one.path.relative_to(results).as_posix(): one for one in _stored(results)} if patterns else {}
    fitting = {pattern: fnmatch.filter(known, pattern) for pattern in patterns}
    files = [file for file in known if any(file in some for some in fitting.values())]
    old, states = _all_stale(results) if files else {}, {}
    for file in files:
        role.env.note_dependency(str(results / file))
        commits = ", ".join(sorted(commit for commit, _ in known[file].commits))
        states[known[file].name] = commits if known[file].name in old else ""
    report, missing = role.inliner.reporter.error, [one for one, some in fitting.items() if not some]
    return states, [report(f"no stored result fits {one!r}", line=role.lineno) for one in missing]


_stored = cache(stored_results)


@cache
def _all_stale(results):
    return stale_results(results, results.parents[1] / "notebooks")


def cost(path, results):
    """Time and memory of the notebook at `path`, with figures stored in the folder `results`, in words."""
    node = read_notebook(path)
    seconds = node.metadata.get(STAMP, {}).get("execution", {}).get("seconds")
    preset = {one.name: one.default for one in declared_parameters(node)}.get("preset")
    took = _range([seconds] if seconds else [])
    if preset is None:
        return f"{took}, for it shows what is stored"
    names = {figure_options(cell).get("name") for cell in node.cells}
    said = [f"{took} and up to {_memory(preset)} at {preset}"]
    rows = [rows[name] for rows in stored_figures(results).values() for name in rows.keys() & names]
    large = sorted({row["execution"]["seconds"] for row in rows})
    if large:
        said.append(f"{_range(large)} and up to {_memory(LARGE)} at the paper’s size")
    return "; ".join(said) + "; what other chapters had kept was not made again"


def _range(seconds):
    """A time, or the shortest and the longest, with one unit where they share it."""
    if not seconds:
        return "an unknown time"
    first, last = duration(seconds[0]), duration(seconds[-1])
    value, unit = first.split()
    shown = value if last.endswith(f" {unit}") else first
    return first if first == last else f"{shown} to {last}"


def _memory(preset):
    return f"{max(estimate(Survey.preset(preset)).values()) / 1e9:.1f} GB"


def setup(app):
    app.add_role("claim", Claim())
    app.add_role("cost", Cost())
    app.add_role("stale", Stale())
    return {"parallel_read_safe": True, "parallel_write_safe": True}
