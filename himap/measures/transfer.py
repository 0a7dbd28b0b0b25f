"""Signal loss and foreground residual of a cleaning, from mocks whose truth is known.

A mock takes the place of the HI and noise of the data and is cleaned with their foreground, as that is known
(a parametric bootstrap, Efron 1979); or it is added to the data d, and clean(d + m) - clean(d) comes back of
it (Switzer et al. 2013). All is kept by multipole and by wavenumber along frequency, of which C_l and P(k)
are sums.
"""

import itertools
from dataclasses import dataclass, replace

import numpy as np
from scipy import fft

from himap.core.errors import InputError
from himap.core.progress import progress
from himap.maps import sphere
from himap.maps.low_rank import LowRankCube
from himap.measures import diagnostics
from himap.measures.spectra import quotient
from himap.removal.harmonic import to_modes


@dataclass(frozen=True, kw_only=True)
class HarmonicPower:
    """Power by multipole l and wavenumber k along frequency, P_l(k), of one cube or of two with each other.

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
        return self._correlation(0)

    @property
    def neighbours(self):
        """Cross C_l of channels and the next, mK^2, (n_l,); that of the last and the first is one of them."""
        return self._correlation(1)

    def _correlation(self, lag):
        """Cross C_l of channels `lag` apart, by the Wiener-Khinchin theorem, (n_l,)."""
        times = 2 * np.cos(self.k * self.channel_width * lag)  # k and -k
        times[0] /= 2
        if self.n_channels % 2 == 0:
            times[-1] /= 2
        return self.power @ times / (self.n_channels * self.channel_width)

    @property
    def frequency(self):
        """P(k) averaged over the sphere, mK^2 MHz, (n_k,): the sum over all modes."""
        return (2 * self.degrees + 1) @ self.power / (4 * np.pi)

    def less(self, other):
        """The same less the power of another cube, which may end at another l: beyond that nothing."""
        power, n_l = self.power.copy(), min(len(self.power), len(other.power))
        power[:n_l] -= other.power[:n_l]
        return replace(self, power=power)

    def binned(self, edges):
        """Means over the modes in bins of l, from one of the `edges` to below the next, (n_bins, n_k)."""
        n_modes = 2.0 * self.degrees + 1
        bins = [slice(low, high) for low, high in itertools.pairwise(edges)]
        return np.array([n_modes[inside] @ self.power[inside] / n_modes[inside].sum() for inside in bins])


@dataclass(frozen=True)
class MockPower:
    """Power of a mock, or of any cube, before and after a cleaning (Cunnington et al. 2023, Eq. 12).

    Attributes
    ----------
    input, output, cross
        `HarmonicPower` of the mock, of what comes back of it, and of the two with each other.
    """

    input: HarmonicPower
    output: HarmonicPower
    cross: HarmonicPower

    @property
    def degrees(self):
        """l, (n_l,), from 0 to where the method ends."""
        return self.input.degrees

    @property
    def k(self):
        """1/MHz, (n_k,), from 0."""
        return self.input.k

    def ratios(self, part="output"):
        """C/C0 and P/P0 of a part to the input, {"angular": (n_l,), "frequency": (n_k,)}; NaN at 0.

        Raises
        ------
        InputError
            The input has no power at some other l or k.
        """
        ratios = {}
        for kind in ("angular", "frequency"):
            power, true = (getattr(getattr(self, name), kind)[1:] for name in (part, "input"))
            ratios[kind] = np.r_[np.nan, diagnostics.ratio(power, true)]
        return ratios

    def band_means(self, ratios=None):
        """Means over `diagnostics.bands` of `ratios`, those of the output unless given, {band: (...)}."""
        return diagnostics.band_means(ratios or self.ratios(), self.degrees, self.k)


@dataclass(frozen=True, kw_only=True)
class TransferFunction:
    """The share of the power of mocks that comes back, and spectra that are corrected by it.

    The transfer function T is the cross power of residual and mock over the power of the mock (Cunnington et
    al. 2023). What a residual has beyond T times its truth has nothing in common with that truth: of members
    of a bootstrap (`himap.removal.cleaning.Cleaning.resampled`) it is foreground residual, and subtracted.
    Where it is estimated from the member itself, and subtracted from its output, so it must be from a
    residual that is corrected: then the rest is what that estimate lacks in the mean.

    Attributes
    ----------
    mocks
        A tuple with the `MockPower` of each mock.

    Raises
    ------
    InputError
        No mock.
    """

    mocks: tuple

    def __post_init__(self):
        if not self.mocks:
            raise InputError("a transfer function needs mocks, one or more, got none.")

    @property
    def degrees(self):
        """l, (n_l,), from 0 to where the method ends."""
        return self.mocks[0].degrees

    @property
    def k(self):
        """1/MHz, (n_k,), from 0."""
        return self.mocks[0].k

    def _fit(self, kind):
        """Transfer function, and mean power of the residual that is unlike the mocks, each (n,)."""
        true, residual, cross = (
            np.mean([getattr(getattr(mock, part), kind) for mock in self.mocks], axis=0)
            for part in ("input", "output", "cross")
        )
        share = quotient(cross, true)
        return share, residual - share * true

    @property
    def angular(self):
        """T(l), (n_l,): of C_l averaged over channels; 0 where there is no input."""
        return self._fit("angular")[0]

    @property
    def frequency(self):
        """T(k), (n_k,): of P(k) averaged over the sphere."""
        return self._fit("frequency")[0]

    def cylindrical(self, edges):
        """T(l, k) in bins of l from one of the `edges` to below the next, (n_bins, n_k)."""
        back = np.mean([mock.cross.binned(edges) for mock in self.mocks], axis=0)
        return quotient(back, np.mean([mock.input.binned(edges) for mock in self.mocks], axis=0))

    def corrected(self, kind, power):
        """A spectrum (n,) of a residual, less the power that has nothing in common with the mocks, over T.

        `kind` is "angular", of C_l, or "frequency", of P(k); 0 where T is.
        """
        share, unlike = self._fit(kind)
        return quotient(power - unlike, share)

    def errors(self, kind):
        """Relative error of each mock once it is corrected by the others, (n_mocks, n).

        Raises
        ------
        InputError
            Fewer than two mocks.
        """
        if len(self.mocks) < 2:
            raise InputError("error bars need two mocks or more, got one.")
        errors = []
        for n, mock in enumerate(self.mocks):
            others = replace(self, mocks=self.mocks[:n] + self.mocks[n + 1 :])
            corrected = others.corrected(kind, getattr(mock.output, kind))
            errors.append(quotient(corrected, getattr(mock.input, kind)) - 1)
        return np.array(errors)

    def sample(self, kind):
        """Power of each mock over the mean of all, less 1, (n_mocks, n): sample variance and noise.

        Times the root of n / (n - 1) of n mocks, as each is in the mean (Bessel's correction).
        """
        powers, n_mocks = np.array([getattr(mock.input, kind) for mock in self.mocks]), len(self.mocks)
        return (quotient(powers, powers.mean(axis=0)) - 1) * np.sqrt(n_mocks / max(n_mocks - 1, 1))


def harmonic_power(alms, channel_width):
    """The `HarmonicPower` of a cube of coefficients, (n_channels, n_alm), mK; channel width in MHz."""
    rows = [(np.mean(np.abs(waves) ** 2, axis=1),) for _, waves in _waves(alms)]
    return _harmonic_powers(rows, len(alms), channel_width)[0]


def mock_power(alms, output, channel_width):
    """The `MockPower` of a cube T and of what comes back of it.

    Parameters
    ----------
    alms
        Coefficients of T, (n_channels, n_alm), mK; what is compared ends where they do.
    output
        What comes back less T, a `LowRankCube`. Or its coefficients, as `alms`, where it differs from T by
        more than a few spectra, as with gaps, each of which takes another part of T.
    channel_width
        MHz.

    Raises
    ------
    InputError
        The two have not the same channels.
    """
    few = isinstance(output, LowRankCube)
    n_channels = len(output.spectra if few else output)
    if len(alms) != n_channels:
        raise InputError(
            f"the output has {n_channels} channels, the input {len(alms)}; both must be of one cube."
        )
    if few:
        more = sphere.analyse(output.maps.astype(np.float32), sphere.lmax_of_size(alms.shape[-1]))
        spectra = fft.rfft(output.spectra, axis=0)
    rows = []
    for degree, waves in _waves(alms):
        if few:
            back = waves + spectra @ to_modes(more, degree, degree)
        else:
            back = fft.rfft(to_modes(output, degree, degree), axis=0)
        powers = np.abs(waves) ** 2, np.abs(back) ** 2, (waves * back.conj()).real
        rows.append([power.mean(axis=1) for power in powers])
    return MockPower(*_harmonic_powers(rows, n_channels, channel_width))


def expected_mock_power(separation, channel_width):
    """The `MockPower` of HI and noise with the covariance C_l of a `FilteredSeparation`: no mocks, no truth.

    Of the modes n_l of HI and noise the filter W_l G_l leaves n_l - W_l G_l n_l, whose powers are sums over
    C_l: those of infinitely many mocks, of a Gaussian field less its channel means. The filter is held fixed,
    as a Wiener filter of smooth spectra nearly is. A residual spectrum is to be divided by the share of
    `cross` alone: it has as much foreground as is missing in `output`, if its covariance is the right one.
    `channel_width` in MHz.
    """
    linear, rows = separation.filter, []
    waves = fft.rfft(np.eye(len(linear.spectra[0])), axis=0)
    for degree, (spectra, estimators) in enumerate(zip(linear.spectra, linear.estimators, strict=True)):
        faint = linear.faint_at(degree) * bool(degree)
        keeps = np.eye(len(faint)) - spectra @ estimators
        cross = keeps @ faint
        covariances = faint, cross @ keeps.T, cross
        rows.append([np.sum((waves @ one) * waves.conj(), axis=1).real for one in covariances])
    return MockPower(*_harmonic_powers(rows, len(faint), channel_width))


def expected_power(spectra, channel_width):
    """The `HarmonicPower` of a field with the covariance F F^T of channels at each l.

    Of F, (n_channels, n), mK, of one l after the other; the channel width is in MHz.
    """
    rows = []
    for one in spectra:
        rows.append((np.sum(np.abs(fft.rfft(one, axis=0)) ** 2, axis=1),))
    return _harmonic_powers(rows, len(one), channel_width)[0]


def _harmonic_powers(rows, n_channels, channel_width):
    """`HarmonicPower` of each column of `rows`, which have some powers (n_k,) for each l."""
    scale, common = channel_width / n_channels, {"n_channels": n_channels, "channel_width": channel_width}
    return [HarmonicPower(power=scale * np.array(power), **common) for power in zip(*rows, strict=True)]


def _waves(alms):
    """Pairs of every l and the Fourier transforms along frequency of its real modes, (n_k, 2 l + 1)."""
    for degree in progress(range(sphere.lmax_of_size(alms.shape[-1]) + 1), "powers"):
        yield degree, fft.rfft(to_modes(alms, degree, degree), axis=0)
