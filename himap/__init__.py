"""himap: foreground removal in HI intensity mapping, a companion of Gkogkou et al. (2025)."""

import os
import sys

# `python -m himap` puts the current folder before all packages. It goes before anything is imported that a
# file there could stand in for; while a package is looked up for `-m`, that is all of argv[0].
_PLACE = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))
if sys.argv[:1] == ["-m"] and sys.path[0] == os.getcwd() != _PLACE:
    del sys.path[0]

from himap.core.files import keep_compiled_code  # noqa: E402

__all__ = ["__version__"]

__version__ = "0.1.0"

keep_compiled_code()  # before numba is imported
