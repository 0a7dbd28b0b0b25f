"""The commands of `himap` for users' cubes.

Computing modules are imported when needed, so that `himap --help` is fast.
"""

import functools
from dataclasses import replace

from click import option

from himap.app.cli.cube_options import (
    METHOD,
    MOCKS,
    WEIGHTS,
    cube_command,
    outputs_of,
    tell,
    write_and_say,
)
from himap.app.cli.shared import NamesOption, methods
from himap.core.errors import InputError

_COARSE = 0.5  # FWHM in pixels, below which maps hardly show a beam
_GROWS = 1.01  # FWHM at the highest relative to the lowest frequency: beams of telescopes do not increase


def _cube_and_beams(asked, remover):
    """The cube, whose remarks are printed, and its beams, None if not given.

    With weights or flags, pixels with too few channels for the method, or for the masking of peaks, are
    excluded.
    """
    import numpy as np

    from himap.cubes.cleaning import beams_of, check_pixels, with_enough_channels
    from himap.cubes.files import read_cube
    from himap.instrument.beams import named
    from himap.instrument.beams.base import gaussian_widths

    if asked.dish is not None and asked.beam is None:
        raise InputError("--dish belongs to a beam; give --beam too.")
    if asked.beam is None and "beams" in remover.uses:
        raise InputError(f"{remover.name} needs the beam of the cube; give --beam.")
    if asked.weighed:
        remover.check_weights()
    scattered = "weights" in remover.uses
    cube = read_cube(asked.path, **asked.reading, **asked.weighed, scattered=scattered)
    check_pixels(cube, remover)
    if asked.mask is not None:
        cube = cube.masked(asked.mask, rotate=asked.rotate)
    cube = with_enough_channels(cube, remover, peaks=asked.peaks)
    tell(asked, *cube.said)
    if asked.beam is None:
        return cube, None
    beams = beams_of(cube, asked.beam, dish=asked.dish)
    beam = named(asked.beam).chosen_for(cube.freqs)
    widths = np.rad2deg(np.abs(gaussian_widths(beams)))  # some are -0
    (first, last), (low, high) = widths[[0, -1]], cube.freqs[[0, -1]]
    said = f"The beams, {beam}, have a FWHM of {first:.3g} deg at {low:g} MHz and {last:.3g} at {high:g} MHz"
    if "beams" not in remover.uses and not getattr(asked, "mocks", ()):
        said += f"; {remover.name} does not use them"
    if last > first * _GROWS and beam.by_line:
        said += ": they grow with frequency, so check that their lines have the order of the channels of CUBE"
    pixel = np.rad2deg(np.sqrt(4 * np.pi / len(cube.mask)))
    if beam.by_line and 0 < widths.max() < _COARSE * pixel:
        said += f"; pixels are {pixel:.3g} deg wide, so check that widths are in degrees"
    tell(asked, f"{said}.")
    return cube, beams


@cube_command(
    METHOD,
    option("--truth", metavar="CUBE", help="Residual of a perfect cleaning, for the page."),
    option(
        *("-o", "--output"), metavar="FILE", required=True, help="Cleaned: .h5, .fits(.gz), .npy; and .html."
    ),
    option("--patches", is_flag=True, help="Show P(k_perp, k_par) of patches of the sky on the page."),
    option("--restarts", type=int, metavar="N", help="Starts of a chaotic method, sdecgmca; default 4."),
    *MOCKS,
    short_help="Remove the foregrounds of the cube of maps in CUBE.",
)
def clean(asked):
    """\b
    Remove the foregrounds of CUBE: HDF5, FITS (or a folder of it) or .npy.
    himap clean cube.h5 --method beam_subspace --beam oscillating -p n_sources=3 -o cleaned.h5
    """
    from himap.cubes.writing import write_cleaned

    endings = (".html", ".csv") if asked.mocks else (".html",)
    files = outputs_of(asked, endings, page=False)
    cleaned, write_pages = _cleaned(asked)

    def write(*temporary):
        write_cleaned(cleaned, temporary[: -len(endings)], said=asked.said)
        write_pages(*temporary[-len(endings) :])

    write_and_say(asked, files, write, remarks=cleaned.remarks)


@cube_command(
    METHOD,
    option("--truth", metavar="CUBE", help="Residual of a perfect cleaning."),
    option("-o", "--output", metavar="FILE", required=True, help="Page, .html; spectra next to it, .csv."),
    *MOCKS,
    short_help="Measure the signal loss and foreground residual of CUBE, and correct its spectra.",
)
def transfer(asked):
    """Correct the spectra of CUBE for signal loss and foreground residual, with mocks of HI; ten unless
    --mocks is given.

    \b
    himap transfer cube.h5 --method pca --beam meerkat -p n_sources=5 --mock-noise 0.04 -o transfer.html
    """
    asked.mocks, asked.patches, asked.restarts = asked.mocks or ("10",), False, None
    files = outputs_of(asked, (".csv",))
    cleaned, write_pages = _cleaned(asked)
    write_and_say(asked, files, write_pages, remarks=cleaned.remarks)


def _cleaned(asked):
    """A `CleanedCube`, and the function that writes its page, and spectra, to paths."""
    from himap.cubes import scatter
    from himap.cubes.cleaning import clean_cube
    from himap.cubes.corrected import write_spectra
    from himap.cubes.report import cylindrical_part, write_report
    from himap.cubes.spectra import compared, remarks_on_truth, spectra_of

    remover, cube, beams, true = _checked_input(asked)
    mocks = _mocks(cube, beams, asked)
    options = {"beams": beams, "peaks": asked.peaks, "restarts": asked.restarts}
    cleaned, more, corrected, scattered = clean_cube(cube, remover, **options), [], None, None
    comparison = None if true is None else compared(cleaned, true)
    if comparison is not None:
        tell(asked, *remarks_on_truth(comparison))
    spectra = None if true is not None and mocks is None else spectra_of(cleaned)
    if mocks is not None:
        corrected, more = _corrected(asked, cleaned, mocks, beams, spectra, comparison)
    if cleaned.ensemble is not None:
        scattered = scatter.scatter_of(cleaned)
        more = [*scatter.scatter_parts(scattered), *more]
        asked.tables.append(scatter.scatter_table(scattered))
    if asked.patches and cube.layout.pixels.whole_sky:  # always on the page of an image
        more = [*more, cylindrical_part(cleaned, true)]
    shown = spectra if comparison is None else comparison

    def write_pages(page, table=None):
        write_report(cleaned, page, truth=true, spectra=shown, more=more, said=asked.said)
        if corrected is not None:
            write_spectra(corrected, table, scattered)

    return cleaned, write_pages


def _checked_input(asked):
    """The method, the cube, its beams and the truth, None if not given, checked before the work."""
    from himap.cubes.cleaning import method_for
    from himap.cubes.files import read_truth
    from himap.cubes.spectra import check_truth
    from himap.cubes.writing import check_columns
    from himap.removal import create
    from himap.removal.restarts import checked_restarts

    remover = create(asked.method, **asked.parameters)
    checked_restarts(remover, asked.restarts)
    cube, beams = _cube_and_beams(asked, remover)
    method_for(cube, remover, beams=beams)  # before the truth is read
    check_columns(cube, asked.output)
    if hasattr(remover, "n_sources") and "n_sources" not in asked.parameters:
        tell(
            asked,
            f"{remover.name} removes {remover.n_sources} sources by default (-p n_sources=); "
            "`himap suggest` recommends a number.",
        )
    _check_mocks(asked, cube)
    true, given = None, [asked.truth] * (asked.truth is not None)
    for path in (*given, *(word for word in asked.mocks if not _is_number(word))):
        cube = _in_frames_of(asked, cube, path)
    if asked.truth is not None:
        true = read_truth(asked.truth, cube=cube, **asked.reading)
        tell(asked, *(f"The truth: {remark}" for remark in true.remarks))
        check_truth(cube, true)
    return remover, cube, beams, true


def _corrected(asked, cleaned, mocks, beams, spectra, comparison):
    """The result of `correct` for a `CleanedCube`, and its parts of the page; tells tables and remarks."""
    from himap.cubes import brightness, corrected, neighbours
    from himap.cubes.transfer import measure_transfer

    transfer = measure_transfer(cleaned, mocks, beams=beams)
    both = corrected.correct(cleaned, transfer, spectra, comparison)
    in_parts, common = brightness.by_brightness(cleaned, transfer, both), neighbours.in_neighbours(transfer)
    checks = [brightness.brightness_table(in_parts), neighbours.neighbours_table(common)]
    asked.tables += [corrected.corrected_table(both), *checks]
    if not transfer.drawn:
        tell(
            asked,
            f"The mocks have the foreground estimated by {cleaned.method.name}, and foreground residual is "
            "unknown: its estimate needs a full sky without gaps, --beam and more than six channels.",
        )
    tell(asked, *corrected.remarks_on(both))
    tell(asked, *brightness.remarks_on_brightness(in_parts), *neighbours.remarks_on_neighbours(common))
    return both, [*corrected.corrected_parts(both), *checks]


def _in_frames_of(asked, cube, path):
    """The cube, with missing frames adopted from its truth or a mock; what does not match is refused."""
    from himap.cubes.files import read_truth
    from himap.cubes.spectra import check_truth

    other = read_truth(path, cube=cube, **asked.reading)
    frame = other.layout.pixels.frame or cube.layout.pixels.frame  # what has none says so when it is read
    joined = cube.layout.joined(path, frame, other.layout.spectral_frame)
    tell(asked, *joined.remarks[len(cube.remarks) :])
    cube = replace(cube, layout=joined)
    if path != asked.truth:  # which is checked once its remarks are printed
        check_truth(cube, other, f"{path}: a mock")
    return cube


def _is_number(word):
    """Whether the value of --mocks is a number, not a file."""
    return word.lstrip("-").isdecimal()


def _check_mocks(asked, cube):
    """Refuse mocks for an image in the plane, and options for mocks that contradict each other."""
    words, noise = asked.mocks, asked.mock_noise
    numbers = [*filter(_is_number, words)]
    if (not words and noise is not None) or (numbers and len(words) > 1):
        raise InputError("--mocks is one number, or a file per mock; --mock-noise applies to a number.")
    if words:
        _ = cube.nside
    if noise is not None and not numbers:
        raise InputError("--mock-noise applies to generated mocks; those from files include noise.")


def _mocks(cube, beams, asked):
    """Yield the maps of mocks as given by the option, a number or files; None if it is empty."""
    from himap.cubes.mocks import draw_mocks, read_mocks

    words, noise, said = asked.mocks, asked.mock_noise, functools.partial(tell, asked)
    if not words:
        return None
    if not _is_number(words[0]):
        return read_mocks(cube, words, tell=said, **asked.reading)
    if noise is None:
        tell(asked, "The mocks have no noise: without --mock-noise, noise of CUBE counts as foreground.")
    return draw_mocks(cube, beams, int(words[0]), noise=noise, tell=said)


def _methods_with_sources():
    from himap.removal.base import REGISTRY

    return [name for name in methods() if "n_sources" in REGISTRY[name].__dataclass_fields__]


@cube_command(
    option(
        "--method",
        cls=NamesOption,
        names=_methods_with_sources,
        default="pca",
        show_default=True,
        metavar="NAME",
    ),
    option("--from", "least", type=int, default=1, show_default=True, help="Smallest number of sources."),
    option("--to", "most", type=int, help="Largest number of sources; default 10 at most."),
    option("-o", "--output", metavar="FILE", help="Page with the figures, .html."),
    *WEIGHTS,
)
def suggest(asked):
    """Suggest how many sources to remove from the cube in CUBE, without the truth.

    \b
    himap suggest cube.h5 --method pca -o how_many.html
    himap suggest cube.h5 --method beam_subspace --beam oscillating
    """
    from himap.cubes import suggestion
    from himap.removal import create

    files = outputs_of(asked)
    if "n_sources" in asked.parameters:
        raise InputError(
            "the numbers of sources to try are given with --from and --to, not with -p n_sources."
        )
    suggestion.check_method(asked.method)
    # Lines of sight need enough channels for the largest number.
    least, most = asked.least, asked.most
    largest = suggestion.MOST_SOURCES if most is None or most < 1 else most
    cube, beams = _cube_and_beams(asked, create(asked.method, n_sources=largest, **asked.parameters))
    most = min(suggestion.MOST_SOURCES, len(cube.freqs) - 1) if most is None else most
    options = {"n_sources": range(least, most + 1), "beams": beams, "peaks": asked.peaks}
    result = suggestion.suggest(cube, asked.method, **options, **asked.parameters)
    advice = f"{result.n_bright} eigenvalues exceed HI and noise. {suggestion.advice(result)}"
    asked.tables = [suggestion.suggestion_table(result), advice]
    write_and_say(asked, files, functools.partial(suggestion.write_suggestion, result, said=asked.said))


@cube_command(
    METHOD,
    option("--width", "widths", type=float, multiple=True, help="Relative error of the FWHM; ±0.1 and 1 %."),
    option(
        "--ripple", "ripples", type=float, multiple=True, help="Of an error that oscillates; 1e-5 to 1e-3."
    ),
    option("--period", type=float, help="Of that, MHz; 20 unless given."),
    option("-o", "--output", metavar="FILE", help="Page with the figure, .html."),
    short_help="Measure the sensitivity of the residual of CUBE to its beam.",
)
def sensitivity(asked):
    """Clean CUBE with beams that differ slightly from --beam, and measure the change of the residual power.

    \b
    himap sensitivity cube.h5 --method beam_subspace --beam oscillating -p n_sources=3 -o beam.html
    """
    from himap.cubes import sensitivity as measured
    from himap.cubes.cleaning import clean_cube
    from himap.removal import create

    files = outputs_of(asked)
    remover = create(asked.method, **asked.parameters)
    if "beams" not in remover.uses:
        raise InputError(f"{remover.name} does not use the beam: beam errors do not affect the residual.")
    errors = {"widths": asked.widths, "ripples": asked.ripples} if asked.widths or asked.ripples else {}
    if asked.period is None:
        asked.period = 20.0
    elif asked.widths and not asked.ripples:
        raise InputError("--period applies to oscillating errors: give --ripple too, or omit it.")
    cube, beams = _cube_and_beams(asked, remover)
    measured.perturbed_beams(asked.beam, cube.freqs, **errors, period=asked.period)  # before the work
    cleaned = clean_cube(cube, remover, beams=beams, peaks=asked.peaks, restarts=1)
    tell(asked, *cleaned.remarks)
    ratios = measured.beam_sensitivity(cleaned, asked.beam, **errors, period=asked.period, dish=asked.dish)
    asked.tables = [measured.sensitivity_table(ratios, asked.period)]
    write = functools.partial(measured.write_sensitivity, ratios, period=asked.period, said=asked.said)
    write_and_say(asked, files, write)
