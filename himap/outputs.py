"""Files that are written whole or not at all."""

import os
import tempfile
from contextlib import contextmanager
from pathlib import Path

from himap.errors import InputError

__all__ = ["whole_file"]


@contextmanager
def whole_file(path):
    """A name to write to that becomes `path` when all is written, and vanishes if that fails.

    Raises
    ------
    InputError
        The file, or the folders that it lies in, cannot be written.
    """
    path = Path(path)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=path.resolve().parent, prefix=".himap-") as folder:
            temporary = Path(folder) / path.name
            yield temporary
            os.replace(temporary, path)
    except OSError as error:
        raise InputError(
            f"{path} cannot be written ({error.strerror or error}); give another place."
        ) from None
