"""A cross-check of corrected power: residual power in parts of the sky, extrapolated to no foreground.

Foreground residual is brighter where the foreground is; HI and noise are not. The extrapolation uses neither
an estimate of the residual nor a beam. The brightest part determines the line, so that a residual that is as
bright in all others is not seen.
"""

from dataclasses import dataclass

import numpy as np

from himap.cubes.corrected import band_table, in_bands
from himap.maps.low_rank import blocks
from himap.measures.bootstrap import LEVEL, chance_of, sigma
from himap.measures.spectra import frequency_power

N_PARTS = 5
"""Parts of the sky with as many pixels each."""


@dataclass(frozen=True, kw_only=True)
class Parts:
    """The seen pixels of a cleaned cube, in parts by the brightness of its foreground, the faintest first.

    Attributes
    ----------
    pixels
        Indices of the pixels of each part, a list.
    brightness
        Mean squared foreground of each part over that of all, (`N_PARTS`,).
    """

    pixels: list
    brightness: np.ndarray

    @classmethod
    def of(cls, cleaned):
        """Those of a `CleanedCube`."""
        separation, squares = cleaned.separation, np.empty(cleaned.cube.maps.shape[1])
        for block in blocks(len(squares)):
            lines = separation.foreground.lines(block) + separation.means[:, None]
            squares[block] = np.mean(lines**2, axis=0)
        pixels = np.array_split(np.argsort(squares, kind="stable"), N_PARTS)
        brightness = np.array([squares[part].mean() for part in pixels])
        return cls(pixels=pixels, brightness=brightness / squares.mean())

    def powers(self, residual, channel_width):
        """P(k) of a residual (n_channels, n_seen), mK, in each part, mK^2 MHz, (`N_PARTS`, n_k)."""
        return np.array([frequency_power(residual[:, part], channel_width).power for part in self.pixels])

    def without(self, ratios):
        """Ratios (..., `N_PARTS`) at the brightness 0, by a line through them, (...)."""
        design = np.vander(self.brightness, 2, increasing=True)
        return ratios @ np.linalg.pinv(design)[0]


@dataclass(frozen=True, kw_only=True)
class Band:
    """Residual power in parts of the sky in one band of k, over T times the corrected power.

    Attributes
    ----------
    ratios
        In each part; where mocks have more than on average they are less by that.
    without
        The same extrapolated to no foreground: 1 if the foreground residual is what was subtracted.
    error
        Of `without` - 1: of the extrapolation, from mocks compared with each other, error bar and systematic
        error of the corrected power, in quadrature; NaN where one mock is all.
    chance
        That it is as far from 1.
    """

    ratios: np.ndarray
    without: float
    error: float
    chance: float


def by_brightness(cleaned, transfer, corrected):
    """{band of k: `Band`} of a `CleanedCube`, its `CubeTransfer`, and what `correct` makes of it."""
    parts, n_mocks = transfer.parts, len(transfer.mocks)
    own, power = parts.powers(cleaned.residual, cleaned.cube.channel_width)[:, 1:], {}
    for name, (one, inside) in in_bands(corrected).items():
        if one is not corrected["frequency"]:
            continue
        mocks, residual = transfer.powers[..., 1:][..., inside].mean(axis=-1), own[:, inside].mean(axis=-1)
        foreground, total = (np.mean(each[inside]) for each in (one.foreground, one.residual))
        ratios = _shape(residual) / _shape(mocks.mean(axis=0)) * total / (total - foreground)
        without, error, chance = float(parts.without(ratios)), np.nan, np.nan
        if n_mocks > 1:
            others = (mocks.sum(axis=0) - mocks) / (n_mocks - 1)
            line = sigma(parts.without(_shape(mocks) / _shape(others)) - 1)
            error = float(np.linalg.norm([line, *one.errors_in(inside)[:2]]))
            chance = float(chance_of(abs(without - 1) / error, n_mocks))
        power[name] = Band(ratios=ratios, without=without, error=error, chance=chance)
    return power


def _shape(powers):
    """Powers (..., `N_PARTS`) over their mean."""
    return powers / powers.mean(axis=-1, keepdims=True)


def brightness_table(power):
    """A `Table` of what `by_brightness` gives."""
    rows = [
        [name, *map("{:.4f}".format, [*one.ratios, one.without]), f"{one.error:.2%}", f"{one.chance:.2g}"]
        for name, one in power.items()
    ]
    middle = [f"{n}" for n in range(2, N_PARTS)]
    header = ["fifths of the sky", "faintest", *middle, "brightest", "no foreground", "error", "chance"]
    note = (
        "Residual power by the brightness of the foreground, over T times the corrected power; extrapolated "
        "to no foreground, with the error of this and of the corrected power, and the chance that it is as "
        "far from 1."
    )
    return band_table(header, rows, note)


def remarks_on_brightness(power):
    """What the user should know of it, a list of sentences."""
    unlike = [name for name, one in power.items() if one.chance * len(power) < LEVEL]
    return [
        f"The corrected power is not that of the residual extrapolated to no foreground, in "
        f"{', '.join(unlike)}: the foreground residual is not what was subtracted, the beam is another, or "
        "noise is distributed unlike that of the mocks."
    ] * bool(unlike)
