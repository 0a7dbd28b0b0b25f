"""The interface to healpy and ducc0: maps, harmonic coefficients, power spectra, beams.

Maps are HEALPix RING; coefficients are in healpy's order (m major), for real fields of spin 0.
The transforms run in ducc0, on all cores, in the precision of their input: float32 maps
give complex64 coefficients. They agree with healpy to rounding (tests/test_sphere.py).
"""

from functools import lru_cache

import ducc0
import healpy as hp
import numpy as np

from himap.core.errors import InputError
from himap.core.progress import progress

N_ITER = 3
"""Refinements of the HEALPix quadrature, as in healpy's map2alm."""

N_ITER_FLAT = 2
"""Refinements for maps with much power up to l = 3 nside, such as HI and noise: a third makes them worse
beyond 2 nside (C_l errors there are 1 to 10 %, with two 0.2 to 2 %) and hardly better below."""

_ROOMY = 160
"""Smallest lmax of transforms; values beyond the requested lmax are zero. Below l of about 130 the last bits
of ducc0's Legendre functions depend on the order of its scratch in memory, and iterative thresholding
(SDecGMCA) amplifies such a difference to another result."""

_TRIAL, _MOST = 5, 50  # iterations of least squares
_IN_VAIN = 0.99  # share of the residual that remains if it lies beyond the multipoles


def n_threads():
    """Number of threads of a transform: all cores, unless the variable DUCC0_NUM_THREADS is set."""
    return ducc0.misc.thread_pool_size()


def is_n_pix(number):
    """Whether a sphere can have this number of pixels: 12 nside^2, nside a power of two."""
    return bool(hp.isnpixok(number) and hp.isnsideok(hp.npix2nside(number), nest=True))


def nside_of(maps):
    """nside of a map, or of a cube from its last axis.

    Raises
    ------
    InputError
        If the number of pixels is not 12 nside^2 with nside a power of two.
    """
    n_pix = np.shape(maps)[-1]
    if not is_n_pix(n_pix):
        raise InputError(f"a HEALPix map has 12 nside^2 pixels, nside a power of two; got {n_pix} pixels.")
    return hp.npix2nside(n_pix)


def sphere_sizes(shape):
    """The numbers in `shape` that can be the number of pixels of a sphere."""
    return [n for n in shape if is_n_pix(n)]


def alm_size(lmax):
    """Number of coefficients (m >= 0) up to `lmax`."""
    return hp.Alm.getsize(lmax)


def lmax_of_size(n_alm):
    """The lmax of `n_alm` coefficients; the inverse of `alm_size`."""
    lmax = hp.Alm.getlmax(n_alm)
    if lmax < 0:
        raise InputError(f"{n_alm} is not the number of coefficients of any lmax.")
    return lmax


@lru_cache(maxsize=8)
def alm_degree(lmax):
    """The degree l of every coefficient, shape (n_alm,), read-only."""
    degree = hp.Alm.getlm(lmax)[0]
    degree.flags.writeable = False
    return degree


def alm_index(lmax, degree, order):
    """Indices of coefficients with these l and m among those up to `lmax`, arrays of integers."""
    return hp.Alm.getidx(lmax, degree, order)


def alms_upto(alms, lmax):
    """The coefficients (..., n_alm) up to `lmax`: the same array if they end at or before it."""
    own = lmax_of_size(alms.shape[-1])
    return alms if lmax >= own else alms[..., alm_degree(own) <= lmax]


def alms_padded(alms, lmax):
    """The same coefficients padded with zeros up to a larger `lmax`, in a new array."""
    padded = np.zeros((*alms.shape[:-1], alm_size(lmax)), dtype=alms.dtype)
    padded[..., alm_degree(lmax) <= lmax_of_size(alms.shape[-1])] = alms
    return padded


@lru_cache(maxsize=8)
def _geometry(nside):
    return ducc0.healpix.Healpix_Base(nside, "RING").sht_info()


def synthesise(alm, nside):
    """Synthesise maps from harmonic coefficients: (..., n_alm) to (..., n_pix), float32 for complex64."""
    alm = np.asarray(alm)
    lmax = lmax_of_size(alm.shape[-1])
    flat = alm.reshape(-1, alm.shape[-1])
    real = np.float32 if alm.dtype == np.complex64 else np.float64
    maps = np.empty((len(flat), 12 * nside**2), dtype=real)
    for row, out in zip(flat, maps, strict=True):
        _synthesise(row.astype(np.result_type(real, 1j), copy=False), out, lmax, _geometry(nside))
    return maps.reshape(*alm.shape[:-1], 12 * nside**2)


def analyse(maps, lmax=None, *, n_iter=N_ITER, pixels=None):
    """Harmonic coefficients of maps: (..., n_pix) to (..., n_alm).

    HEALPix has no exact quadrature; each of `n_iter` refinements adds the coefficients of the residual, as
    in healpy's map2alm. `lmax` is 3 nside - 1 by default. If maps are 0 except in some `pixels`, given by
    index, an analysis without refinements is faster: only their rings are transformed.
    """
    maps = np.asarray(maps)
    nside = nside_of(maps)
    lmax = 3 * nside - 1 if lmax is None else lmax
    flat = maps.reshape(-1, maps.shape[-1])
    real = np.float32 if maps.dtype == np.float32 else np.float64
    alms = np.zeros((len(flat), alm_size(lmax)), dtype=np.result_type(real, 1j))
    rings = _geometry(nside)
    if pixels is not None:
        numbers = np.unique(hp.pix2ring(nside, pixels)) - 1
        rings = {name: values[numbers] for name, values in rings.items()}
    rows = progress(flat, "analysis") if len(flat) > 1 else flat
    for row, alm in zip(rows, alms, strict=True):
        for turn in range(n_iter + 1):
            residual = row - synthesise(alm, nside) if turn else row.astype(real)
            alm += (
                4 * np.pi / len(row) * _adjoint_synthesis(residual, lmax, _geometry(nside) if turn else rings)
            )
    return alms.reshape(*maps.shape[:-1], -1)


def _synthesise(alm, out, lmax, rings):
    """Synthesise one field of coefficients into `out`, on any rings."""
    if lmax < _ROOMY:
        size, places = _places(lmax)
        given, alm = alm, np.zeros(size, dtype=alm.dtype)
        alm[places] = given
    ducc0.sht.synthesis(alm=alm[None], map=out[None], lmax=max(lmax, _ROOMY), mmax=lmax, **_PLAIN, **rings)


def _adjoint_synthesis(field, lmax, rings):
    """Coefficients, the sum over pixels of field times Y_lm^*, on any rings."""
    room = max(lmax, _ROOMY)
    alm = ducc0.sht.adjoint_synthesis(map=field[None], lmax=room, mmax=lmax, **_PLAIN, **rings)[0]
    return alm if lmax == room else alm[_places(lmax)[1]]


_PLAIN = {"spin": 0, "nthreads": 0}  # 0: the number of threads set in ducc0


@lru_cache(maxsize=32)
def _places(lmax):
    """Number of coefficients with l <= `_ROOMY`, m <= `lmax`; and which of them have l <= `lmax`."""
    places = alm_index(_ROOMY, *hp.Alm.getlm(lmax))
    places.flags.writeable = False
    return hp.Alm.getsize(_ROOMY, lmax), places


def analyse_closely(pixels, lmax, tolerance):
    """Coefficients that reproduce one map (n_pix,) to `tolerance` of its rms, by least squares (LSMR).

    The refinements of `analyse` have errors of percents near l = 3 nside, where HEALPix quadrature is poor.
    This is for bright maps: a tolerance below the noise of a map would fit that noise. Returns the result
    of `analyse` if the first iterations hardly reduce the residual, as no coefficients reproduce it then.
    """
    pixels = np.asarray(pixels, dtype=np.float64)
    nside = nside_of(pixels)
    alm = analyse(pixels, lmax)
    residual = pixels - synthesise(alm, nside)
    share = np.linalg.norm(residual) / np.linalg.norm(pixels)
    if share <= tolerance:
        return alm
    given = {"map": residual[None], "lmax": lmax, "epsilon": tolerance / share, **_PLAIN, **_geometry(nside)}
    for most in (_TRIAL, _MOST):
        (correction,), _, _, remaining, _ = ducc0.sht.pseudo_analysis(maxiter=most, **given)
        if remaining <= tolerance / share:
            break
        if remaining > _IN_VAIN:
            return alm
    return alm + correction


@lru_cache(maxsize=4)
def _grid(lmax):
    """Rings of a Gauss-Legendre grid that is exact to `lmax`, thinned towards the poles.

    On a ring at angle theta from the pole coefficients of m far beyond l sin(theta) are negligible, so
    rings need about 2 l sin(theta) pixels, and all pixels have nearly the same area.
    """
    nodes, weights = np.polynomial.legendre.leggauss(lmax + 1)
    theta = np.arccos(nodes[::-1])
    largest_m = np.minimum(lmax, np.ceil(lmax * np.sin(theta) + 40 + 0.02 * lmax)).astype(np.uint64)
    nphi = np.array([ducc0.fft.good_size(2 * int(m) + 2, True) for m in largest_m], dtype=np.uint64)
    start = np.concatenate([[0], np.cumsum(nphi)[:-1]]).astype(np.uint64)
    rings = {"theta": theta, "nphi": nphi, "phi0": np.zeros(lmax + 1), "ringstart": start}
    return rings, np.repeat(2 * np.pi * weights[::-1] / nphi, nphi.astype(int))


def synthesise_grid(alm, grid_lmax=None):
    """Synthesise a field on the cheapest grid that represents it exactly, (..., n_alm) to (..., n_grid).

    For work between two transforms, such as thresholding; `analyse_grid` is the inverse. Pixels of this grid
    have equal areas within a factor of two, except near the poles. `grid_lmax` selects the grid of a larger
    lmax than that of the coefficients.
    """
    alm = np.asarray(alm, dtype=complex)
    lmax = lmax_of_size(alm.shape[-1])
    rings, area = _grid(lmax if grid_lmax is None else grid_lmax)
    fields = np.empty((*alm.shape[:-1], len(area)))
    for row, out in zip(alm.reshape(-1, alm.shape[-1]), fields.reshape(-1, len(area)), strict=True):
        _synthesise(row, out, lmax, rings)
    return fields


def analyse_grid(fields, lmax):
    """Coefficients of a field on the grid of `synthesise_grid`; exact if the field is limited to `lmax`."""
    rings, area = _grid(lmax)
    return np.apply_along_axis(lambda field: _adjoint_synthesis(field * area, lmax, rings), -1, fields)


def gaussian_beam(fwhm, lmax):
    """b_l = exp(-l (l + 1) sigma^2 / 2) of Gaussian beams: FWHM in rad, (...), to (..., lmax + 1)."""
    sigma = np.asarray(fwhm) / np.sqrt(8 * np.log(2))
    degree = np.arange(lmax + 1)
    return np.exp(-0.5 * degree * (degree + 1) * sigma[..., None] ** 2)


def multiply_beam(alm, beam):
    """Coefficients times b_l, (..., n_alm) times (lmax_beam + 1,), in a new array.

    Raises
    ------
    InputError
        If the beam ends before the coefficients.
    """
    lmax = lmax_of_size(alm.shape[-1])
    if len(beam) <= lmax:
        raise InputError(f"the beam must reach l = {lmax}, got {len(beam) - 1}; give a longer b_l.")
    return alm * np.asarray(beam, dtype=alm.real.dtype)[alm_degree(lmax)]


def synthesise_cube(alms, nside, *, n_channels, label, floats=np.float32):
    """Synthesise a cube (n_channels, n_pix) of `floats` channel by channel, with a progress bar."""
    out = np.empty((n_channels, 12 * nside**2), dtype=floats)
    for row, alm in zip(progress(out, label), alms, strict=True):
        row[:] = synthesise(alm, nside)
    return out


def power_spectrum(alms):
    """C_l of coefficients, (..., n_alm) to (..., lmax + 1) float64."""
    return np.apply_along_axis(lambda alm: hp.alm2cl(alm.astype(complex)), -1, alms)


def gaussian_alm(cl, rng):
    """A Gaussian realisation with spectrum `cl`, (n_alm,), complex128."""
    lmax = len(cl) - 1
    alm = rng.standard_normal(alm_size(lmax)) + 1j * rng.standard_normal(alm_size(lmax))
    alm /= np.sqrt(2)
    alm[: lmax + 1] = alm[: lmax + 1].real * np.sqrt(2)
    return multiply_beam(alm, np.sqrt(cl))


def change_resolution(pixels, nside):
    """Change nside of one map: pixel means to a lower, copies to a higher one (no ringing, no new scales)."""
    return hp.ud_grade(pixels, nside, power=0)


def pixels_in_frame(nside, frame, other):
    """RING index of the pixel of `other` that contains the centre of every pixel of `frame`, (n_pix,).

    Frames are letters of `himap.maps.frames.FRAMES`. ``pixels[pixels_in_frame(...)]`` converts a map from
    frame `other` to `frame` without new values, for example a mask or hits.
    """
    vectors = hp.Rotator(coord=[frame, other])(pixel_vectors(nside).T)
    return hp.vec2pix(nside, *vectors)


def rotate_maps(maps, frame, other):
    """Rotate maps (n, n_pix) of `frame` to `other`, by their multipoles to 3 nside - 1.

    Frames are letters of `himap.maps.frames.FRAMES`. Unlike averaging nearby pixels, this preserves C_l.
    """
    rotator, out = hp.Rotator(coord=[frame, other]), np.empty_like(maps)
    for row, turned in zip(maps, out, strict=True):
        alm = rotator.rotate_alm(analyse(row.astype(np.float64), n_iter=N_ITER))
        turned[:] = synthesise(alm, nside_of(maps))
    return out


def coupling_matrix(mask_cl, lmax):
    """Mode coupling of a mask, (lmax + 1, lmax + 1): <pseudo C_l> = sum_l' M_ll' C_l'.

    M_ll' = (2 l' + 1) / (4 pi) sum_L (2 L + 1) W_L (l l' L; 0 0 0)^2 with W_L the mask's spectrum
    (Hivon et al. 2002, Eq. A31).
    """
    n = min(len(mask_cl), 2 * lmax + 1)
    # The square of a symbol is half the integral of three Legendre polynomials: exact with n_nodes.
    n_nodes = lmax + n // 2 + 1
    nodes = np.cos(ducc0.misc.GL_thetas(n_nodes))
    legendre = np.polynomial.legendre.legvander(nodes, max(lmax, n - 1)).T
    weights = ducc0.misc.GL_weights(n_nodes, 1) / (2 * np.pi)
    weights *= (2 * np.arange(n) + 1) * mask_cl[:n] / (4 * np.pi) @ legendre[:n]
    products = legendre[: lmax + 1] * weights @ legendre[: lmax + 1].T
    return (np.arange(lmax + 1) + 0.5) * products


def pixel_vectors(nside, *, nest=False):
    """Unit vectors of the pixel centres, RING or NESTED, (n_pix, 3)."""
    return np.stack(hp.pix2vec(nside, np.arange(12 * nside**2), nest=nest), axis=-1)


def nest_to_ring(nside):
    """RING index of every NESTED pixel, (n_pix,)."""
    return hp.nest2ring(nside, np.arange(12 * nside**2))


def pixel_at(nside, lon, lat):
    """RING index of the pixel at Galactic longitude and latitude, deg."""
    return hp.ang2pix(nside, lon, lat, lonlat=True)


def pixel_latitude(nside):
    """Galactic latitude of every RING pixel, deg, (n_pix,)."""
    return hp.pix2ang(nside, np.arange(12 * nside**2), lonlat=True)[1]
