"""Plain numbers from files. Nothing that is read can run code."""

import numpy as np

from himap.errors import InputError

__all__ = ["read_array", "read_numbers"]


def read_array(path):
    """The array of a .npy file; object arrays, which could run code, are refused."""
    try:
        array = np.load(path, allow_pickle=False)
    except (ValueError, OSError, EOFError) as error:
        raise InputError(f"{path} is no .npy file of plain numbers ({error}).") from None
    if not isinstance(array, np.ndarray):
        raise InputError(f"{path} is an archive of arrays (.npz); save the one that is meant as .npy.")
    return array


def read_numbers(path):
    """The numbers of a .npy file, or of a text file with columns parted by blanks or commas."""
    if path.suffix == ".npy":
        return read_array(path)
    try:
        return np.loadtxt(path.read_text().replace(",", " ").splitlines(), ndmin=1)
    except (ValueError, UnicodeDecodeError) as error:
        raise InputError(f"{path} is no table of numbers ({error}).") from None
