"""Criteria for the number of sources of a method, with and without the truth."""

import numpy as np
import pandas as pd
from sklearn.decomposition import PCA as SklearnPCA

from himap.measures import n_sources
from himap.measures.diagnostics import JUDGED
from himap.paper import cleaned, pipeline
from himap.paper.mocks import own_recovery, transfer_functions
from himap.removal.blurred_mixture import one_resolution_eigenvalues
from himap.removal.covariance import channel_covariance
from himap.store.store import product

SETTLED = 0.03
"""Relative change of a band of a corrected spectrum with one more source, below which it is settled."""


@product
def eigenvalues(case, aware=False):
    """Eigenvalues of the channel covariance of the peak-masked maps, (n_channels,) descending, mK^2.

    For an `aware` method, of the maps at the resolution of the worst channel, up to l = 2 nside.
    """
    if not aware:
        return np.linalg.eigvalsh(channel_covariance(pipeline.basis(case, True)))[::-1]
    beams = case.beam.of_survey(case.survey).total
    return one_resolution_eigenvalues(pipeline.analysis(case), beams, 2 * case.survey.nside)


@product
def minka(case):
    """The number of principal components with the highest evidence (Minka 2000), from scikit-learn."""
    lines = pipeline.basis(case, True).T.astype(float)
    return int(SklearnPCA(n_components="mle", svd_solver="covariance_eigh").fit(lines).n_components_)


def source_number_criteria(case, removers, mocks):
    """Criteria for each number of sources of a method, `removers`, ascending by one.

    A DataFrame indexed by the number. Columns: "bic" and "aic" (`n_sources.information`); "change" and
    "corrected_change" to the next number (`n_sources.changes`), of C_l and P(k), and of their bands divided
    by the transfer function, NaN for the last; "error" and "corrected_error", the deviation of the worst band
    from the truth, as it is and divided by the transfer function.
    """
    counts = np.array([remover.n_sources for remover in removers])
    own = [own_recovery(case, remover) for remover in removers]
    transfers = transfer_functions(case, removers, mocks)

    def in_bands(several):
        """Means of C_l and P(k), or of these over mocks, in the judged bands, (n, n_bands)."""
        rows = []
        for spectra in several:
            known = {kind: getattr(spectra, kind) for kind in ("angular", "frequency")}
            rows.append([mean for band, mean in own[0].band_means(known).items() if band in JUDGED])
        return np.array(rows)

    residual, true = in_bands([one.output for one in own]), in_bands([one.input for one in own])
    corrected = residual / in_bands([transfers[remover] for remover in removers])
    variances = np.array([cleaned.assessment(case, one).power_spectra.angular.variance for one in removers])
    table = pd.DataFrame(index=counts)
    for kind in ("bic", "aic"):
        table[kind] = n_sources.information(variances, counts, case.survey.n_pix, kind=kind)
    spectra = [(one.output.angular[2:], one.output.frequency[1:]) for one in own]
    table["change"] = np.append(n_sources.changes(spectra), np.nan)
    table["corrected_change"] = np.append(n_sources.changes([row[:, None] for row in corrected]), np.nan)
    table["error"] = np.abs(residual / true - 1).max(axis=1)
    table["corrected_error"] = np.abs(corrected / true - 1).max(axis=1)
    return table


def recommended(criteria, values):
    """{criterion: number of sources, or None}, for all except "minka"; none of them knows the truth.

    Arguments are the results of `source_number_criteria` and `eigenvalues`.
    """
    counts = criteria.index
    return {
        "bic": int(criteria["bic"].idxmin()),
        "aic": int(criteria["aic"].idxmin()),
        "eigenvalues": n_sources.n_significant(values),
        "stability": n_sources.settled(criteria["change"].to_numpy(), counts),
        "mocks": n_sources.settled(criteria["corrected_change"].to_numpy(), counts, SETTLED),
    }
