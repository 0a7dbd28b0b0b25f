"""Foreground removal: one file per published method, behind one interface."""

from himap.removal.base import Cleaned, ForegroundRemover, Separation, SeparationWarning
from himap.removal.pca import PCA

__all__ = ["PCA", "Cleaned", "ForegroundRemover", "Separation", "SeparationWarning", "available", "create"]

available = ForegroundRemover.available
create = ForegroundRemover.create
