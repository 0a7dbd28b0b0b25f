"""Files that are written whole or not at all, alone or as a set.

They are written in a folder of their own beside the place that they are for. Once all are there, so is a list
of them, and they are renamed. A process that is killed before the list is there leaves none of its files, and
the folder goes at the next start; one that is killed after it leaves a set that the next start completes.
"""

import json
import os
import shutil
import stat
from contextlib import contextmanager, suppress
from pathlib import Path

from himap.core.errors import InputError
from himap.core.folders import is_abandoned, own_name

_PREFIX, _LIST = ".himap", ".whole"


@contextmanager
def whole_file(path):
    """A name to write to that becomes `path` when all is written, and vanishes if that fails.

    Raises
    ------
    InputError
        The file, or the folders that it lies in, cannot be written.
    """
    with whole_files(path) as (temporary,):
        yield temporary


@contextmanager
def whole_files(*paths):
    """Names to write to, in this order, that become `paths`, of one folder, when all of them are written.

    Raises
    ------
    InputError
        One of them, which the message names, or the folders that they lie in, cannot be written.
    """
    paths = [Path(path) for path in paths]
    home, at_work = paths[0].parent, paths[0]
    try:
        home.mkdir(parents=True, exist_ok=True)
        complete_left(home)
        folder = home.resolve() / own_name(_PREFIX)
        folder.mkdir(mode=0o700)
        temporary = [folder / path.name for path in paths]
        try:
            yield temporary
            _write_list(folder, temporary)
            _move(folder, temporary)
        finally:
            at_work = next((path for path in reversed(paths) if (folder / path.name).exists()), at_work)
            shutil.rmtree(folder, ignore_errors=True)
    except OSError as error:
        why = error.strerror or f"{error}: is the disk full?"
        raise InputError(f"{at_work} cannot be written ({why}); give another place.") from None


def _write_list(folder, files):
    part = folder / f"{_LIST}.part"
    part.write_text(json.dumps([file.name for file in files]), encoding="utf-8")
    os.replace(part, folder / _LIST)


def _move(folder, files):
    """Rename files to where the folder lies."""
    for file in files:
        os.replace(file, folder.parent / file.name)


def complete_left(home):
    """Put in order what processes that are no more left in the folder `home`.

    Returns
    -------
    set
        The paths of whole sets that were not all renamed, and are now.
    """
    completed = set()
    for folder in home.glob(f"{_PREFIX}-*"):
        if not is_abandoned(folder):
            continue
        with suppress(OSError, ValueError):
            names = json.loads((folder / _LIST).read_text(encoding="utf-8"))
            files = [folder / Path(name).name for name in names]
            _move(folder, [file for file in files if file.exists()])
            completed |= {home / file.name for file in files}
        shutil.rmtree(folder, ignore_errors=True)
    return completed


def check_free(paths, *, overwrite):
    """Refuse, before the work, files of one folder that cannot be, or that are there, without `overwrite`.

    What a process that was killed had not finished is put in order first, and does not stand in the way.

    Raises
    ------
    InputError
        A folder in the place of a file, a name that no file can have, or a file that is there.
    """
    completed = complete_left(paths[0].parent)
    for path in paths:
        try:
            status = path.lstat()
        except FileNotFoundError:
            continue
        except OSError as error:
            raise InputError(f"the output {path} cannot be written ({error.strerror}).") from None
        if path.is_dir():
            raise InputError(f"the output {path} is a folder; give the name of a file.")
        if not (stat.S_ISREG(status.st_mode) or path.is_symlink()):
            raise InputError(f"the output {path} is no ordinary file; choose another output.")
        if not (overwrite or path in completed):
            raise InputError(f"{path} exists; choose another output, or give --overwrite (overwrite=True).")
