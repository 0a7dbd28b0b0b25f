"""Signal loss and foreground residual of a cleaning, measured on mocks with known truth.

A mock replaces the HI and noise of the data and is cleaned with their estimated foreground (a parametric
bootstrap, Efron 1979); or it is added to the data d, and clean(d + m) - clean(d) is its output (Switzer
et al. 2013). All powers are kept by multipole and by wavenumber along frequency; C_l and P(k) are sums
of these.
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
    """Power by multipole l and wavenumber k along frequency, P_l(k): of one cube, or cross power of two.

    Attributes
    ----------
    power
        P_l(k), mK^2 MHz, (n_l, n_k): the mean over the modes of one l of |dnu FFT_nu a_lm|^2 over the band.
    n_channels, channel_width
        Number of channels of the cube, and their width in MHz.
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
        """Cross C_l of neighbouring channels, mK^2, (n_l,); includes the pair of last and first channel."""
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
        """This power less that of another cube, which may end at another l: beyond, zero is subtracted."""
        power, n_l = self.power.copy(), min(len(self.power), len(other.power))
        power[:n_l] -= other.power[:n_l]
        return replace(self, power=power)

    def binned(self, edges):
        """Means over modes in bins of l, each from one of the `edges` to below the next, (n_bins, n_k)."""
        n_modes = 2.0 * self.degrees + 1
        bins = [slice(low, high) for low, high in itertools.pairwise(edges)]
        return np.array([n_modes[inside] @ self.power[inside] / n_modes[inside].sum() for inside in bins])


@dataclass(frozen=True)
class MockPower:
    """Power of a mock, or of any cube, before and after a cleaning (Cunnington et al. 2023, Eq. 12).

    Attributes
    ----------
    input, output, cross
        `HarmonicPower` of the mock, of the recovered mock, and the cross power of both.
    """

    input: HarmonicPower
    output: HarmonicPower
    cross: HarmonicPower

    @property
    def degrees(self):
        """l, (n_l,), from 0 to the last l of the method."""
        return self.input.degrees

    @property
    def k(self):
        """1/MHz, (n_k,), from 0."""
        return self.input.k

    def ratios(self, part="output"):
        """C/C0 and P/P0 of one part over the input, {"angular": (n_l,), "frequency": (n_k,)}; NaN at 0.

        Raises
        ------
        InputError
            If the input has no power at some other l or k.
        """
        ratios = {}
        for kind in ("angular", "frequency"):
            power, true = (getattr(getattr(self, name), kind)[1:] for name in (part, "input"))
            ratios[kind] = np.r_[np.nan, diagnostics.ratio(power, true)]
        return ratios

    def band_means(self, ratios=None):
        """Means of `ratios`, default those of the output, over `diagnostics.bands`, {band: (...)}."""
        return diagnostics.band_means(ratios or self.ratios(), self.degrees, self.k)


@dataclass(frozen=True, kw_only=True)
class TransferFunction:
    """The recovered share of the power of mocks, and spectra corrected by it.

    The transfer function T is the cross power of residual and mock over the power of the mock (Cunnington et
    al. 2023). The part of a residual beyond T times its truth is uncorrelated with that truth: for members of
    a bootstrap (`himap.removal.cleaning.Cleaning.resampled`) it is foreground residual, and is subtracted.
    If it is estimated from each member and subtracted from its output, the same must be done to a residual
    before correction; the uncorrelated part is then the mean error of that estimate.

    Attributes
    ----------
    mocks
        A tuple with the `MockPower` of each mock.

    Raises
    ------
    InputError
        If there is no mock.
    """

    mocks: tuple

    def __post_init__(self):
        if not self.mocks:
            raise InputError("a transfer function needs mocks, one or more, got none.")

    @property
    def degrees(self):
        """l, (n_l,), from 0 to the last l of the method."""
        return self.mocks[0].degrees

    @property
    def k(self):
        """1/MHz, (n_k,), from 0."""
        return self.mocks[0].k

    def _fit(self, kind):
        """Transfer function, and mean power of the residual uncorrelated with the mocks, each (n,)."""
        true, residual, cross = (
            np.mean([getattr(getattr(mock, part), kind) for mock in self.mocks], axis=0)
            for part in ("input", "output", "cross")
        )
        share = quotient(cross, true)
        return share, residual - share * true

    @property
    def angular(self):
        """T(l), (n_l,), for C_l averaged over channels; 0 where there is no input."""
        return self._fit("angular")[0]

    @property
    def frequency(self):
        """T(k), (n_k,), for P(k) averaged over the sphere."""
        return self._fit("frequency")[0]

    def cylindrical(self, edges):
        """T(l, k) in bins of l, each from one of the `edges` to below the next, (n_bins, n_k)."""
        back = np.mean([mock.cross.binned(edges) for mock in self.mocks], axis=0)
        return quotient(back, np.mean([mock.input.binned(edges) for mock in self.mocks], axis=0))

    def corrected(self, kind, power):
        """A spectrum (n,) of a residual, less the power uncorrelated with the mocks, divided by T.

        `kind` is "angular" for C_l, or "frequency" for P(k); the result is 0 where T is.
        """
        share, unlike = self._fit(kind)
        return quotient(power - unlike, share)

    def errors(self, kind):
        """Relative error of each mock after correction by the others, (n_mocks, n).

        Raises
        ------
        InputError
            If there are fewer than two mocks.
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
        """Power of each mock over the mean of all, minus 1, (n_mocks, n): sample variance and noise.

        Multiplied by sqrt(n / (n - 1)) for n mocks, as each is part of the mean (Bessel's correction).
        """
        powers, n_mocks = np.array([getattr(mock.input, kind) for mock in self.mocks]), len(self.mocks)
        return (quotient(powers, powers.mean(axis=0)) - 1) * np.sqrt(n_mocks / max(n_mocks - 1, 1))


def harmonic_power(alms, channel_width):
    """The `HarmonicPower` of a cube of coefficients, (n_channels, n_alm), mK; channel width in MHz."""
    rows = [(np.mean(np.abs(waves) ** 2, axis=1),) for _, waves in _waves(alms)]
    return _harmonic_powers(rows, len(alms), channel_width)[0]


def mock_power(alms, output, channel_width):
    """The `MockPower` of a cube T and its recovered version.

    Parameters
    ----------
    alms
        Coefficients of T, (n_channels, n_alm), mK; both are compared up to their lmax.
    output
        Recovered cube minus T, a `LowRankCube`. Or coefficients of the recovered cube, like `alms`, if it
        differs from T by more than a few spectra, for example with gaps.
    channel_width
        MHz.

    Raises
    ------
    InputError
        If the two do not have the same channels.
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
    """The `MockPower` for HI and noise with the covariance C_l of a `FilteredSeparation`: no mocks, no truth.

    Modes n_l of HI and noise are recovered by the filter W_l G_l as n_l - W_l G_l n_l, whose powers are sums
    over C_l: the limit of infinitely many mocks of a Gaussian field less its channel means. The filter is
    held fixed, which is nearly true of a Wiener filter of smooth spectra. Divide a residual spectrum by the
    share of `cross` alone: if the covariance is correct, the residual has as much foreground as `output`
    lacks. `channel_width` is in MHz.
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
    """The `HarmonicPower` of a field with channel covariance F F^T at each l.

    `spectra` yields F, (n_channels, n), mK, for each l in turn; the channel width is in MHz.
    """
    rows = []
    for one in spectra:
        rows.append((np.sum(np.abs(fft.rfft(one, axis=0)) ** 2, axis=1),))
    return _harmonic_powers(rows, len(one), channel_width)[0]


def _harmonic_powers(rows, n_channels, channel_width):
    """`HarmonicPower` of each column of `rows`, which yield several powers (n_k,) for each l."""
    scale, common = channel_width / n_channels, {"n_channels": n_channels, "channel_width": channel_width}
    return [HarmonicPower(power=scale * np.array(power), **common) for power in zip(*rows, strict=True)]


def _waves(alms):
    """Pairs of every l and the Fourier transforms along frequency of its real modes, (n_k, 2 l + 1)."""
    for degree in progress(range(sphere.lmax_of_size(alms.shape[-1]) + 1), "powers"):
        yield degree, fft.rfft(to_modes(alms, degree, degree), axis=0)
