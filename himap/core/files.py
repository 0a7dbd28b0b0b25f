"""Files that are written completely or not at all, and folders to which nobody else can write.

Unfinished work is under a name with the machine and the process, so that the next process can
see whether its owner is still there. Files are written in such a folder next to their place. Once all are
there, so is a list of them, and they are renamed. A process that is killed before the list is there leaves
none of its files, and the folder goes at the next start; one that is killed after it leaves a set that the
next start completes.
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

_OUTPUT, _RUN = ".himap", "himap"  # beginnings of names
_LIST = ".whole"
_LONGEST = 60  # bytes of the name of a folder that leaves room for those of sockets
_SEMAPHORES = Path("/dev/shm")  # where Linux has them
_CLOCK = 60  # s that the clocks of a disk and of the machine may differ
_ELSEWHERE = "Or set the variable HIMAP_CACHE to a folder of your own."


def cache_folder():
    """The folder named by the variable HIMAP_CACHE, else `user_cache`."""
    folder = os.environ.get("HIMAP_CACHE")
    return Path(os.path.expanduser(folder)) if folder else user_cache()


def user_cache():
    """The folder ``himap`` among those of the user's caches."""
    import platformdirs  # here, as psutil below: not every process asks, and each of them imports himap

    return platformdirs.user_cache_path("himap", appauthor=False)


def make_private(folder):
    """Make a folder, and those above it, for its owner alone; an existing one stays as it is."""
    folder.parent.mkdir(parents=True, exist_ok=True)
    folder.mkdir(mode=0o700, exist_ok=True)


def check_private(folder):
    """InputError for an existing folder that others own or can write to."""
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
    """Whether a folder named by `unfinished_name` is of a process of this machine and user that has ended."""
    import psutil

    pid = path.name.partition(f"-{socket.gethostname()}-")[2].partition("-")[0]
    if not pid.isdecimal():
        return False
    try:
        status = path.lstat()
        if not stat.S_ISDIR(status.st_mode) or (hasattr(os, "geteuid") and status.st_uid != os.geteuid()):
            return False
        # A process that began after the folder was last touched has the number of another one.
        return psutil.Process(int(pid)).create_time() > status.st_mtime + _CLOCK
    except (psutil.NoSuchProcess, OverflowError):
        return True
    except (OSError, psutil.Error):
        return False


@cache
def run_folder():
    """A temporary folder that the processes of a run share, until this process ends.

    Those of killed processes are removed, and the semaphores of joblib that these had. InputError where no
    folder for temporary files can be written to.
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
    """Note in a `run_folder`, if it is on this machine, that this process works for it."""
    with suppress(OSError):
        (folder / f"{os.getpid()}.worker").touch()


def keep_compiled_code():
    """Let numba keep what it compiles, which it runs again, where nobody else can write.

    In the folder that the variable NUMBA_CACHE_DIR names, else in ``numba`` in the user's cache or in that of
    results, else until this process ends. A folder that others can write to is never used, with a warning
    where it is the one that was named.
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
    """Names to write to, in this order, that become `paths`, of one folder, when all of them are written.

    InputError where one of them, which the message names, or a folder that they lie in, cannot be written.
    An OSError of another file stays as it is.
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
    """Rename files to the folder that theirs is in."""
    for file in files:
        os.replace(file, file.parents[1] / file.name)


def complete_abandoned(home):
    """Complete or remove what ended processes did not finish in a folder; the paths that are complete now."""
    completed = set()
    for folder in filter(is_abandoned, home.glob(f"{_OUTPUT}-*")):
        with suppress(OSError, ValueError):
            names = json.loads((folder / _LIST).read_text(encoding="utf-8"))
            files = [folder / Path(name).name for name in names]
            _move([file for file in files if file.exists()])
            completed |= {home / file.name for file in files}
        shutil.rmtree(folder, ignore_errors=True)
    return completed


def check_free(paths, *, overwrite):
    """InputError, before the work, for output files of one folder that cannot be written, or that exist.

    That is a folder or device in the place of a file, a name that no file can have, or, without `overwrite`,
    a file. What a killed process did not finish is completed first, and may be overwritten.
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
