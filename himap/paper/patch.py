"""A patch of sky observed in single-dish mode: uneven hits, and lost channels and voxels.

Position and size are similar to MeerKLASS (MeerKLASS Collaboration 2025, Cunnington et al. 2023): dishes
scan to and fro at one elevation while the sky drifts by, rising or setting, so a block of observation
covers a parallelogram, sheared to either side. Hits and losses depend on a seed.
"""

from dataclasses import dataclass

import numpy as np
import pandas as pd
from astropy.coordinates import SkyCoord

from himap.core.checks import checked_fields, parameter
from himap.instrument.noise import noise_maps
from himap.maps import sphere
from himap.measures.low_rank_spectra import masked_alms
from himap.measures.spectra import decouple, frequency_power
from himap.paper import pipeline
from himap.removal.spectral_filter import on_sky

_SHEAR = 0.7  # deg of right ascension per deg of declination, for scans in azimuth at mid elevations
_EDGE = 0.5  # deg over which the hits of a block decrease at its sides
_LEAST = 0.05  # share of the largest hits: pixels with fewer are outside


@dataclass(frozen=True, kw_only=True)
class Patch:
    """A box of right ascension and declination, observed in blocks; angles in deg.

    A block has a weight w between 0.4 and 1 for the share of good dishes and scans, and its hits are
    w f(u) f(v): u is the right ascension plus (rising) or minus (setting) 0.7 times the declination from the
    centre, times cos(dec), v the declination; f is one inside of the block and decreases at its sides as a
    logistic function over 0.5 deg. A block is half as wide as the patch, at any position in it.
    """

    ra: float = parameter(347.5, "right ascension of the centre, deg", minimum=0, maximum=360)
    dec: float = parameter(-30.0, "declination of the centre, deg", minimum=-70, maximum=70)
    width: float = parameter(35.0, "width in right ascension, deg", minimum=5, maximum=120)
    height: float = parameter(10.0, "height in declination, deg", minimum=2, maximum=40)
    n_blocks: int = parameter(40, "blocks of observation, half of them rising", minimum=2)
    n_channels: int = parameter(3, "channels that are lost completely", minimum=0)
    n_bursts: int = parameter(40, "bursts, each in a few channels while some of the sky drifts by", minimum=0)
    voxels: float = parameter(0.02, "share of lost single voxels", minimum=0, maximum=0.5)
    seed: int = parameter(21, "seed of all of these", minimum=0)

    def __post_init__(self):
        checked_fields(self)

    @property
    def box(self):
        """(lowest, highest) right ascension and declination, deg, as used by `plotting.sky_maps`."""
        ra, dec = self.ra - 360 * (self.ra > 180), self.dec
        half = self.width / 2, self.height / 2
        return (ra - half[0] - 2, ra + half[0] + 2), (dec - half[1] - 2, dec + half[1] + 2)

    def offsets(self, nside):
        """Right ascension and declination of all pixels from the centre, deg, each (n_pix,)."""
        places = SkyCoord(*sphere.pixel_vectors(nside).T, frame="galactic", representation_type="cartesian")
        equatorial = places.icrs.represent_as("unitspherical")
        ra, dec = equatorial.lon.deg, equatorial.lat.deg
        return (ra - self.ra + 180) % 360 - 180, dec - self.dec

    def hits(self, nside):
        """Hits of the pixels, (n_pix,), at most 1; 0 outside."""
        rng = np.random.default_rng(self.seed)
        ra, dec = self.offsets(nside)
        squeeze = np.cos(np.deg2rad(self.dec))
        total = np.zeros(len(ra))
        for block in range(self.n_blocks):
            across = (ra + (-1) ** block * _SHEAR * dec) * squeeze
            middle = rng.uniform(-0.25, 0.25) * self.width * squeeze
            total += rng.uniform(0.4, 1) * _inside(across - middle, self.width * squeeze / 2)
        total *= _inside(dec, self.height) * _inside(ra * squeeze, self.width * squeeze)
        total /= total.max()
        return np.where(total > _LEAST, total, 0)

    def flags(self, nside, n_channels):
        """Voxels lost to interference, (n_channels, n_pix) bool.

        Some complete channels; bursts, each in one to four channels while 2 to 10 deg of right ascension
        drift by; and single voxels.
        """
        rng = np.random.default_rng([self.seed, 1])
        lost = rng.random((n_channels, 12 * nside**2)) < self.voxels
        lost[rng.choice(n_channels, min(self.n_channels, n_channels - 2), replace=False)] = True
        ra, dec = self.offsets(nside)
        for burst in range(self.n_bursts):
            first, length = rng.integers(n_channels), rng.integers(1, 5)
            middle, width = rng.uniform(-0.5, 0.5) * self.width, rng.uniform(2, 10)
            drifting = np.abs(ra + (-1) ** burst * _SHEAR * dec - middle) < width / 2
            lost[first : first + length, drifting] = True
        return lost


def _inside(offset, width):
    """One within half of a width of 0, with soft edges."""
    return 1 / (1 + np.exp(np.clip((np.abs(offset) - width / 2) / (_EDGE / 4), -50, 50)))


def patch_sky(case):
    """Foreground and HI of a `Case` through its beam, mK, each (n_channels, n_pix) float32, full sky.

    InputError for a survey with a taper, which is not supported by measures of an image.
    """
    case.survey.check_untapered()
    foreground = on_sky(pipeline.foreground_seen(case), case.survey.nside).cube()
    return foreground, pipeline.hi_seen(case)


def noise_by_hits(survey, hits, rng):
    """Noise of every channel, mK, (n_channels, n_pix) float32: `noise_sigma` at the mean of the hits.

    `survey` has the time, the dishes and the sky fraction of the patch; the standard deviation is that times
    (mean of hits / hits)^1/2, and 0 without hits.
    """
    spread = np.zeros(len(hits))
    spread[hits > 0] = np.sqrt(hits[hits > 0].mean() / hits[hits > 0])
    maps = noise_maps(survey, rng)
    maps *= spread.astype(np.float32)
    return maps


def interpolated(maps, missing):
    """Maps (n_channels, n_pix) with missing voxels interpolated linearly between neighbouring channels."""
    known = pd.DataFrame(maps).mask(missing).interpolate(limit_direction="both")
    return known.fillna(pd.DataFrame(maps)).to_numpy()  # lines of sight without any are unchanged


@dataclass(frozen=True, kw_only=True)
class PatchPower:
    """Both spectra of cubes of a patch, pixels weighted with their hits, 0 in missing voxels.

    Gaps reduce power, by the same factor in two spectra that are compared.
    """

    weights: np.ndarray  # of the pixels, between 0 and 1, (n_pix,)
    seen: np.ndarray  # voxels that are not missing, (n_channels, n_pix) bool
    channel_width: float  # MHz
    bin_width: int  # multipoles in a bin

    def alms(self, maps):
        """`masked_alms` of maps (n_channels, n_pix): linear in the maps."""
        return masked_alms(np.where(self.seen, maps, np.zeros((), maps.dtype)), mask=self.weights)

    def __call__(self, maps, alms=None):
        """{"angular": (l, C_l), "frequency": (k, P(k))} of maps (n_channels, n_pix), l and k above 0.

        `alms` are those of the maps, if known: they are most of the work.
        """
        alms = self.alms(maps) if alms is None else alms
        angular = decouple(sphere.power_spectrum(alms), self.weights, self.bin_width)
        maps = np.where(self.seen, maps, np.zeros((), maps.dtype))
        frequency = frequency_power(maps, self.channel_width, mask=self.weights)
        return {
            "angular": (angular.degrees[1:], angular.mean[1:]),
            "frequency": (frequency.k[1:], frequency.power[1:]),
        }

    def share(self, mocks, returned, alms=None):
        """The transfer function: {kind: cross power of recovered and input mocks over the input power}.

        Both are lists of maps; `alms` are those of the mocks, if known. The cross power is half of the power
        of their sum less that of each.
        """
        common, own = [], []
        for mock, back, known in zip(mocks, returned, alms or map(self.alms, mocks), strict=True):
            found = self.alms(back)
            power, alone, both = self(mock, known), self(back, found), self(mock + back, known + found)
            common.append({kind: (both[kind][1] - power[kind][1] - alone[kind][1]) / 2 for kind in power})
            own.append(power)
        return {
            kind: sum(one[kind] for one in common) / sum(one[kind][1] for one in own) for kind in common[0]
        }
