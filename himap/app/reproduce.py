"""Execution of the notebooks: with other parameters, or again after a change of something they depend on.

An executed notebook carries a stamp: the fingerprint of its code, those of every product, method and beam
that it uses in himap, and the parameters that were passed. A notebook is fresh if its stamp matches the
current code, or former code whose numbers are accepted as equal (`himap.store.verify`). Code that affects
only the appearance has a separate fingerprint: after a change only of this, a notebook can be drawn again but
is not stale.
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
_EDITED = "edited in Jupyter, differs from its .py"
_TEXT_CHANGED = "its text changed"
_LOOKS_CHANGED = "only its looks changed"


class NotebookError(RuntimeError):
    """A notebook that stopped with an error; the message states where."""


def run(name, *, parameters=None, output=None, folder=None, again=True, overwrite=False):
    """Execute a notebook, named as in `find`, with other parameters.

    Returns the path of the executed notebook, a complete file or none, and whether it was executed now.
    InputError for an invalid name, parameter or output, an existing output, and for invalid input detected by
    the notebook itself; `NotebookError` if it stops with any other error.

    Parameters
    ----------
    parameters
        {name: value}; fields of `Survey` may be among them.
    output
        Path of the executed notebook; default ``results/<name>_<preset>.ipynb`` in the current folder, with
        the other parameters in the name. An existing file is replaced if himap wrote it with the same
        parameters and it was not edited since.
    again
        Whether to execute it even if the output exists, from the current code and these parameters.
    overwrite
        Whether to overwrite any existing file.
    """
    notebook = find(name, folder)
    values = check_parameters(notebook.parameters, parameters or {})
    defaults = {parameter.name: parameter.default for parameter in notebook.parameters}
    default_name = copy_name(notebook.name, (defaults | values).get("preset"), values)
    path = Path("results", default_name) if output is None else Path(output)
    if os.path.realpath(path) in {os.path.realpath(other.executed) for other in notebooks(folder)}:
        raise InputError(
            f"{path} is the book's copy of a notebook, written only by --stale; give another output."
        )
    stamp, unedited = {}, False
    with contextlib.suppress(OSError, ValueError, AttributeError, KeyError, TypeError):
        if path.is_file():  # not a pipe, which could block
            node = read_notebook(path)
            stamp = node.metadata[STAMP]
            unedited = stamp["text"] == text_digest(node)
    same = stamp.get("parameters") == json.loads(json.dumps(values))  # as stored in a file
    current = same and stamp.get("execution", {}).get("files", {}) == _files_in(values)
    if not again and current and not moved(stamp.get("fingerprint"), notebook.fingerprint(), looks=True):
        return path, False
    # Another run may have the same name, as characters that file systems do not allow are replaced.
    check_output(path, overwrite=overwrite or (output is None and unedited and same))
    write_notebook(_execute(notebook, values, Path.cwd(), copied=True), path)
    return path, True


def stale(folder=None, *, looks=False):
    """Notebooks whose executed file does not match the current code: {name: reason}.

    With `looks`, also those with only a changed appearance.
    """
    tree = CodeTree()
    states = {notebook.name: _state(notebook, tree) for notebook in notebooks(folder)}
    return {name: state for name, state in states.items() if state and (looks or state != _LOOKS_CHANGED)}


def refresh(names=None, folder=None, *, report=None):
    """Update stale notebooks: execute them in place, or copy the text if only the text changed.

    Applies to all, or those named as in `find`; those with only a changed appearance are executed too.
    ``report(name, reason)`` is called before each. Returns {name: reason} of the updated ones. InputError if
    an ``.ipynb`` has edits that its ``.py`` lacks, which would be lost; `NotebookError` if a notebook stops
    with an error, and is left unchanged.
    """
    chosen = notebooks(folder) if names is None else [find(name, folder) for name in names]
    tree = CodeTree()
    todo = {notebook: state for notebook in chosen if (state := _state(notebook, tree))}
    edited = [notebook.executed.name for notebook, state in todo.items() if state == _EDITED]
    if edited:
        raise InputError(
            f"{', '.join(edited)} was edited in Jupyter and differs from its .py; transfer the edits with "
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
    """Reason why the executed notebook is stale; empty if it is fresh."""
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
    """The executed notebook, cleaned and stamped, for Jupyter if `copied`. No files are written meanwhile."""
    import nbformat  # slow, as below, and not needed by most commands
    import papermill

    from himap.app.kernels import AsyncLocalKernelManager

    fingerprint = notebook.fingerprint()  # before the run, as code may be edited meanwhile
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
    """{name: digest} of parameters that name a file or folder, by names, sizes and times of the files."""
    digests = {}
    for name, value in parameters.items():
        states = []
        for path in _paths_in(value):
            with contextlib.suppress(OSError):  # reported by the notebook
                files = sorted(path.iterdir()) if path.is_dir() else [path]
                states += [(one.name, one.stat().st_size, one.stat().st_mtime_ns) for one in files]
        if states:
            digests[name] = hashlib.sha256(repr(states).encode()).hexdigest()[:16]
    return digests


def _paths_in(value):
    """Paths named by a parameter, a list: alone, in lists, or as a parameter of a beam."""
    if isinstance(value, dict):
        value = [*value.values()]
    if isinstance(value, list | tuple):
        return [path for one in value for path in _paths_in(one)]
    if not isinstance(value, str):
        return []
    texts = [value, *(part.partition("=")[2] for part in re.split("[:,;]", value) if "=" in part)]
    # A text too long for a path raises an error in `Path.exists` of older Pythons.
    return [Path(path) for path in map(os.path.expanduser, texts) if path and os.path.exists(path)]


def _kernel_variables():
    """Environment of a kernel: this himap, the user's terminal for progress bars, and no extra messages.

    Modules in the current folder and the user's IPython startup files are excluded.
    """
    logging.getLogger("papermill").setLevel(logging.ERROR)
    # A kernel removes the first entry if it is the current folder, so the first one does not exist.
    paths = [str(run_folder() / "nowhere"), str(Path(__file__).resolve().parents[2])]
    variables = {
        "PYTHONPATH": os.pathsep.join([*paths, *filter(None, [os.environ.get("PYTHONPATH")])]),
        "PYTHONSAFEPATH": "1",
        "IPYTHONDIR": str(run_folder() / "ipython"),
        "PYDEVD_DISABLE_FILE_VALIDATION": "1",
        "JUPYTER_PLATFORM_DIRS": "1",
    }
    # Kernels run in the folder of the notebooks, where relative paths differ.
    folders = ((name, os.environ.get(name)) for name in ("HIMAP_CACHE", "NUMBA_CACHE_DIR"))
    variables |= {name: os.path.abspath(os.path.expanduser(one)) for name, one in folders if one}
    home = Path.home()
    if not (home.is_dir() and os.access(home, os.W_OK)):  # matplotlib would warn in the notebook
        variables["MPLCONFIGDIR"] = os.environ.get("MPLCONFIGDIR", str(run_folder() / "matplotlib"))
    with contextlib.suppress(OSError, AttributeError):
        variables[TERMINAL_VARIABLE] = os.ttyname(sys.stderr.fileno())
    return variables
