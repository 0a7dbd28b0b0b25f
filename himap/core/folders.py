"""Folders of ours: where results are kept, whether nobody else can write there, and whose work lies in them.

Work that is not finished lies under a name that tells the machine and the process, so that the next process
can tell whether its owner is still there.
"""

import atexit
import contextlib
import os
import shutil
import socket
import stat
import tempfile
import uuid
from functools import cache
from pathlib import Path

from himap.core.errors import InputError

_RUN = "himap"
_LONGEST = 60  # bytes of the name of a folder that leaves room for those of sockets
_SEMAPHORES = Path("/dev/shm")  # where Linux has them
_CLOCK = 60  # s that the clocks of a disk and of the machine may differ


def cache_folder():
    """The folder named by the variable HIMAP_CACHE, else `user_cache`."""
    folder = os.environ.get("HIMAP_CACHE")
    return Path(os.path.expanduser(folder)) if folder else user_cache()


def user_cache():
    """The folder ``himap`` among those of the user's caches."""
    import platformdirs  # here, as psutil below: not every process asks, and each of them imports himap

    return platformdirs.user_cache_path("himap", appauthor=False)


def make_private(folder):
    """Make a folder, and those above it, for its owner alone; one that is there stays as it is."""
    folder.parent.mkdir(parents=True, exist_ok=True)
    folder.mkdir(mode=0o700, exist_ok=True)


def check_ours(folder):
    """Refuse a folder that is there and that others own or can write to.

    Raises
    ------
    InputError
        It is one; the message says the way out.
    """
    try:
        status = folder.stat()
    except (FileNotFoundError, NotADirectoryError):
        return
    except OSError as error:
        raise InputError(
            f"the folder {folder} cannot be looked at ({error.strerror}). {_ELSEWHERE}"
        ) from None
    if not hasattr(os, "geteuid"):
        return
    if status.st_uid != os.geteuid():
        raise InputError(
            f"the folder {folder} belongs to another user (number {status.st_uid}), who could put anything "
            f"there. {_ELSEWHERE}"
        )
    if status.st_mode & (stat.S_IWGRP | stat.S_IWOTH):
        raise InputError(
            f"other users can write to the folder {folder}, and so put anything there: take that from them "
            f"with `chmod go-w {folder}`. {_ELSEWHERE}"
        )


_ELSEWHERE = "Or set the variable HIMAP_CACHE to a folder of your own."


def own_name(prefix):
    """A new name, ``prefix-MACHINE-PROCESS-XXXXXXXX``, for what this process has not finished."""
    return f"{prefix}-{socket.gethostname()}-{os.getpid()}-{uuid.uuid4().hex[:8]}"


def is_abandoned(path):
    """Whether `path`, of a name by `own_name`, is of a process of this machine and user that is no more."""
    import psutil

    _, _, rest = path.name.partition(f"-{socket.gethostname()}-")
    pid, _, _ = rest.partition("-")
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
    """A folder for what the processes of a run share, until this one ends; what killed ones left goes.

    Raises
    ------
    InputError
        No folder for temporary files can be written to.
    """
    for home in _temporary_folders():
        with contextlib.suppress(OSError):
            for left in filter(is_abandoned, home.glob(f"{_RUN}-*")):
                _remove_left(left)
            folder = home / own_name(_RUN)
            folder.mkdir(mode=0o700)
            atexit.register(shutil.rmtree, folder, ignore_errors=True)
            return folder
    raise InputError("no folder for temporary files can be written to; name one with the variable TMPDIR.")


def _temporary_folders():
    """The system's, after a shorter one where its name leaves no room for those of sockets."""
    with contextlib.suppress(FileNotFoundError):
        chosen = Path(tempfile.gettempdir())
        return [chosen] if len(os.fsencode(chosen)) < _LONGEST else [Path("/tmp"), chosen]
    return []


def note_worker(folder):
    """Note in a `run_folder`, if it is on this machine, that this process works for it."""
    with contextlib.suppress(OSError):
        (folder / f"{os.getpid()}.worker").touch()


def _remove_left(folder):
    """Remove the run folder of a process that was killed, and the semaphores of joblib that were its own."""
    pids = [folder.name.split("-")[-2], *(file.stem for file in folder.glob("*.worker"))]
    for pid in pids:
        for file in _SEMAPHORES.glob(f"sem.loky-{pid}-*"):
            with contextlib.suppress(OSError):
                file.unlink()
    shutil.rmtree(folder, ignore_errors=True)
