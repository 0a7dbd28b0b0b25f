"""How a cleaned cube of images in the plane is judged and shown: P(k_perp, k_par), P(k_nu), maps."""

from dataclasses import dataclass

import numpy as np

from himap.cubes import page
from himap.errors import InputError
from himap.figures import comparisons, planes, plotting, styles
from himap.figures.tables import Table
from himap.measures import diagnostics
from himap.measures.cylindrical import CylindricalPower, cell_of, cylindrical_power
from himap.measures.power_spectra import FrequencyPower, frequency_power

__all__ = [
    "PlaneComparison",
    "PlaneSpectra",
    "compared",
    "cylindrical_figure",
    "maps_figure",
    "scales",
    "spectra_beside",
    "spectra_of",
    "spectra_part",
]

_WIDE = np.deg2rad(20)  # across an image: at its edge an angle is half a percent off the plane


@dataclass(frozen=True, kw_only=True)
class PlaneSpectra:
    """Power spectra of one cube of images.

    Attributes
    ----------
    frequency
        The `FrequencyPower`.
    cylindrical
        The `CylindricalPower`; None where the cube has none.
    why_not
        Why it has none.
    """

    frequency: FrequencyPower
    cylindrical: CylindricalPower | None = None
    why_not: str = ""


@dataclass(frozen=True, kw_only=True)
class PlaneComparison:
    """`PlaneSpectra` of what a method leaves, and of the truth."""

    recovered: PlaneSpectra
    true: PlaneSpectra

    @property
    def k(self):
        """Above 0, 1/MHz, (n_k,)."""
        return self.true.frequency.k[1:]

    @property
    def frequency(self):
        return self.recovered.frequency.power[1:]

    @property
    def true_frequency(self):
        return self.true.frequency.power[1:]

    @property
    def frequency_ratio(self):
        """P/P0, (n_k,)."""
        return diagnostics.ratio(self.frequency, self.true_frequency)


def spectra_of(cleaned):
    """The `PlaneSpectra` of a `CleanedCube`."""
    return _spectra(cleaned.cube, cleaned.residual)


def _spectra(cube, maps):
    frequency = frequency_power(maps, cube.channel_width)
    try:
        cell, _ = cell_of(cube.freqs, cube.layout.pixels.pixel_angles())
        shape = cube.layout.pixels.shape
        images = cube.on_sphere(maps).reshape(-1, *shape)
        power = cylindrical_power(images, cell, mask=cube.mask.reshape(shape))
    except InputError as error:
        return PlaneSpectra(frequency=frequency, why_not=str(error))
    return PlaneSpectra(frequency=frequency, cylindrical=power)


def spectra_beside(first):
    """`spectra_of`: of a cube in the plane nothing is gained by knowing that `first` differs little."""
    return spectra_of


def compared(cleaned, true):
    """The spectra of a `CleanedCube` beside those of the truth, (n_channels, n_seen): a `PlaneComparison`."""
    return PlaneComparison(recovered=spectra_of(cleaned), true=_spectra(cleaned.cube, true))


def scales(cube, spectra):
    """P(k_perp, k_par), where there is one, and P(k) for k > 0, each (n,)."""
    found = [] if spectra.cylindrical is None else [spectra.cylindrical.power]
    return *(power[np.isfinite(power)] for power in found), spectra.frequency.power[1:]


def spectra_part(cleaned, spectra):
    """HTML of P(k_nu) and P(k_perp, k_par), and of their ratios to the truth where it is known."""
    text = (
        "A smooth, steep rise towards the smallest k is foreground that is left; a dip there is signal that "
        "was taken. A bump at one k is a ripple of the instrument."
    )
    parts = ["<h2>Spectra</h2>", page.figure(_frequency_figure(spectra), "Frequency power spectrum", text)]
    if isinstance(spectra, PlaneComparison):
        rows = [
            ("P/P0, k < 0.03 / MHz", page.mean_ratio(spectra.k, spectra.frequency_ratio, 0, 0.03)),
            ("P/P0, beyond", page.mean_ratio(spectra.k, spectra.frequency_ratio, 0.03, np.inf)),
        ]
        parts += ["<h3>Over the truth</h3>", Table([], rows).html()]
    return [*parts, *_cylindrical_part(cleaned.cube, spectra)]


def _frequency_figure(spectra):
    style = {"label": "cleaned", "color": styles.BLUE}
    if isinstance(spectra, PlaneComparison):
        return plotting.spectrum([comparisons.panel("frequency", [(style, spectra)])])
    k, power = spectra.frequency.k[1:], spectra.frequency.power[1:]
    labels = {name: styles.AXES["frequency"][name] for name in ("xlabel", "ylabel")}
    return plotting.lines(
        [labels | {"curves": [(k, power, style)], "xscale": "log", "yscale": "log"}], columns=1, size=(6, 3.6)
    )


def _cylindrical_part(cube, spectra):
    compares = isinstance(spectra, PlaneComparison)
    own, true = (spectra.recovered, spectra.true.cylindrical) if compares else (spectra, None)
    if own.cylindrical is None:
        return [page.note(f"There is no P(k_perp, k_par): {own.why_not}")]
    angles = cube.layout.pixels.pixel_angles()
    _, z = cell_of(cube.freqs, angles)
    text = (
        f"Scales are comoving, at redshift {z:.3g}, on a flat sky, with the cosmology of the paper; the area "
        "that is not seen is left out of the normalisation. Foreground that is left fills the smallest "
        "k_par, and where the beam changes with frequency a wedge above them."
    )
    widest = np.max(cube.layout.pixels.shape * angles)
    if widest > _WIDE:
        text += f" The image is {np.rad2deg(widest):.0f} deg wide: scales are those in its middle."
    picture = cylindrical_figure(own.cylindrical, true)
    return ["<h2>Across and along the line of sight</h2>", page.figure(picture, "P(k_perp, k_par)", text)]


def cylindrical_figure(power, true=None):
    """P(k_perp, k_par), a `CylindricalPower`; beside that of the truth, and their ratio, if it is known."""
    shown, ratio = {"cleaned": power.power}, None
    if true is not None:
        shown["HI + noise"] = true.power
        ratio = (r"$P / P_0$", power.power / true.power)
    return planes.power_planes(
        shown,
        x=power.perp_edges,
        y=power.par_edges,
        xlabel=r"$k_\perp$ [$h$/Mpc]",
        ylabel=r"$k_\parallel$ [$h$/Mpc]",
        unit=r"$P$ [mK$^2$ (Mpc/$h$)$^3$]",
        ratio=ratio,
    )


def maps_figure(cleaned):
    """What is left in the channel in the middle, and its rms over channels, in the projection of the cube."""
    pixels = cleaned.cube.layout.pixels
    maps, spans = page.maps_of_residual(cleaned)
    images = {title: values.reshape(pixels.shape) for title, values in maps.items()}
    return planes.sky_images(images, pixels.celestial, span=spans)
