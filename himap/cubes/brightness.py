"""A cross-check of corrected power: whether it depends on how bright the foreground is.

Foreground residual that the members of a bootstrap do not have is brighter where the foreground is; HI and
noise are not. No estimate of the residual enters, nor a beam.
"""

from dataclasses import dataclass

import numpy as np

from himap.cubes.corrected import plain_band
from himap.figures.tables import Table
from himap.maps.low_rank import blocks
from himap.measures.bootstrap import LEVEL, chance_of, sigma
from himap.measures.diagnostics import bands
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
        """Ratios (..., `N_PARTS`) at the brightness 0, by a line through them, over their mean, (...)."""
        slope, none = np.polyfit(self.brightness, np.reshape(ratios, (-1, N_PARTS)).T, 1)
        return (none / np.mean(np.reshape(ratios, (-1, N_PARTS)), axis=1)).reshape(np.shape(ratios)[:-1])


@dataclass(frozen=True, kw_only=True)
class Band:
    """Power in parts of the sky in one band of k.

    Attributes
    ----------
    ratios
        Power of the residual over the mean of the members, in each part, over the mean of these ratios.
    without
        The same extrapolated to no foreground.
    sigma
        Error bar of `without`, from members compared with each other; NaN where one mock is all.
    chance
        That it is as far from 1, if the foreground residual is that of the members.
    """

    ratios: np.ndarray
    without: float
    sigma: float
    chance: float


def by_brightness(cleaned, transfer):
    """{band of k: `Band`} of a `CleanedCube` and its `CubeTransfer`."""
    cube, parts, members = cleaned.cube, transfer.parts, transfer.powers
    own, power = parts.powers(cleaned.residual, cube.channel_width), {}
    for name, (_, inside) in bands(np.empty(0), transfer.k[1:]).items():
        inside = np.r_[False, inside]
        several, n_mocks = members[..., inside].mean(axis=-1), len(members)
        ratios = own[:, inside].mean(axis=-1) / several.mean(axis=0)
        without, bar = float(parts.without(ratios)), np.nan
        if n_mocks > 1:
            others = (several.sum(axis=0) - several) / (n_mocks - 1)
            bar = float(sigma(parts.without(several / others) - 1))
        power[plain_band(name)] = Band(
            ratios=ratios / ratios.mean(),
            without=without,
            sigma=bar,
            chance=float(chance_of(abs(without - 1) / bar, n_mocks)),
        )
    return power


def brightness_table(power):
    """A `Table` of what `by_brightness` gives."""
    rows = [
        [name, *map("{:.4f}".format, [*one.ratios, one.without]), f"{one.sigma:.2%}", f"{one.chance:.2g}"]
        for name, one in power.items()
    ]
    rows = [["–" if cell.startswith("nan") else cell for cell in row] for row in rows]
    middle = [f"{n}" for n in range(2, N_PARTS)]
    header = ["fifths of the sky", "faintest", *middle, "brightest", "no foreground", "error bar", "chance"]
    note = (
        "Corrected power by the brightness of the foreground, over the mean of the fifths; by a line where "
        "there is no foreground, with its error bar, and the chance that it is as far from 1."
    )
    return Table(header, rows, align="l" + "r" * (len(header) - 1), note=note)


def remarks_on_brightness(power):
    """What the user should know of it, a list of sentences."""
    unlike = [name for name, one in power.items() if one.chance * len(power) < LEVEL]
    return [
        f"The corrected power depends on how bright the foreground is ({', '.join(unlike)}): there is "
        "foreground residual that is not known, or the beam is another."
    ] * bool(unlike)
