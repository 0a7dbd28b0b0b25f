"""What a file and its user say of units and pixels: one of them has to, and they may not differ."""

from himap.cubes.pixels import SpherePixels
from himap.errors import InputError
from himap.maps.healpix_files import is_nested, temperature_unit

__all__ = ["told_nested", "told_pixels", "told_unit"]


def told_unit(file_unit, user_unit):
    """The name of the unit, from what the file and the user say."""
    units = {temperature_unit(text) for text in (file_unit, user_unit) if text is not None}
    if not units:
        raise InputError("the file does not say whether its maps are in K or mK; give unit= (--unit).")
    if len(units) > 1:
        raise InputError(
            f"the file says {file_unit}, but the unit given is {user_unit}; leave it out, or mend the file."
        )
    return units.pop()


def told_pixels(raw, order, remarks):
    """The `Pixels` of a `RawCube`."""
    if raw.image is None:
        return SpherePixels(nested=told_nested(raw.nested, order, remarks), partial=raw.partial)
    if order is not None:
        raise InputError(f"an image has no order of HEALPix pixels; leave order = {order} (--order) out.")
    return raw.image


def told_nested(file_nested, order, remarks):
    """Whether pixels are in NESTED order; what is taken for granted is added to `remarks`."""
    if order is None:
        if file_nested is None:
            remarks.append(
                "the file does not say the order of its pixels: taken as RING (--order to change it)."
            )
        return bool(file_nested)
    nested = is_nested(str(order), "order")
    if file_nested is not None and file_nested != nested:
        raise InputError(
            f"the file says {'NESTED' if file_nested else 'RING'}, but the order given is {order}."
        )
    return nested
