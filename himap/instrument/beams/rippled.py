"""The paper's oscillating beam with a ripple of one's own."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from himap.instrument.beams.base import GaussianBeam, diffraction_fwhm, parameter
from himap.instrument.beams.oscillating import Oscillating

_PAPER = Oscillating()


@dataclass(frozen=True, kw_only=True)
class Rippled(GaussianBeam):
    """Gaussian, FWHM = lambda / D [sum_d a_d nu^d + A sin(2 pi nu / period + phase)] (paper, Eq. 10).

    With its defaults it is `Oscillating()`, A = 0.1 / 60.

    Raises
    ------
    InputError
        A field outside its range; in use, frequencies as for `Oscillating`.
    """

    name: ClassVar[str] = "rippled"
    follows_dish: ClassVar[bool] = True
    amplitude: float = parameter(0.1, "60 A", minimum=-10, maximum=10)
    period: float = parameter(20.0, "MHz", minimum=0, above=True)
    phase: float = parameter(0.0, "at 0 MHz, rad")

    def _fwhm(self, freqs, dish_diameter):
        own = self.amplitude * np.sin(2 * np.pi * freqs / self.period + self.phase)
        paper = 0.1 * np.sin(2 * np.pi * freqs / 20)
        change = diffraction_fwhm(freqs, dish_diameter) * (own - paper) / 60
        return _PAPER.fwhm(freqs, dish_diameter=dish_diameter) + change
