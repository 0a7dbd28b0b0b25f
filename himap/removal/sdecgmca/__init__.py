"""SDecGMCA (paper, Sect. 3.3), and code that only it needs."""

from himap.removal.sdecgmca.method import SDecGMCA

__all__ = ["SDecGMCA"]
