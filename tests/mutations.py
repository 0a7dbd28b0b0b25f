"""Good files, damaged: a part cut off, zeroed, shifted or replaced, by a generator with a fixed seed."""

from pathlib import Path

from hostile_files import READING

__all__ = ["KINDS", "SOURCES", "mutated"]

SOURCES = {  # by the part that says what the rest is: (words of the command, its length in bytes)
    "good.h5": (["good.h5"], 2400),
    "good.fits": (["good.fits"], 2880 * 4),
    "part.fits": (["part.fits"], 2880 * 4),
    "good.npy": (["good.npy", *READING], 128),
    "nu.npy": (["good.npy", "--freqs", "nu.npy", "--unit", "mK"], 128),
    "bl.npy": (["good.h5", "--beam", "bl.npy"], 128),
    "widths.txt": (["good.h5", "--beam", "widths.txt"], 600),
    "mask.fits": (["good.h5", "--mask", "mask.fits"], 2880 * 2),
}


def _cut(data, head, rng):
    return data[: rng.integers(head)]


def _zeroed(data, head, rng):
    start = rng.integers(head)
    stop = start + rng.integers(8, 200)
    return data[:start] + bytes(len(data[start:stop])) + data[stop:]


def _shifted(data, head, rng):
    start = rng.integers(head)
    return data[:start] + rng.bytes(rng.integers(1, 9)) + data[start:]


def _flipped(data, head, rng):
    out = bytearray(data)
    for place in rng.integers(min(head, len(data)), size=rng.integers(1, 16)):
        out[place] = rng.integers(256)
    return bytes(out)


def _swapped(data, head, rng):
    """Two blocks of the head in each other's place."""
    one, two = sorted(rng.integers(min(head, len(data)) - 80, size=2))
    out = bytearray(data)
    out[one : one + 80], out[two : two + 80] = data[two : two + 80], data[one : one + 80]
    return bytes(out)


def _of_another_file(data, head, rng):
    """A head of one format before the body of another."""
    other = Path("nu.txt" if data.startswith(b"\x89HDF") else "good.h5").read_bytes()
    return other[: rng.integers(64, 600)] + data[head:]


KINDS = {
    "cut": _cut,
    "zeroed": _zeroed,
    "shifted": _shifted,
    "flipped": _flipped,
    "swapped": _swapped,
    "of another file": _of_another_file,
}


def mutated(source, kind, rng):
    """The bytes of a good file of the current folder, damaged in this way."""
    return KINDS[kind](Path(source).read_bytes(), SOURCES[source][1], rng)
