"""The beam that narrows with frequency (paper, Sect. 2.2.1)."""

from dataclasses import dataclass
from typing import ClassVar

from himap.instrument.beams.base import GaussianBeam, diffraction_fwhm


@dataclass(frozen=True, kw_only=True)
class Evolving(GaussianBeam):
    """Gaussian, as wide as diffraction makes it: FWHM = lambda / D (paper, Eq. 8)."""

    name: ClassVar[str] = "evolving"
    follows_dish: ClassVar[bool] = True

    def _fwhm(self, freqs, dish_diameter):
        return diffraction_fwhm(freqs, dish_diameter)
