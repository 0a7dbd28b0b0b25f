"""Signal loss without the truth: mocks of HI, cleaned with an observation or in place of its HI.

A mock is the truth of another sky: HI and noise, seen through the same beam.
"""

from dataclasses import dataclass, replace

import numpy as np

from himap.core.checks import checked_fields, parameter
from himap.core.errors import InputError
from himap.maps import sphere
from himap.measures.transfer import TransferFunction, expected_power, mock_power
from himap.paper import cleaned, pipeline
from himap.removal import harmonic
from himap.removal.smooth_posterior import foreground_given, products_of
from himap.sky.cosmology import HIModel
from himap.sky.hi import hi_maps
from himap.store.store import product

_MOST_MOCKS = 10_000  # of one sky


@dataclass(frozen=True, kw_only=True)
class Mock:
    """The truth of another sky than that of the data, and changes of its HI."""

    seed: int = parameter(1, "seed of the mock's sky; must not be that of the data", minimum=0, maximum=2**63)
    bias: float = parameter(1.0, "factor on the bias of HI", minimum=0, above=True)
    abundance: float = parameter(
        1.0, "factor on the abundance of HI, and so on its maps", minimum=0, above=True
    )
    gaussian: bool = parameter(False, "with the powers of the lognormal field, but none of its peaks")

    def __post_init__(self):
        checked_fields(self)


@dataclass(frozen=True, kw_only=True)
class _Biased(HIModel):
    factor: float

    def bias(self, z):
        return self.factor * super().bias(z)


@product
def hi_alms_of_mock(sky, mock):
    """Harmonic coefficients of the HI of a mock before the beam, up to 3 nside - 1, complex64.

    `sky` is that of the mock, a `Survey`.
    """
    if mock.bias == 1:
        alms = np.array(pipeline.hi_alms_of_sky(sky))
    else:
        maps = hi_maps(sky, sky.rng("hi"), model=_Biased(factor=mock.bias))
        alms = sphere.analyse(maps, n_iter=sphere.N_ITER_FLAT)
    if mock.gaussian:
        # Modes of each l are rotated into each other, equally in all channels, which changes no power of any
        # channel or of two: each is now a sum over all of its l, Gaussian by the central limit theorem.
        modes, rng = harmonic.to_modes(alms), sky.rng("phases")
        for block in harmonic.blocks(modes):
            turn, triangle = np.linalg.qr(rng.standard_normal((block.shape[1], block.shape[1])))
            block[:] = block @ (turn * np.sign(np.diag(triangle)))  # uniform in rotations (Mezzadri 2007)
        alms = harmonic.from_modes(modes).astype(alms.dtype)
    alms *= np.float32(mock.abundance)
    return alms


def mock_alms(case, mock):
    """Coefficients of a mock through the beam of a case, less channel means, (n_channels, n_alm) complex64.

    Raises
    ------
    InputError
        If the mock is the sky of the case itself.
    """
    if mock.seed == case.survey.seed:
        raise InputError(f"a mock must be of another sky than the data, got the seed {mock.seed} for both.")
    other = replace(case, survey=replace(case.survey, seed=mock.seed))
    hi = None if mock == Mock(seed=mock.seed) else hi_alms_of_mock(other.survey.sky, mock)
    return pipeline.truth_alms(other, hi=hi)


@product
def recovered(case, removers, mock, mask_peaks=True):
    """Recovery of a mock in an observation, a list with the `MockPower` of each method.

    All estimates are repeated (`Cleaning.with_mock`). If the method ends at some l, so does the comparison.
    """
    alms, maps = _alms_and_maps(case, mock)
    mocked, powers = cleaned.cleaning(case, removers[0], mask_peaks).with_mock(maps), []
    for remover in removers:
        before, found = cleaned.separation(case, remover, mask_peaks), _separated(case, mocked, remover)
        powers.append(_power(case, alms, before, found))
    return powers


def _alms_and_maps(case, mock):
    alms = mock_alms(case, mock)
    return alms, sphere.synthesise_cube(alms, case.survey.nside, n_channels=len(alms), label="mock")


def _separated(case, mocked, remover):
    """The `Separation` of a `Cleaning` with a mock by a method."""
    return mocked.with_method(remover, rng=case.survey.rng(f"removal {remover.name}")).separation


def _power(case, alms, before, after):
    """The `MockPower` of a mock with coefficients `alms`, given the `Separation` without and with it."""
    own = alms if after.lmax is None else sphere.alms_upto(alms, min(after.lmax, case.survey.lmax))
    wrong = cleaned.difference(case, before.foreground, after.foreground)
    return mock_power(own, wrong, case.survey.channel_width)


@product
def foreground_like(case, mocks):
    """The `SmoothForeground` of a case, if HI and noise are like some mocks."""
    alms = (mock_alms(case, mock) for mock in mocks)
    return foreground_given(_with_peaks(case), products_of(alms, case.survey.lmax), len(mocks))


def _with_peaks(case):
    """The `Data` of a case with its peaks, as mocks have peaks, too."""
    data = cleaned.data_of(case, pipeline.observation(case).maps)
    data.known["modes"] = lambda: pipeline.analysis(case, False)
    return data


@product
def foreground_left(case, remover, mocks, mask_peaks=True):
    """The `HarmonicPower` of the foreground residual of a method on a case (`foreground_like`)."""
    known, found = foreground_like(case, mocks), cleaned.separation(case, remover, mask_peaks)
    return _left(case, known, _with_peaks(case), remover, found)


def _left(case, known, data, remover, separation):
    """`foreground_left` for `Data` with the foreground `known`, given the `Separation` of a method."""
    beams = data.beams if "beams" in remover.uses else None
    return expected_power(known.residual_spectra(data, separation, beams), case.survey.channel_width)


@product
def resampled(case, removers, mock, mocks, mask_peaks=True):
    """Members of a parametric bootstrap, whose truth is a mock: a list with the `MockPower` of each method.

    For all methods the foreground is drawn from its posterior if HI and noise are like some `mocks`
    (`SmoothForeground`). The estimate of a method with few spectra would have less foreground and more HI.
    The power of the foreground residual is estimated from the member and the other mocks, as
    `foreground_left` estimates it from the data, and subtracted from the output.
    """
    alms, maps = _alms_and_maps(case, mock)
    rng = replace(case.survey, seed=mock.seed).rng("foreground")
    known = foreground_like(case, mocks)
    drawn = known.draw(_with_peaks(case), rng)
    member, powers = cleaned.cleaning(case, removers[0], mask_peaks).resampled(maps, drawn), []
    known = known.of_member(member.data, alms)
    for remover in removers:
        found = _separated(case, member, remover)
        power = _power(case, alms, drawn, found)
        left = _left(case, known, member.data, remover, found)
        powers.append(replace(power, output=power.output.less(left)))
    return powers


def transfer_functions(case, removers, mocks):
    """{method: `TransferFunction`} from the recovery of several `Mock` in an observation (`recovered`)."""
    return _by_method(removers, [recovered(case, tuple(removers), mock) for mock in mocks])


def bootstrap(case, removers, mocks):
    """{method: `TransferFunction`} from members of a bootstrap of a case, each with one of several `Mock`.

    They correct the power of a residual less `foreground_left`.
    """
    calls = [(case, tuple(removers), mock, tuple(mocks)) for mock in mocks]
    return _by_method(removers, [resampled(*call) for call in calls])


def _by_method(removers, powers):
    several = zip(removers, zip(*powers, strict=True), strict=True)
    return {remover: TransferFunction(mocks=mocks) for remover, mocks in several}


@product
def own_recovery(case, remover, mask_peaks=True):
    """The `MockPower` of the truth itself: what a transfer function should give without the truth."""
    found = cleaned.separation(case, remover, mask_peaks)
    wrong = cleaned.error(case, remover, mask_peaks)
    return mock_power(pipeline.truth_alms(case, found.lmax), wrong, case.survey.channel_width)


def mocks_of_sky(seed, n_mocks):
    """`n_mocks` default mocks for the sky of a seed, a tuple, with seeds that no sky or other mock has."""
    first = _MOST_MOCKS * (seed + 1)
    return tuple(Mock(seed=first + n) for n in range(n_mocks))


def first_mocks(n_mocks, cases):
    """`n_mocks` default mocks for `cases` with ascending seeds, the same for any number of cases: from 1.

    If skies have these seeds, the mocks are those of `mocks_of_sky` for the first sky.
    """
    first = cases[0].survey.seed
    return [*mocks_of_sky(first, n_mocks)] if first <= n_mocks else [Mock(seed=1 + n) for n in range(n_mocks)]
