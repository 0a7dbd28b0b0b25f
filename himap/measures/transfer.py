"""What a cleaning loses, from mocks: put into the data, cleaned with them, and compared with what comes back.

Of a mock m in data d comes back clean(d + m) - clean(d) (Switzer et al. 2013; Cunnington et al. 2023). All is
kept by multipole and by wavenumber along frequency, of which C_l and P(k) are sums.
"""

import itertools
import math
from dataclasses import dataclass, replace
from functools import reduce
from operator import add

import numpy as np
from scipy import fft

from himap.core.errors import InputError
from himap.core.progress import progress
from himap.maps import sphere
from himap.measures import diagnostics

DEFINITIONS = ("cross", "auto")
"""Of a transfer function: the power that comes back and is in common with the mock, or all of it."""

ANGULAR_BANDS = ((2, 4), (5, 9), (10, 19), (20, 39), (40, 99), (100, 200))
"""Bands of l, first and last, in which ratios are averaged."""

FREQUENCY_BANDS = ((0, 0.03), (0.03, 0.1), (0.1, math.inf))
"""Bands of k, 1/MHz."""

JUDGED = ("C/C0, 10-19", "C/C0, 20-39", "C/C0, 40-99", "P/P0, 0.03-0.1", "P/P0, k > 0.1")
"""Those by which cleanings are judged: below are few multipoles, and slow modes are lost with any beam."""

_PARTS = {"cross": ("common", "put_in"), "auto": ("came_back", "put_in")}


@dataclass(frozen=True, kw_only=True)
class CylindricalPower:
    """Power by multipole l and by wavenumber k along frequency, of one cube or of two with each other.

    Attributes
    ----------
    power
        P_l(k), mK^2 MHz, (n_l, n_k): the mean over the modes of one l of |dnu FFT_nu a_lm|^2 over the band.
    n_channels, channel_width
        Of the cube; MHz.
    """

    power: np.ndarray
    n_channels: int
    channel_width: float

    @property
    def degrees(self):
        """l, (n_l,), from 0."""
        return np.arange(len(self.power))

    @property
    def k(self):
        """1/MHz, (n_k,), from 0."""
        return 2 * np.pi * fft.rfftfreq(self.n_channels, self.channel_width)

    @property
    def angular(self):
        """C_l averaged over channels, mK^2, (n_l,): by Parseval's theorem the sum over all k."""
        times = np.full(self.power.shape[1], 2.0)  # k and -k
        times[0] = 1
        if self.n_channels % 2 == 0:
            times[-1] = 1
        return self.power @ times / (self.n_channels * self.channel_width)

    @property
    def frequency(self):
        """P(k) averaged over the sphere, mK^2 MHz, (n_k,): the sum over all modes."""
        return (2 * self.degrees + 1) @ self.power / (4 * np.pi)

    def __add__(self, other):
        return replace(self, power=self.power + other.power)

    def binned(self, edges):
        """Means over the modes in bins of l, from one of the `edges` to below the next, (n_bins, n_k)."""
        n_modes = 2.0 * self.degrees + 1
        bins = [slice(low, high) for low, high in itertools.pairwise(edges)]
        return np.array([n_modes[one] @ self.power[one] / n_modes[one].sum() for one in bins])


@dataclass(frozen=True, kw_only=True)
class Recovery:
    """What was put in, what came back, and what the two have in common, each a `CylindricalPower`."""

    put_in: CylindricalPower
    came_back: CylindricalPower
    common: CylindricalPower

    def __add__(self, other):
        return Recovery(**{name: power + vars(other)[name] for name, power in vars(self).items()})


@dataclass(frozen=True, kw_only=True)
class TransferFunction:
    """Which share of the power of mocks comes back.

    Attributes
    ----------
    recoveries
        A tuple with the `Recovery` of each mock.
    definition
        "cross": the power that what comes back has in common with what was put in, over that of the latter
        (Cunnington et al. 2023). "auto": all the power that comes back. What a projection keeps it keeps
        whole, so that the two agree and there is no square to divide by. They differ where a mock changes
        what is taken of the data: that is power which the data without the mock do not have.

    Raises
    ------
    InputError
        No mock, or an unknown definition.
    """

    recoveries: tuple
    definition: str = "cross"

    def __post_init__(self):
        if not self.recoveries:
            raise InputError("a transfer function needs mocks, one or more, got none.")
        if self.definition not in DEFINITIONS:
            raise InputError(f"definition must be {' or '.join(DEFINITIONS)}, got {self.definition!r}.")

    @property
    def degrees(self):
        """l, (n_l,), from 0 to where the method ends."""
        return self.recoveries[0].put_in.degrees

    @property
    def k(self):
        """1/MHz, (n_k,), from 0."""
        return self.recoveries[0].put_in.k

    @property
    def angular(self):
        """T(l), (n_l,): of C_l averaged over channels; 0 where nothing was put in."""
        return _share(self.recoveries, self.definition, "angular")

    @property
    def frequency(self):
        """T(k), (n_k,): of P(k) averaged over the sphere."""
        return _share(self.recoveries, self.definition, "frequency")

    def cylindrical(self, edges):
        """T(l, k) in bins of l from one of the `edges` to below the next, (n_bins, n_k)."""
        total = reduce(add, self.recoveries)
        return _quotient(*(getattr(total, name).binned(edges) for name in _PARTS[self.definition]))

    def errors(self, kind):
        """What is wrong, relatively, with each mock once it is corrected by the others, (n_mocks, n).

        Of C_l or P(k), `kind` "angular" or "frequency". Its scatter is the error bar of a corrected spectrum:
        loss differs from mock to mock, and the transfer function is known from a few only.

        Raises
        ------
        InputError
            Fewer than two mocks.
        """
        if len(self.recoveries) < 2:
            raise InputError("error bars need two mocks or more, got one.")
        errors = []
        for n, mock in enumerate(self.recoveries):
            others = self.recoveries[:n] + self.recoveries[n + 1 :]
            back, put_in = (getattr(getattr(mock, name), kind) for name in _PARTS[self.definition])
            errors.append(_quotient(back, put_in * _share(others, self.definition, kind)) - 1)
        return np.array(errors)


def bands(angular, frequency):
    """The bands that some l (n_l,) and k (n_k,), 1/MHz, reach, and what lies in them.

    Returns
    -------
    dict
        {name: ("angular" or "frequency", which elements)}, such as "C/C0, 10-19".
    """
    found = {}
    for first, last in ANGULAR_BANDS:
        inside = (angular >= first) & (angular <= last)
        if inside.any() and last <= angular[-1]:
            found[f"C/C0, {first}-{last}"] = "angular", inside
    for low, high in FREQUENCY_BANDS:
        inside = (frequency > low) & (frequency <= high)
        if inside.any():
            name = f"P/P0, k > {low:g}" if high == math.inf else f"P/P0, {low:g}-{high:g}"
            found[name] = "frequency", inside
    return found


def band_means(spectra, degrees, k):
    """Means over the `bands` that some l (n_l,) and k (n_k,), 1/MHz, reach, {band: (...)}.

    `spectra` are values there, {"angular": (..., n_l), "frequency": (..., n_k)}.
    """
    return {
        name: spectra[kind][..., inside].mean(axis=-1) for name, (kind, inside) in bands(degrees, k).items()
    }


def power_ratios(found, part="came_back"):
    """C/C0 and P/P0 of a part of a `Recovery` to what was put in, {"angular": (n_l,), "frequency": (n_k,)}.

    NaN at l = 0 and k = 0.

    Raises
    ------
    InputError
        Something else of what was put in has no power.
    """
    ratios = {}
    for kind in ("angular", "frequency"):
        power, true = (getattr(getattr(found, name), kind)[1:] for name in (part, "put_in"))
        ratios[kind] = np.r_[np.nan, diagnostics.ratio(power, true)]
    return ratios


def _share(recoveries, definition, kind):
    """The ratio of sums over mocks of C_l or P(k)."""
    total = reduce(add, recoveries)
    return _quotient(*(getattr(getattr(total, name), kind) for name in _PARTS[definition]))


def cylindrical_power(alms, channel_width):
    """The `CylindricalPower` of a cube of coefficients, (n_channels, n_alm), mK; channel width in MHz."""
    return _sum_over_modes(alms, channel_width, lambda waves, degree: (np.abs(waves) ** 2,))[0]


def recovery(alms, wrong, channel_width):
    """The `Recovery` of a cube T that came back as T and something more.

    Parameters
    ----------
    alms
        Coefficients of T, (n_channels, n_alm), mK; what is compared ends where they do.
    wrong
        What came back is more than T, a `MapModes`.
    channel_width
        MHz.

    Raises
    ------
    InputError
        The two have not the same channels.
    """
    _check_channels(alms, wrong.spectra)
    lmax = sphere.lmax_of_size(alms.shape[-1])
    more = sphere.analyse(wrong.maps.astype(np.float32), lmax)
    spectra = fft.rfft(wrong.spectra, axis=0)
    return _recovery(alms, channel_width, lambda waves, degree: waves + spectra @ _modes(more, degree))


def recovery_of_cubes(alms, back, channel_width):
    """The `Recovery` of a cube T from coefficients of T and of what came back, each (n_channels, n_alm), mK.

    For what differs from T by more than a few spectra, as with gaps, each of which takes another part of T.

    Raises
    ------
    InputError
        The two have not the same channels.
    """
    _check_channels(alms, back)
    return _recovery(alms, channel_width, lambda waves, degree: fft.rfft(_modes(back, degree), axis=0))


def _check_channels(alms, back):
    if len(alms) != len(back):
        raise InputError(
            f"what came back has {len(back)} channels, what was put in {len(alms)}; both must be of one cube."
        )


def _recovery(alms, channel_width, returned):
    """The `Recovery` of coefficients; ``returned(waves, degree)`` are the waves that came back."""

    def powers(waves, degree):
        back = returned(waves, degree)
        return np.abs(waves) ** 2, np.abs(back) ** 2, (waves * back.conj()).real

    put_in, came_back, common = _sum_over_modes(alms, channel_width, powers)
    return Recovery(put_in=put_in, came_back=came_back, common=common)


def _sum_over_modes(alms, channel_width, powers):
    """`CylindricalPower` of each array (n_k, n_modes) that ``powers(waves, degree)`` gives.

    `waves` are the Fourier transforms along frequency of the real modes of one l.
    """
    n_channels, lmax = len(alms), sphere.lmax_of_size(alms.shape[-1])
    rows = []
    for degree in progress(range(lmax + 1), "powers"):
        waves = fft.rfft(_modes(alms, degree), axis=0)
        rows.append([power.mean(axis=1) for power in powers(waves, degree)])
    scale = channel_width / n_channels
    return [
        CylindricalPower(power=scale * np.array(power), n_channels=n_channels, channel_width=channel_width)
        for power in zip(*rows, strict=True)
    ]


def _modes(alms, degree):
    """The real modes of one l, (n, 2 l + 1), of coefficients (n, n_alm): those of m > 0 have two parts."""
    places = sphere.alm_index(sphere.lmax_of_size(alms.shape[-1]), degree, np.arange(degree + 1))
    own = alms[:, places].astype(complex)
    zonal, others = own[:, :1].real, np.sqrt(2) * own[:, 1:]
    return np.hstack([zonal, others.real, others.imag])


def _quotient(power, ratio):
    """power / ratio, 0 where the ratio is 0."""
    power, ratio = np.broadcast_arrays(power, ratio)
    return np.divide(power, ratio, out=np.zeros(power.shape), where=ratio != 0)
