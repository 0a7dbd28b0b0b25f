"""SDecGMCA: separation of sparse sources seen through beams (paper, Sect. 3.3; C21)."""

from collections import deque
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
from himap.removal.sdecgmca.scales import PIXELS, Scales
from himap.removal.separation import ordered
from himap.removal.spectral_filter import on_sky, seen_through, through_beams

_MOST_MORE = 50  # iterations of the warm-up beyond its least number, and of the refinement, as in C21's code
_LAST_MOST = 25  # turns of the last S


def _option(name):
    """A parameter that is as the reading has it unless given."""
    option = OPTIONS[name]
    return parameter(None, f"{option.question}; as the reading has it", choices=tuple(option.choices))


@dataclass(frozen=True, kw_only=True)
class Step:
    """The result of one iteration.

    Attributes
    ----------
    mixing
        A, columns of unit length, (n_channels, n_sources).
    sources
        S after its thresholds, real modes (n_sources, (lmax + 1)^2).
    refining
        False in the warm-up.
    settled
        Whether S changed by less than the tolerance of its stage.
    """

    mixing: np.ndarray
    sources: np.ndarray
    refining: bool
    settled: bool


@dataclass(frozen=True, kw_only=True)
class SDecGMCA(ForegroundRemover):
    """Sparse component separation and deconvolution in turns: X_l = diag(H_l) A S_l + N_l (paper, Eq. 21).

    A starts from the principal components of the data brought to the lowest resolution. Then, in turns, S
    comes from A by least squares with a Tikhonov term epsilon at every l (C21, Eq. 21; paper, Eq. 23), its
    starlet coefficients pass soft thresholds that keep a share of those above `n_sigma` times the noise, and
    A comes from S by least squares (C21, Eqs. 14 to 16), negative entries set to zero, columns of unit
    length. In the warm-up the share grows evenly to `share` and epsilon follows A and the beams (strategy
    #3); in the refinement epsilon follows the spectra of the sources (#4) and large coefficients have lower
    thresholds. The foreground is H A S with the last S without thresholds, up to `lmax`.

    The paper leaves choices; each is a parameter by name (`himap.removal.sdecgmca.readings.OPTIONS`), and
    `reading` is a set of them: "default", "letter" (nothing that contradicts the text), "code" (the steps
    of the public code of C21, which this follows, as a test shows), "follow-up". The coefficient that is
    itself the threshold stays unchanged, as in that code. There is no randomness.

    With ``beyond="cut"`` nothing is found beyond `lmax`, and all that is there goes with the foreground: the
    residual ends at `lmax` (`Separation.lmax`), and is compared with a truth that ends there too.
    """

    name: ClassVar[str] = "sdecgmca"
    uses: ClassVar[frozenset] = frozenset({"beams", "noise", "sphere"})
    ends_by_count: ClassVar[bool] = True
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
    resolution: str = _option("resolution")
    start: str = _option("start")
    last: str = _option("last")
    last_coefficients: str = _option("last_coefficients")
    beyond: str = _option("beyond")
    pixels: str = parameter(
        "grid", "where thresholds work: grid (exact transforms) or healpix", choices=tuple(PIXELS)
    )
    noise: float | tuple | None = parameter(
        None, "noise per pixel, mK, or one for each channel; that of the instrument unless given"
    )
    n_sigma: float = parameter(3.0, "lowest threshold, in units of the noise", minimum=0)
    n_warmup: int = parameter(100, "iterations in which the share grows; 50 more may follow", minimum=1)
    n_refinement: int = parameter(25, "least number of refinements, of at most 50", minimum=1, maximum=50)
    warmup_tolerance: float = parameter(1e-2, "relative change of S that ends the warm-up", minimum=0)
    tolerance: float = parameter(1e-4, "relative change of S that ends the refinement", minimum=0)
    last_tolerance: float = parameter(
        None, "relative change that ends the turns of the last S; as the reading has it", minimum=0
    )

    @property
    def ends(self):
        return self.beyond == "cut"

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

    def _separate(self, data):
        maps, beams, modes = data.centred, data.beams, data.modes
        nside, noise = sphere.nside_of(maps), data.noise if self.noise is None else self.noise
        lmax = min(self.lmax, 2 * nside, beams.shape[1] - 1)
        windows = beams / beams.max(axis=0) if self.resolution == "best" else beams
        mixture = BlurredMixture(
            modes.upto(lmax),
            windows[:, : lmax + 1],
            noise=None if noise is None else noise_per_mode(noise, *maps.shape),
            floor=self.floor,
        )
        scales = Scales.of(self, lmax, nside)
        steps = enumerate(self.iterate(mixture, scales, mixture.start(self.n_sources, self.start)), 1)
        ((n_iterations, step),) = deque(steps, maxlen=1)
        if self.beyond == "regularised":
            top = min(3 * nside, windows.shape[1]) - 1
            mixture = replace(mixture, modes=modes.upto(top), beams=windows[:, : top + 1])
        sources = self.last_sources(mixture, scales, step.mixing, step.sources)
        if self.beyond != "projection":
            low_rank = on_sky(seen_through(sources, step.mixing, mixture.beams), nside)
        else:  # all l by projection, and up to lmax what the last S is more than that
            low_rank = through_beams(maps, step.mixing, windows, modes)
            if self.last != "unregularised":
                more = sources - mixture.sources(mixture.inverses(step.mixing, 0))
                low_rank += on_sky(seen_through(more, step.mixing, mixture.beams), nside)
        mixing, sources = ordered(step.mixing, sources)
        return Separation(
            low_rank=low_rank,
            mixing=mixing,
            sources=sphere.synthesise(harmonic.from_modes(sources), nside),
            converged=step.settled,
            n_iterations=n_iterations,
            lmax=lmax if self.ends else None,
        )

    def iterate(self, mixture, scales, mixing, *, done=0):
        """The `Step` of every iteration in turn: warm-up, then refinement (paper, Sect. 3.3).

        Parameters
        ----------
        mixture, scales
            `BlurredMixture` and `Scales`.
        mixing
            A at the start, (n_channels, n_sources).
        done
            Iterations of the warm-up that led to this A; in the warm-up A is all that the next one needs.
        """
        window = scales.detail if self.mixing_scales == "detail" else np.ones(mixture.lmax + 1)
        sources = None
        for refining in (False, True):
            least, tolerance = (
                (self.n_refinement, self.tolerance) if refining else (self.n_warmup, self.warmup_tolerance)
            )
            memory = scales.empty_memory(mixing.shape[1]) if refining and self.reweighted else None
            most = max(least, _MOST_MORE) if refining else least + _MOST_MORE
            counts = range(1 if refining else 1 + done, most + 1)
            for count in progress(counts, "refinement" if refining else "warm-up"):
                share = self.share if refining else min(self.share / least * count, self.share)
                if refining and self.coefficients == "spectrum":
                    epsilon = mixture.epsilon_of_spectra(sources, self.regularisation)
                else:
                    epsilon = mixture.epsilon_of_matrices(mixing, self.regularisation)
                inverses, last = mixture.inverses(mixing, epsilon), sources
                sources, memory = scales.threshold(mixture, inverses, share, memory)
                mixing = self._unit_columns(
                    mixture.fit(sources * window[harmonic.degrees(mixture.lmax)], window), mixing
                )
                settled = last is not None and _change(last, sources) <= tolerance
                yield Step(mixing=mixing, sources=sources, refining=refining, settled=settled)
                if settled and count >= least:
                    break

    def _unit_columns(self, mixing, last):
        """A with its sign and columns of unit length; that of a source that vanished stays as it was."""
        if self.sign == "nonnegative":
            mixing = np.maximum(mixing * np.where(mixing.sum(axis=0) < 0, -1, 1), 0)
        length = np.linalg.norm(mixing, axis=0)
        return np.where(length > 0, mixing / np.where(length > 0, length, 1), last)

    def last_sources(self, mixture, scales, mixing, sources):
        """S of the last A (paper, Eq. 23), real modes (n_sources, (lmax + 1)^2).

        `sources` are those of the last iteration, up to their own lmax; where `mixture` goes further, epsilon
        is that of strategy #3 there unless S is found in several turns.
        """
        if self.last == "unregularised":
            return mixture.sources(mixture.inverses(mixing, 0))
        epsilon = mixture.epsilon_of_matrices(mixing, self.regularisation)
        if self.last == "once":
            epsilon = np.repeat(epsilon, mixing.shape[1], axis=1)
            if self.last_coefficients == "spectrum":
                of_spectra = mixture.epsilon_of_spectra(sources, self.regularisation)
                epsilon[: len(of_spectra)] = of_spectra
            return mixture.sources(mixture.inverses(mixing, epsilon))
        inverses, last, memory = mixture.inverses(mixing, epsilon), None, None
        for count in range(_LAST_MOST + 1):
            if self.last == "thresholded":
                sources, memory = scales.threshold(mixture, inverses, 1.0, memory)
                if count == 0 and self.reweighted:
                    memory = scales.empty_memory(len(sources))
            else:
                sources = mixture.sources(inverses)
            # The first S is that of strategy #3, which the turns only start from.
            if count > 1 and _change(last, sources) < self.last_tolerance:
                break
            last = sources
            if self.last_coefficients == "spectrum":
                epsilon = mixture.epsilon_of_spectra(sources, self.regularisation)
                inverses = mixture.inverses(mixing, epsilon)
        return sources


def _change(last, sources):
    """Relative change of the sources, for the stopping rules (paper, Sect. 3.3)."""
    size = np.linalg.norm(sources)
    return np.linalg.norm(sources - last) / size if size else 0.0
