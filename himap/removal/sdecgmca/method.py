"""SDecGMCA: separation of sparse sources seen through beams (paper, Sect. 3.3; C21)."""

from collections import deque
from dataclasses import dataclass, replace
from typing import ClassVar

from himap.core.checks import checked_noise
from himap.core.errors import InputError
from himap.maps import sphere
from himap.removal import harmonic
from himap.removal.base import ForegroundRemover, Separation, parameter
from himap.removal.beam_projection import on_sky, seen_through, through_beams
from himap.removal.blurred_mixture import noise_per_mode
from himap.removal.sdecgmca.iteration import iterations, last_sources
from himap.removal.sdecgmca.pixels import Grid, HEALPix
from himap.removal.sdecgmca.problem import Problem
from himap.removal.sdecgmca.readings import OPTIONS, READINGS, resolved
from himap.removal.sdecgmca.scales import Scales
from himap.removal.separation import ordered

_PIXELS = {"grid": Grid, "healpix": HEALPix}
_BY_READING = (*OPTIONS, "last_tolerance")


def _option(name):
    """A parameter that is as the reading has it unless given."""
    option = OPTIONS[name]
    return parameter(None, f"{option.question}; as the reading has it", choices=tuple(option.choices))


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
    `reading` is a set of them: "default", "letter" (nothing that the text speaks against), "code" (the steps
    of the public code of C21, which this follows, as a test shows), "follow-up". The coefficient that is
    itself the threshold stays whole, as in that code. There is no randomness.

    With ``beyond="cut"`` nothing is found beyond `lmax`, and all that is there goes with the foreground: the
    maps that are left end at `lmax` (`Separation.lmax`), and are compared with a truth that ends there too.
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
        "grid", "where thresholds work: grid (exact transforms) or healpix", choices=tuple(_PIXELS)
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
        options = resolved(self.reading, {name: getattr(self, name) for name in _BY_READING})
        for name, value in options.items():
            object.__setattr__(self, name, value)
        super().__post_init__()
        object.__setattr__(self, "noise", checked_noise("noise", self.noise))

    def check(self, n_channels):
        super().check(n_channels)
        checked_noise("noise", self.noise, n_channels)

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
        problem = Problem(
            modes=modes.upto(lmax),
            beams=windows[:, : lmax + 1],
            noise=None if noise is None else noise_per_mode(noise, *maps.shape),
            floor=self.floor,
        )
        scales = Scales(
            lmax,
            self.n_scales,
            pixels=_PIXELS[self.pixels](lmax, nside),
            wavelets=self.wavelets,
            n_sigma=self.n_sigma,
            least_kept=self.least_kept,
            analytic=self.thresholds == "analytic",
        )
        start = problem.start(self.n_sources, self.start)
        steps = enumerate(iterations(self, problem, scales, start), 1)
        ((n_iterations, step),) = deque(steps, maxlen=1)
        sources, low_rank = self._last(maps, problem, scales, step, windows, modes)
        mixing, sources = ordered(step.mixing, sources)
        return Separation(
            low_rank=low_rank,
            mixing=mixing,
            sources=sphere.synthesise(harmonic.from_modes(sources), nside),
            converged=step.settled,
            n_iterations=n_iterations,
            lmax=lmax if self.ends else None,
        )

    def _last(self, maps, problem, scales, step, windows, modes):
        """The last S, real modes to the l that it is found to, and the foreground, a `MapModes`."""
        if self.beyond == "regularised":
            top = min(3 * sphere.nside_of(maps), windows.shape[1]) - 1
            problem = replace(problem, modes=modes.upto(top), beams=windows[:, : top + 1])
        mixing = step.mixing
        sources = last_sources(self, problem, scales, mixing, step.sources)
        nside = sphere.nside_of(maps)
        if self.beyond != "projection":
            return sources, on_sky(seen_through(sources, mixing, problem.beams), nside)
        # All l by projection, and up to lmax what the last S is more than that.
        taken = through_beams(maps, mixing, windows, modes)
        if self.last != "unregularised":
            more = sources - problem.sources(problem.inverses(mixing, 0))
            taken += on_sky(seen_through(more, mixing, problem.beams), nside)
        return sources, taken
