"""Mocks for a user's cube: known HI in its channels and pixels."""

import math

import numpy as np
from scipy import fft

from himap.core.checks import checked_beams, checked_noise, evenly_spaced, whole_number
from himap.core.errors import InputError
from himap.core.progress import progress
from himap.core.survey import Survey
from himap.cubes.cube import rms_of
from himap.cubes.files import read_truth
from himap.cubes.spectra import check_truth
from himap.maps import sphere
from himap.measures.cylindrical import cell_of
from himap.sky.cosmology import HIModel, redshift
from himap.sky.hi import hi_maps

_CELLS = (64, 1024)  # cells per side of a box: minimum, and maximum for a workstation
_DEEP = 1.05  # times the depth of a channel: cells that contain nearly all of its HI
_ROOM = 1.01  # size of the box relative to the band
_BRIGHT = 0.5  # rms relative to a cube with foreground, which is far brighter than HI


def read_mocks(cube, paths, *, tell=None, **reading):
    """Yield the maps of mocks from files, (n_channels, n_seen) float32, mK.

    Parameters
    ----------
    cube
        The `Cube` whose signal the mocks replace.
    paths
        Files as in `read_cube`, one per mock, with the beam of the cube.
    tell
        Called with each remark on a file, a sentence.
    reading
        As in `read_truth`, for anything the files do not state.

    Raises
    ------
    InputError
        When a file is read: another nside, other channels, or missing pixels of the cube.
    """
    rms = rms_of(cube.maps, cube.missing) if tell else None
    for path in paths:
        mock = read_truth(path, cube=cube, **reading)
        for remark in mock.remarks if tell else ():
            tell(f"{path}: {remark}")
        check_truth(cube, mock, f"{path}: a mock")
        maps = mock.maps[:, cube.mask[mock.mask]]
        if tell and (share := rms_of(maps, cube.missing) / rms) > _BRIGHT:
            tell(f"{path} has {share:.2g} times the rms of the cube: mocks are HI and noise only.")
        yield maps


def draw_mocks(cube, beams, n_mocks, *, noise=None, tell=None):
    """Yield the maps of lognormal mocks, (n_channels, n_seen) float32, mK.

    HI as in the simulations of the paper, through the beams, and white noise if its level is given. The box
    resolves the channels: for 1 MHz, each mock needs some minutes and up to 9 GB of memory.

    Parameters
    ----------
    cube
        The `Cube` whose signal the mocks replace.
    beams
        b_l, (n_channels, lmax + 1) with lmax of 2 nside or more.
    n_mocks
        Number of mocks.
    noise
        Noise per pixel, mK, a number or (n_channels,); None for none.
    tell
        As in `read_mocks`; also for channels narrower than the cells of the largest box.

    Raises
    ------
    InputError
        No beams, unevenly spaced channels, channels outside the range of simulations, or an invalid number.
    """
    whole_number("the number of mocks", n_mocks, 1, 10_000)
    if beams is None:
        raise InputError("mocks need the beam of the cube; give it (beams=, --beam), or your own mocks.")
    beams = checked_beams("beams", beams, len(cube.freqs))
    sigma = checked_noise("noise", noise, len(cube.freqs))
    survey = mock_survey(cube)
    (depth,), _ = cell_of(survey.freqs, ())
    cell = survey.box_size / survey.box_cells
    if tell and cell > _DEEP * depth:
        tell(
            f"Channels are {depth:.2g} Mpc/h deep, and the cells of the mocks, {survey.box_cells} per side, "
            f"{cell:.2g}: HI power is too low at large k; give your own mocks (--mocks FILE)."
        )

    def mock(rng):
        maps = hi_maps(survey, rng)[np.abs(survey.freqs[:, None] - cube.freqs).argmin(axis=0)]
        for channel, window in zip(progress(maps, "mock"), beams, strict=True):
            lmax = min(3 * cube.nside, len(window)) - 1
            alm = sphere.analyse(channel, lmax, n_iter=sphere.N_ITER_FLAT)
            channel[:] = sphere.synthesise(sphere.multiply_beam(alm, window), cube.nside)
        maps = maps[:, cube.mask]
        if sigma is not None:
            spread = np.broadcast_to(np.asarray(sigma, dtype=np.float32), len(maps))
            maps += spread[:, None] * rng.standard_normal(maps.shape, dtype=np.float32)
        return maps

    return (mock(np.random.default_rng(1 + n)) for n in range(n_mocks))


def mock_survey(cube):
    """The `Survey` with the channels and pixels of a cube, and a box that contains its band.

    Cells are no larger than the depth of a channel, except for boxes of 1024 cells per side, and there are at
    least 4 nside cells per side. If channels are missing in the cube but present in its file, and spacing
    would be uneven without them, they are included.

    Raises
    ------
    InputError
        Unevenly spaced channels, or a band outside the range of `Survey`.
    """
    whole = len(cube.freqs) == len(cube.layout.freqs) or evenly_spaced(cube.freqs)
    freqs = cube.freqs if whole else np.sort(cube.layout.freqs)
    if not evenly_spaced(freqs):
        steps = np.diff(cube.freqs)
        raise InputError(
            f"mocks need evenly spaced channels, but the spacing is {steps.min():g} to {steps.max():g} "
            "MHz; give your own mocks (--mocks FILE)."
        )
    half = float(freqs[-1] - freqs[0]) / (len(freqs) - 1) / 2
    low, high = float(freqs[0]) - half, float(freqs[-1]) + half
    options = {"nside": cube.nside, "n_channels": len(freqs), "freq_min": low, "freq_max": high}
    try:
        reach = float(HIModel().cosmology.comoving_distance(redshift(low)))
        size = max(Survey().box_size, 2 * _ROOM * reach)
        (depth,), _ = cell_of(Survey(**options).freqs, ())
        cells = max(4 * cube.nside, 2 * fft.next_fast_len(math.ceil(size / depth / 2), real=True))
        return Survey(**options, box_cells=int(np.clip(cells, *_CELLS)), box_size=size)
    except InputError as error:
        raise InputError(f"no mocks can be made for this cube: {error} Give your own mocks.") from None
