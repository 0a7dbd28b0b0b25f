"""The numbers behind a figure: notebooks store them with the picture, the book offers them for download.

Curves are stored as CSV. Maps and other images are stored as NPZ (numpy's ``np.load`` opens it), in base64:
maps up to `NSIDE`, rounded to four digits, so that a notebook is small enough to commit.
"""

import base64
import csv
import io

import numpy as np

from himap.maps import sphere

_CURVES, _ARRAYS = "text/csv", "application/x-npz"

DATA_TYPES = {_CURVES: "csv", _ARRAYS: "npz"}
"""{type of output in which a notebook stores the numbers of a figure: extension of their file}."""

NSIDE = 32
"""Largest nside of stored maps of a figure; finer maps are averaged over its pixels."""

_BITS = 13  # of the mantissa: 1.2e-4 of the value at most


def with_curves(figure, curves):
    """Add the numbers of [(panel, label, x, y)], texts and arrays (n,), to a figure in place; return it."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(("panel", "curve", "x", "y"))
    for panel, label, xs, ys in curves:
        writer.writerows((panel, label, f"{x:.5g}", f"{y:.5g}") for x, y in zip(xs, ys, strict=True))
    return _carrying(figure, _CURVES, text.getvalue())


def panel_names(panels):
    """Names of the panels of a figure in its file, all different.

    The title; if it is empty or not unique, followed by the labels of the axes, and finally by a number.
    `panels` are dicts, as in `himap.figures.plotting.lines`, whose values are converted to text.

    >>> panel_names([{"title": "a", "ylabel": "C"}, {"title": "a", "ylabel": "P"}, {"title": 7}, {}])
    ['a, C', 'a, P', '7', 'panel 4']
    """
    names = [""] * len(panels)
    for key in ("title", "ylabel", "xlabel", "number"):
        parts = [str(panel.get(key, "")) for panel in panels]
        if key == "number":
            parts = [f"panel {n}" for n, _ in enumerate(panels, start=1)]
        names = [
            name if name and names.count(name) == 1 else ", ".join(filter(None, (name, part)))
            for name, part in zip(names, parts, strict=True)
        ]
    return names


def with_maps(figure, maps, units):
    """Add maps, at `NSIDE` or coarser, and the unit of each to a figure in place; return it.

    The maps are {title: (n_pix,)}, RING; pixels without a value are NaN. The file holds ``maps``
    (n_maps, n_pix), ``titles``, ``units``, ``ordering`` and ``coordinates``.
    """
    kept = []
    for pixels in maps.values():
        pixels = np.asarray(pixels, dtype=np.float64)
        if sphere.nside_of(pixels) > NSIDE:  # means over pixels with a value
            has_value = np.isfinite(pixels)
            share = sphere.change_resolution(has_value.astype(np.float64), NSIDE)
            mean = sphere.change_resolution(np.where(has_value, pixels, 0), NSIDE)
            pixels = np.divide(mean, share, out=np.full(len(mean), np.nan), where=share > 0)
        kept.append(pixels)
    labels = {"titles": list(maps), "units": list(units), "ordering": "RING", "coordinates": "Galactic"}
    return _with_arrays(figure, maps=np.stack(kept), **labels)


def with_image(figure, values, *, x, y, unit):
    """Add an image (n_y, n_x) over `x` and `y` to a figure; the file has all three under these names."""
    return _with_arrays(figure, values=values, x=x, y=y, unit=unit)


def _with_arrays(figure, **arrays):
    """Add an NPZ file in base64 to the figure; real numbers become float32, rounded."""
    for name, array in arrays.items():
        array = np.asarray(array)
        if array.dtype.kind == "f":
            mantissa, exponent = np.frexp(array)
            array = np.ldexp(np.round(mantissa * 2**_BITS) / 2**_BITS, exponent).astype(np.float32)
        arrays[name] = array
    file = io.BytesIO()
    np.savez_compressed(file, **arrays)
    return _carrying(figure, _ARRAYS, base64.b64encode(file.getvalue()).decode())


def _carrying(figure, kind, text):
    figure._repr_mimebundle_ = lambda include=None, exclude=None: {kind: text}
    return figure
