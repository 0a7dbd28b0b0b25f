"""Templates of the Galaxy: from FITS files in a folder, and from PySM 3, as in the paper."""

import hashlib
import logging
import os
import re
import warnings
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import numpy as np

from himap.core.checks import power_of_two
from himap.core.errors import InputError
from himap.core.files import atomic_files, complete_abandoned
from himap.core.reading import regular_file
from himap.maps.healpix_io import (
    MILLIKELVIN,
    agreed,
    freq_in_header,
    freqs_in,
    read_maps,
    temperature_unit,
    to_ring,
    write_maps,
)
from himap.sky.emission import PowerLaw
from himap.sky.synthetic import FREE_FREE_INDEX

_FITS = re.compile(r"\.fits(\.gz)?$", re.IGNORECASE)
_KINDS = {  # {kind: (label, pattern of names)}; a name counts only for the first pattern that it matches
    "index": ("synchrotron index", "synchrotron.*(beta|index)"),
    "synchrotron": ("synchrotron intensity", "synchrotron"),
    "free-free": ("free-free intensity", "free[ _-]?free"),
}
_INDEX_LIMITS = (-5.0, 0.0)
_NOT_POSITIVE = 0.01  # largest share of pixels that may be zero or negative

PYSM_NSIDE = 512
"""Resolution of PySM's maps of s1 and f1."""

_MODELS = {"s1": "synchrotron", "f1": "free-free"}

EXPECTED_FILES = (
    "one synchrotron intensity (such as synchrotron_408MHz.fits), one synchrotron index map (such as "
    "synchrotron_beta.fits) and one free-free intensity (such as freefree_30GHz.fits); the reference "
    "frequency, in MHz or GHz, is read from the name"
)


def read_templates(folder):
    """Read the synchrotron and free-free templates in a folder, a list of two `PowerLaw`.

    Each map may have any nside and either ordering. Intensities are in K, mK or uK (Rayleigh-Jeans).

    Raises
    ------
    InputError
        If a file is missing, ambiguous or unreadable; a map is partial, has bad pixels, an unknown unit, a
        frame other than Galactic, more than 1 % of intensities that are not positive, or an index outside
        -5..0; or a header contradicts the frequency in the name of its file.
    """
    files = find_templates(folder)
    index, _ = _read_map(files["index"])
    low, high = _INDEX_LIMITS
    if index.min() < low or index.max() > high:
        raise InputError(
            f"{files['index'].name} must hold a spectral index between {low:g} and {high:g} (T ~ nu^index), "
            f"got {index.min():.3g} to {index.max():.3g}. Is it another map?"
        )
    templates = []
    for name, beta in (("synchrotron", index), ("free-free", FREE_FREE_INDEX)):
        path = files[name]
        pixels, file = _read_map(path)
        unit = temperature_unit(file.units[0], f"TUNIT1 in {path.name}")
        stated = freqs_in(path.name)
        if len(stated) != 1 or stated[0].freq <= 0:
            raise InputError(
                f"the name of a template states one positive reference frequency, such as 408MHz or 30GHz; "
                f"{path.name} states {', '.join(f'{item.freq:g} MHz' for item in stated)}. Rename the file."
            )
        freq = agreed(stated[0], freq_in_header(file.header, path), path)
        amplitude = _positive(pixels * MILLIKELVIN[unit], f"{name} ({path.name})")
        templates.append(PowerLaw(name=name, amplitude=amplitude, freq_ref=freq, index=beta))
    return templates


def digest_of(folder):
    """A hash of the names and contents of the template files of a folder."""
    digest = hashlib.sha256()
    for kind, path in sorted(find_templates(folder).items()):
        digest.update(f"{kind} {path.name} ".encode())
        digest.update(hashlib.sha256(regular_file(path, "template").read_bytes()).digest())
    return digest.hexdigest()


def find_templates(folder):
    """Paths of the three files by kind: "synchrotron", "index", "free-free"."""
    folder = Path(folder)
    try:
        paths = [path for path in sorted(folder.iterdir()) if _FITS.search(path.name)]
    except (OSError, ValueError) as error:
        raise InputError(
            f"template_dir must be a folder with {EXPECTED_FILES}; {folder} cannot be read "
            f"({getattr(error, 'strerror', None) or error})."
        ) from None
    templates = {}
    for kind, (label, pattern) in _KINDS.items():
        matches = [path for path in paths if re.search(pattern, path.name, re.IGNORECASE)]
        if kind == "index":
            paths = [path for path in paths if freqs_in(path.name) and path not in matches]
        if len(matches) != 1:
            names = ", ".join(path.name for path in matches) or "none"
            raise InputError(
                f"template_dir must hold {EXPECTED_FILES}. {folder} has {len(matches)} files for the "
                f"{label}: {names}. Leave exactly one of each there."
            )
        (templates[kind],) = matches
    return templates


def _read_map(path):
    """First map of a file, RING, Galactic, float64, without missing pixels, and the `HealpixFile`."""
    file = read_maps(path, n_maps=1)
    if file.nested is None:
        raise InputError(
            f"{path.name} must say ORDERING = RING or NESTED in its header. Write it again with "
            "healpy.write_map."
        )
    frame = file.frame or "G"
    if frame != "G":
        raise InputError(
            f"{path.name} must be in Galactic coordinates (COORDSYS = G), got COORDSYS = {frame!r}. Rotate "
            f"it first: healpy.Rotator(coord=[{frame[:1]!r}, 'G']).rotate_map_pixel(pixels), and "
            "healpy.write_map(..., coord='G')."
        )
    pixels = file.maps[0].astype(np.float64)
    n_bad = np.count_nonzero(~np.isfinite(pixels))
    if n_bad:
        raise InputError(
            f"{path.name} has {n_bad} of {len(pixels)} pixels that are NaN, infinite, UNSEEN or absent; "
            "templates need a value in every pixel. Fill the holes first."
        )
    return to_ring(pixels) if file.nested else pixels, file


def _positive(pixels, label):
    """An intensity map without zero or negative pixels: a few are raised, with a warning.

    Raises
    ------
    InputError
        If more than 1 % of the pixels are zero or negative, or some are not finite.
    """
    bad = ~(pixels > 0)
    n_bad = np.count_nonzero(bad)
    if n_bad > _NOT_POSITIVE * len(pixels) or not np.isfinite(pixels).all():
        raise InputError(
            f"{label}: an intensity must be finite and positive, but {n_bad} of {len(pixels)} pixels are "
            f"not, and himap repairs at most {_NOT_POSITIVE:.0%}. Fill them, or give another template."
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


def pysm_version():
    """Version of pysm3, a text.

    Raises
    ------
    InputError
        If it is not installed.
    """
    try:
        return version("pysm3")
    except PackageNotFoundError as error:
        raise InputError(_no_pysm("is not installed")) from error


def pysm_templates(nside):
    """Synchrotron and free-free emission of PySM, a list of two `PowerLaw`.

    At `nside`, averaged over pixels by PySM (healpy's ud_grade), or at PySM's own nside if that is coarser.

    Raises
    ------
    InputError
        If pysm3 is not installed, or cannot download its maps, as it does on first use.
    """
    try:
        import pysm3  # slow to import, and only this source needs it
    except ImportError as error:
        raise InputError(_no_pysm("cannot be imported")) from error
    log = logging.getLogger("pysm3")
    was_disabled, log.disabled = log.disabled, True  # its log blames the version if the network is missing
    try:
        sky = pysm3.Sky(nside=min(nside, PYSM_NSIDE), preset_strings=list(_MODELS))
    except OSError as error:  # urllib's errors and timeouts are OSErrors
        raise InputError(_no_pysm(f"could not download its templates ({error})")) from error
    finally:
        log.disabled = was_disabled
    templates = []
    for name, model in zip(_MODELS.values(), sky.components, strict=True):
        amplitude, index = (
            np.asarray(values, dtype=np.float64).reshape(-1)
            for values in (model.I_ref.to_value(pysm3.units.mK_RJ), model.pl_index.value)
        )
        freq = float(model.freq_ref_I.to_value(pysm3.units.MHz))
        index = index if index.size > 1 else index.item()
        amplitude = _positive(amplitude, f"{name} of PySM")
        templates.append(PowerLaw(name=name, amplitude=amplitude, freq_ref=freq, index=index))
    return templates


def _no_pysm(reason):
    return (
        f"this Galaxy needs the package pysm3 and its templates, but it {reason}. Install it (pip install "
        "pysm3) and go online once (PySM keeps what it downloads), or take the Galaxy 'synthetic', which "
        "needs nothing, or 'templates' with FITS files of your own."
    )


def write_templates(folder, nside):
    """Write PySM's Galaxy as the three files that `read_templates` reads.

    Synchrotron and free-free emission in K (Rayleigh-Jeans) at their reference frequencies, stated in the
    names, and the index of synchrotron emission: RING, Galactic, float32. Writes all files or none.

    Parameters
    ----------
    folder
        A new folder, or an empty one.
    nside
        A power of two from 4 to 512, the nside of PySM.

    Returns
    -------
    list
        Paths of the written files.

    Raises
    ------
    InputError
        If nside is invalid, or the folder is not empty or not writable; or see `pysm_templates`.
    """
    nside = power_of_two("nside", nside, 4, PYSM_NSIDE)
    folder = Path(os.path.expanduser(folder))
    completed = complete_abandoned(folder)
    try:
        paths = folder.iterdir() if folder.exists() else ()
        held = sorted(path.name for path in paths if path not in completed)
    except OSError as error:
        raise InputError(f"{folder} cannot be a folder of templates ({error.strerror}).") from None
    if held:
        raise InputError(
            f"templates are written to a new or an empty folder, but {folder} holds "
            f"{', '.join(held[:3])}; give another one, or empty it."
        )
    synchrotron, free_free = pysm_templates(nside)
    if np.any(np.not_equal(free_free.index, FREE_FREE_INDEX)):
        raise InputError(
            f"templates in files have a free-free index of {FREE_FREE_INDEX}, and this PySM has another; "
            "take the Galaxy as source='pysm3'."
        )
    index = np.array(np.broadcast_to(synchrotron.index, synchrotron.amplitude.shape))
    files = {f"synchrotron_beta_nside{nside}.fits": (index, "BETA", None)}
    for name, template in (("synchrotron", synchrotron), ("freefree", free_free)):
        freq = template.freq_ref
        stated = f"{freq:.10g}MHz" if freq < 1e3 else f"{freq / 1e3:.10g}GHz"
        files[f"{name}_{stated}_K_nside{nside}.fits"] = (template.amplitude / MILLIKELVIN["K"], "T", "K_RJ")
    cards = [("PYSM3", pysm_version(), "version that the maps are from")]
    with atomic_files(*(folder / name for name in files)) as temporary:
        for target, (pixels, column, unit) in zip(temporary, files.values(), strict=True):
            maps = pixels[None].astype(np.float32)
            write_maps(target, maps, names=[column], unit=unit, nested=False, frame="G", cards=cards)
    return [folder / name for name in files]
