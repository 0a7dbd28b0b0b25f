"""What numba has compiled, kept from process to process: in a folder of ours, checked, and never in the way.

By itself numba keeps it as pickles beside the source or in the user's cache folder, ends every import where
neither can be written, and takes what is damaged for code. For the functions of himap, and no others, the
folder is for its owner alone, every file has a checksum, and what cannot be read or kept is compiled again.
"""

import hashlib
import json
import os
import warnings
from contextlib import suppress
from pathlib import Path


def keep_ours(module):
    """Put our cache in the place of numba's in ``numba.core.dispatcher``, for functions of himap."""
    numbas = getattr(module, "FunctionCache", None)
    if numbas is None:  # a numba that keeps things in another way does so
        return
    kept = _kept(numbas)

    def cache_of(function):
        if function.__module__.partition(".")[0] != "himap":
            return numbas(function)
        for folder in _folders():
            try:
                return kept(function, folder)
            except (OSError, ValueError, RuntimeError):  # ValueError: an InputError
                continue
        warnings.warn(
            f"what numba compiles can be kept nowhere, not in {' nor in '.join(map(str, _folders()))}: every "
            "start takes seconds longer. Set the variable HIMAP_CACHE to a folder of your own.",
            stacklevel=2,
        )
        return module.NullCache()

    module.FunctionCache = cache_of


def _folders():
    """Where to keep what is compiled, best first."""
    from himap.core.folders import cache_folder, user_cache

    chosen = os.environ.get("NUMBA_CACHE_DIR")
    return [Path(chosen)] if chosen else [user_cache() / "numba", cache_folder() / "numba"]


def _kept(function_cache):
    """The class of our cache, which is numba's with checksums."""
    from numba.core import config

    from himap.core.folders import check_ours, make_private

    class Kept(function_cache):
        def __init__(self, function, folder):
            make_private(folder)
            check_ours(folder)
            before, config.CACHE_DIR = config.CACHE_DIR, str(folder)
            try:
                super().__init__(function)
            finally:
                config.CACHE_DIR = before
            self._place = Path(self._cache_path)
            if folder not in self._place.parents:
                raise OSError(f"numba keeps {function} in {self._place}")
            self._sums = self._place / f"{self._impl.filename_base}.json"

        def load_overload(self, signature, context):
            with suppress(Exception):  # no list, or a broken one, or whatever a damaged pickle raises
                if json.loads(self._sums.read_bytes()) == self._checksums():
                    return super().load_overload(signature, context)
            with suppress(OSError):
                for file in self._files():
                    file.unlink(missing_ok=True)
            return None

        def save_overload(self, signature, data):
            part = self._sums.with_name(f"{self._sums.name}.{os.getpid()}.tmp")
            try:
                super().save_overload(signature, data)
                part.write_text(json.dumps(self._checksums()))
                part.replace(self._sums)
            except OSError:  # such as a full disk: it is compiled again the next time
                with suppress(OSError):
                    part.unlink()

        def _files(self):
            """Index and code, as numba names them."""
            start, place = f"{self._impl.filename_base}.", self._place
            names = [name for name in os.listdir(place) if name.startswith(start)]
            return [place / name for name in names if name.endswith((".nbi", ".nbc"))]

        def _checksums(self):
            return {file.name: hashlib.sha256(file.read_bytes()).hexdigest() for file in self._files()}

    return Kept
