"""himap: foreground removal in HI intensity mapping, a companion of Gkogkou et al. (2025)."""

from himap.core.files import keep_compiled_code

__all__ = ["__version__"]

__version__ = "0.1.0"

keep_compiled_code()  # before numba is imported
