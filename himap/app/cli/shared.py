"""What the commands of `himap` share: options, errors told in one paragraph, sizes."""

import functools
from pathlib import Path

import click

from himap.app import reproduce
from himap.app.notebook_files import check_output
from himap.app.reproduce import changed_environment
from himap.core.errors import InputError, shortened
from himap.core.memory import LIMIT_VARIABLE, parse_size
from himap.store.parallel import DASK_VARIABLE, JOBS_VARIABLE, check_scheduler

SETTINGS = {"help_option_names": ["-h", "--help"], "max_content_width": 100}


class _BadInput(click.ClickException):
    exit_code = 2


_NOTEBOOK_PACKAGES = {
    "IPython",
    "ipykernel",
    "jupyter_client",
    "jupytext",
    "nbclient",
    "nbformat",
    "papermill",
    "PIL",
}
_FOR_CHILDREN = {"PYTHONSAFEPATH": "1"}
"""Processes that a command starts take no modules from the current folder."""


class Commands(click.Group):
    """Commands whose errors of the user's making are told in one paragraph."""

    def invoke(self, context):
        try:
            with changed_environment(_FOR_CHILDREN):
                return super().invoke(context)
        except (InputError, reproduce.NotebookError) as error:
            if context.meta.get("debug"):
                raise
            if isinstance(error, InputError):
                raise _BadInput(shortened(str(error))) from None
            text = f"{shortened(str(error))}\nAdd --debug for the traceback."
            raise click.ClickException(text) from None
        except ModuleNotFoundError as error:
            name = (error.name or "").partition(".")[0]
            if context.meta.get("debug") or name not in _NOTEBOOK_PACKAGES:
                raise
            raise _BadInput(
                f"this needs the packages for notebooks, and {name} is not there: "
                "pip install 'himap[notebooks]'."
            ) from None


def _remember_debug(context, parameter, value):
    context.meta["debug"] = value or context.meta.get("debug", False)


debug = click.option(
    "--debug",
    is_flag=True,
    expose_value=False,
    callback=_remember_debug,
    help="Show the traceback of an error.",
)


def _checked_size(context, parameter, value):
    if value is not None:
        parse_size(value)
    return value


_WORKERS = {
    JOBS_VARIABLE: click.option(
        "--jobs",
        JOBS_VARIABLE.lower(),
        type=click.IntRange(min=1),
        help="Processes that work at once; default 1.",
    ),
    DASK_VARIABLE: click.option(
        "--dask",
        DASK_VARIABLE.lower(),
        metavar="ADDRESS",
        help="Scheduler of a Dask cluster to share the work, such as tcp://host:8786.",
    ),
    LIMIT_VARIABLE: click.option(
        "--max-memory",
        LIMIT_VARIABLE.lower(),
        metavar="SIZE",
        callback=_checked_size,
        help="What may be used, such as 16GB; default: what is free.",
    ),
}


def workers(command):
    """The options that say who does the work of a command, and with how much memory.

    Kernels and worker processes read them from the environment, where they are while the command runs. An
    address without a scheduler is refused before any work, also where all is in the cache already.
    """

    @functools.wraps(command)
    def wrapped(*args, **options):
        settings = {name: options.pop(name.lower()) for name in _WORKERS}
        with changed_environment({name: str(value) for name, value in settings.items() if value is not None}):
            check_scheduler()
            return command(*args, **options)

    for option in reversed(_WORKERS.values()):
        wrapped = option(wrapped)
    return wrapped


overwrite_option = click.option("--overwrite", is_flag=True, help="Write over what is there.")


def json_output(output, name, *, overwrite):
    """The path of a JSON file to write: `output`, or `name` in results/; see `check_output`."""
    path = Path("results") / name if output is None else Path(output)
    return check_output(path, suffix=".json", overwrite=overwrite)


def check_alone(option, output, overwrite):
    """Refuse outputs beside an option that writes into the file it names, such as --check."""
    if output is not None or overwrite:
        raise InputError(f"{option} writes into the file that it names; leave -o out, and --overwrite.")


def named_values(pairs):
    """{name: text} of texts NAME=VALUE."""
    texts = {}
    for pair in pairs:
        name, equals, text = pair.partition("=")
        if not (equals and name.isidentifier()):
            raise InputError(f"a parameter is given as -p name=value; got -p {pair}.")
        if name in texts:
            raise InputError(
                f"the parameter {name} is given twice, as {texts[name]} and as {text}; give one."
            )
        texts[name] = text
    return texts


def size_text(n_bytes):
    for unit in ("B", "kB", "MB"):
        if n_bytes < 1000:
            return f"{n_bytes:.0f} {unit}" if unit == "B" else f"{n_bytes:.1f} {unit}"
        n_bytes /= 1000
    return f"{n_bytes:.1f} GB"
