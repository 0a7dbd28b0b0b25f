"""A page on a cleaned cube: spectra, leading modes, maps of what is left, and what to look at."""

from dataclasses import asdict, dataclass

import numpy as np

from himap import plotting
from himap.cubes import page
from himap.errors import InputError
from himap.removal.pca import channel_covariance
from himap.spectra import angular_power, frequency_power

__all__ = [
    "Recovered",
    "maps_figure",
    "modes_figure",
    "recovered_spectra",
    "spectra_figure",
    "write_report",
]

_FAINT = 1e-3  # of the faintest eigenvalue before: what cleaning took altogether is drawn there


@dataclass(frozen=True, kw_only=True)
class Recovered:
    """C_l averaged over channels and P(k) of cleaned maps, and of the truth where it is known.

    `degrees`, `angular` and `true_angular` (n_l,), mK^2; `k`, `frequency` and `true_frequency` (n_k,), 1/MHz
    and mK^2 MHz. The true ones are None without a truth.
    """

    degrees: np.ndarray
    angular: np.ndarray
    k: np.ndarray
    frequency: np.ndarray
    true_angular: np.ndarray | None = None
    true_frequency: np.ndarray | None = None


def recovered_spectra(cleaned, truth=None):
    """Both spectra of a `CleanedCube`, 2 <= l <= 2 nside and k > 0; with a mask C_l are decoupled.

    Parameters
    ----------
    cleaned
        The `CleanedCube`.
    truth
        A `Cube` of what a perfect cleaning would leave, with the same channels.

    Raises
    ------
    InputError
        A truth of another resolution, other channels, or that does not see what was cleaned.
    """
    cube = cleaned.cube
    degrees, angular, k, frequency = _spectra(cube, cleaned.residual)
    if truth is None:
        return Recovered(degrees=degrees, angular=angular, k=k, frequency=frequency)
    _check_truth(cube, truth)
    seen = truth.maps[:, cube.mask[truth.mask]]
    _, true_angular, _, true_frequency = _spectra(cube, seen)
    return Recovered(
        degrees=degrees,
        angular=angular,
        k=k,
        frequency=frequency,
        true_angular=true_angular,
        true_frequency=true_frequency,
    )


def _check_truth(cube, truth):
    if truth.nside != cube.nside or not np.array_equal(truth.freqs, cube.freqs):
        raise InputError(
            f"the truth must have the channels and the nside of the cube, {len(cube.freqs)} and "
            f"{cube.nside}; got {len(truth.freqs)} and {truth.nside}."
        )
    if (cube.mask & ~truth.mask).any():
        raise InputError("the truth must see all pixels of the cube.")


def _spectra(cube, maps):
    """(l, C_l averaged over channels, k, P) of seen maps."""
    mask = None if cube.whole else cube.mask
    power = angular_power(cube.on_sphere(maps), mask=mask)
    inside = (power.degrees >= 2) & (power.degrees <= 2 * cube.nside)
    lines = frequency_power(maps, cube.channel_width)
    return power.degrees[inside], power.mean[inside], lines.k[1:], lines.power[1:]


def write_report(cleaned, path, *, truth=None):
    """Write the page, one HTML file that needs nothing else."""
    found = recovered_spectra(cleaned, truth)
    parts = [*_head(cleaned), *_spectra_part(found), *_modes_part(cleaned), *_maps_part(cleaned)]
    path.write_text(page.page(f"Cleaned with {cleaned.method.name}", parts), encoding="utf-8")


def _head(cleaned):
    cube, method = cleaned.cube, cleaned.method
    parameters = [f"{name} = {value}" for name, value in asdict(method).items()]
    facts = {
        "method": ", ".join([method.name, *parameters]),
        "channels": f"{len(cube.freqs)}, {cube.freqs[0]:g} to {cube.freqs[-1]:g} MHz",
        "sky": f"nside {cube.nside}, {cube.mask.mean():.1%} seen",
        "rms of what came": f"{_rms(cube.maps):.4g} mK",
        "rms of what is left": f"{_rms(cleaned.residual):.4g} mK",
        "peak masking": f"{cleaned.flagged:.2%} of the voxels replaced before the foreground was looked for",
        "iterations": f"{cleaned.separation.n_iterations}"
        + ("" if cleaned.separation.converged else ", stopped before it converged"),
    }
    notes = [*cube.remarks, *filter(None, [cleaned.separation.remark])]
    return [page.table(facts.items()), *map(page.note, notes)]


def _rms(maps):
    """Rms of maps less their channel means, mK."""
    return float(np.sqrt(np.mean([pixels.var(dtype=np.float64) for pixels in maps])))


def spectra_figure(found):
    """Both spectra of a `Recovered`, with their ratios to the truth where that is known."""
    style = {"label": "cleaned", "color": "#0072B2"}
    sides = [
        ((r"multipole $\ell$", r"$C_\ell$ [mK$^2$]", r"$C_\ell / C_\ell^\mathrm{true}$"), found.degrees),
        ((r"$k_\nu$ [MHz$^{-1}$]", r"$P$ [mK$^2$ MHz]", r"$P / P^\mathrm{true}$"), found.k),
    ]
    values = [(found.angular, found.true_angular), (found.frequency, found.true_frequency)]
    panels = []
    for ((xlabel, ylabel, ratio_label), x), (cleaned, true) in zip(sides, values, strict=True):
        panel = {"xlabel": xlabel, "ylabel": ylabel}
        if true is None:
            panel |= {"curves": [(x, cleaned, style)], "xscale": "log", "yscale": "log"}
        else:
            panel |= {"title": "", "true": (x, true), "ratio_label": ratio_label}
            panel["curves"] = [(style, x, cleaned, true)]
        panels.append(panel)
    return plotting.lines(panels) if found.true_angular is None else plotting.spectrum(panels)


def _spectra_part(found):
    text = (
        "A smooth, steep rise towards the smallest k is foreground that is left; a dip there is signal that "
        "was taken. A bump at one k is a ripple of the instrument."
    )
    parts = [
        "<h2>Spectra</h2>",
        page.figure(spectra_figure(found), "Angular and frequency power spectrum", text),
    ]
    if found.true_angular is not None:
        angular, frequency = found.angular / found.true_angular, found.frequency / found.true_frequency
        rows = [
            ("C/C0, l < 10", _mean(found.degrees, angular, 0, 10)),
            ("C/C0, beyond", _mean(found.degrees, angular, 10, np.inf)),
            ("P/P0, k < 0.03 / MHz", _mean(found.k, frequency, 0, 0.03)),
            ("P/P0, beyond", _mean(found.k, frequency, 0.03, np.inf)),
        ]
        parts += ["<h3>Over the truth</h3>", page.table(rows)]
    return parts


def _mean(x, values, low, high):
    inside = (x > low) & (x < high)
    return f"{values[inside].mean():.3f}" if inside.any() else "no such scale"


def modes_figure(cleaned):
    """Eigenvalues of the channel covariance before and after, and the mixing matrix."""
    cube = cleaned.cube
    before, after = (
        np.linalg.eigvalsh(channel_covariance(maps))[::-1] for maps in (cube.maps, cleaned.residual)
    )
    numbers = np.arange(1, len(before) + 1)
    mixing = cleaned.separation.mixing
    panels = [
        {
            "title": "Eigenvalues of the channel covariance",
            "xlabel": "component",
            "ylabel": r"variance [mK$^2$]",
            "xscale": "log",
            "yscale": "log",
            "curves": [
                (numbers, before, {"label": "as it came", "color": "#D55E00"}),
                (numbers, np.maximum(after, before.min() * _FAINT), {"label": "cleaned", "color": "#0072B2"}),
            ],
        },
        {
            "title": "Spectra of the sources",
            "xlabel": r"$\nu$ [MHz]",
            "ylabel": "column of A",
            "legend": {"loc": "center left", "bbox_to_anchor": (1, 0.5)},
            "curves": [
                (cube.freqs, column, style)
                for column, style in zip(
                    mixing.T, plotting.sequence(range(1, mixing.shape[1] + 1)), strict=True
                )
            ],
        },
    ]
    return plotting.lines(panels)


def _modes_part(cleaned):
    text = (
        "Foreground components stand above the slow decline of HI and noise. Cleaned eigenvalues that stand "
        "out still mean too few sources; columns of A that are one spike mean too many."
    )
    return [
        "<h2>Leading modes</h2>",
        page.figure(modes_figure(cleaned), "Eigenvalues and mixing matrix", text),
    ]


def maps_figure(cleaned):
    """What is left in the channel in the middle, and its rms over channels."""
    cube, middle = cleaned.cube, len(cleaned.cube.freqs) // 2
    maps = {
        f"left at {cube.freqs[middle]:g} MHz": cleaned.residual[middle],
        "rms over channels": np.sqrt(np.mean(np.square(cleaned.residual, dtype=np.float64), axis=0)),
    }
    spans = {title: tuple(np.percentile(pixels, (1, 99))) for title, pixels in maps.items()}
    return plotting.sky_maps({title: _with_gaps(cube, one) for title, one in maps.items()}, span=spans)


def _maps_part(cleaned):
    text = (
        "HI and noise look alike in all directions. Structure that follows the Galaxy or point sources is "
        "foreground; lines of sight whose rms stands out can be left out of the spectra."
    )
    return ["<h2>What is left</h2>", page.figure(maps_figure(cleaned), "Maps of the residual", text)]


def _with_gaps(cube, pixels):
    out = np.full(len(cube.mask), np.nan)
    out[cube.mask] = pixels
    return out
