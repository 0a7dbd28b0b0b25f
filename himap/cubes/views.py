"""How a cleaned cube is judged and shown, by its pixels: HEALPix maps, or images in the plane."""

from dataclasses import dataclass, replace

import numpy as np

from himap.core.errors import InputError
from himap.cubes import page
from himap.figures import planes, plotting, styles
from himap.figures.tables import Table
from himap.measures.cylindrical import CylindricalPower, cell_of, cylindrical_power
from himap.measures.diagnostics import Comparison
from himap.measures.low_rank_spectra import angular_power_pair, difference, masked_alms
from himap.measures.spectra import FrequencyPower, PowerSpectra, angular_power, frequency_power

_WIDE = np.deg2rad(20)  # across an image: at its edge an angle is half a percent off the plane
_BANDS = {  # of ratios to the truth: (quantity, l or k above, up to)
    "C/C0, l < 10": ("angular", 0, 10),
    "C/C0, beyond": ("angular", 10, np.inf),
    "P/P0, k < 0.03 / MHz": ("frequency", 0, 0.03),
    "P/P0, beyond": ("frequency", 0.03, np.inf),
}
_TEXT = (
    "A smooth, steep rise towards the smallest k is foreground that is left; a dip there is signal that "
    "was taken. A bump at one k is a ripple of the instrument."
)


def views_of(cube):
    """The `SphereViews` or `ImageViews` of a cube."""
    return SphereViews() if cube.layout.pixels.whole_sky else ImageViews()


class SphereViews:
    """C_l, P(k_nu) and maps of the sky."""

    def spectra_of(self, cleaned):
        """The `PowerSpectra` of a `CleanedCube`; with a mask C_l are decoupled."""
        cube = cleaned.cube
        return PowerSpectra(
            angular=angular_power(cube.on_sphere(cleaned.residual), mask=cube.sky_mask),
            frequency=frequency_power(cleaned.residual, cube.channel_width),
        )

    def spectra_beside(self, first):
        """`spectra_of`, for cubes that differ from a first one by a few spectra, without analysing each anew.

        Parameters
        ----------
        first
            A `CleanedCube`; the others are the same cube, cleaned in another way.

        Returns
        -------
        callable
            It takes one of them.
        """
        mask = first.cube.sky_mask
        maps = first.cube.on_sphere(first.residual)
        alms = masked_alms(maps, mask=mask)

        def spectra(cleaned):
            more = difference(cleaned.cube.on_sphere(cleaned.residual), maps, mask=mask)
            return PowerSpectra(
                angular=angular_power_pair(alms, more, mask=mask)[0],
                frequency=frequency_power(cleaned.residual, cleaned.cube.channel_width),
            )

        return spectra

    def compared(self, cleaned, true):
        """Both spectra beside those of the truth, (n_channels, n_seen): a `Comparison`."""
        cube, cubes = cleaned.cube, (cleaned.residual, true)
        recovered, true = (cube.on_sphere(maps) for maps in cubes)
        mask = cube.sky_mask
        more = difference(recovered, true, mask=mask)
        angular = angular_power_pair(masked_alms(true, mask=mask), more, mask=mask)
        recovered, true = (
            PowerSpectra(angular=power, frequency=frequency_power(maps, cube.channel_width))
            for power, maps in zip(angular, cubes, strict=True)
        )
        return Comparison.of(recovered, true, l_top=2 * cube.nside)

    def scales(self, cube, spectra):
        """C_l for 2 <= l <= 2 nside, and P(k) for k > 0."""
        inside = (spectra.angular.degrees >= 2) & (spectra.angular.degrees <= 2 * cube.nside)
        return spectra.angular.mean[inside], spectra.frequency.power[1:]

    def spectra_part(self, cleaned, spectra):
        """HTML of both spectra, and of their ratios to the truth where it is known."""
        text = (
            f"{_TEXT} A rise towards the largest multipoles, after a method that uses the beam, means that "
            "the beam is not that of the cube."
        )
        picture = spectra_figure(spectra)
        parts = page.section("Spectra", picture, "Angular and frequency power spectrum", text)
        return [*parts, *_ratios_part(spectra)] if isinstance(spectra, Comparison) else parts

    def maps_figure(self, cleaned):
        """The residual in the channel in the middle, and its rms over channels."""
        maps, spans = _maps_of(cleaned)
        return plotting.sky_maps(maps, span=spans)


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
    true
        `PlaneSpectra` of the truth, where it is known.
    """

    frequency: FrequencyPower
    cylindrical: CylindricalPower | None = None
    why_not: str = ""
    true: "PlaneSpectra | None" = None

    @property
    def comparison(self):
        """P(k_nu) beside the truth, a `Comparison` without C_l."""
        none = np.empty(0)
        powers = {"frequency": self.frequency.power[1:], "true_frequency": self.true.frequency.power[1:]}
        return Comparison(degrees=none, angular=none, true_angular=none, k=self.frequency.k[1:], **powers)


class ImageViews:
    """P(k_nu), P(k_perp, k_par) and maps in the projection of the cube; methods as of `SphereViews`."""

    def spectra_of(self, cleaned):
        """The `PlaneSpectra` of a `CleanedCube`."""
        return self._spectra(cleaned.cube, cleaned.residual)

    @staticmethod
    def _spectra(cube, maps):
        frequency, pixels = frequency_power(maps, cube.channel_width), cube.layout.pixels
        try:
            cell, _ = cell_of(cube.freqs, pixels.pixel_angles())
            images = cube.on_sphere(maps).reshape(-1, *pixels.shape)
            power = cylindrical_power(images, cell, mask=cube.image)
        except InputError as error:
            return PlaneSpectra(frequency=frequency, why_not=str(error))
        return PlaneSpectra(frequency=frequency, cylindrical=power)

    def spectra_beside(self, first):
        """`spectra_of`: of a cube in the plane nothing is gained by knowing that `first` differs little."""
        return self.spectra_of

    def compared(self, cleaned, true):
        """The `PlaneSpectra` with those of the truth, (n_channels, n_seen)."""
        return replace(self.spectra_of(cleaned), true=self._spectra(cleaned.cube, true))

    def scales(self, cube, spectra):
        """P(k_perp, k_par), where there is one, and P(k) for k > 0, each (n,)."""
        found = [] if spectra.cylindrical is None else [spectra.cylindrical.power]
        return *(power[np.isfinite(power)] for power in found), spectra.frequency.power[1:]

    def spectra_part(self, cleaned, spectra):
        """HTML of P(k_nu) and P(k_perp, k_par), and of their ratios to the truth where it is known."""
        style = {"label": "cleaned", "color": styles.BLUE}
        if spectra.true is not None:
            picture = plotting.spectrum(
                [plotting.comparison_panel("frequency", [(style, spectra.comparison)])]
            )
        else:
            panel = _panel("frequency", spectra.frequency.k, spectra.frequency.power, style)
            picture = plotting.lines([panel], columns=1, size=(6, 3.6))
        parts = page.section("Spectra", picture, "Frequency power spectrum", _TEXT)
        ratios = [] if spectra.true is None else _ratios_part(spectra.comparison)
        return [*parts, *ratios, *self._cylindrical_part(cleaned.cube, spectra)]

    @staticmethod
    def _cylindrical_part(cube, spectra):
        if spectra.cylindrical is None:
            return [page.note(f"There is no P(k_perp, k_par): {spectra.why_not}")]
        angles = cube.layout.pixels.pixel_angles()
        _, z = cell_of(cube.freqs, angles)
        text = (
            f"Scales are comoving, at redshift {z:.3g}, on a flat sky, with the cosmology of the paper; the "
            "area that is not seen is left out of the normalisation. Foreground that is left fills the "
            "smallest k_par, and where the beam changes with frequency a wedge above them."
        )
        widest = np.max(cube.layout.pixels.shape * angles)
        if widest > _WIDE:
            text += f" The image is {np.rad2deg(widest):.0f} deg wide: scales are those in its middle."
        picture = cylindrical_figure(spectra.cylindrical, spectra.true and spectra.true.cylindrical)
        return page.section("Across and along the line of sight", picture, "P(k_perp, k_par)", text)

    def maps_figure(self, cleaned):
        """The residual in the channel in the middle, and its rms over channels."""
        pixels, (maps, spans) = cleaned.cube.layout.pixels, _maps_of(cleaned)
        images = {title: values.reshape(pixels.shape) for title, values in maps.items()}
        return planes.sky_images(images, pixels.celestial, span=spans)


def spectra_figure(spectra):
    """Both spectra, `PowerSpectra`, or with their ratios to the truth, a `Comparison`."""
    style = {"label": "cleaned", "color": styles.BLUE}
    if isinstance(spectra, Comparison):
        panels = [plotting.comparison_panel(kind, [(style, spectra)]) for kind in ("angular", "frequency")]
        return plotting.spectrum(panels)
    angular, frequency = spectra.angular, spectra.frequency
    return plotting.lines(
        [
            _panel("angular", angular.degrees, angular.mean, style),
            _panel("frequency", frequency.k, frequency.power, style),
        ]
    )


def _panel(kind, x, y, style):
    """A panel of `plotting.lines` with a spectrum beyond 0."""
    labels = {name: styles.AXES[kind][name] for name in ("xlabel", "ylabel")}
    return labels | {"curves": [(x[x > 0], y[x > 0], style)], "xscale": "log", "yscale": "log"}


def _ratios_part(comparison):
    """HTML of the mean ratios of a `Comparison`, of those spectra that it has."""
    x, rows = {"angular": comparison.degrees, "frequency": comparison.k}, []
    for name, (kind, low, high) in _BANDS.items():
        inside = (x[kind] > low) & (x[kind] < high)
        if len(x[kind]):
            ratio = getattr(comparison, f"{kind}_ratio")
            rows.append((name, f"{ratio[inside].mean():.3f}" if inside.any() else "no such scale"))
    return ["<h3>Over the truth</h3>", Table([], rows).html()]


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


def _maps_of(cleaned):
    """By title maps (n_pix,) of a residual, mK, NaN where nothing is seen, and the spans of their colours."""
    cube, middle = cleaned.cube, len(cleaned.cube.freqs) // 2
    seen = {
        f"left at {cube.freqs[middle]:g} MHz": cleaned.residual[middle],
        "rms over channels": np.sqrt(np.einsum("cp,cp->p", *[cleaned.residual] * 2) / len(cube.freqs)),
    }
    maps = {title: np.full(len(cube.mask), np.nan) for title in seen}
    for title, pixels in seen.items():
        maps[title][cube.mask] = pixels
    return maps, {title: tuple(np.percentile(pixels, (1, 99))) for title, pixels in seen.items()}
