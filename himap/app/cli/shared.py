"""Options shared by commands of `himap`, and their errors, in one paragraph."""

import functools
import os
from contextlib import suppress
from importlib import import_module
from unittest.mock import patch

import click
from click.shell_completion import CompletionItem

from himap.app.notebooks import notebooks
from himap.app.reproduce import NotebookError
from himap.core import progress
from himap.core.errors import InputError, shortened
from himap.core.memory import LIMIT_VARIABLE, parse_size
from himap.core.survey import PRESETS
from himap.store.parallel import DASK_VARIABLE, JOBS_VARIABLE, check_scheduler

_NOTEBOOK_PACKAGES = {
    *("IPython", "ipykernel", "jupyter_client", "jupytext"),
    *("nbclient", "nbformat", "papermill", "PIL"),
}
_FOR_CHILDREN = {"PYTHONSAFEPATH": "1"}
"""Processes started by a command do not import modules from the current folder."""


class Commands(click.Group):
    """Commands whose user errors end with one paragraph: code 2 for bad input, 1 for a failed notebook."""

    def invoke(self, context):
        try:
            with patch.dict(os.environ, _FOR_CHILDREN), patch.object(progress, "in_lines", True):
                return super().invoke(context)
        except (InputError, NotebookError, ModuleNotFoundError) as error:
            name = (getattr(error, "name", None) or "").partition(".")[0]
            is_missing, is_failed = isinstance(error, ModuleNotFoundError), isinstance(error, NotebookError)
            if context.meta.get("debug") or (is_missing and name not in _NOTEBOOK_PACKAGES):
                raise
            message = shortened(str(error)) + is_failed * "\nAdd --debug for the traceback."
            if is_missing:
                message = f"{name}, a package for notebooks, is missing: pip install 'himap[notebooks]'."
            shown = click.ClickException(message)
            shown.exit_code = 1 if is_failed else 2
            raise shown from None


def completed_by(names):
    """Shell completion of an argument or option: names from ``names()``, or a file."""

    def complete(context, parameter, incomplete):
        known = []
        with suppress(InputError):  # there are no notebooks
            known = [CompletionItem(name) for name in names() if name.startswith(incomplete)]
        return known or [CompletionItem(incomplete, type="file")]

    return {"shell_complete": complete}


def methods():
    """Names of the methods of foreground removal."""
    return import_module("himap.removal").available()


PRESET = completed_by(lambda: PRESETS) | {"metavar": "NAME", "type": str.lower}
NOTEBOOK = completed_by(lambda: [notebook.name for notebook in notebooks()])
METHOD = completed_by(methods)
EXPERIMENT = completed_by(lambda: import_module("himap.paper.experiments").EXPERIMENTS)


class NamesOption(click.Option):
    """An option for one of ``names()``, which are listed only for its help or shell completion."""

    def __init__(self, *arguments, names=methods, more="", **options):
        self._names, self._more = names, more
        super().__init__(*arguments, **options, **completed_by(names))

    def get_help_record(self, context):
        self.help = f"{', '.join(self._names())}{self._more}."
        option, text = super().get_help_record(context)
        return option, text.replace("  [required]", "")  # reported by an error, and the help is one line


def with_options(*options):
    """Decorator: add these options to a command, in this order."""
    return lambda command: functools.reduce(lambda so_far, option: option(so_far), reversed(options), command)


debug = click.option(
    "--debug",
    is_flag=True,
    expose_value=False,
    callback=lambda context, _, value: value and context.meta.update(debug=True),
    help="Show the traceback of an error.",
)
overwrite_option = click.option("--overwrite", is_flag=True, help="Replace existing files.")


def workers(command):
    """Options for the processes and the memory of a command.

    Kernels and worker processes read them from the environment, where they are set while the command runs. An
    address without a scheduler is refused before any work, even if all results are in the cache.
    """

    @functools.wraps(command)
    def wrapped(*args, jobs, dask, max_memory, **options):
        settings = {JOBS_VARIABLE: jobs, DASK_VARIABLE: dask, LIMIT_VARIABLE: max_memory}
        given = {name: str(value) for name, value in settings.items() if value is not None}
        if max_memory is not None:
            parse_size(max_memory)
        with patch.dict(os.environ, given):
            check_scheduler()
            return command(*args, **options)

    address = "Scheduler of a Dask cluster, such as tcp://host:8786."
    size = "Memory limit, such as 16GB; default: free memory."
    return with_options(
        click.option("--jobs", type=click.IntRange(min=1), help="Number of parallel processes; default 1."),
        click.option("--dask", metavar="ADDRESS", help=address),
        click.option("--max-memory", metavar="SIZE", help=size),
    )(wrapped)


def named_values(pairs, preset=None):
    """{name: text} from texts NAME=VALUE, names in lower case, and from the option --preset."""
    texts = {}
    for pair in dict.fromkeys(pairs if preset is None else [f"preset={preset}", *pairs]):
        name, equals, text = pair.partition("=")
        name = name.lower()
        if not (equals and name.isidentifier()):
            raise InputError(f"parameters are given as -p name=value; got -p {pair}.")
        try:
            text.encode()
        except UnicodeEncodeError:
            raise InputError(f"the parameter {name} must be text in UTF-8, got {text!r}.") from None
        if name in texts:
            raise InputError(
                f"the parameter {name} is given twice, as {texts[name]} and as {text}; give one."
            )
        texts[name] = text
    return texts
