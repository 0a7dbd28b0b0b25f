"""Self-contained HTML pages on a cleaned cube, with tables, figures and notes."""

import base64
import html
import io
import warnings
from dataclasses import asdict
from pathlib import Path

import numpy as np

from himap import __version__
from himap.core.errors import InputError
from himap.cubes.cleaning import check_cleaned
from himap.cubes.cube import rms_of
from himap.cubes.spectra import PATCH, compared, patch_power, spectra_of
from himap.figures import planes, plotting, styles
from himap.figures.tables import Table
from himap.measures.cylindrical import cell_of
from himap.measures.diagnostics import Comparison, band_means
from himap.removal.covariance import channel_covariance

_STYLE = """
:root { color-scheme: light dark; }
body { font: 16px/1.5 system-ui, sans-serif; max-width: 60rem; margin: 2rem auto; padding: 0 1rem; }
img { max-width: 100%; background: white; border-radius: 4px; }
.himap-table { overflow-x: auto; }
table { border-collapse: collapse; }
td, th { padding: .2rem .5rem .2rem 0; }
td:first-child, th:first-child { white-space: nowrap; }
figure { margin: 1.5rem 0; } figcaption { font-size: .9rem; opacity: .85; }
"""
_WIDE = np.deg2rad(20)  # size of an image at whose edge angles deviate from the plane by half a percent
_FAINT = 1e-3  # of the smallest eigenvalue before cleaning: removed modes are drawn there
_CLEANED = {"label": "cleaned", "color": styles.BLUE}
_SPECTRA = (
    "A smooth, steep rise towards the smallest k is foreground residual; a dip there is signal loss. A bump "
    "at one k is an instrumental ripple."
)
_ANGULAR = (
    " A rise towards the largest multipoles, after a method that uses the beam, means that the assumed beam "
    "is wrong."
)
_WEDGE = (
    "Foreground residual occupies the smallest k_par, and where the beam changes with frequency a wedge "
    "above them."
)
_MODES = (
    "Foreground components exceed the slow decline of HI and noise. Eigenvalues above HI and noise after "
    "cleaning mean too few sources; spectra that are a single spike mean too many. If a method projects and "
    "no peaks are masked, the last eigenvalues after cleaning, one per source, are zero."
)
_MAPS = (
    "HI and noise are statistically isotropic. Structure that follows the Galaxy or point sources is "
    "foreground residual; lines of sight with an outlying rms can be excluded from the spectra."
)


def write_page(path, title, parts, *, said=()):
    """Write a page of `parts`, each HTML or a `Table`, followed by sentences on what was assumed."""
    head = [
        '<!doctype html><html lang="en"><head><meta charset="utf-8">',
        '<meta name="viewport" content="width=device-width, initial-scale=1">',
        f"<title>{html.escape(title)}</title><style>{_STYLE}</style></head><body>",
        f"<h1>{html.escape(title)}</h1>",
        f"<p>himap {__version__}</p>",
    ]
    texts = [part.html() if isinstance(part, Table) else part for part in parts]
    texts += map(note, said)
    Path(path).write_text("\n".join([*head, *texts, "</body></html>\n"]), encoding="utf-8")


def note(text):
    """HTML of a highlighted paragraph."""
    return f"<p><strong>Note:</strong> {html.escape(text)}</p>"


def figure(picture, alt, text, *, title=""):
    """HTML of a matplotlib figure with a caption below and a title above."""
    buffer = io.BytesIO()
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message="Creating legend")  # that takes long on a busy machine
        picture.savefig(buffer, format="png", dpi=100, bbox_inches="tight")
    data = base64.b64encode(buffer.getvalue()).decode()
    return (
        (f"<h2>{html.escape(title)}</h2>\n" if title else "")
        + f'<figure><img alt="{html.escape(alt)}" src="data:image/png;base64,{data}">'
        + f"<figcaption>{html.escape(text)}</figcaption></figure>"
    )


def write_report(cleaned, path, *, truth=None, spectra=None, more=(), said=None):
    """Write the page on a `CleanedCube`: spectra, leading modes, maps of the residual, and remarks.

    Parameters
    ----------
    cleaned, path
        The `CleanedCube`, and the path of the output.
    truth
        A `Cube` of the residual of a perfect cleaning.
    spectra
        Result of `compared` if there is a truth, otherwise of `spectra_of`, if already computed.
    more
        Parts of the page after the spectra, as in `write_page`.
    said
        Sentences on what was assumed; default: those of the cube.
    """
    check_cleaned(cleaned)
    if spectra is None:
        spectra = spectra_of(cleaned) if truth is None else compared(cleaned, truth)
    on_plane = cleaned.cube.image is not None
    alt, text = ("Frequency", _SPECTRA) if on_plane else ("Angular and frequency", _SPECTRA + _ANGULAR)
    parts = _head(cleaned, cleaned.cube.said if said is None else said)
    parts.append(figure(spectra_figure(spectra), f"{alt} power spectrum", text, title="Spectra"))
    if isinstance(spectra, Comparison):
        means = band_means(spectra.ratios, spectra.degrees, spectra.k)
        rows = [(name, f"{mean:.3g}") for name, mean in means.items()]
        parts += ["<h3>Over the truth</h3>", Table([], rows)]
    if on_plane:
        parts.append(cylindrical_part(cleaned, truth))
    parts += [
        *more,
        figure(modes_figure(cleaned), "Eigenvalues and mixing matrix", _MODES, title="Leading modes"),
        figure(maps_figure(cleaned), "Maps of the residual", _MAPS, title="Residual"),
    ]
    write_page(path, f"Cleaned with {cleaned.method.name}", parts)


def _head(cleaned, said):
    cube, method, pixels = cleaned.cube, cleaned.method, cleaned.cube.layout.pixels
    parameters = [f"{name} = {value}" for name, value in asdict(method).items()]
    facts = {
        "method": ", ".join([method.name, *parameters]),
        "channels": f"{len(cube.freqs)}, {cube.freqs[0]:g} to {cube.freqs[-1]:g} MHz",
        "sky": f"{pixels.described(cube.layout.unit)}; {cube.mask.mean():.1%} observed",
        "rms of the input": f"{rms_of(cube.maps, cube.missing):.4g} mK",
        "rms of the residual": f"{rms_of(cleaned.residual, cube.missing):.4g} mK",
        "peak masking": f"{cleaned.flagged:.2%} of the voxels replaced before the foreground was estimated",
        "iterations": f"{cleaned.separation.n_iterations}",
    }
    return [Table([], facts.items()), *map(note, [*said, *cleaned.remarks])]


def cylindrical_part(cleaned, truth=None):
    """A part of a page: `patch_power` of a `CleanedCube`, and of the truth, a `Cube`, if known."""
    cube, ratio = cleaned.cube, None
    try:
        power, n_patches = patch_power(cube, cleaned.residual)
        shown = {"cleaned": power.power}
        if truth is not None:
            shown["HI + noise"] = patch_power(cube, cube.seen_of(truth))[0].power
            ratio = (r"$P / P_0$", power.power / shown["HI + noise"])
    except InputError as error:
        return note(f"No P(k_perp, k_par): {error}")
    picture = planes.power_planes(
        shown,
        x=power.perp_edges,
        y=power.par_edges,
        xlabel=r"$k_\perp$ [$h$/Mpc]",
        ylabel=r"$k_\parallel$ [$h$/Mpc]",
        unit=r"$P$ [mK$^2$ (Mpc/$h$)$^3$]",
        ratio=ratio,
    )
    title = "Across and along the line of sight"
    return figure(picture, "P(k_perp, k_par)", _about_patches(cube, n_patches), title=title)


def _about_patches(cube, n_patches):
    """The caption of P(k_perp, k_par): scales and area."""
    if cube.image is None:
        return (
            f"Mean over {n_patches} flat patches of {np.rad2deg(PATCH):.0f} deg, up to the Nyquist "
            "wavenumber of the pixels, not corrected for the pixel window. Scales are comoving, with the "
            f"cosmology of the paper. {_WEDGE}"
        )
    angles = cube.layout.pixels.pixel_angles()
    text = (
        f"Scales are comoving, at redshift {cell_of(cube.freqs, angles)[1]:.3g}, on a flat sky, with the "
        f"cosmology of the paper; the unobserved area is excluded from the normalisation. {_WEDGE}"
    )
    widest = np.max(cube.layout.pixels.shape * angles)
    if widest > _WIDE:
        text += f" The image is {np.rad2deg(widest):.0f} deg wide: scales are those at its centre."
    return text


def spectra_figure(spectra):
    """Figure of the spectra from `spectra_of`, or of those from `compared` with their ratios to the truth."""
    if isinstance(spectra, Comparison):
        kinds = ("angular", "frequency") if len(spectra.degrees) else ("frequency",)
        return plotting.spectrum([plotting.comparison_panel(k, [(_CLEANED, spectra)]) for k in kinds])
    angular, frequency = spectra.angular, spectra.frequency
    powers = {"angular": (angular.degrees, angular.mean)} if len(angular.degrees) else {}
    powers["frequency"] = frequency.k, frequency.power
    panels = [panel(kind, [(x[x > 0], y[x > 0], _CLEANED)]) for kind, (x, y) in powers.items()]
    return plotting.lines(panels, **({"columns": 1, "size": (6, 3.6)} if len(panels) == 1 else {}))


def panel(kind, curves, **settings):
    """A panel of `plotting.lines` with "eigenvalues" or, from `styles.AXES`, power, on logarithmic axes."""
    known = {"eigenvalues": {"xlabel": "component", "ylabel": r"variance [mK$^2$]"}} | styles.AXES
    labels = {name: known[kind][name] for name in ("xlabel", "ylabel")}
    return labels | {"curves": curves, "xscale": "log", "yscale": "log"} | settings


def modes_figure(cleaned):
    """Figure of eigenvalues of the channel covariance before and after cleaning, and the mixing matrix."""
    before, after = (
        np.linalg.eigvalsh(channel_covariance(maps))[::-1] for maps in (cleaned.maps, cleaned.residual)
    )
    numbers, mixing = np.arange(1, len(before) + 1), cleaned.separation.mixing
    looks = styles.sequence([f"source {n + 1}" for n in range(mixing.shape[1])])
    curves = [
        (numbers, before, {"label": "observed", "color": styles.VERMILION}),
        (numbers, np.maximum(after, before.min() * _FAINT), _CLEANED),
    ]
    sources = {
        "title": "Spectra of the sources",
        "xlabel": styles.CHANNELS,
        "ylabel": "mixing coefficient",
        "legend": {"loc": "center left", "bbox_to_anchor": (1, 0.5)},
        "curves": [(cleaned.cube.freqs, one, look) for one, look in zip(mixing.T, looks, strict=True)],
    }
    title = "Eigenvalues of the channel covariance"
    return plotting.lines([panel("eigenvalues", curves, title=title), sources])


def maps_figure(cleaned):
    """Figure of the residual in the central channel, and its rms over channels; blank where not observed."""
    cube, middle, maps = cleaned.cube, len(cleaned.cube.freqs) // 2, {}
    there = True if cube.missing is None else ~cube.missing[middle]
    n_seen = len(cube.freqs) if cube.missing is None else np.count_nonzero(~cube.missing, axis=0)
    seen = {
        f"residual at {cube.freqs[middle]:g} MHz": np.where(there, cleaned.residual[middle], np.nan),
        "rms over channels": np.sqrt(np.einsum("cp,cp->p", *[cleaned.residual] * 2) / n_seen),
    }
    for title, values in seen.items():
        maps[title] = np.full(cube.layout.pixels.shape, np.nan)
        maps[title].flat[cube.mask] = values
    spans = {title: tuple(np.nanpercentile(values, (1, 99))) for title, values in seen.items()}
    if cube.image is None:
        return plotting.sky_maps(maps, span=spans)
    return planes.sky_images(maps, cube.layout.pixels.celestial, span=spans)
