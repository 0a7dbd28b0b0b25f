"""The Galaxy of the paper, PySM 3's models s1 and f1: as templates, and as a folder of their files."""

import logging
import os
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import numpy as np

from himap.core.checks import whole_number
from himap.core.errors import InputError
from himap.core.files import complete_left, whole_files
from himap.maps import sphere
from himap.maps.healpix_io import MILLIKELVIN, write_maps
from himap.sky.synthetic import FREE_FREE_INDEX
from himap.sky.templates import Template, positive

PYSM_NSIDE = 512
"""Resolution of PySM's own maps of s1 and f1."""

_MODELS = {"s1": "synchrotron", "f1": "free-free"}
_COARSEST = 4  # nside: the least of a survey


def pysm_version():
    """Version of pysm3, a text.

    Raises
    ------
    InputError
        It is not installed.
    """
    try:
        return version("pysm3")
    except PackageNotFoundError as error:
        raise InputError(_no_pysm("is not installed")) from error


def pysm_templates(nside):
    """Synchrotron and free-free emission as PySM has them, a list of two `Template`.

    At `nside`, averaged over pixels by PySM (healpy's ud_grade), or at PySM's own where that is coarser.

    Raises
    ------
    InputError
        pysm3 is not installed, or cannot download its maps, which it does on first use.
    """
    try:
        import pysm3  # slow to import, and only this source needs it
    except ImportError as error:
        raise InputError(_no_pysm("cannot be imported")) from error
    log = logging.getLogger("pysm3")
    was_disabled, log.disabled = log.disabled, True  # it blames its version for a missing network
    try:
        sky = pysm3.Sky(nside=min(nside, PYSM_NSIDE), preset_strings=list(_MODELS))
    except OSError as error:  # urllib's errors and timeouts are OSErrors
        raise InputError(_no_pysm(f"could not download its templates ({error})")) from error
    finally:
        log.disabled = was_disabled
    return [
        _template(name, model, pysm3.units)
        for name, model in zip(_MODELS.values(), sky.components, strict=True)
    ]


def _no_pysm(reason):
    return (
        f"this Galaxy needs the package pysm3 and its templates, but it {reason}. Install it (pip install "
        "pysm3) and go online once (PySM keeps what it downloads), or take source='synthetic', which needs "
        "nothing, or source='templates' with FITS files of your own."
    )


def _template(name, model, units):
    """A PySM power-law model as a `Template`."""
    amplitude = np.asarray(model.I_ref.to_value(units.mK_RJ), dtype=np.float64).reshape(-1)
    sphere.nside_of(amplitude)
    index = np.asarray(model.pl_index.value, dtype=np.float64)
    return Template(
        name=name,
        amplitude=positive(amplitude, f"{name} of PySM"),
        freq_ref=float(model.freq_ref_I.to_value(units.MHz)),
        index=index.reshape(-1) if index.size > 1 else float(index.reshape(-1)[0]),
    )


def write_templates(folder, nside):
    """Write PySM's Galaxy as the three files that `himap.sky.templates.read_templates` reads.

    Synchrotron and free-free emission in K (Rayleigh-Jeans) at their reference frequencies, which the names
    state, and the index of synchrotron emission: RING, Galactic, float32. All of them or none.

    Parameters
    ----------
    folder
        A new folder, or an empty one.
    nside
        A power of two from 4 to 512, which is PySM's own.

    Returns
    -------
    list
        The paths that were written.

    Raises
    ------
    InputError
        An nside that cannot be, a folder that holds something or cannot be written, or as `pysm_templates`.
    """
    nside = whole_number("nside", nside, _COARSEST, PYSM_NSIDE)
    if nside & (nside - 1):
        below = 2 ** (nside.bit_length() - 1)
        raise InputError(f"nside must be a power of two, got {nside}; try {below} or {2 * below}.")
    folder = _free_folder(folder)
    synchrotron, free_free = pysm_templates(nside)
    if np.any(np.not_equal(free_free.index, FREE_FREE_INDEX)):
        raise InputError(
            f"templates in files have a free-free index of {FREE_FREE_INDEX}, and this PySM has another; "
            "take the Galaxy as source='pysm3'."
        )
    index = np.array(np.broadcast_to(synchrotron.index, synchrotron.amplitude.shape))
    files = {
        f"synchrotron_{_freq_text(synchrotron)}_K_nside{nside}.fits": (_kelvin(synchrotron), "T", "K_RJ"),
        f"synchrotron_beta_nside{nside}.fits": (index, "BETA", None),
        f"freefree_{_freq_text(free_free)}_K_nside{nside}.fits": (_kelvin(free_free), "T", "K_RJ"),
    }
    cards = [("COORDSYS", "G"), ("PYSM3", pysm_version(), "version that the maps are from")]
    with whole_files(*(folder / name for name in files)) as temporary:
        for target, (pixels, column, unit) in zip(temporary, files.values(), strict=True):
            maps = pixels[None].astype(np.float32)
            write_maps(target, maps, names=[column], unit=unit, nested=False, cards=cards)
    return [folder / name for name in files]


def _free_folder(folder):
    """`folder` as a path with nothing in it."""
    folder = Path(os.path.expanduser(folder))
    completed = complete_left(folder)
    try:
        held = sorted(path.name for path in folder.iterdir() if path not in completed)
    except FileNotFoundError:
        return folder
    except OSError as error:
        raise InputError(f"{folder} cannot be a folder of templates ({error.strerror}).") from None
    if held:
        more = f" and {len(held) - 3} more" if len(held) > 3 else ""
        raise InputError(
            f"templates are written to a new or an empty folder, but {folder} holds "
            f"{', '.join(held[:3])}{more}; give another one, or empty it."
        )
    return folder


def _freq_text(template):
    """The reference frequency as names of files state it: 408MHz, 30GHz."""
    freq = template.freq_ref
    return f"{freq:.10g}MHz" if freq < 1e3 else f"{freq / 1e3:.10g}GHz"


def _kelvin(template):
    return template.amplitude / MILLIKELVIN["K"]
