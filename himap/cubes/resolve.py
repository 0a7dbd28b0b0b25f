"""What a file states of a cube and what its user gives: one of them has to, and they may not differ."""

from dataclasses import replace
from operator import eq

from himap.core.checks import real_array
from himap.core.errors import InputError
from himap.cubes.files import read_freqs
from himap.cubes.layout import same_freqs
from himap.cubes.weights import is_path
from himap.maps.healpix_files import is_nested, temperature_unit


def resolve(path, what, stated, given, *, same=eq, show=str, default=None, gap=""):
    """The value of `what` that the file `path` states, or the caller gives, or both, which must agree.

    Parameters
    ----------
    path, what
        For errors.
    stated, given
        The values, None where there is none.
    same, show
        Whether two values are the same, and the text of one.
    default, gap
        The value where neither says it; without one the sentence that says so.

    Raises
    ------
    InputError
        A contradiction, or a gap.
    """
    if stated is not None and given is not None and not same(stated, given):
        raise InputError(
            f"{path}: the file says {show(stated)}, but the {what} given is {show(given)}; leave it out, or "
            "mend the file."
        )
    value = next((value for value in (stated, given, default) if value is not None), None)
    if value is None:
        raise InputError(gap)
    return value


def resolved(path, maps, layout, *, freqs=None, unit=None, order=None, only_gaps=False):
    """The `Layout` of a file with what the caller gives of frequencies, unit and order, as of `read_cube`.

    With `only_gaps` what is given counts only where the file states nothing. Errors as of `resolve`.
    """
    pixels, remarks = layout.pixels, list(layout.remarks)
    if only_gaps:
        freqs = freqs if layout.freqs is None else None
        unit = unit if layout.unit is None else None
        order = order if pixels.nested is None else None
    freqs, given_by = read_freqs(freqs) if is_path(freqs) else (freqs, "what was given")
    freqs = resolve(
        path,
        "list of frequencies",
        layout.freqs,
        None if freqs is None else real_array("freqs", freqs).astype(float),
        same=lambda one, two: one.shape == two.shape and same_freqs(two, one).all(),
        show=_listed,
        gap=f"{path} does not tell its frequencies; give them with freqs= (--freqs FILE), MHz, or name their "
        f"dataset (--freqs-name). {layout.nearly}".rstrip(),
    )
    unit = resolve(
        path,
        "unit",
        layout.unit,
        unit,
        same=lambda one, two: temperature_unit(one) == temperature_unit(two),
        gap="the file does not say whether its maps are in K or mK; give unit= (--unit).",
    )
    if order is not None and not pixels.whole_sky:
        raise InputError(f"an image has no order of HEALPix pixels; leave order = {order} (--order) out.")
    if pixels.whole_sky:
        if pixels.nested is None and order is None:
            remarks.append(
                "the file does not say the order of its pixels: taken as RING (--order to change it)."
            )
        given = None if order is None else is_nested(str(order), "order")
        show = {False: "RING", True: "NESTED"}.get
        nested = resolve(path, "order", pixels.nested, given, show=show, default=False)
        pixels = replace(pixels, nested=nested)
    if freqs.shape != (len(maps),):
        raise InputError(
            f"there must be one frequency for each of the {len(maps)} channels, got {freqs.size}."
        )
    return replace(
        layout,
        pixels=pixels,
        freqs=freqs,
        freqs_from=layout.freqs_from or given_by,
        unit=temperature_unit(unit),
        remarks=tuple(remarks),
    )


def _listed(freqs):
    """Frequencies in their order, for messages."""
    texts = [f"{freq:g}" for freq in freqs.ravel()]
    return f"{', '.join(texts if len(texts) < 5 else [*texts[:3], '...', texts[-1]])} MHz ({len(texts)})"
