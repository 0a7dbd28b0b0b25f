"""Files that are written completely or not at all, and folders that nobody else can write to.

Unfinished work is in a folder named after the machine and the process, next to its destination, so that the
next process can see whether its owner still runs. When all files of the folder are complete, a list of them
is written, and they are renamed. A process killed before the list exists leaves none of its files, and the
folder is removed at the next start; a process killed afterwards leaves a set that is completed at the next
start.
"""

import atexit
import json
import os
import shutil
import socket
import stat
import tempfile
import uuid
import warnings
from contextlib import contextmanager, suppress
from functools import cache
from pathlib import Path

from himap.core.errors import InputError

_OUTPUT, _RUN = ".himap", "himap"  # prefixes of names
_LIST = ".whole"
_LONGEST = 60  # bytes of the name of a folder, so that names of sockets fit
_SEMAPHORES = Path("/dev/shm")  # where Linux has them
_CLOCK = 60  # s, largest difference between the clocks of a disk and of the machine
_ELSEWHERE = "Or set the variable HIMAP_CACHE to a folder of your own."


def cache_folder():
    """The folder given by the variable HIMAP_CACHE, else `user_cache`."""
    folder = os.environ.get("HIMAP_CACHE")
    return Path(os.path.expanduser(folder)) if folder else user_cache()


def user_cache():
    """The folder ``himap`` in the user's cache folder."""
    import platformdirs  # here, like psutil below: only some processes need it, and all import himap

    return platformdirs.user_cache_path("himap", appauthor=False)


def make_private(folder):
    """Make a folder, and its parents, accessible to its owner only; an existing one is unchanged."""
    folder.parent.mkdir(parents=True, exist_ok=True)
    folder.mkdir(mode=0o700, exist_ok=True)


def check_private(folder):
    """Raise InputError if an existing folder is owned or writable by others."""
    try:
        status = folder.stat()
    except (FileNotFoundError, NotADirectoryError):
        return
    except OSError as error:
        raise InputError(f"the folder {folder} cannot be checked ({error.strerror}). {_ELSEWHERE}") from None
    is_open = status.st_mode & (stat.S_IWGRP | stat.S_IWOTH)
    if hasattr(os, "geteuid") and (is_open or status.st_uid != os.geteuid()):
        raise InputError(
            f"other users can write to the folder {folder}, which belongs to the user with number "
            f"{status.st_uid}, and so put anything there: if it is yours, `chmod go-w {folder}` ends that. "
            f"{_ELSEWHERE}"
        )


def unfinished_name(prefix):
    """A new name, ``prefix-MACHINE-PROCESS-XXXXXXXX``, for unfinished work of this process."""
    return f"{prefix}-{socket.gethostname()}-{os.getpid()}-{uuid.uuid4().hex[:8]}"


def is_abandoned(path):
    """Whether a folder named by `unfinished_name` belongs to an ended process of this machine and user."""
    import psutil

    pid = path.name.partition(f"-{socket.gethostname()}-")[2].partition("-")[0]
    if not pid.isdecimal():
        return False
    try:
        status = path.lstat()
        if not stat.S_ISDIR(status.st_mode) or (hasattr(os, "geteuid") and status.st_uid != os.geteuid()):
            return False
        # If the process began after the last change of the folder, its number has been reused.
        return psutil.Process(int(pid)).create_time() > status.st_mtime + _CLOCK
    except (psutil.NoSuchProcess, OverflowError):
        return True
    except (OSError, psutil.Error):
        return False


@cache
def run_folder():
    """A temporary folder shared by the processes of a run, until this process ends.

    Folders of killed processes are removed, and their semaphores of joblib. InputError if no folder for
    temporary files is writable.
    """
    homes = []
    with suppress(FileNotFoundError):
        homes.append(Path(tempfile.gettempdir()))
        if len(os.fsencode(homes[0])) >= _LONGEST:  # no room for sockets
            homes.insert(0, Path("/tmp"))
    for home in homes:
        with suppress(OSError):
            for old in filter(is_abandoned, home.glob(f"{_RUN}-*")):
                for pid in [old.name.split("-")[-2], *(file.stem for file in old.glob("*.worker"))]:
                    for file in _SEMAPHORES.glob(f"sem.loky-{pid}-*"):
                        file.unlink(missing_ok=True)
                shutil.rmtree(old, ignore_errors=True)
            folder = home / unfinished_name(_RUN)
            folder.mkdir(mode=0o700)
            atexit.register(shutil.rmtree, folder, ignore_errors=True)
            return folder
    raise InputError("no folder for temporary files can be written to; name one with the variable TMPDIR.")


def note_worker(folder):
    """Record in a `run_folder`, if it is on this machine, that this process works for it."""
    with suppress(OSError):
        (folder / f"{os.getpid()}.worker").touch()


def keep_compiled_code():
    """Let numba store compiled code, which it executes again, where nobody else can write.

    It is stored in the folder given by the variable NUMBA_CACHE_DIR, else in ``numba`` in the user's cache or
    that of results, else only until this process ends. A folder writable by others is never used; a
    warning is issued if it was given by the variable.
    """
    named = os.environ.get("NUMBA_CACHE_DIR")
    if named:
        try:
            return check_private(Path(named))
        except InputError as error:
            warnings.warn(f"compiled code is not kept in NUMBA_CACHE_DIR: {error}", stacklevel=2)
    for home in (user_cache, cache_folder, run_folder):
        with suppress(OSError, InputError):
            folder = home() / "numba"
            make_private(folder)
            check_private(folder)
            if os.access(folder, os.W_OK):
                os.environ["NUMBA_CACHE_DIR"] = str(folder)
                return


@contextmanager
def atomic_files(*paths):
    """Names to write to, in this order, that become `paths`, in one folder, when all of them are written.

    InputError, naming the file, if one of them or a parent folder cannot be written. An OSError of any
    other file is raised unchanged.
    """
    paths = [Path(path) for path in paths]
    home, at_work = paths[0].parent, paths[0]
    folder = home.resolve() / unfinished_name(_OUTPUT)
    try:
        home.mkdir(parents=True, exist_ok=True)
        complete_abandoned(home)
        folder.mkdir(mode=0o700)
        temporary = [folder / path.name for path in paths]
        try:
            yield temporary
            part = folder / f"{_LIST}.part"
            part.write_text(json.dumps([file.name for file in temporary]), encoding="utf-8")
            os.replace(part, folder / _LIST)
            _move(temporary)
        finally:
            at_work = next((path for path in reversed(paths) if (folder / path.name).exists()), at_work)
            shutil.rmtree(folder, ignore_errors=True)
    except OSError as error:
        where = folder if error.filename is None else Path(os.fsdecode(error.filename)).resolve()
        if where.parent != folder and not folder.is_relative_to(where):
            raise
        why = error.strerror or f"{error}: is the disk full?"
        raise InputError(f"{at_work} cannot be written ({why}); give another place.") from None


def _move(files):
    """Rename files to the parent of their folder."""
    for file in files:
        os.replace(file, file.parents[1] / file.name)


def complete_abandoned(home):
    """Complete or remove unfinished work of ended processes in a folder; return the completed paths."""
    completed = set()
    for folder in filter(is_abandoned, home.glob(f"{_OUTPUT}-*")):
        try:
            names = json.loads((folder / _LIST).read_text(encoding="utf-8"))
        except (OSError, ValueError):
            names = []  # not all files were written
        files = [folder / Path(name).name for name in names]
        with suppress(OSError):  # something is in the way of a complete file, which is kept
            for file in files:
                with suppress(FileNotFoundError):  # renamed before, or by another process at the same time
                    _move([file])
            completed |= {home / file.name for file in files}
            shutil.rmtree(folder, ignore_errors=True)
    return completed


def check_free(paths, *, overwrite):
    """Raise InputError, before any work, if output files of one folder exist or cannot be written.

    They cannot be written if the path is a folder or device, or an impossible name; an existing file is
    accepted with `overwrite`. Output of a killed process is completed first, and may be overwritten.
    """
    completed = complete_abandoned(paths[0].parent)
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
