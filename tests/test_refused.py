"""What the library refuses, in one table: a call, what is wrong in it, and what is said."""

from dataclasses import fields, replace
from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest
from test_parameters import DECLARED

from himap import removal
from himap.app.parameters import check_parameters, parse_texts, read_parameters
from himap.core.checks import checked_cube, whole_number
from himap.core.errors import InputError
from himap.core.memory import parse_size
from himap.core.reading import regular_file
from himap.core.survey import Survey
from himap.cubes import beam_sensitivity, beams_of, clean_cube, read_cube, save_cleaned, suggest
from himap.cubes.cube import make_cube
from himap.cubes.layout import Layout
from himap.cubes.mocks import draw_mocks
from himap.cubes.report import write_report
from himap.instrument import beams
from himap.instrument.beams import Degraded, Evolving, FromFile, Oscillating, named
from himap.instrument.beams.base import REGISTRY as BEAMS
from himap.maps import sphere
from himap.maps.frames import is_nested
from himap.maps.healpix_io import freq_in_header, temperature_unit
from himap.measures.cylindrical import cell_of, cylindrical_power
from himap.measures.diagnostics import inside, mean_squared_error, ratio
from himap.measures.low_rank_spectra import difference, frequency_power_without
from himap.measures.spectra import angular_power, frequency_power
from himap.measures.transfer import HarmonicPower, MockPower, TransferFunction
from himap.paper import pipeline
from himap.paper.ensembles import compare_samples
from himap.paper.experiments.beam_errors import assumed_beam
from himap.paper.masked import Region, compared
from himap.paper.methods import methods_for, sdecgmca_for
from himap.paper.mocks import Mock, recovered
from himap.paper.patch import Patch, patch_sky
from himap.paper.readings import find_reading
from himap.paper.realisation import Realisation
from himap.paper.study import Study
from himap.removal.base import REGISTRY
from himap.removal.peaks import mask_peaks
from himap.removal.restarts import Ensemble
from himap.removal.smooth_spectra import SmoothSpectra
from himap.sky.cosmology import Cosmology
from himap.sky.galaxy import Dimming, Galaxy
from himap.sky.hi import hi_maps, lognormal_box

N_PIX = 192
FREQS = np.linspace(902.5, 1397.5, 100)
SKY = 1e4 * (FREQS[:, None] / 1150) ** np.linspace(-3.2, -2.1, N_PIX)
ONES = np.ones((16, N_PIX))
BROKEN = np.where(np.indices(SKY.shape).sum(axis=0) == 0, np.nan, SKY)
FLAT = np.where(np.arange(100)[:, None] == 5, 3.0, SKY)
DARK = np.where(np.indices(SKY.shape).sum(axis=0) == 0, 0, SKY)
ONE = HarmonicPower(power=np.ones((5, 4)), n_channels=6, channel_width=1.0)
CELL = np.array([3.0, 2.0, 2.5])
SURVEY = Survey(nside=4, n_channels=6, box_cells=16)
CASE = pipeline.Case(survey=SURVEY)
CUBE = make_cube(SKY[:24], Layout.of_sphere(SKY, nested=False, freqs=FREQS[:24], unit="mK"))


def changed(value, where=(3, 5)):
    """Weights of one everywhere else."""
    out = ONES.copy()
    out[where] = value
    return out


def clean(name, n_channels=100, maps=SKY, parameters=(), **given):
    method = removal.create(name, **dict(parameters))
    return method.clean(maps[:n_channels], **{"freqs": FREQS[:n_channels]} | given)


def windows(beam):
    return partial(named(beam).windows, lmax=10)


def ways_of(method):
    return partial(compared, CASE, method, Region())


def restarted(method):
    return partial(Ensemble.of, SimpleNamespace(method=method))


def errors_of_transfer(**given):
    return TransferFunction(**({"mocks": (MockPower(ONE, ONE, ONE),)} | given)).errors("angular")


def mocks_of_cube(*, freqs=FREQS[:24], **given):
    return draw_mocks(replace(CUBE, freqs=freqs), **{"beams": np.ones((24, 12)), "n_mocks": 2} | given)


def power_of_box(**given):
    return cylindrical_power(**({"maps": np.zeros((4, 5, 6)), "cell": CELL} | given))


def sensitivity_to(beam="evolving", method="beam_subspace", **given):
    beams = beams_of(CUBE, beam) if method != "pca" else None
    return beam_sensitivity(clean_cube(CUBE, method, n_sources=2, beams=beams, peaks=False), beam, **given)


def typed(**texts):
    return check_parameters(DECLARED, parse_texts(DECLARED, texts))


method = partial(partial, removal.create)
weighted, masked = partial(clean, "pca", 16), partial(clean, "pca")
subspace = partial(clean, "beam_subspace")
within = partial(clean, "beam_subspace", 4, mask=np.arange(N_PIX) < N_PIX // 2)
peaks = partial(mask_peaks, SKY, FREQS)
powers, along = partial(angular_power, ONES), partial(frequency_power, ONES)
checked = partial(checked_cube, "maps")
a_table = partial(regular_file, kind="table")
squared_error = partial(mean_squared_error, [1.0], [1.0])
without_lines = partial(frequency_power_without, None, channel_width=2.0, cube=SKY)
CI, TAPERED = Study(preset="ci"), replace(CASE, survey=replace(SURVEY, taper="hann"))
COUNTS = [1, 3], [3], [], [0, 1], range(20, 25), range(1, 10**30), [2, 1], 3
SIZES = "", "much", "0GB", "-1GB", "GB", "1e3", "3 PB", "nan", "2000TB", "9" * 400, "0.1B", "\u0663GB"
aware = partial(clean_cube, CUBE, "beam_subspace")
UNCOUNTED = "polynomial", "gnilc"
LINES = "x = 1", "x: int", "x: int = len('a')", "x: set = {1}", "print(1)"
UNITS = "K_CMB", "Jy", "MJy/sr", "nK", "RJ", "K K", "mK_RJ_RJ"
TYPED = [
    ("n_sources", "three", "a whole number, got 'three'"),
    ("n_sources", "3.5", "a whole number, got 3.5"),
    ("n_sources", "true", "a whole number, got True"),
    ("n_sources", "null", "a whole number, got None"),
    ("share", "half", "a number, got 'half'"),
    ("masked", "1", "true or false, got 1"),
    ("degrees", "3", "a list, got 3"),
    ("options", "[]", r"a dict such as .* got \[\]"),
    ("options", "{[1]: 2}", "a dict such as .* got '{"),
    ("degrees", "[" * 100_000, r"a list, got '\["),
    ("n_max", "x", "a whole number or null, got 'x'"),
]
PASSED = [
    ({"n_sorces": 3}, r"unknown parameter n_sorces \(did you mean n_sources\?\); .* share, .*seed"),
    ({"nsid": 3}, "did you mean nside"),
    ({"zzz": 3, "qqq": 1}, "unknown parameters zzz, qqq; known are preset, n_sources"),
    ({"noise_reading": "power"}, "noise_reading must be deviation or variance"),
    (parse_texts(DECLARED, {"noise_reading": "1"}), "noise_reading must be deviation or variance"),
    ({"nside": 65}, "nside must be a power of two, got 65"),
    ({"survey": {"nsides": 64}}, "unknown Survey field nsides"),
    ({"preset": "big"}, "unknown preset 'big'; there are ci"),
    ({"survey": {"seed": 7}, "seed": 8}, "seed given twice, alone and in survey"),
]
passed = partial(check_parameters, DECLARED)
freq_of = partial(freq_in_header, path="a.fits")
assumed, ADDITIVE = partial(assumed_beam, Oscillating()), Oscillating(ripple="additive")
logarithm = partial(clean, "polynomial", parameters={"variable": "logarithm"})
IMAGE, BAD_IMAGE = np.ones((12, 16), bool), r"image must be \(n_y, n_x\) bool, True at the"
on_image = partial(clean, "gmca", image=IMAGE)
IMAGES = IMAGE[1:], IMAGE.ravel(), IMAGE.astype(int), IMAGE[None]
BETWEEN, BETWEEN_1 = "must be between 0 and", "n must be a whole number between 1 and 4, got"
TABLE = [
    (Survey, "nside", 65, "power of two, got 65; try 64 or 128"),
    (Survey.preset, "name", "huge", "ci, quick, laptop, paper"),
    (partial(Survey.preset, "ci"), "channels", 3, "n_channels: int  number of frequency channels"),
    (Survey, "freq_min", 1400.0, "freq_min < freq_max"),
    (Survey, "r_smooth", -1, r"r_smooth \(Gaussian smoothing.*must be at least 0 and at most 100, got -1"),
    (Survey, "box_cells", 65, "box_cells must be even.*got 65, try 66"),
    (Survey, "hi_bias", "matter", "hi_bias must be exponential or contrast, got 'matter'"),
    (Galaxy, "source", "haslam", "there are synthetic, templates, pysm3"),
    (Galaxy, "source", "templates", "needs template_dir.*one synchrotron index map"),
    (partial(Galaxy, source="templates"), "template_dir", "no/such", "no/such cannot be read"),
    (Galaxy, "template_dir", ".", "leave it out or choose the Galaxy 'templates'"),
    (partial(Galaxy, source="pysm3"), "template_dir", ".", "with 'pysm3'"),
    (Galaxy, "small_scales", "yes", "True or False"),
    (Galaxy, "small_scales", False, "leave it out, or choose the Galaxy 'templates'"),
    (partial(Galaxy().components, rng=np.random.default_rng(1)), "nside", 0, "whole number between 1"),
    (partial(Galaxy().components, rng=np.random.default_rng(1)), "nside", 48, "power of two"),
    (partial(Galaxy().components, rng=np.random.default_rng(1)), "nside", 16.5, "whole number between 1"),
    (Cosmology().comoving_distance, "z", 7.0, BETWEEN),
    (Cosmology().redshift_at, "distance", 9000.0, BETWEEN),
    (Cosmology, "omega_m", 0.04, "omega_b < omega_m"),
    (partial(lognormal_box, 8, 1000.0, None), "hi_bias", "Contrast", "must be exponential or contrast"),
    (named, "text", "beams/nowhere", "there is no file of widths or b_l of a beam 'beams/nowhere'"),
    (named, "text", "nowhere.txt", "there is no file of widths or b_l of a beam 'nowhere.txt'"),
    (named, "text", "square", "unknown beam 'square'; there are degraded, evolving, file, "),
    (named, "text", "evolving:width=3", "evolving has no parameter 'width'; its parameters are none"),
    (named, "text", "oscillating:riple=additive", r"did you mean ripple\?"),
    (named, "text", "oscillating:ripple=wobble", "ripple must be bracket, additive or additive_strong"),
    (named, "text", "misjudged:beam=square", "unknown beam 'square'"),
    (named, "text", "misjudged:width=wide", "width .* must be a number, got 'wide'"),
    (named, "text", 3, "a beam is a name or the path of a file, got 3"),
    (named, "text", "meerkat:band=L,Band=UHF", "given twice"),
    (a_table, "path", "/dev/null", "the table /dev/null must be a file that is on"),
    (FromFile, "path", "nowhere.txt", "there is no file of widths or b_l of a beam 'nowhere.txt'"),
    *((windows("oscillating"), "freqs", ends, "850 to 1420 MHz") for ends in ([849, 1000], [1000, 1421])),
    *((partial(Evolving().windows, FREQS), "lmax", n, "lmax must be a whole number") for n in (2.5, -1)),
    (windows("rippled"), "freqs", [1000.0, 1500.0], "850 to 1420 MHz.*oscillating:ripple=additive"),
    (windows("evolving"), "freqs", 1000.0, "one MHz value per channel"),
    (partial(windows("evolving"), [1000.0]), "dish_diameter", "a", "dish must be a diameter in m.*got 'a'"),
    (windows("meerkat"), "freqs", [971, 1023], "of UHF and L, got 971 to 1023.*name one: meerkat:band=UHF"),
    (windows("meerkat"), "freqs", [500, 600], "UHF from 550 to 1050 MHz, L from 900 to 1650 MHz.*leave out"),
    (windows("meerkat"), "freqs", [880, 1060], "one band alone, of UHF and L, got 880 to 1060"),
    (windows("meerkat:band=UHF"), "freqs", [1000, 1084], "of UHF, got 1000 to 1084"),
    (windows("meerkat_lobes:band=L"), "freqs", [899, 1000], "of L, got 899 to 1000"),
    (partial(hi_maps, rng=None), "survey", Survey(box_size=2000.0), "box_size to at least 2994"),
    (removal.create, "name", "pcs", r"unknown method 'pcs' \(did you mean pca\?\); there are .*pca"),
    *((removal.create, "name", name, "unknown method") for name in ("", "__init__", "base", "_", 3)),
    (method("pca"), "n_sorces", 3, "did you mean n_sources.*number of components"),
    (method("parametric", beta_max=-2.5), "beta_min", -2.5, "beta_min must be below beta_max"),
    (partial(clean, "parametric"), "n_channels", 2, "needs 3 channels"),
    (partial(clean, "parametric"), "maps", SKY - SKY.mean(axis=1)[:, None], "give maps from which no mean"),
    (partial(clean, "gmca"), "maps", SKY[:, 1:], "nside a power of two"),
    *((partial(clean, "gmca"), "image", image, f"{BAD_IMAGE} 192 pixels") for image in IMAGES),
    (on_image, "parameters", {"n_scales": 5}, "n_scales must be at most 4 for an image of"),
    (partial(clean, "gnilc"), "image", IMAGE, "looks at the sphere, by multipoles; image= must be left out"),
    (partial(clean, "fastica"), "rng", None, "random rotation: pass rng="),
    (partial(clean, "gaussian_process"), "n_channels", 6, "needs 7 channels or more, got 6"),
    (partial(clean, "gnilc"), "n_channels", 7, "needs 8 channels or more, got 7"),
    (partial(clean, "pca"), "maps", FLAT, "channel 5 has one value everywhere"),
    (partial(clean, "gaussian_process"), "maps", np.ones(SKY.shape), "maps that vary over the sky"),
    (method("gnilc"), "prior", 3, "prior must be the path"),
    (partial(clean, "gnilc"), "freqs", FREQS + 100, "HI is expected below"),
    *(
        (method(name), *bad)
        for name in ("beam_subspace", "sdecgmca")
        for bad in (
            ("noise", -1, "noise must be above zero, in mK per pixel, got -1"),
            ("noise", (0.1, np.nan), "noise must be above zero"),
            ("noise", "white", "noise must be real numbers"),
            ("noise", ((0.1, 0.2), 0.3), "noise must be one array"),
        )
    ),
    *(
        (partial(clean, name), "beams", np.ones((100, n)), f"with lmax of 1 or more, got .100, {n}")
        for name in ("beam_subspace", "smooth_spectra")
        for n in (0, 1)
    ),
    (within, "beams", np.ones((4, 5)), "must reach l = 8, as beam_subspace does, got b_l to 4"),
    (subspace, "parameters", {"noise": (1, 2)}, "one value or 100, .*, got 2"),
    (method("sdecgmca"), "reading", "quick", "one of default, letter, code, code-rounding, .*, got 'quick'"),
    (method("sdecgmca"), "reading", None, "reading must be one of"),
    (method("sdecgmca", beyond="regularised"), "last", "unregularised", "take last='once' or 'repeated'"),
    (method("sdecgmca", beyond="regularised"), "last", "thresholded", "last='thresholded' has none"),
    (partial(clean, "polynomial"), "n_channels", 7, "order must be a whole number between 1 and 5, got 6"),
    (partial(clean, "polynomial"), "parameters", {"n_sigma": 0.5}, "could flag"),
    (logarithm, "maps", DARK, "1 of 19200 voxels are not positive; .*variable='temperature'"),
    (SmoothSpectra(n_sources=9).check, "n_channels", 40, "at most n_smooth, 8, got 9; give a larger"),
    (SmoothSpectra(n_smooth=40).check, "n_channels", 40, "below the number of channels, 40, got 40"),
    (SmoothSpectra(n_sources=41).check, "n_channels", 40, "at most the number of channels, 40, got 41"),
    (peaks, "order", 0, "order must be a whole number between 1 and 98, got 0"),
    (peaks, "order", 99, "between 1 and 98, got 99"),
    (peaks, "n_sigma", 0, "n_sigma must be a positive number .*, got 0"),
    *((peaks, "n_sigma", value, f"got {value!r}") for value in (np.nan, "5", True)),
    (peaks, "n_sigma", 1.0, "could flag 99 of 100 channels, too many to fit order 6"),
    (peaks, "spread", "sky", "one of line, channel, cube, mad, got 'sky'"),
    (partial(peaks, spread="cube"), "weights", np.ones(SKY.shape), "that of the line, got 'cube'"),
    (partial(mask_peaks, SKY[:1]), "freqs", FREQS[:1], "2 or more channels"),
    (partial(mask_peaks, SKY), "freqs", FREQS[1:], "one MHz value per channel"),
    (partial(mask_peaks, SKY), "freqs", FREQS[::-1], "ascending"),
    (partial(mask_peaks, BROKEN), "freqs", FREQS, "got 1 NaN"),
    (masked, "mask", np.ones(N_PIX - 1), r"shape \(n_pix,\) = \(192,\), got \(191,\)"),
    (masked, "mask", np.full(N_PIX, 0.5), "got values between"),
    (masked, "mask", np.full(N_PIX, np.nan), "got values outside"),
    (masked, "mask", np.zeros(N_PIX, bool), "keeps no pixel"),
    (masked, "mask", np.full(N_PIX, "yes"), "the mask must be real numbers"),
    (partial(clean, "pca", maps=BROKEN), "mask", np.arange(N_PIX) < 9, "got 1 NaN, infinite or UNSEEN"),
    (partial(clean, "pca", 16, BROKEN), "weights", changed(0), "got 1 NaN, infinite or UNSEEN"),
    (weighted, "weights", changed(-1), "finite and 0 or more, got 1 that are not"),
    (weighted, "weights", changed(np.nan), "finite and 0 or more, got 1 that are not"),
    (weighted, "weights", changed(np.inf, (slice(2), 0)), "finite and 0 or more, got 2 that are not"),
    (weighted, "weights", ONES[0, :-1], r"that of the maps, \(16, 192\); got \(191,"),
    (weighted, "weights", ONES.T, r"got \(192, 16\)"),
    (weighted, "weights", ONES[:3], r"got \(3, 192\)"),
    (weighted, "weights", 0 * ONES[0], "0 in all pixels that are kept"),
    (weighted, "weights", changed(0, 4), "0 in all pixels of channel 4 and 0 more; leave these channels out"),
    (weighted, "weights", np.full(N_PIX, "many"), "weights must be real numbers"),
    (weighted, "weights", changed(0, (slice(3, None), 7)), "pca needs 4 channels .* 1 of 192 have fewer"),
    (partial(clean, "polynomial", 16), "weights", changed(0, (slice(7, None), 7)), "needs 8 channels .* 1"),
    *((partial(clean, "pca"), "freqs", FREQS * factor, "looks like another unit") for factor in (1e-3, 1e6)),
    (partial(clean, "pca"), "freqs", FREQS + 1j, "real numbers"),
    *((partial(clean, "pca"), "freqs", FREQS * bad, "positive and finite") for bad in (np.nan, -1, np.inf)),
    (Survey, "dish_diameter", 10**400, "must be a number, got 1000"),
    (partial(clean, "pca", 2), "maps", [[1, 2], [3]], "one array, got rows of unequal length"),
    (checked, "maps", 1j * ONES, "maps must be real numbers, got complex128"),
    (checked, "maps", np.array([["a"]]), "real numbers, got <U1"),
    (checked, "maps", ONES > 0, "real numbers, got bool"),
    (checked, "maps", np.ones(3), r"\(n_channels, n_pix\), got \(3,\)"),
    (checked, "maps", np.ones((3, 0)), r"got \(3, 0\)"),
    (checked, "maps", np.full((2, 3), -1.6375e30), "got 6 NaN, infinite or UNSEEN"),
    *((partial(whole_number, "n", low=1, high=4), "value", value, BETWEEN_1) for value in (0, 5, 2.5, None)),
    (powers, "mask", np.ones(12), "must have shape"),
    (powers, "mask", np.zeros(N_PIX), "keeps no pixel"),
    (powers, "mask", np.ma.masked_array(np.ones(N_PIX, bool), np.arange(N_PIX) < 5), "has masked values"),
    (powers, "mask", [[True], [True, False]], "rows of unequal length"),
    (powers, "mask", np.full(N_PIX, 2.0), "between 0 and 1"),
    (powers, "mask", np.full(N_PIX, np.nan), "between 0 and 1"),
    (angular_power, "maps", np.ma.masked_greater(ONES, 0), "maps has masked values"),
    (powers, "bin_width", 0, "bin_width"),
    (partial(along, channel_width=1.0), "taper", ["hann"], "taper must be one of none, hann, got"),
    (partial(along, channel_width=1.0), "taper", "cosine", "taper must be one of none, hann, got 'cosine'"),
    *((along, "channel_width", value, "a positive number") for value in (0, -1, np.nan, np.inf, "4", 1j)),
    *((sphere.nside_of, "maps", np.zeros(n), f"got {n} pixels") for n in (100, 12 * 9**2)),
    (sphere.lmax_of_size, "n_alm", 12, "12 is not the number"),
    (partial(sphere.multiply_beam, np.zeros(sphere.alm_size(47))), "beam", np.ones(10), "l = 47, got 9"),
    (partial(pipeline.Case, survey=SURVEY), "galaxy", "synthetic", "a Survey and a Galaxy"),
    (partial(pipeline.Case, survey=SURVEY), "beam", "degraded", "a Case takes a beam, such as Degraded"),
    (partial(pipeline.Case, survey=SURVEY), "dimming", 0.1, "dimming must be a Dimming or None, got 0.1"),
    (Region, "north", "yes", "north must be True or False, got 'yes'"),
    (Mock, "gaussian", "no", "gaussian must be True or False, got 'no'"),
    (ways_of(removal.BeamSubspace()), "way", "outside", "no mask, post-masked, dimmed or inside, got 'outsi"),
    (ways_of(removal.SDecGMCA(reading="code")), "way", "inside", "residual of sdecgmca ends at some l"),
    (partial(recovered, CASE, (removal.PCA(),)), "mock", Mock(seed=SURVEY.seed), "another sky than the data"),
    (partial(methods_for, Evolving()), "method", "gmca", "SDecGMCA can be replaced by .*, got 'gmca'"),
    (partial(sdecgmca_for, Evolving()), "depth", 2, "SDecGMCA has no field depth; it has n_sources,"),
    (Realisation, "options", (("depth", 7),), "SDecGMCA has no field depth; it has n_sources"),
    (Realisation, "options", (("share", 7),), "share"),
    (find_reading, "label", "nonsense", "reading must be one of default; letter; .*, got 'nonsense'"),
    (CI.check, "removers", {Degraded(): [removal.PCA(n_sources=101)]}, "at most the number of channels, 100"),
    (CI.check, "removers", {"round": [removal.PCA()]}, "a Case takes a beam"),
    (CI.check, "removers", {}, "nothing to clean"),
    (Realisation, "restart", -1, "restart must be a whole number"),
    (partial(Realisation, method="beam_subspace"), "restart", 1, "BeamSubspace has no field restart"),
    (partial(Realisation, survey=SURVEY), "n_sources", (), "scan needs .* to the 6 channels, got none"),
    (patch_sky, "case", TAPERED, "no taper, got taper='hann'; leave it out"),
    (partial(assumed, kind="colour"), "error", 1, "one of width, ripple, .* got 'colour' and 1"),
    (partial(assumed, kind="width"), "error", "much", "and a number, got 'width' and 'much'"),
    (partial(assumed, kind="width"), "error", True, "and a number, got 'width' and True"),
    (partial(assumed, kind="width"), "error", 2, "at most 0.5, got 2"),
    (partial(assumed, kind="beam"), "error", "square", "unknown beam 'square'"),
    (partial(assumed_beam, Evolving(), "phase"), "error", 0.1, "the phase of a ripple .* got evolving"),
    (partial(assumed_beam, ADDITIVE, "amplitude"), "error", 0.1, "got oscillating:ripple=additive"),
    (partial(difference, SKY[:1]), "truth", SKY, "one shape"),
    (partial(difference, BROKEN), "truth", SKY, "finite|NaN"),
    (partial(difference, SKY, SKY), "mask", np.ones(7, dtype=bool), "mask"),
    (partial(compare_samples, np.zeros((4, 3))), "two", np.zeros((5, 2)), "expected"),
    (partial(compare_samples, np.zeros((4, 3))), "two", np.zeros((0, 3)), "expected"),
    (partial(compare_samples, np.zeros((4, 3))), "two", np.full((5, 3), np.nan), "finite"),
    (partial(ratio, [1.0]), "true", [1.0, 2.0], "one shape"),
    (partial(ratio, [1.0]), "true", [0.0], "must be positive"),
    (squared_error, "definition", "rms", "'rms'; there are relative, logarithmic"),
    (partial(inside, np.arange(5), np.arange(5), 4), "high", 9, "between 4 and 9: the values go from 0 to 4"),
    (restarted(removal.PCA()), "n", 8, "pca does not depend on its start"),
    (restarted(removal.SDecGMCA()), "n", 0, "restarts must be a whole number between 1"),
    (without_lines, "removed", np.ones(N_PIX, dtype=bool), "no line of sight is kept"),
    (errors_of_transfer, "mocks", (), "got none"),
    (errors_of_transfer, "mocks", (MockPower(ONE, ONE, ONE),), "two mocks or more"),
    (mocks_of_cube, "freqs", np.geomspace(900, 1100, 24), "evenly spaced"),
    (mocks_of_cube, "freqs", np.linspace(1300, 1500, 24), "no mocks can be made for this cube: freq_max"),
    (mocks_of_cube, "noise", [1, 2], "24"),
    (mocks_of_cube, "beams", np.ones((23, 12)), "24"),
    (partial(clean_cube, CUBE, removal.PCA()), "n_sources", 9, "n_sources: pass parameters to PCA"),
    (partial(clean_cube, CUBE), "method", removal.PCA, "a method, such as PCA"),
    (partial(clean_cube, method="pca"), "cube", "a.h5", "must be a Cube, as returned by read_cube, got str"),
    (partial(clean_cube, CUBE, "pca"), "peaks", "no", "peaks must be True or False"),
    (partial(clean_cube, CUBE, "fastica"), "seed", "x", "seed must be a whole number"),
    (partial(clean_cube, CUBE, "pca"), "n_sources", 24, "below the number of channels, 24"),
    *((aware, "beams", np.ones((24, n)), f"to 2 nside = 8 at least, got {n}") for n in (5, 8)),
    (partial(save_cleaned, path="a.h5"), "cleaned", CUBE, "expected a CleanedCube, .* got Cube"),
    (partial(write_report, path="a.html"), "cleaned", None, "expected a CleanedCube, .* got NoneType"),
    (read_cube, "path", SKY, "must be given by its path, got ndarray"),
    (partial(sensitivity_to, method="pca"), "beam", "evolving", "pca does not use the beam"),
    (partial(sensitivity_to, ripples=[]), "widths", [], "beam errors must be given and nonzero"),
    (sensitivity_to, "widths", [0.0], "beam errors must be given and nonzero"),
    (sensitivity_to, "widths", [0.9], "at most 0.5, got 0.9"),
    (sensitivity_to, "period", 0, "period .* above 0"),
    (sensitivity_to, "period", float(np.diff(FREQS)[0]), "nearly constant over the channels"),
    (
        partial(sensitivity_to, beam="meerkat:band=L"),
        "dish",
        12,
        "--dish. applies to beams",
    ),
    *((partial(suggest, CUBE), "method", one, f"{one} has no number of sources; b") for one in UNCOUNTED),
    (partial(suggest, CUBE), "n_sources", range(5, 4), "got 5 to 3"),
    (partial(suggest, CUBE), "n_sources", [1.0, 2.5], "n_sources .*must be a whole number"),
    *((partial(suggest, CUBE), "n_sources", n, "n_sources .*two or more .* in a row.* got") for n in COUNTS),
    *((parse_size, "text", size, "such as 16GB") for size in SIZES),
    *((read_parameters, "source", line, "name: type = default") for line in LINES),
    *((typed, name, text, f"parameter {name}( .*)? must be {message}") for name, text, message in TYPED),
    *((passed, "given", values, message) for values, message in PASSED),
    *((temperature_unit, "text", text, f"brightness temp.* got unit {text!r}") for text in UNITS),
    *((temperature_unit, "text", text, "brightness temperatures .*got no unit") for text in (None, "", " ")),
    *((is_nested, "order", text, "must be RING or NESTED") for text in ("", "SPIRAL", "NESTLE")),
    *((freq_of, "header", {"FREQ": bad}, "MHz, got .* in a.fits") for bad in ("950 MHz", True, np.inf)),
    (power_of_box, "maps", np.zeros((4, 9)), "shape"),
    (power_of_box, "maps", np.zeros((4, 1, 9)), "shape"),
    (power_of_box, "cell", (1, 2), "three sides"),
    (power_of_box, "cell", (1, 2, 0), "three sides"),
    (power_of_box, "mask", np.zeros((5, 6), dtype=bool), "True somewhere"),
    (power_of_box, "mask", np.ones((6, 5), dtype=bool), "of shape"),
    (power_of_box, "maps", np.full((4, 5, 6), np.nan), "maps must be finite everywhere, got 120 NaN"),
    (partial(cell_of, angles=(0.01, 0.01)), "freqs", np.array([900.0, 901, 905]), "evenly spaced"),
    (partial(cell_of, angles=(0.01, 0.01)), "freqs", np.array([1410.0, 1420, 1430]), "below 1420.4"),
    (partial(cell_of, angles=(0.01, 0.01)), "freqs", np.array([100.0, 101, 102]), BETWEEN),
    (partial(cell_of, angles=(0.01, 0.01)), "freqs", np.array([1000.0]), "two channels at least"),
]


@pytest.mark.parametrize(("call", "name", "value", "message"), TABLE)
def test_refused(call, name, value, message):
    with pytest.raises(InputError, match=message):
        call(**{name: value})


KINDS = [Survey, Cosmology, Dimming, Region, Patch, Mock]
KINDS += [REGISTRY[name] for name in removal.available()] + [BEAMS[name] for name in beams.available()]


@pytest.mark.parametrize("kind", KINDS)
def test_a_parameter_beyond_its_limits(kind):
    """Every one that states limits or choices refuses what is not among them, by its name."""
    for item in fields(kind):
        low, high, above, choices = (item.metadata[key] for key in ("minimum", "maximum", "above", "choices"))
        is_number = item.type in (int, float) and not choices
        wrong = ["much", None, np.nan, np.inf, True] if is_number else ["nonsense"] * bool(choices)
        wrong += [] if low is None else [low if above else low - 1]
        wrong += [] if high is None else [high + 1]
        wrong += [low + 0.5] if item.type is int and low is not None else []
        for value in (one for one in wrong if one is not item.default):  # None may stand for a reading's
            with pytest.raises(InputError, match=rf"^{item.name}\b.* must be .*, got {value!r}"):
                kind(**{item.name: value})
