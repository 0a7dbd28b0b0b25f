"""What the attributes of a dataset, or of a file, in HDF5 say in words."""

from himap.errors import InputError

__all__ = ["text_of"]


def text_of(item, *names):
    """The text of the attribute of one of these names, with an s or without, or None.

    Raises
    ------
    InputError
        Several are there, and say different things.
    """
    texts = {
        name: _decoded(value) if isinstance(value, bytes) else str(value)
        for name, value in item.attrs.items()
        if name.lower().removesuffix("s") in names
    }
    if len(set(texts.values())) > 1:
        told = ", ".join(f"{name} = {text!r}" for name, text in texts.items())
        raise InputError(f"attributes of {item.name} say different things: {told}. Delete what is wrong.")
    return next(iter(texts.values()), None)


def _decoded(value):
    try:
        return value.decode()
    except UnicodeDecodeError:
        return value.decode("latin-1")
