"""himap: foreground removal in HI intensity mapping, a companion of Gkogkou et al. (2025)."""

__all__ = ["__version__"]

__version__ = "0.1.0"
