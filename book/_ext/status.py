"""Sphinx extension: ``{status}``, how each notebook was last executed, with which versions, and what made the
results that are stored."""

from importlib.metadata import version
from pathlib import Path

from docutils import nodes
from docutils.statemachine import StringList
from sphinx.util.docutils import SphinxDirective

from himap.app.notebook_files import STAMP, read_notebook
from himap.app.notebooks import notebooks
from himap.app.reproduce import stale
from himap.app.stored import stale_results, stored_results
from himap.figures.tables import Table
from himap.store.provenance import duration, environment

RENDERERS = ("jupyter-book", "sphinx", "myst-nb", "matplotlib")


class Status(SphinxDirective):
    """The directive: three tables."""

    def run(self):
        folder = Path(self.env.srcdir, "notebooks")
        executions = {}
        for one in notebooks(folder):
            self.env.note_dependency(str(one.executed))
            executions[one.name] = read_notebook(one.executed).metadata[STAMP].get("execution", {})
        results = Path(self.env.srcdir, "book", "results")
        stored = stored_results(results)
        for one in stored:
            self.env.note_dependency(str(one.path))
        lines = [*_runs(executions, stale(folder, looks=True)), "", *_versions(executions), ""]
        lines += _stored(stored, stale_results(results, folder))
        node = nodes.container()
        self.state.nested_parse(StringList(lines, self.name), self.content_offset, node)
        return node.children


def _runs(executions, old):
    """Lines of the table of notebooks."""
    rows = []
    for name, one in executions.items():
        commit = _commit(one["commit"], one["dirty"]) if one else ""
        time = duration(one["seconds"]) if one else ""
        state = f"stale: {old[name]}" if name in old else "fresh"
        rows.append([f"[{name}](../notebooks/{name}.ipynb)", state, time, one.get("himap", ""), commit])
    total = sum(one.get("seconds", 0) for one in executions.values())
    rows.append(["all", "", duration(total), "", ""])
    return Table(["Notebook", "State", "Time", "himap", "Commit"], rows).markdown()


def _commit(short, dirty):
    return f"`{short}`{' with edits' if dirty else ''}"


def _versions(executions):
    """Lines of the table of versions; more than one where the notebooks differ."""
    found = {}
    for one in executions.values():
        for name, number in {"python": one.get("python"), **one.get("packages", {})}.items():
            found.setdefault(name, set()).add(number)
    rows = {name: ", ".join(sorted(filter(None, numbers))) for name, numbers in found.items()}
    rows |= {f"{name} (rendering)": version(name) for name in RENDERERS}
    rows["commit (rendering)"] = f"`{environment()['commit']}`"
    return Table(["Package", "Version"], rows.items()).markdown()


def _stored(results, old):
    """Lines of the table of stored results."""
    rows = []
    for one in results:
        state = f"stale: {old[one.name]}" if one.name in old else "fresh" if one.codes else "timing"
        if one.checked and one.name not in old:
            state = f"fresh (one sky again at `{one.checked}`: the same numbers)"
        commits = ", ".join(_commit(*commit) for commit in sorted(one.commits))
        rows.append([one.name, state, f"{one.preset}, {one.galaxy} Galaxy", duration(one.seconds), commits])
    return Table(["Stored result", "State", "Made with", "Time", "Commit"], rows).markdown()


def setup(app):
    app.add_directive("status", Status)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
