"""Fast independent component analysis (paper, Sect. 3.1.2)."""

import warnings
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from himap.core.errors import InputError
from himap.removal.base import ForegroundRemover, Separation, parameter
from himap.removal.pca import principal_components
from himap.removal.separation import ordered


@dataclass(frozen=True, kw_only=True)
class FastICA(ForegroundRemover):
    """Independent components: the rotation of the principal components that is least Gaussian.

    The `n_sources` principal components U^T X, each divided by its standard deviation D^1/2, are
    *white*: Z = D^-1/2 U^T X. They remain white under every rotation W. FastICA (Hyvarinen 1999, with all
    rows of W at once) chooses the rotation whose sources S = W Z have the largest contrast E[G(S)], a
    measure of non-Gaussianity. The mixing matrix is A = U D^1/2 W^T.

    W cancels in A S = U U^T X: **the foreground is that of PCA**, to the last bit. Only the sources differ.

    Mixing columns are scaled to unit length, so the sources are in mK; they come in the order of
    their variance, the largest entry of each column positive. If the maps have fewer independent
    directions than `n_sources`, the additional sources are zero.
    """

    name: ClassVar[str] = "fastica"
    n_sources: int = parameter(3, "number of components to remove", minimum=1)
    contrast: str = parameter(
        "logcosh", "contrast function: logcosh, exp or cube", choices=("logcosh", "exp", "cube")
    )
    max_iterations: int = parameter(500, "largest number of iterations", minimum=1)
    tolerance: float = parameter(1e-6, "rotation between iterations at which to stop", minimum=0, above=True)

    def check_data(self, data):
        super().check_data(data)
        if data.seed is None:
            raise InputError("fastica starts from a random rotation: pass rng=np.random.default_rng(seed).")

    def _separate(self, data):
        # Imported here: no other method needs it, and the import takes as long as all of himap.
        from sklearn.decomposition import fastica
        from sklearn.exceptions import ConvergenceWarning

        axes = principal_components(data, self.n_sources)
        scale = np.sqrt(np.mean(axes.sources**2, axis=1))
        # Smaller scales are only the rounding of float32 maps, spread over channels.
        rank = np.count_nonzero(scale > scale[0] * np.finfo(np.float32).eps / np.sqrt(len(data.freqs)))
        mixing, sources = np.zeros_like(axes.mixing), np.zeros_like(axes.sources)
        n_iterations = 0
        if rank:
            white = axes.sources[:rank] / scale[:rank, None]
            options = {"fun": self.contrast, "max_iter": self.max_iterations, "tol": self.tolerance}
            start = {"whiten": False, "w_init": data.rng.standard_normal((rank, rank))}
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", ConvergenceWarning)  # the base class issues its own warning
                _, rotation, _, n_iterations = fastica(
                    white.T, **options, **start, compute_sources=False, return_n_iter=True
                )
            mixing[:, :rank], sources[:rank] = ordered(
                axes.mixing[:, :rank] * scale[:rank] @ rotation.T, rotation @ white
            )
        return Separation(
            low_rank=axes.foreground,
            mixing=mixing,
            sources=sources,
            converged=n_iterations < self.max_iterations,  # otherwise equal to max_iterations
            n_iterations=n_iterations,
        )
