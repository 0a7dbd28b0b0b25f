"""Running the notebooks: with other parameters, or again because something they depend on changed.

An executed notebook carries a stamp: the fingerprint of its code, that of every product, method and beam
that this reaches in himap, and the parameters that were passed. A notebook whose stamp is that of today's
code, or of former code whose numbers are accepted for those of today's (`himap.store.verify`), is fresh.
Code of the appearance has a separate fingerprint: where only that changed, a notebook is drawn again, and is
not stale.
"""

import contextlib
import copy
import hashlib
import json
import logging
import os
import re
import sys
import time
from pathlib import Path
from unittest.mock import patch

from himap.app.notebook_files import (
    KERNEL,
    STAMP,
    check_output,
    code_cells,
    copy_name,
    for_jupyter,
    read_notebook,
    stamped,
    text_digest,
    write_notebook,
)
from himap.app.notebooks import find, notebooks
from himap.app.parameters import check_parameters
from himap.core.errors import InputError
from himap.core.files import run_folder
from himap.core.memory import cause_of_death, memory_kills
from himap.core.progress import TERMINAL_VARIABLE
from himap.store.fingerprint import CodeTree, moved

_KERNEL_OPTIONS = ["--log-level=CRITICAL", "--IPKernelApp.ignore_cwd=True"]
_ABOUT_ITSELF = """import json
from himap.store.provenance import environment
print(json.dumps(environment()))"""
_EDITED = "edited in Jupyter, unlike its .py"
_TEXT_CHANGED = "its text changed"
_LOOKS_CHANGED = "only its looks changed"


class NotebookError(RuntimeError):
    """A notebook that stopped at an error; the message says where."""


def run(name, *, parameters=None, output=None, folder=None, again=True, overwrite=False):
    """Execute a notebook, named as in `find`, with other parameters.

    Returns the path of the executed notebook, which is written whole or not at all, and whether it was
    executed now. InputError for a bad name, parameter or output, an output that is there, and for bad input
    that the notebook itself meets; `NotebookError` where it stops at any other error.

    Parameters
    ----------
    parameters
        {name: value}; fields of `Survey` may be among them.
    output
        Path of the executed notebook; default ``results/<name>_<preset>.ipynb`` in the current folder, the
        other parameters that were passed in the name too. What is there is replaced if himap wrote it, with
        the same parameters, and nobody edited it since.
    again
        Whether to execute it also where the output is there, of today's code and these parameters.
    overwrite
        Whether to write over whatever is there.
    """
    notebook = find(name, folder)
    values = check_parameters(notebook.parameters, parameters or {})
    defaults = {parameter.name: parameter.default for parameter in notebook.parameters}
    default_name = copy_name(notebook.name, (defaults | values).get("preset"), values)
    path = Path("results", default_name) if output is None else Path(output)
    if os.path.realpath(path) in {os.path.realpath(other.executed) for other in notebooks(folder)}:
        raise InputError(
            f"{path} is the book's own copy of a notebook, which only --stale writes; give another output."
        )
    stamp, unedited = {}, False
    with contextlib.suppress(OSError, ValueError, AttributeError, KeyError, TypeError):
        if path.is_file():  # no pipe, which would have to be waited for
            node = read_notebook(path)
            stamp = node.metadata[STAMP]
            unedited = stamp["text"] == text_digest(node)
    same = stamp.get("parameters") == json.loads(json.dumps(values))  # as a file holds them
    current = same and stamp.get("execution", {}).get("files", {}) == _files_in(values)
    if not again and current and not moved(stamp.get("fingerprint"), notebook.fingerprint(), looks=True):
        return path, False
    # Another run may have this name too, as characters that a file system does not take are replaced.
    check_output(path, overwrite=overwrite or (output is None and unedited and same))
    write_notebook(_execute(notebook, values, Path.cwd(), copied=True), path)
    return path, True


def stale(folder=None, *, looks=False):
    """The notebooks whose executed file is not that of today's code: {name: why}.

    With `looks`, those too of which only the looks are others.
    """
    tree = CodeTree()
    states = {notebook.name: _state(notebook, tree) for notebook in notebooks(folder)}
    return {name: state for name, state in states.items() if state and (looks or state != _LOOKS_CHANGED)}


def refresh(names=None, folder=None, *, report=None):
    """Make stale notebooks fresh: execute them in place, or copy the text where only text changed.

    All are made fresh, or those named as in `find`; those of which only the looks changed are executed too.
    Before each, ``report(name, why)`` is called. Returns {name: why} of what was done. InputError where an
    ``.ipynb`` holds edits that its ``.py`` lacks, which would be lost; `NotebookError` where a notebook stops
    at an error, and is as it was before.
    """
    chosen = notebooks(folder) if names is None else [find(name, folder) for name in names]
    tree = CodeTree()
    todo = {notebook: state for notebook in chosen if (state := _state(notebook, tree))}
    edited = [notebook.executed.name for notebook, state in todo.items() if state == _EDITED]
    if edited:
        raise InputError(
            f"{', '.join(edited)} was edited in Jupyter and differs from its .py; take the edits over with "
            "`jupytext --to py:percent` or delete the file, then run this again."
        )
    for notebook, state in todo.items():
        if report:
            report(notebook.name, state)
        if state == _TEXT_CHANGED:
            done, old = copy.deepcopy(notebook.node), read_notebook(notebook.executed)
            for cell, former in zip(code_cells(done), code_cells(old), strict=True):
                cell.outputs, cell.execution_count = former.outputs, former.execution_count
            stamp = {key: value for key, value in old.metadata[STAMP].items() if key != "text"}
            done = stamped(done, notebook.node, **stamp)
        else:
            done = _execute(notebook, {}, notebook.path.parent)
        write_notebook(done, notebook.executed)
    return {notebook.name: state for notebook, state in todo.items()}


def _state(notebook, tree):
    """Why the executed notebook is stale; empty if it is fresh."""
    try:
        node = read_notebook(notebook.executed)
    except (OSError, ValueError):
        return "there is no executed notebook"
    stamp = node.metadata.get(STAMP, {})
    text, source = text_digest(node), text_digest(notebook.node)
    if stamp and text not in (stamp.get("text"), source):
        return _EDITED
    if not stamp or any(cell.execution_count is None for cell in code_cells(node)):
        return "it was never executed"
    if stamp.get("parameters"):
        return "it was executed with other parameters"
    changed = moved(stamp.get("fingerprint"), notebook.fingerprint(tree), looks=True)
    if changed == ["look"]:
        return _LOOKS_CHANGED
    if changed:
        names = ("the code behind it" if name == "code" else name for name in changed if name != "look")
        return f"{', '.join(names)} changed"
    return "" if text == source == stamp.get("text") else _TEXT_CHANGED


def _execute(notebook, parameters, folder, *, copied=False):
    """The executed notebook, cleaned and stamped, if `copied` for Jupyter. Nothing is written on the way."""
    import nbformat  # slow, as below, and most commands do without
    import papermill

    from himap.app.kernels import AsyncLocalKernelManager

    fingerprint = notebook.fingerprint()  # of the code that runs, whatever is edited meanwhile
    files = _files_in(parameters)
    node = copy.deepcopy(notebook.node)
    node.metadata["kernelspec"] = dict(KERNEL)
    node.cells.append(nbformat.v4.new_code_cell(_ABOUT_ITSELF))
    AsyncLocalKernelManager.exit_code = None
    started, variables, kills = time.monotonic(), _kernel_variables(), memory_kills()
    try:
        with patch.dict(os.environ, variables):
            done = papermill.execute_notebook(
                node,
                None,
                parameters,
                cwd=folder,
                progress_bar=TERMINAL_VARIABLE in variables and {"desc": notebook.name, "leave": False},
                extra_arguments=_KERNEL_OPTIONS,
                kernel_manager_class=AsyncLocalKernelManager,
            )
    except papermill.PapermillExecutionError as error:
        if error.ename == InputError.__name__:
            raise InputError(error.evalue) from error
        number = error.exec_count - bool(parameters)  # papermill adds a cell for them
        raise NotebookError(
            f"{notebook.name} stopped in cell [{number}] with {error.ename}: {error.evalue}"
        ) from error
    except RuntimeError as error:
        if AsyncLocalKernelManager.exit_code is None:
            raise
        cause = cause_of_death([AsyncLocalKernelManager.exit_code], kills)
        way_out = " Try a smaller preset." if "memory" in cause else ""
        raise NotebookError(f"the kernel of {notebook.name} died of {cause}.{way_out}") from error
    said = json.loads("".join(output.text for output in done.cells.pop().outputs))
    execution = said | {"seconds": round(time.monotonic() - started, 1)}
    execution |= {"files": files} if files else {}
    if copied:
        for_jupyter(done, notebook, parameters, execution["seconds"])
    return stamped(done, notebook.node, fingerprint=fingerprint, parameters=parameters, execution=execution)


def _files_in(parameters):
    """{name: digest} of the parameters that name a file or folder, by names, sizes and times of the files."""
    digests = {}
    for name, value in parameters.items():
        states = []
        for path in _paths_in(value):
            with contextlib.suppress(OSError):  # the notebook says it
                files = sorted(path.iterdir()) if path.is_dir() else [path]
                states += [(one.name, one.stat().st_size, one.stat().st_mtime_ns) for one in files]
        if states:
            digests[name] = hashlib.sha256(repr(states).encode()).hexdigest()[:16]
    return digests


def _paths_in(value):
    """The paths that a parameter names, a list: by itself, in lists, or as a parameter of a beam."""
    if isinstance(value, dict):
        value = [*value.values()]
    if isinstance(value, list | tuple):
        return [path for one in value for path in _paths_in(one)]
    if not isinstance(value, str):
        return []
    texts = [value, *(part.partition("=")[2] for part in re.split("[:,;]", value) if "=" in part)]
    # A text that is too long for a path is none; `Path.exists` of older Pythons raises an error.
    return [Path(path) for path in map(os.path.expanduser, texts) if path and os.path.exists(path)]


def _kernel_variables():
    """Environment of a kernel: this himap, the terminal that a person watches, for bars, and no chatter.

    Neither modules in the current folder nor what a user lets IPython do at each start come into it.
    """
    logging.getLogger("papermill").setLevel(logging.ERROR)
    # A kernel takes the first of them off where that is the current folder: so the first one is nowhere.
    paths = [str(run_folder() / "nowhere"), str(Path(__file__).resolve().parents[2])]
    variables = {
        "PYTHONPATH": os.pathsep.join([*paths, *filter(None, [os.environ.get("PYTHONPATH")])]),
        "PYTHONSAFEPATH": "1",
        "IPYTHONDIR": str(run_folder() / "ipython"),
        "PYDEVD_DISABLE_FILE_VALIDATION": "1",
        "JUPYTER_PLATFORM_DIRS": "1",
    }
    # Kernels run in the folder of the notebooks, where a relative path is another one.
    folders = ((name, os.environ.get(name)) for name in ("HIMAP_CACHE", "NUMBA_CACHE_DIR"))
    variables |= {name: os.path.abspath(os.path.expanduser(one)) for name, one in folders if one}
    home = Path.home()
    if not (home.is_dir() and os.access(home, os.W_OK)):  # matplotlib would say so in the notebook
        variables["MPLCONFIGDIR"] = os.environ.get("MPLCONFIGDIR", str(run_folder() / "matplotlib"))
    with contextlib.suppress(OSError, AttributeError):
        variables[TERMINAL_VARIABLE] = os.ttyname(sys.stderr.fileno())
    return variables
