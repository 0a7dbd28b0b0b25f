"""Maps of a small part of the sky, by right ascension and declination."""

import matplotlib.pyplot as plt
import numpy as np
from astropy.coordinates import SkyCoord

from himap.figures.data import with_maps
from himap.figures.plotting import _RC, _finished
from himap.maps import sphere

_N_ROWS = 160  # of a picture


def patch_maps(maps, box, *, columns=2, unit="mK", span=None, diverging=False):
    """A figure of several maps, each with its own colour bar; right ascension grows to the left.

    Parameters
    ----------
    maps
        {title: (n_pix,)}, Galactic RING; NaN where there is nothing.
    box
        (lowest, highest) right ascension and (lowest, highest) declination, deg; the former may be negative,
        or more than 360.
    columns
        Of maps.
    unit, span, diverging
        As in `himap.figures.plotting.sky_maps`.
    """
    ra, dec = _grid(box)
    places = SkyCoord(np.mod(ra, 360), dec, unit="deg").galactic
    columns = min(columns, len(maps))
    rows = -(-len(maps) // columns)
    size = (4.6 * columns, rows * (1.2 + 4.6 * np.ptp(box[1]) / _width(box)))
    with plt.rc_context(_RC | {"axes.grid": False}):
        figure, panels = plt.subplots(rows, columns, figsize=size, dpi=100, squeeze=False)
        for axes in panels.flat[len(maps) :]:
            axes.set_visible(False)
        units = {title: unit.get(title) if isinstance(unit, dict) else unit for title in maps}
        for axes, (title, pixels) in zip(panels.flat, maps.items(), strict=False):
            values = pixels[sphere.pixel_at(sphere.nside_of(pixels), places.l.deg, places.b.deg)]
            limits = span.get(title) if isinstance(span, dict) else span
            low, high = np.nanpercentile(pixels, (1, 99)) if limits is None else limits
            if diverging:
                low, high = -max(abs(low), abs(high)), max(abs(low), abs(high))
            shown = axes.imshow(
                values,
                origin="lower",
                extent=(*box[0][::-1], *box[1]),
                aspect=_aspect(box),
                vmin=low,
                vmax=high,
                cmap="RdBu_r" if diverging else "cividis",
            )
            axes.set_title(f"{title} [{units[title]}]" if units[title] else title, fontsize=10)
            axes.set(xlabel="right ascension [deg]", ylabel="declination [deg]")
            axes.xaxis.set_major_formatter(lambda x, _: f"{x % 360:g}")
            figure.colorbar(shown, ax=axes, location="bottom", shrink=0.7, pad=0.03, extend="both")
    return with_maps(_finished(figure), maps, [text or "" for text in units.values()])


def _grid(box):
    """Right ascension, falling, and declination, deg, (n_rows, n_columns)."""
    n_columns = int(_N_ROWS * _width(box) / np.ptp(box[1]))
    (left, right), (low, high) = box
    x, y = (np.arange(n) + 0.5 for n in (n_columns, _N_ROWS))
    return np.meshgrid(right - (right - left) * x / n_columns, low + (high - low) * y / _N_ROWS)


def _aspect(box):
    """Length of a degree of declination over one of right ascension."""
    return 1 / np.cos(np.deg2rad(np.mean(box[1])))


def _width(box):
    return np.ptp(box[0]) / _aspect(box)
