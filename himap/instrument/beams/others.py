"""Other beams: widths or b_l from a file, and another beam with an error of its width."""

from dataclasses import dataclass, replace
from hashlib import sha256
from pathlib import Path
from typing import ClassVar

import numpy as np

from himap.core.checks import parameter
from himap.core.errors import InputError
from himap.core.reading import is_file, read_numbers, regular_file
from himap.instrument.beams.base import Beam, Windows
from himap.maps import sphere

_NARROWEST, _WIDEST = 0.04, 10.0  # deg, range of a FWHM: smaller values are probably in rad, larger in arcmin
_TOLERANCE = 0.01  # allowed deviation of b_l from 1 at l = 0


@dataclass(frozen=True, kw_only=True)
class FromFile(Beam):
    """FWHM in degrees (then Gaussian), or b_l from l = 0, from a .npy or text file.

    One line for each channel: for a survey by ascending frequency, for a cube in the order of the cube's
    file. Results depend on the content of the file, not on its name.

    Raises
    ------
    InputError
        If there is no such file; in use, if its numbers do not fit the channels or cannot be a beam.
    """

    name: ClassVar[str] = "file"
    by_line: ClassVar[bool] = True
    path: str = parameter(help="path of a file with one line for each channel: FWHM (deg), or b_l")

    def __post_init__(self):
        object.__setattr__(self, "path", str(regular_file(self.path, "file of widths or b_l of a beam")))

    def __str__(self):
        return self.path

    def digest(self):
        """A hash of the content of the file, for stored results."""
        return sha256(Path(self.path).read_bytes()).hexdigest()

    def _windows(self, freqs, lmax, dish_diameter):
        numbers = read_numbers(self.path)
        if numbers.ndim == 2 and numbers.shape[1] == 1:
            numbers = numbers[:, 0]
        if numbers.ndim not in (1, 2) or len(numbers) != len(freqs):
            raise InputError(
                f"{self.path} must hold one FWHM (deg) or one line of b_l for each of the {len(freqs)} "
                f"channels, got {numbers.shape}."
            )
        if numbers.ndim == 1:
            if not ((numbers >= _NARROWEST) & (numbers <= _WIDEST)).all():
                raise InputError(
                    f"{self.path} must hold FWHM in degrees, between {_NARROWEST:g} and {_WIDEST:g}, got "
                    f"{numbers.min():g} to {numbers.max():g}."
                )
            return Windows(telescope=sphere.gaussian_beam(np.deg2rad(numbers), lmax))
        beams = numbers[:, : lmax + 1]
        at_zero, largest = beams[:, 0], np.abs(beams).max()
        if not (np.abs(at_zero - 1).max() <= _TOLERANCE and largest <= 1 + _TOLERANCE):
            raise InputError(
                f"{self.path} must hold finite b_l that are 1 at l = 0 and nowhere more, got "
                f"{at_zero.min():g} to {at_zero.max():g} at l = 0 and {largest:g} at most; for widths give "
                "one FWHM (deg) a line."
            )
        return Windows(telescope=beams)


@dataclass(frozen=True, kw_only=True)
class PerturbedBeam(Beam):
    """Another beam whose FWHM has a relative error e = width + ripple sin(2 pi nu / period + phase).

    For a Gaussian this is b_l to the power (1 + e)^2; the same is used for other beams. Parameters of the
    other beam are separated by semicolons, so that ``str`` of both can be parsed.

    Raises
    ------
    InputError
        For an unknown beam, or a field outside its range.
    """

    name: ClassVar[str] = "misjudged"
    beam: str = parameter("oscillating", "the true beam, by name, or a file")
    width: float = parameter(0.0, "relative error of the FWHM of all channels", minimum=-0.5, maximum=0.5)
    ripple: float = parameter(0.0, "relative amplitude of the oscillating error", minimum=-0.5, maximum=0.5)
    period: float = parameter(20.0, "its period, MHz", minimum=0, above=True)
    phase: float = parameter(0.0, "its phase at 0 MHz, rad")

    def __post_init__(self):
        if isinstance(self.beam, str) and not is_file(self.beam):
            object.__setattr__(self, "beam", self.beam.replace(",", ";"))
        super().__post_init__()
        _ = self._true

    @property
    def _true(self):
        from himap.instrument.beams import named  # here, because the registry imports this module

        return named(self.beam if is_file(self.beam) else self.beam.replace(";", ","))

    @property
    def follows_dish(self):
        """Whether the width of the true beam follows from the diameter of the dish."""
        return self._true.follows_dish

    @property
    def by_line(self):
        """Whether the true beam is given by the lines of a file."""
        return self._true.by_line

    def chosen_for(self, freqs):
        """The same error of the true beam as chosen for `freqs`, MHz."""
        return replace(self, beam=str(self._true.chosen_for(freqs)))

    def digest(self):
        """A hash of the file of the beam, if it has one, for stored results."""
        return self._true.digest() if self.by_line else ""

    def error(self, freqs):
        """The relative error of the FWHM at `freqs` in MHz, (n_channels,)."""
        return self.width + self.ripple * np.sin(2 * np.pi * np.asarray(freqs) / self.period + self.phase)

    def _windows(self, freqs, lmax, dish_diameter):
        true = self._true.windows(freqs, lmax=lmax, dish_diameter=dish_diameter)
        power = (1 + self.error(freqs)[:, None]) ** 2
        # The resmoothing is known exactly; b_l of a measured beam may be slightly negative.
        telescope = np.sign(true.telescope) * np.abs(true.telescope) ** power
        return Windows(telescope=telescope, resmoothing=true.resmoothing)
