"""Templates of the Galaxy from FITS files: found by name, checked, and brought to any resolution."""

import hashlib
import re
import warnings
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from himap.core.errors import InputError
from himap.core.reading import regular_file
from himap.maps import sphere
from himap.maps.healpix_io import (
    MILLIKELVIN,
    agreed,
    freq_in_header,
    freqs_in,
    read_maps,
    temperature_unit,
    to_ring,
)
from himap.sky.emission import PowerLaw
from himap.sky.small_scales import change_index_resolution, refine
from himap.sky.synthetic import FREE_FREE_INDEX

_INDEX = re.compile("synchrotron.*(beta|index)", re.IGNORECASE)
_KINDS = {
    "synchrotron": re.compile("synchrotron", re.IGNORECASE),
    "free-free": re.compile("free[ _-]?free", re.IGNORECASE),
}
_INDEX_LIMITS = (-5.0, 0.0)
_NOT_POSITIVE = 0.01  # share of the pixels that may be zero or negative

EXPECTED_FILES = (
    "one synchrotron intensity (such as synchrotron_408MHz.fits), one synchrotron index map (such as "
    "synchrotron_beta.fits) and one free-free intensity (such as freefree_30GHz.fits); the reference "
    "frequency, in MHz or GHz, is read from the name"
)


@dataclass(frozen=True, kw_only=True)
class Template:
    """A component at the resolution that it is known at.

    Attributes
    ----------
    name
        Of the component.
    amplitude
        Brightness temperature at `freq_ref`, mK (Rayleigh-Jeans), positive, (n_pix,), RING, Galactic.
    freq_ref
        MHz.
    index
        Spectral index: a number, or a map of any nside.
    """

    name: str
    amplitude: np.ndarray
    freq_ref: float
    index: np.ndarray | float

    def power_law(self, nside, rng, *, small_scales=True):
        """The component at `nside`, a `PowerLaw`; `rng` draws the small scales of `small_scales.refine`."""
        index = change_index_resolution(self.index, nside) if np.ndim(self.index) else self.index
        amplitude = refine(self.amplitude, nside, rng, small_scales=small_scales)
        return PowerLaw(name=self.name, amplitude=amplitude, freq_ref=self.freq_ref, index=index)


def read_templates(folder):
    """Synchrotron and free-free templates of a folder, a list of two `Template`.

    The maps may have any nside and either ordering. Intensities are in K, mK or uK (Rayleigh-Jeans).

    Raises
    ------
    InputError
        A file is missing, ambiguous or unreadable; a map is partial, has bad pixels, an unknown unit,
        another frame than the Galactic one, more than 1 % of intensities that are not positive, or an
        index outside -5..0; a header contradicts the frequency in the name of its file.
    """
    files = find_templates(folder)
    intensity = {name: _read_intensity(files[name], name) for name in _KINDS}
    index = {"synchrotron": _read_index(files["index"]), "free-free": FREE_FREE_INDEX}
    return [
        Template(name=name, amplitude=amplitude, freq_ref=freq, index=index[name])
        for name, (amplitude, freq) in intensity.items()
    ]


def digest_of(folder):
    """A hash of the names and contents of the template files of a folder."""
    digest = hashlib.sha256()
    for kind, path in sorted(find_templates(folder).items()):
        digest.update(f"{kind} {path.name} ".encode())
        digest.update(hashlib.sha256(regular_file(path, "template").read_bytes()).digest())
    return digest.hexdigest()


def nsides_of(folder):
    """nside of each template of a folder, {kind: nside}; kinds as in `find_templates`."""
    files = find_templates(folder)
    return {kind: sphere.nside_of(read_maps(path, n_maps=1).maps) for kind, path in files.items()}


def find_templates(folder):
    """Paths of the three files by kind: "synchrotron", "index", "free-free"."""
    folder = Path(folder)
    try:
        names = sorted(path.name for path in folder.iterdir())
    except (OSError, ValueError) as error:
        raise InputError(
            f"template_dir must be a folder with {EXPECTED_FILES}; {folder} cannot be read "
            f"({getattr(error, 'strerror', None) or error})."
        ) from None
    paths = [folder / name for name in names if re.search(r"\.fits(\.gz)?$", name, re.IGNORECASE)]
    candidates = {"index": [path for path in paths if _INDEX.search(path.name)]}
    for kind, pattern in _KINDS.items():
        candidates[kind] = [
            path
            for path in paths
            if pattern.search(path.name) and freqs_in(path.name) and path not in candidates["index"]
        ]
    for kind, matches in candidates.items():
        if len(matches) != 1:
            label = {"index": "synchrotron index"}.get(kind, f"{kind} intensity")
            names = ", ".join(path.name for path in matches) or "none"
            raise InputError(
                f"template_dir must hold {EXPECTED_FILES}. {folder} has {len(matches)} files for the "
                f"{label}: {names}. Leave exactly one of each there."
            )
    return {kind: matches[0] for kind, matches in candidates.items()}


def _freq_of(path, header):
    """Reference frequency that a file name states, and its header does not contradict, MHz."""
    stated = freqs_in(path.name)
    if len(stated) != 1 or stated[0].freq <= 0:
        raise InputError(
            f"the name of a template states one positive reference frequency, such as 408MHz or 30GHz; "
            f"{path.name} states {', '.join(f'{one.freq:g} MHz' for one in stated)}. Rename the file."
        )
    return agreed(stated[0], freq_in_header(header, path), path)


def _read_map(path):
    """First map of a file, RING, Galactic, float64, without holes, and the `HealpixFile`."""
    file = read_maps(path, n_maps=1)
    if file.partial:
        raise InputError(
            f"{path.name} covers a part of the sky; templates cover all of it. Fill the rest first."
        )
    if file.nested is None:
        raise InputError(
            f"{path.name} must say ORDERING = RING or NESTED in its header. Write it again with "
            "healpy.write_map."
        )
    frame = (file.coordinates or "G").upper()
    if frame not in ("G", "GAL", "GALACTIC"):
        raise InputError(
            f"{path.name} must be in Galactic coordinates (COORDSYS = G), got COORDSYS = {frame!r}. Rotate "
            f"it first: healpy.Rotator(coord=[{frame[:1]!r}, 'G']).rotate_map_pixel(pixels), and "
            "healpy.write_map(..., coord='G')."
        )
    pixels = file.maps[0].astype(np.float64)
    n_bad = np.count_nonzero(~np.isfinite(pixels))
    if n_bad:
        raise InputError(
            f"{path.name} has {n_bad} of {len(pixels)} pixels that are NaN, infinite or UNSEEN; "
            "templates need a value in every pixel. Fill the holes first."
        )
    return to_ring(pixels) if file.nested else pixels, file


def _read_intensity(path, name):
    """Intensity map in mK, RING, positive, and the frequency that it is at, MHz."""
    pixels, file = _read_map(path)
    unit = temperature_unit(file.units[0], f"TUNIT1 in {path.name}")
    amplitude = positive(pixels * MILLIKELVIN[unit], f"{name} ({path.name})")
    return amplitude, _freq_of(path, file.header)


def positive(pixels, label):
    """An intensity map without zero or negative pixels: a few are raised, with a warning.

    Raises
    ------
    InputError
        More than 1 % of the pixels are zero or negative, or some are not finite.
    """
    bad = ~(pixels > 0)
    n_bad = np.count_nonzero(bad)
    if n_bad > _NOT_POSITIVE * len(pixels) or not np.isfinite(pixels).all():
        raise InputError(
            f"{label}: an intensity must be finite and positive, but {n_bad} of {len(pixels)} pixels are "
            f"not, and himap mends at most {_NOT_POSITIVE:.0%}. Fill them, or give another template."
        )
    if n_bad:
        smallest = pixels[~bad].min()
        warnings.warn(
            f"{label}: {n_bad} of {len(pixels)} pixels are zero or negative; raised to the smallest positive "
            f"value, {smallest:.3g} mK.",
            stacklevel=2,
        )
        pixels = np.where(bad, smallest, pixels)
    return pixels


def _read_index(path):
    pixels, _ = _read_map(path)
    low, high = _INDEX_LIMITS
    n_bad = np.count_nonzero((pixels < low) | (pixels > high))
    if n_bad:
        raise InputError(
            f"{path.name} must hold a spectral index between {low:g} and {high:g} (T ~ nu^index, about -3), "
            f"but {n_bad} of {len(pixels)} pixels are outside; they range from {pixels.min():.3g} to "
            f"{pixels.max():.3g}. Is it another map?"
        )
    return pixels
