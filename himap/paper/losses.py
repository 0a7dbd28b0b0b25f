"""The error of a component method, taken apart: foreground that was left, HI that was lost."""

import numpy as np

from himap.maps import sphere
from himap.maps.low_rank import centred
from himap.paper import cleaned, pipeline
from himap.removal.analysis import analysed
from himap.removal.spectral_filter import through_beams


def error_parts(case, remover):
    """(foreground left, HI lost, truth) of a component method that was given peak-masked maps.

    What such a method takes away is a projection P of the maps, once its mixing matrix is found, so that what
    it leaves of foreground F and truth T, whose peaks D were masked, is off by

        left - T = (F - P F) - P (T - D).

    P is on the columns of A, or for a method that knows the beam, on diag(H_l) A at every l. What an epsilon
    of its inversion keeps back is on the side of the foreground. Of a method that ends at some l, all is up
    to that l.

    Parameters
    ----------
    case
        `pipeline.Case`.
    remover
        A method with a number of sources.

    Returns
    -------
    foreground_left, hi_lost, truth
        (n_channels, n_pix) float32, mK, less their channel means.
    """
    observed, found = pipeline.observation(case), cleaned.separation(case, remover)
    known = centred(observed.truth - (observed.maps - pipeline.peak_masked(case).maps))
    if found.lmax is not None:
        known = sphere.cut_cube(known, found.lmax)
    if "beams" in remover.uses:
        relative = observed.beams / observed.beams.max(axis=0)
        hi_lost = through_beams(known, found.mixing, relative, analysed(known)).cube()
    else:
        basis = np.linalg.qr(found.mixing)[0].astype(np.float32)
        hi_lost = basis @ (basis.T @ known)
    return cleaned.error(case, remover).cube() + hi_lost, hi_lost, centred(pipeline.truth(case, found.lmax))
