"""What is known of each number of sources of a method, with and without the truth."""

from dataclasses import dataclass

import numpy as np
from sklearn.decomposition import PCA as SklearnPCA

from himap.measures import n_sources
from himap.measures.diagnostics import JUDGED
from himap.measures.transfer import TransferFunction
from himap.paper import cleaned, pipeline
from himap.paper.mocks import own_recovery, recovered
from himap.removal.blurred_mixture import one_resolution_eigenvalues
from himap.removal.covariance import channel_covariance
from himap.store.store import product

SETTLED = 0.03
"""Relative change of a band of a corrected spectrum with one source more, below which it is settled."""


@product
def eigenvalues(case, aware=False):
    """Of the channel covariance of the peak-masked maps, (n_channels,) descending, mK^2.

    For an `aware` method those of the maps at the resolution of the worst channel, to l = 2 nside.
    """
    if not aware:
        return np.linalg.eigvalsh(channel_covariance(pipeline.basis(case, True)))[::-1]
    beams = case.beam.of_survey(case.survey).total
    return one_resolution_eigenvalues(pipeline.analysis(case), beams, 2 * case.survey.nside)


@product
def minka(case):
    """The number of principal components that has most evidence (Minka 2000), scikit-learn's."""
    lines = pipeline.basis(case, True).T.astype(float)
    return int(SklearnPCA(n_components="mle", svd_solver="covariance_eigh").fit(lines).n_components_)


@dataclass(frozen=True, kw_only=True)
class SourceNumberCriteria:
    """What is known of each number of sources of one method on one case.

    Attributes
    ----------
    counts
        The numbers, (n,), ascending by one.
    bic, aic
        Information criteria, (n,) (`n_sources.information`).
    eigenvalues
        (n_channels,), descending, mK^2.
    change, corrected_change
        To the next number, (n - 1,) (`n_sources.changes`): of C_l and P(k), and of their bands over the
        transfer function.
    error, corrected_error
        How far the worst band is from the truth, (n,), as it is and over the transfer function.
    """

    counts: np.ndarray
    bic: np.ndarray
    aic: np.ndarray
    eigenvalues: np.ndarray
    change: np.ndarray
    corrected_change: np.ndarray
    error: np.ndarray
    corrected_error: np.ndarray

    @property
    def best(self):
        """The number whose residual is nearest to the truth, without a correction."""
        return int(self.counts[self.error.argmin()])

    def recommended(self):
        """{criterion: number of sources, or None}, of all but "minka"; none of them knows the truth."""
        return {
            "bic": int(self.counts[self.bic.argmin()]),
            "aic": int(self.counts[self.aic.argmin()]),
            "eigenvalues": n_sources.n_significant(self.eigenvalues),
            "stability": n_sources.settled(self.change, self.counts),
            "mocks": n_sources.settled(self.corrected_change, self.counts, SETTLED),
        }


def source_number_criteria(case, removers, mocks):
    """`SourceNumberCriteria` of a method with each number of sources, `removers`, ascending by one."""
    counts = np.array([remover.n_sources for remover in removers])
    own = [own_recovery(case, remover) for remover in removers]
    columns = zip(*(recovered(case, tuple(removers), mock) for mock in mocks), strict=True)

    def in_bands(several):
        """Means of C_l and P(k), or of the same over mocks, in the judged bands, (n, n_bands)."""
        rows = []
        for spectra in several:
            known = {kind: getattr(spectra, kind) for kind in ("angular", "frequency")}
            rows.append([mean for band, mean in own[0].band_means(known).items() if band in JUDGED])
        return np.array(rows)

    residual, true = in_bands([one.output for one in own]), in_bands([one.input for one in own])
    corrected = residual / in_bands([TransferFunction(mocks=column) for column in columns])
    variances = np.array([cleaned.assessment(case, one).power_spectra.angular.variance for one in removers])
    n_pix = case.survey.n_pix
    bic, aic = (n_sources.information(variances, counts, n_pix, kind=kind) for kind in ("bic", "aic"))
    return SourceNumberCriteria(
        counts=counts,
        bic=bic,
        aic=aic,
        eigenvalues=eigenvalues(case, "beams" in removers[0].uses),
        change=n_sources.changes([(one.output.angular[2:], one.output.frequency[1:]) for one in own]),
        corrected_change=n_sources.changes([row[:, None] for row in corrected]),
        error=np.abs(residual / true - 1).max(axis=1),
        corrected_error=np.abs(corrected / true - 1).max(axis=1),
    )
