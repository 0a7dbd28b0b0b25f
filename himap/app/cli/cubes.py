"""The commands of `himap` for cubes of one's own: options, the cube and its beams, outputs and remarks.

What does the work is imported when it is needed: `himap --help` need not wait seconds for it.
"""

import functools
import time
import warnings
from dataclasses import replace
from types import SimpleNamespace

import click
from click import option

from himap.app.cli.cube_options import COMMON, METHOD, MOCKS, WEIGHTS
from himap.app.cli.shared import NamesOption, named_values, with_options
from himap.app.parameters import parse_texts
from himap.core.errors import InputError, plain_text
from himap.core.files import atomic_files
from himap.core.reading import is_file, regular_file

_READING = ("freqs", "unit", "order", "frame", "rotate", "maps_name", "freqs_name", "axes")
_FILES = ("path", "truth", "beam", "freqs", "mask", "weights", "flags")


def _command(*options, short_help=None):
    """Decorator: a command for CUBE with these options and those that all have.

    It gets them in one namespace, with `reading` those of `read_cube`, `weighed` the weights and flags,
    `parameters` of the method, `peaks` to mask, `inputs` all files that it reads, or what may be such, when
    it `started`, and the sentences that were `said`.
    """

    def decorate(function):
        @functools.wraps(function)
        def command(**given):
            from himap.removal.base import SeparationWarning

            asked = SimpleNamespace(**given, said=[], started=time.monotonic(), peaks=not given["keep_peaks"])
            asked.reading = {name: given[name] for name in _READING}
            names = ("weights", "flags")
            asked.weighed = {name: given[name] for name in names if given.get(name) is not None}
            asked.parameters = parse_texts([], named_values(given["pairs"]))
            if "name" in asked.parameters:
                raise InputError("no method has a parameter called name; --method says which method.")
            values = [value for value in asked.parameters.values() if isinstance(value, str)]
            files = [*map(given.get, _FILES), *given.get("mocks", ())]
            files += [regular_file(value) for value in values if is_file(value)]
            asked.inputs = [file for file in files if file is not None]
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", SeparationWarning)  # the report says it, and remarks do
                function(asked)

        path = click.argument("path", metavar="CUBE")
        return click.command(short_help=short_help)(with_options(path, *options, *COMMON)(command))

    return decorate


def _tell(asked, *sentences):
    """Say sentences on standard error, whatever the names in them, and keep them for what is written."""
    for sentence in sentences:
        click.echo(plain_text(sentence), err=True)
        asked.said.append(sentence)


def _output(asked, endings=(), page=True):
    """The checked path of the output, None where there is none."""
    from himap.cubes.writing import check_output

    more = {"overwrite": asked.overwrite, "inputs": asked.inputs, "endings": endings, "page": page}
    return None if asked.output is None else check_output(asked.output, **more)


def _write(asked, files, write, *, remarks=()):
    """Write all `files` or none, ``write(*temporary names)``, and say remarks and their names."""
    with atomic_files(*files) as temporary:
        write(*temporary)
    _tell(asked, *remarks)
    took = time.monotonic() - asked.started
    click.echo(f"{plain_text('  '.join(map(str, files)))}  ({took:.0f} s)")


def _cube_and_beams(asked, remover):
    """The cube, whose remarks are printed, and its beams, None where none are named.

    With weights or flags, pixels are left out of which too many channels are missing for the method, and
    for the masking of peaks.
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
    _tell(asked, *cube.said)
    if asked.beam is None:
        return cube, None
    beams = beams_of(cube, asked.beam, dish=asked.dish)
    widths, beam = np.rad2deg(gaussian_widths(beams)), named(asked.beam).chosen_for(cube.freqs)
    _tell(asked, f"The beams, {beam}, have a FWHM of {abs(min(widths)):.3g} to {abs(max(widths)):.3g} deg.")
    return cube, beams


@_command(
    METHOD,
    option("--truth", metavar="CUBE", help="What a perfect cleaning would leave, for the page."),
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
    from himap.cubes.writing import companion, files_of, write_cleaned

    endings = (".html", ".csv") if asked.mocks else (".html",)
    output = _output(asked, endings, page=False)
    cleaned, write_pages = _cleaned(asked)
    outputs = files_of(output)

    def write(*temporary):
        write_cleaned(cleaned, temporary[: len(outputs)], said=asked.said)
        write_pages(*temporary[len(outputs) :])

    pages = [companion(output, end) for end in endings]
    _write(asked, [*outputs, *pages], write, remarks=cleaned.remarks)


@_command(
    METHOD,
    option("--truth", metavar="CUBE", help="What a perfect cleaning would leave."),
    option("-o", "--output", metavar="FILE", required=True, help="Page, .html; spectra next to it, .csv."),
    *MOCKS,
    short_help="Measure the signal loss and foreground residual of CUBE, and correct its spectra.",
)
def transfer(asked):
    """Correct the spectra of CUBE for signal loss and foreground residual, by mocks of HI; ten unless --mocks
    says otherwise.

    \b
    himap transfer cube.h5 --method pca --beam meerkat -p n_sources=5 -o transfer.html
    """
    asked.mocks, asked.patches, asked.restarts = asked.mocks or ("10",), False, None
    page = _output(asked, (".csv",))
    cleaned, write_pages = _cleaned(asked)
    _write(asked, [page, page.with_suffix(".csv")], write_pages, remarks=cleaned.remarks)


def _cleaned(asked):
    """A `CleanedCube`, and the function that writes its page, and spectra, to paths."""
    from himap.cubes import corrected as texts
    from himap.cubes import scatter
    from himap.cubes.brightness import brightness_table, by_brightness, remarks_on_brightness
    from himap.cubes.cleaning import clean_cube, method_for
    from himap.cubes.files import read_truth
    from himap.cubes.report import cylindrical_part, write_report
    from himap.cubes.spectra import check_truth, compared, spectra_of
    from himap.cubes.transfer import correct, measure_transfer
    from himap.cubes.writing import check_columns
    from himap.removal import create
    from himap.removal.restarts import checked_restarts

    remover = create(asked.method, **asked.parameters)
    checked_restarts(remover, asked.restarts)
    cube, beams = _cube_and_beams(asked, remover)
    method_for(cube, remover, beams=beams)  # before the truth is read
    check_columns(cube, asked.output)
    if hasattr(remover, "n_sources") and "n_sources" not in asked.parameters:
        _tell(
            asked,
            f"{remover.name} removes {remover.n_sources} sources unless -p n_sources= says otherwise; "
            "`himap suggest` can suggest a number.",
        )
    cube = _with_frames(asked, cube)
    true = None if asked.truth is None else read_truth(asked.truth, cube=cube, **asked.reading)
    if true is not None:
        _tell(asked, *(f"The truth: {remark}" for remark in true.remarks))
        check_truth(cube, true)  # before the work
    mocks = _mocks(cube, beams, asked)
    options = {"beams": beams, "peaks": asked.peaks, "restarts": asked.restarts}
    cleaned, more, corrected = clean_cube(cube, remover, **options), [], None
    comparison = None if true is None else compared(cleaned, true)
    spectra = None if true is not None and mocks is None else spectra_of(cleaned)
    if mocks is not None:
        measured = measure_transfer(cleaned, mocks, beams=beams)
        corrected = correct(cleaned, measured, spectra, comparison)
        if not measured.drawn:
            _tell(
                asked,
                f"The mocks have the foreground that {remover.name} estimated, and foreground residual is "
                "not known: it is for a full sphere without gaps, with --beam and more than six channels.",
            )
        in_parts = by_brightness(cleaned, measured, corrected)
        more = [*texts.corrected_parts(corrected), brightness_table(in_parts)]
        click.echo(texts.corrected_table(corrected))
        click.echo(brightness_table(in_parts))
        _tell(asked, *texts.remarks_on(corrected), *remarks_on_brightness(in_parts))
    scattered = None if cleaned.ensemble is None else scatter.scatter_of(cleaned)
    if scattered is not None:
        more = [*scatter.scatter_parts(scattered), *more]
        click.echo(scatter.scatter_table(scattered))
    if asked.patches and cube.layout.pixels.whole_sky:  # the page of an image has it anyway
        more = [*more, cylindrical_part(cleaned, true)]
    shown = spectra if comparison is None else comparison

    def write_pages(page, table=None):
        write_report(cleaned, page, truth=true, spectra=shown, more=more, said=asked.said)
        if corrected is not None:
            texts.write_spectra(corrected, table, scattered)

    return cleaned, write_pages


def _with_frames(asked, cube):
    """The cube with the frames that its truth or mocks state, where it states none; others are refused."""
    from himap.cubes.files import read_truth

    given = [asked.truth] * (asked.truth is not None)
    for path in (*given, *(word for word in asked.mocks if not _is_number(word))):
        layout = read_truth(path, cube=cube, **asked.reading).layout
        joined = cube.layout.joined(path, layout.pixels.frame, layout.spectral_frame)
        _tell(asked, *joined.remarks[len(cube.remarks) :])
        cube = replace(cube, layout=joined)
    return cube


def _is_number(word):
    """Whether what is given as mocks is how many, and no file."""
    return word.lstrip("-").isdecimal()


def _mocks(cube, beams, asked):
    """The maps of mocks, one after the other, as the option says: a number, or files; None if it is empty."""
    from himap.cubes.mocks import draw_mocks, read_mocks

    words, noise = asked.mocks, asked.mock_noise
    numbers = [*filter(_is_number, words)]
    if (not words and noise is not None) or (numbers and len(words) > 1):
        raise InputError("--mocks is one number, or a file for each mock; --mock-noise belongs to a number.")
    if not words:
        return None
    _ = cube.nside  # refuses an image in the plane
    if numbers:
        if noise is None:
            _tell(
                asked, "The mocks have no noise; noise in the cube counts as foreground without --mock-noise."
            )
        return draw_mocks(cube, beams, int(numbers[0]), noise=noise)
    if noise is not None:
        raise InputError("--mock-noise is that of mocks that are made; those from files have their own.")
    return read_mocks(cube, words, tell=functools.partial(_tell, asked), **asked.reading)


@_command(
    option("--method", cls=NamesOption, default="pca", show_default=True, metavar="NAME"),
    option("--from", "least", type=int, default=1, show_default=True, help="Least number of sources."),
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

    page = _output(asked)
    if "n_sources" in asked.parameters:
        raise InputError(
            "the numbers of sources to try are given with --from and --to, not with -p n_sources."
        )
    # Lines of sight must have channels enough for the largest number.
    least, most = asked.least, asked.most
    largest = suggestion.MOST_SOURCES if most is None or most < 1 else most
    cube, beams = _cube_and_beams(asked, create(asked.method, n_sources=largest, **asked.parameters))
    most = min(suggestion.MOST_SOURCES, len(cube.freqs) - 1) if most is None else most
    options = {"n_sources": range(least, most + 1), "beams": beams, "peaks": asked.peaks}
    result = suggestion.suggest(cube, asked.method, **options, **asked.parameters)
    click.echo(suggestion.suggestion_table(result))
    click.echo(f"{result.n_bright} eigenvalues exceed HI and noise. {suggestion.advice(result)}")
    if page is not None:
        _write(asked, [page], functools.partial(suggestion.write_suggestion, result, said=asked.said))


@_command(
    METHOD,
    option("--width", "widths", type=float, multiple=True, help="Relative error of the FWHM; ±0.1 and 1 %."),
    option(
        "--ripple", "ripples", type=float, multiple=True, help="Of an error that oscillates; 1e-5 to 1e-3."
    ),
    option("--period", type=float, default=20.0, show_default=True, help="Of that, MHz."),
    option("-o", "--output", metavar="FILE", help="Page with the figure, .html."),
    short_help="Measure how far the residual of CUBE depends on its beam.",
)
def sensitivity(asked):
    """Clean CUBE with beams that differ a little from --beam, and say how the power of the residual changes.

    \b
    himap sensitivity cube.h5 --method beam_subspace --beam oscillating -p n_sources=3 -o beam.html
    """
    from himap.cubes import sensitivity as measured
    from himap.cubes.cleaning import clean_cube
    from himap.removal import create

    page = _output(asked)
    remover = create(asked.method, **asked.parameters)
    if "beams" not in remover.uses:
        raise InputError(f"{remover.name} does not use the beam: no error of it changes the residual.")
    errors = {"widths": asked.widths, "ripples": asked.ripples} if asked.widths or asked.ripples else {}
    if asked.beam is not None:
        measured.perturbed_beams(asked.beam, **errors, period=asked.period)  # before the work
    cube, beams = _cube_and_beams(asked, remover)
    cleaned = clean_cube(cube, remover, beams=beams, peaks=asked.peaks, restarts=1)
    _tell(asked, *cleaned.remarks)
    ratios = measured.beam_sensitivity(cleaned, asked.beam, **errors, period=asked.period, dish=asked.dish)
    click.echo(measured.sensitivity_table(ratios, asked.period))
    if page is not None:
        write = functools.partial(measured.write_sensitivity, ratios, period=asked.period, said=asked.said)
        _write(asked, [page], write)
