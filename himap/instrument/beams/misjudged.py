"""A beam of another width than it has: what an analyst may take it for."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from himap.instrument.beams.base import Beam, Windows, parameter


@dataclass(frozen=True, kw_only=True)
class Misjudged(Beam):
    """Another beam whose FWHM is wrong by a share e = width + ripple sin(2 pi nu / period + phase).

    That of a Gaussian is b_l to the power (1 + e)^2; so it is taken of any other.

    Raises
    ------
    InputError
        An unknown beam, or a field outside its range.
    """

    name: ClassVar[str] = "misjudged"
    beam: str = parameter("oscillating", "the beam that it is, by name, or a file")
    width: float = parameter(0.0, "relative error of the FWHM of all channels", minimum=-0.5, maximum=0.5)
    ripple: float = parameter(
        0.0, "relative amplitude of an error that oscillates", minimum=-0.5, maximum=0.5
    )
    period: float = parameter(20.0, "its period, MHz", minimum=0, above=True)
    phase: float = parameter(0.0, "its phase at 0 MHz, rad")

    def __post_init__(self):
        super().__post_init__()
        _ = self._known

    @property
    def _known(self):
        # Imported here: the register finds the beams, this one too.
        from himap.instrument.beams import named

        return named(self.beam)

    @property
    def follows_dish(self):
        """Whether the width of the beam that it is follows from the diameter of the dish."""
        return self._known.follows_dish

    @property
    def by_line(self):
        """Whether the beam that it is goes by the lines of a file."""
        return self._known.by_line

    def digest(self):
        """A hash of the file that holds the beam, if one does, for results that are kept."""
        return self._known.digest() if self._known.by_line else ""

    def error(self, freqs):
        """The relative error of the FWHM at `freqs` in MHz, (n_channels,)."""
        return self.width + self.ripple * np.sin(2 * np.pi * np.asarray(freqs) / self.period + self.phase)

    def _windows(self, freqs, lmax, dish_diameter):
        known = self._known.windows(freqs, lmax=lmax, dish_diameter=dish_diameter)
        power = (1 + self.error(freqs)[:, None]) ** 2
        # Only the telescope is misjudged; b_l of a measured beam may be below zero where it is nothing.
        telescope = np.sign(known.telescope) * np.abs(known.telescope) ** power
        return Windows(telescope=telescope, resmoothing=known.resmoothing)
