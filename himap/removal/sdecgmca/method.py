"""SDecGMCA: separation of sparse sources seen through beams (paper, Sect. 3.3; C21)."""

import math
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from himap.core.errors import InputError
from himap.core.progress import progress
from himap.maps import sphere
from himap.removal import harmonic
from himap.removal.base import ForegroundRemover, Separation, parameter
from himap.removal.blurred_mixture import BlurredMixture, noise_per_mode
from himap.removal.sdecgmca.readings import OPTIONS, READINGS, resolved
from himap.removal.sdecgmca.scales import Scales
from himap.removal.separation import ordered
from himap.removal.spectral_filter import filtered, on_sky, seen_through

_MOST_MORE = 50  # iterations of the warm-up beyond its minimum, and of the refinement, as in C21's code
_LAST_MOST = 25  # largest number of turns for the last S
_PERTURBATION = 1e-10  # relative change of the start by a restart


def _option(name):
    """A parameter that defaults to the value of the reading."""
    option = OPTIONS[name]
    return parameter(None, f"{option.question}; as the reading has it", choices=tuple(option.choices))


@dataclass(frozen=True, kw_only=True)
class Step:
    """The result of one iteration.

    Attributes
    ----------
    mixing, sources
        A, (n_channels, n_sources), columns of unit length; S after its thresholds, real modes.
    refining, change, converged
        Whether the step is in the refinement; the relative change of S, NaN at first; whether that is
        below the tolerance of its stage.
    diagnostics
        In the last step: "n_warmup", "n_refinement", iterations of each stage; "warmup_change",
        "refinement_change", its last relative change of S; "condition", the condition number of A;
        "cost", the paper's cost, mK^2, with thresholds of `n_sigma` times each scale's noise. Else None.
    """

    mixing: np.ndarray
    sources: np.ndarray
    refining: bool
    change: float
    converged: bool
    diagnostics: dict | None = None


@dataclass(frozen=True, kw_only=True)
class SDecGMCA(ForegroundRemover):
    """Sparse component separation and deconvolution in turns: X_l = diag(H_l) A S_l + N_l (paper, Eq. 21).

    A starts from the principal components of the data at the lowest resolution. Then three steps alternate: S
    follows from A by least squares with a Tikhonov term epsilon at every l (C21, Eq. 21; paper, Eq. 23), its
    starlet coefficients pass soft thresholds that keep a share of those above `n_sigma` times the noise, and
    A follows from S by least squares (C21, Eqs. 14 to 16), with columns of unit length. In the warm-up the
    share grows evenly to `share` and epsilon follows from A and the beams (strategy #3); in the refinement
    epsilon follows from the spectra of the sources (#4) and large coefficients have lower thresholds. The
    foreground is H A S with a final S.

    The paper leaves choices open; each is a named parameter (`himap.removal.sdecgmca.readings.OPTIONS`), and
    `reading` is a set of them, described in `himap.removal.sdecgmca.readings`; "code" follows the public code
    of C21, as a test shows. The reading also decides whether negative entries of A are set to zero, whether
    the last S has thresholds, and what the foreground is beyond `lmax`. A coefficient equal to the threshold
    is unchanged, as in that code.

    The iteration is chaotic: it multiplies a change of A of 1e-10 to order one within about five iterations
    and does not converge, in C21's code as here, so one run is one draw. `restart` perturbs the start:
    results are stated over an ensemble of restarts. There is no other randomness.

    With ``beyond="cut"`` nothing is estimated beyond `lmax`, and all that the maps hold there is subtracted
    with the foreground: the residual ends at `lmax` (`Separation.lmax`).
    """

    name: ClassVar[str] = "sdecgmca"
    uses: ClassVar[frozenset] = frozenset({"beams", "noise", "sphere"})
    n_sources: int = parameter(3, "number of sources, n_s", minimum=1)
    regularisation: float = parameter(1e-3, "strength c of the Tikhonov term", minimum=0)
    share: float = parameter(
        0.3, "largest share K_max of significant coefficients kept", minimum=0, maximum=1, above=True
    )
    reading: str = parameter("default", "of the paper's text", choices=tuple(READINGS))
    n_scales: int = parameter(5, "number of starlet detail scales", minimum=1, maximum=12)
    lmax: int = parameter(200, "largest multipole of the inversion, at most 2 nside", minimum=4)
    mixing_scales: str = _option("mixing_scales")
    sign: str = _option("sign")
    coefficients: str = _option("coefficients")
    thresholds: str = _option("thresholds")
    least_kept: int = _option("least_kept")
    reweighted: bool = _option("reweighted")
    wavelets: str = _option("wavelets")
    floor: float = _option("floor")
    last_floor: float = _option("last_floor")
    resolution: str = _option("resolution")
    start_channel: str = _option("start_channel")
    last: str = _option("last")
    last_coefficients: str = _option("last_coefficients")
    beyond: str = _option("beyond")
    pixels: str = parameter(
        "grid", "where thresholds work: grid (exact transforms) or healpix", choices=("grid", "healpix")
    )
    noise: float | tuple | None = parameter(
        None, "noise per pixel, mK, or one for each channel; that of the instrument unless given"
    )
    n_sigma: float = parameter(3.0, "lowest threshold, in units of the noise", minimum=0)
    n_warmup: int = parameter(100, "iterations in which the share grows; 50 more may follow", minimum=1)
    n_refinement: int = parameter(25, "least number of refinements, of at most 50", minimum=1, maximum=50)
    warmup_tolerance: float = parameter(1e-2, "relative change of S that ends the warm-up", minimum=0)
    tolerance: float = parameter(1e-4, "relative change of S that ends the refinement", minimum=0)
    restart: int = parameter(0, "start of A: 0 as it is, k > 0 its k-th perturbation by 1e-10", minimum=0)
    last_tolerance: float = parameter(
        None, "relative change that ends the turns of the last S; as the reading has it", minimum=0
    )

    def __post_init__(self):
        given = {name: getattr(self, name) for name in (*OPTIONS, "last_tolerance")}
        for name, value in resolved(self.reading, given).items():
            object.__setattr__(self, name, value)
        super().__post_init__()

    def check_data(self, data):
        super().check_data(data)
        needs = {
            "thresholds": self.thresholds == "analytic",
            "coefficients": self.coefficients == "spectrum",
            "last_coefficients": self.last_coefficients == "spectrum" and self.last != "unregularised",
        }
        asking = ", ".join(f"{name}={getattr(self, name)!r}" for name, needed in needs.items() if needed)
        if asking and data.noise is None and self.noise is None:
            raise InputError(
                f"sdecgmca needs the noise of the instrument for {asking}: give noise=, mK per pixel, as one "
                "number or one for each channel (-p noise=0.04 on the command line)."
            )

    @property
    def iteration(self):
        """This method with the letter's choices for the last S: methods equal in this share their `fit`."""
        of_last = "last_floor", "last", "last_coefficients", "beyond", "last_tolerance"
        common = {name: READINGS["letter"][name] for name in of_last}
        return replace(self, reading="letter", **common)

    def fit(self, data):
        """The last `Step` for the `Data` of a sphere, shared by all methods with the same `iteration`."""
        return data.get_or_compute(data.key_of(self.iteration), lambda: self._fit(data))

    def _fit(self, data):
        (mixture, scales, start), stages = self.problem(data), {}
        for step in self.iterate(mixture, scales, start):
            stages.setdefault(step.refining, []).append(step.change)
        diagnostics = {
            "n_warmup": len(stages[False]),
            "n_refinement": len(stages[True]),
            "warmup_change": stages[False][-1],
            "refinement_change": stages[True][-1],
            "condition": float(np.linalg.cond(step.mixing)),
            "cost": self._cost(mixture, scales, step),
        }
        return replace(step, diagnostics=diagnostics)

    def problem(self, data):
        """Where `fit` of the `data` starts: `BlurredMixture`, `Scales`, and A, perturbed by `restart`."""
        nside = sphere.nside_of(data.maps)
        lmax = min(self.lmax, 2 * nside, data.beams.shape[1] - 1)
        mixture = self._mixture(data, lmax, data.modes.by_degree(lmax))
        start = mixture.start(self.n_sources, self.start_channel)
        if self.restart:
            normal = np.random.default_rng(self.restart).standard_normal(start.shape)
            start = start * (1 + _PERTURBATION * normal)
        return mixture, Scales(self, mixture.lmax, nside), start

    def _mixture(self, data, lmax, modes):
        """The `BlurredMixture` of the data up to `lmax`, given their `modes`."""
        noise = data.noise if self.noise is None else self.noise
        beams = data.beams / data.beams.max(axis=0) if self.resolution == "best" else data.beams
        return BlurredMixture(
            modes,
            beams[:, : lmax + 1],
            noise=None if noise is None else noise_per_mode(noise, *data.maps.shape),
            floor=self.floor,
        )

    def _cost(self, mixture, scales, step):
        """The paper's cost function of A and S, mK^2: misfit, and coefficients times their thresholds."""
        epsilon = mixture.epsilon_of_matrices(step.mixing, self.regularisation)
        inverses = mixture.inverses(step.mixing, epsilon)
        misfit = np.sum(mixture.residual(step.mixing, step.sources) ** 2)
        return float(misfit + scales.penalty(mixture, inverses, step.sources))

    def _separate(self, data):
        fit, nside = self.fit(data), sphere.nside_of(data.maps)
        lmax = math.isqrt(fit.sources.shape[1]) - 1
        top = min(3 * nside, data.beams.shape[1]) - 1 if self.beyond == "regularised" else lmax
        mixture = replace(self._mixture(data, top, data.modes), floor=self.last_floor)
        sources, epsilon = self.last_sources(mixture, Scales(self, lmax, nside), fit.mixing, fit.sources)
        if self.beyond != "projection":
            low_rank = on_sky(seen_through(sources, fit.mixing, mixture.beams), nside)
        else:
            wide = self._mixture(data, min(data.modes.lmax, data.beams.shape[1] - 1), data.modes)
            spectra, estimators = wide.matrices(fit.mixing), wide.least_squares(fit.mixing)
            low = None if self.last == "unregularised" else sources
            low_rank = filtered(spectra, estimators, data.project, data.modes, low)
        mixing, sources = ordered(fit.mixing, sources)
        return Separation(
            low_rank=low_rank,
            mixing=mixing,
            sources=harmonic.synthesise(sources, nside),
            converged=fit.converged,
            n_iterations=fit.diagnostics["n_warmup"] + fit.diagnostics["n_refinement"],
            lmax=lmax if self.beyond == "cut" else None,
            diagnostics=fit.diagnostics | {"floored": mixture.floored(fit.mixing, epsilon)},
        )

    def iterate(self, mixture, scales, mixing, *, done=0):
        """The `Step` of every iteration in turn: warm-up, then refinement (paper, Sect. 3.3).

        `mixture` is a `BlurredMixture`; `mixing` is A, (n_channels, n_sources), after `done` iterations of
        the warm-up: the next one needs nothing else. The column of a source that vanished stays unchanged.
        """
        window = scales.detail if self.mixing_scales == "detail" else np.ones(mixture.lmax + 1)
        sources, stages = None, ((False, self.n_warmup), (True, self.n_refinement))
        for refining, least in stages:
            tolerance = self.tolerance if refining else self.warmup_tolerance
            counts = range(1, _MOST_MORE + 1) if refining else range(1 + done, least + _MOST_MORE + 1)
            memory = None
            for count in progress(counts, "refinement" if refining else "warm-up"):
                share = self.share if refining else min(self.share / least * count, self.share)
                if refining and self.coefficients == "spectrum":
                    epsilon = mixture.epsilon_of_spectra(sources, self.regularisation)
                else:
                    epsilon = mixture.epsilon_of_matrices(mixing, self.regularisation)
                inverses, last = mixture.inverses(mixing, epsilon), sources
                sources, coefficients = scales.threshold(mixture, inverses, share, memory)
                memory = coefficients if refining and self.reweighted else None
                fitted = mixture.fit(sources * window[harmonic.degrees(mixture.lmax)], window)
                if self.sign == "nonnegative":
                    fitted = np.maximum(fitted * np.where(fitted.sum(axis=0) < 0, -1, 1), 0)
                length = np.linalg.norm(fitted, axis=0)
                mixing = np.where(length > 0, fitted / np.where(length > 0, length, 1), mixing)
                change = math.nan if last is None else _change(last, sources)
                converged = change <= tolerance
                yield Step(
                    mixing=mixing, sources=sources, refining=refining, change=change, converged=converged
                )
                if converged and count >= least:
                    break

    def last_sources(self, mixture, scales, mixing, sources):
        """S for the last A (paper, Eq. 23), real modes, and the epsilon used, (n_l, n_sources or 1).

        `sources` are those of the last iteration up to their own lmax. If `mixture`, a `BlurredMixture` with
        the floor of the last S, extends further, epsilon there is that of strategy #3 unless S takes several
        turns.
        """
        if self.last == "unregularised":
            epsilon = np.zeros((mixture.lmax + 1, 1))
            return mixture.sources(mixture.inverses(mixing, 0)), epsilon
        epsilon = mixture.epsilon_of_matrices(mixing, self.regularisation)
        if self.last == "once":
            epsilon = np.repeat(epsilon, mixing.shape[1], axis=1)
            if self.last_coefficients == "spectrum":
                of_spectra = mixture.epsilon_of_spectra(sources, self.regularisation)
                epsilon[: len(of_spectra)] = of_spectra
            return mixture.sources(mixture.inverses(mixing, epsilon)), epsilon
        last, memory = None, None
        for count in range(_LAST_MOST + 1):
            if count and self.last_coefficients == "spectrum":
                epsilon = mixture.epsilon_of_spectra(last, self.regularisation)
            if self.last == "thresholded":
                inverses = mixture.inverses(mixing, epsilon)
                sources, coefficients = scales.threshold(mixture, inverses, 1.0, memory)
                memory = coefficients if count and self.reweighted else None
            else:
                sources = mixture.sources(mixture.inverses(mixing, epsilon))
            # The first S, from strategy #3, is only the start of the turns.
            if count > 1 and _change(last, sources) < self.last_tolerance:
                break
            last = sources
        return sources, epsilon


def _change(last, sources):
    """Relative change of the sources, for the stopping rules (paper, Sect. 3.3)."""
    size = np.linalg.norm(sources)
    return np.linalg.norm(sources - last) / size if size else 0.0
