"""Mocks for a cube of one's own: HI that is known, in the channels and pixels of the cube."""

import math

import numpy as np
from scipy import fft

from himap.core.checks import checked_beams, checked_noise, evenly_spaced, whole_number
from himap.core.errors import InputError
from himap.core.progress import progress
from himap.core.survey import Survey
from himap.cubes.files import read_truth
from himap.cubes.spectra import check_truth
from himap.maps import sphere
from himap.measures.cylindrical import cell_of
from himap.sky.cosmology import HIModel, redshift
from himap.sky.hi import hi_maps

_CELLS = (64, 1024)  # of a box, along one side: the least, and what fits a workstation
_DEEP = 1.05  # times the depth of a channel: cells that hold nearly all of its HI
_ROOM = 1.01  # of the box beyond the band
_BRIGHT = 0.5  # rms over that of a cube with foreground, which is far brighter than HI


def read_mocks(cube, paths, *, tell=None, **reading):
    """The maps of mocks from files, one after the other, (n_channels, n_seen) float32, mK.

    Parameters
    ----------
    cube
        The `Cube` that they are put into.
    paths
        Files as `read_cube` takes them, one for each mock, with the beam of the cube.
    tell
        Called with what the user should know of a file, a sentence.
    reading
        As in `read_truth`, for what the files do not say.

    Raises
    ------
    InputError
        When a file is read: one of another nside, of other channels, or that does not see what the cube does.
    """
    for path in paths:
        mock = read_truth(path, cube=cube, **reading)
        for remark in mock.remarks if tell else ():
            tell(f"{path}: {remark}")
        check_truth(cube, mock, f"{path}: a mock")
        maps = mock.maps[:, cube.mask[mock.mask]]
        if tell:
            rms = [np.sqrt(np.mean([channel.var() for channel in one])) for one in (maps, cube.maps)]
            if (share := rms[0] / rms[1]) > _BRIGHT:
                tell(f"{path} has {share:.2g} times the rms of the cube: mocks are HI and noise alone.")
        yield maps


def draw_mocks(cube, beams, n_mocks, *, noise=None, tell=None):
    """The maps of lognormal mocks, one after the other, (n_channels, n_seen) float32, mK.

    HI as in the simulations of the paper, through the beams, and white noise where its level is given. The
    box is as fine as the channels: of 1 MHz it takes some minutes and up to 9 GB of memory for each mock.

    Parameters
    ----------
    cube
        The `Cube` that they are put into.
    beams
        b_l, (n_channels, lmax + 1) with lmax of 2 nside or more.
    n_mocks
        How many.
    noise
        Of a pixel, mK, a number or (n_channels,); None for none.
    tell
        As in `read_mocks`; of channels that are narrower than the cells of the largest box.

    Raises
    ------
    InputError
        No beams, channels that are not evenly spaced or beyond what can be simulated, or a bad number.
    """
    whole_number("the number of mocks", n_mocks, 1, 10_000)
    if beams is None:
        raise InputError(
            "mocks are made with the beam of the cube; give it (beams=, --beam), or mocks of your own."
        )
    beams = checked_beams("beams", beams, len(cube.freqs))
    sigma = checked_noise("noise", noise, len(cube.freqs))
    survey = mock_survey(cube)
    (depth,), _ = cell_of(survey.freqs, ())
    cell = survey.box_size / survey.box_cells
    if tell and cell > _DEEP * depth:
        tell(
            f"Channels are {depth:.2g} Mpc/h deep and the cells of the mocks, {survey.box_cells} along a "
            f"side, {cell:.2g}: they have too little HI at large k; give mocks of your own (--mocks FILE)."
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
    """The `Survey` that has the channels and pixels of a cube, and a box that holds its band.

    Its cells are no larger than a channel is deep, but for boxes of 1024 cells along a side, and 4 nside of
    them are one or more. Channels that the file of the cube has, and the cube not, are in it where the others
    are uneven without.

    Raises
    ------
    InputError
        Channels that are not evenly spaced, or a band outside what `Survey` takes.
    """
    whole = len(cube.freqs) == len(cube.layout.freqs) or evenly_spaced(cube.freqs)
    freqs = cube.freqs if whole else np.sort(cube.layout.freqs)
    if not evenly_spaced(freqs):
        steps = np.diff(cube.freqs)
        raise InputError(
            f"mocks can be made for evenly spaced channels, and these are {steps.min():g} to {steps.max():g} "
            "MHz apart; give mocks of your own (--mocks FILE)."
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
        raise InputError(f"no mocks can be made for this cube: {error} Give mocks of your own.") from None
