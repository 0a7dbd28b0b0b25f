"""A beam of one's own: widths or b_l in a file, one line for each channel."""

from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path
from typing import ClassVar

import numpy as np

from himap.core.errors import InputError
from himap.core.reading import is_file, read_numbers, regular_file
from himap.instrument.beams.base import Beam, Windows, parameter
from himap.maps import sphere

_NARROWEST, _WIDEST = 0.04, 10.0  # deg, of a FWHM: less is in rad, more in arcmin
_OFF = 0.01  # by which b_l may miss 1 at l = 0


@dataclass(frozen=True, kw_only=True)
class FromFile(Beam):
    """FWHM in degrees (then Gaussian), or b_l from l = 0, of a .npy or text file.

    One line for each channel: of a survey by ascending frequency, of a cube in the order of the cube's own
    file. What was computed with a beam counts by what the file held.

    Raises
    ------
    InputError
        No such file; in use, numbers that do not fit the channels or cannot be a beam.
    """

    name: ClassVar[str] = "file"
    by_line: ClassVar[bool] = True
    path: str = parameter(help="path of a file with one line for each channel: FWHM (deg), or b_l")

    def __post_init__(self):
        if not isinstance(self.path, str | Path) or not is_file(self.path):
            raise InputError(f"the beam must be in a file of widths or b_l; there is no file {self.path}.")
        regular_file(self.path, "beam")
        object.__setattr__(self, "path", str(self.path))

    def __str__(self):
        return self.path

    def digest(self):
        """A hash of what the file holds, for results that are kept."""
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
        transfer = self._gaussian(numbers, lmax) if numbers.ndim == 1 else numbers[:, : lmax + 1]
        self._check(transfer)
        return Windows(telescope=transfer)

    def _gaussian(self, widths, lmax):
        if not ((widths >= _NARROWEST) & (widths <= _WIDEST)).all():
            raise InputError(
                f"{self.path} must hold FWHM in degrees, between {_NARROWEST:g} and {_WIDEST:g}, got "
                f"{widths.min():g} to {widths.max():g}."
            )
        return sphere.gaussian_beam(np.deg2rad(widths), lmax)

    def _check(self, transfer):
        """Refuse b_l that cannot be those of a beam."""
        bad = np.argwhere(~np.isfinite(transfer))
        if len(bad):
            channel, degree = bad[0]
            raise InputError(
                f"{self.path} must hold finite numbers, got {transfer[channel, degree]} in line "
                f"{channel + 1} at l = {degree}."
            )
        if np.abs(transfer[:, 0] - 1).max() > _OFF or np.abs(transfer).max() > 1 + _OFF:
            raise InputError(
                f"{self.path} must hold b_l that are 1 at l = 0 and nowhere more, got "
                f"{transfer[:, 0].min():g} to {transfer[:, 0].max():g} at l = 0 and "
                f"{np.abs(transfer).max():g} at most; for widths give one FWHM (deg) a line."
            )
