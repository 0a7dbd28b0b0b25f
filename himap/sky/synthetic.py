"""A synthetic Galaxy: a few discs seen from inside, four loops, and lognormal structure.

It has the statistics of the real sky, not its features: medians and 99 % points per band of latitude,
C_l, and the index of synchrotron emission were fitted to the 408 MHz map of Remazeilles et al. (2015),
Planck's free-free map at 30 GHz and the index map of Miville-Deschenes et al. (2008). Only the
Galactic plane, the inner Galaxy and the radio loops are at their true positions.

Structure is drawn multipole by multipole, so one seed gives the same sky at any resolution.
"""

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import RectBivariateSpline

from himap.maps import sphere
from himap.sky.emission import PowerLaw

FREE_FREE_INDEX = -2.14
"""Spectral index of free-free emission (paper, Sect. 2.1.3)."""

NSIDE_CALIBRATED = 64
"""Resolution of the fit: coarser maps are averages of maps at this nside, finer maps have the same mean."""

_FREQ_SYNCHROTRON, _FREQ_FREE_FREE = 408.0, 30_000.0  # MHz
_SUN = 8.2  # kpc from the Galactic centre (GRAVITY collaboration 2019)
_CORE = 1.0  # kpc, rounds off the centre of the discs


_ISOTROPIC = 5.64e3  # mK; half of it is extragalactic
# Discs: amplitude in mK per kpc, length and height in kpc.
_HALO = 370.0, 2.7, 3.9
_THICK_DISC = 5.01e3, 4.2, 0.57
_THIN_DISC = 2.06e3, 3.0, 0.11
_IONISED_DISC = 0.236, 2.46, 0.098

# Four radio loops (Berkhuijsen et al. 1971): longitude, latitude and radius in deg, brightness in mK.
_LOOPS = (
    (329.0, 17.5, 58.0, 13e3),
    (110.0, -32.5, 45.5, 4e3),
    (124.0, 15.5, 32.5, 5e3),
    (315.0, 48.5, 19.8, 4e3),
)
_LOOP_WIDTH = 4.0  # deg


def synthetic_galaxy(nside, rng):
    """Synchrotron at 408 MHz and free-free at 30 GHz, as two `PowerLaw`, mK, RING, Galactic.

    T_sync = halo + T_iso e^(s1 g) + thick disc e^(s2 g) + loops e^(s3 g) + thin disc e^h, and T_ff = disc
    e^(s(b) g'). g is a Gaussian field for synchrotron, h for the plane, and g' approaches h near the plane,
    where both therefore share their structure. Typical values over seeds agree with the real sky to 15 % in
    the medians of six bands of latitude, 30 % in their 99 % points, and a factor 1.2 in C_l up to l = 100.
    One of twelve seeds was off by as much as 40 %, a factor 2 and a factor 9: C_l depends on a few bright
    structures in the plane. Streams are children of `rng`: one for h, one for each component.
    """
    fine = max(nside, NSIDE_CALIBRATED)
    shared, synchrotron, free_free = rng.spawn(3)
    plane = _Field.draw(_free_free_spectrum, fine, shared)
    vectors = sphere.pixel_vectors(fine)
    structure_rng, index_rng = synchrotron.spawn(2)
    structure = _Field.draw(lambda degree: (degree + 4) ** -3.1, fine, structure_rng)
    amplitude = _ISOTROPIC * structure.lognormal(0.23)
    amplitude += _disc_brightness(vectors, *_THICK_DISC) * structure.lognormal(0.15)
    amplitude += _loops(vectors) * structure.lognormal(0.7)
    amplitude += _disc_brightness(vectors, *_HALO)
    amplitude += _disc_brightness(vectors, *_THIN_DISC) * plane.lognormal(1.0)
    # The index map is smoothed to 5 deg.
    steepness = _Field.draw(lambda degree: degree**-2.0 * np.exp(-((degree / 27) ** 2)), fine, index_rng)
    latitude = np.degrees(np.arcsin(np.abs(vectors[:, 2])))
    index = -3.0 + (0.05 + 0.04 * np.exp(-latitude / 12)) * steepness.values
    gas, sine = _Field.draw(_free_free_spectrum, fine, free_free), np.abs(vectors[:, 2])
    share = np.exp(-sine / 0.1)
    mix = _Field(share * plane.values + np.sqrt(1 - share**2) * gas.values, gas.variance_added)
    cavity = np.exp(-2.9 * sine**1.23)  # the Sun is in a bubble with little gas
    ionised = mix.lognormal(1.41 - 0.48 * np.exp(-((sine / 0.25) ** 2)))
    ionised *= _disc_brightness(vectors, *_IONISED_DISC) * cavity
    components = (
        ("synchrotron", amplitude, _FREQ_SYNCHROTRON, sphere.change_resolution(index, nside)),
        ("free-free", ionised, _FREQ_FREE_FREE, FREE_FREE_INDEX),
    )
    return [
        PowerLaw(name=name, amplitude=sphere.change_resolution(pixels, nside), freq_ref=freq, index=index)
        for name, pixels, freq, index in components
    ]


def _disc_brightness(vectors, amplitude, length, height):
    """Brightness towards `vectors`, mK: amplitude exp((R_sun - R) / length) / cosh^2(z / height) to 30 kpc.

    The disc has four-fold symmetry and is smooth, so it is integrated on a grid and interpolated.
    """
    lon = np.radians(np.linspace(0, 180, 121))
    stretch = np.linspace(0, np.arcsinh(90 / 0.5), 61)  # fine at the plane
    lat = np.radians(0.5 * np.sinh(stretch))
    edges = np.append(0, np.geomspace(0.01, 30, 100))
    path = 0.5 * (edges[1:] + edges[:-1])[:, None, None]
    ground = path * np.cos(lat)
    radius = np.sqrt(_SUN**2 + ground**2 - 2 * _SUN * ground * np.cos(lon)[:, None])
    emissivity = np.exp((_SUN - np.hypot(radius, _CORE)) / length)
    emissivity /= np.cosh(np.minimum(path * np.sin(lat) / height, 300)) ** 2  # beyond: no overflow
    brightness = amplitude * np.tensordot(np.diff(edges), emissivity, axes=1)
    spline = RectBivariateSpline(lon, stretch, np.log(brightness))
    latitude = np.degrees(np.arcsin(np.minimum(np.abs(vectors[:, 2]), 1)))
    return np.exp(spline.ev(np.abs(np.arctan2(vectors[:, 1], vectors[:, 0])), np.arcsinh(latitude / 0.5)))


def _loops(vectors):
    """The radio loops, mK: shells, bright at the rim on the side of the plane where they are observed."""
    total = np.zeros(len(vectors))
    for lon, lat, radius, brightness in _LOOPS:
        side = 1 / (1 + np.exp(-np.sign(lat) * np.degrees(np.arcsin(vectors[:, 2])) / 10))
        lon, lat = np.radians((lon, lat))
        centre = np.array([np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)])
        distance = np.degrees(np.arccos(np.clip(vectors @ centre, -1, 1)))
        rim = np.exp(-(((distance - radius) / _LOOP_WIDTH) ** 2))
        inside = 0.3 / (1 + np.exp((distance - radius) / (0.3 * _LOOP_WIDTH)))
        total += brightness * (rim * side + inside)
    return total


@dataclass(frozen=True)
class _Field:
    """A Gaussian field of mean 0, with unit variance at `NSIDE_CALIBRATED` and more beyond."""

    values: np.ndarray
    variance_added: float

    @classmethod
    def draw(cls, spectrum, nside, rng):
        """A realisation of `spectrum`, a function of l, up to l = 3 nside - 1.

        Coefficients at any l do not depend on the last l.
        """
        degree = np.arange(3 * nside)
        cl = np.where(degree > 0, spectrum(np.maximum(degree, 1.0)), 0.0)
        variance = (2 * degree + 1) * cl / (4 * np.pi)
        calibrated = variance[: 3 * NSIDE_CALIBRATED].sum()
        draws = rng.standard_normal(len(cl) ** 2)  # the 2 l + 1 numbers of each l in turn
        of_alm, order = sphere.alm_degree(len(cl) - 1), np.repeat(degree, degree[::-1] + 1)
        real = draws[of_alm**2 + np.maximum(2 * order - 1, 0)]
        imag = np.where(order > 0, draws[of_alm**2 + 2 * order], 0.0)
        scale = np.where(order > 0, np.sqrt(0.5), 1.0) * np.sqrt(cl / calibrated)[of_alm]
        values = sphere.synthesise(scale * (real + 1j * imag), nside)
        return cls(values, variance[3 * NSIDE_CALIBRATED :].sum() / calibrated)

    def lognormal(self, width):
        """exp(width g), with median 1 and its mean at `NSIDE_CALIBRATED`, for any nside."""
        return np.exp(width * self.values - 0.5 * width**2 * self.variance_added)


def _free_free_spectrum(degree):
    return (degree + 3) ** -1.7 / (1 + (degree / 150) ** 4) ** 0.4
