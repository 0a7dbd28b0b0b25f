"""The commands of `himap` for cubes of one's own.

What does the work is imported when it is needed: `himap --help` need not wait seconds for it.
"""

import time
import warnings

import click

from himap.app.cli.cube_options import (
    Methods,
    cube_and_beams,
    cube_options,
    inputs_of,
    method_parameters,
    mock_options,
    tell,
    weight_options,
)
from himap.app.cli.shared import debug
from himap.core.errors import InputError, plain_text
from himap.core.files import whole_file, whole_files
from himap.core.reading import there_is


@click.command(short_help="Remove the foregrounds of the cube of maps in CUBE.")
@click.argument("path", metavar="CUBE")
@click.option("--method", cls=Methods, required=True, metavar="NAME")
@click.option("--truth", metavar="CUBE", help="What a perfect cleaning would leave, for the page.")
@click.option(
    "-o", "--output", metavar="FILE", required=True, help="Cleaned cube: .h5, .fits or .npy; and .html."
)
@click.option("--patches", is_flag=True, help="Show P(k_perp, k_par) of patches of the sky on the page.")
@mock_options
@weight_options
@cube_options
@debug
def clean(output, overwrite, **options):
    """Remove the foregrounds of CUBE: HDF5, FITS (or a folder of it) or .npy.

    \b
    himap clean cube.h5 --method beam_subspace --beam oscillating -p n_sources=3 -o cleaned.h5
    """
    from himap.cubes.writing import check_output, files_of, write_cleaned

    started = time.monotonic()
    endings = (".html", ".csv") if options["mocks"] else (".html",)
    output = check_output(output, overwrite=overwrite, inputs=_inputs(options), endings=endings)
    cleaned, writers = _cleaned(**options)
    outputs = files_of(output)
    files = [*outputs, *map(output.with_suffix, endings)]
    with whole_files(*files) as temporary:  # all of them or none
        write_cleaned(cleaned, temporary[: len(outputs)])
        _write(writers, temporary[len(outputs) :])
    _tell(cleaned, files, started)


@click.command(short_help="Measure what cleaning takes of CUBE, and correct its spectra.")
@click.argument("path", metavar="CUBE")
@click.option("--method", cls=Methods, required=True, metavar="NAME")
@click.option("--truth", metavar="CUBE", help="What a perfect cleaning would leave.")
@click.option("-o", "--output", metavar="FILE", required=True, help="Page, .html; spectra beside it, .csv.")
@mock_options
@weight_options
@cube_options
@debug
def transfer(output, overwrite, **options):
    """Measure with mocks of HI, put into CUBE and cleaned with it, what cleaning takes, and correct the
    spectra. Ten are made, unless --mocks says otherwise.

    \b
    himap transfer cube.h5 --method pca --beam meerkat -p n_sources=5 -o transfer.html
    """
    from himap.cubes.writing import check_output

    started = time.monotonic()
    options["mocks"] = options["mocks"] or ("10",)
    inputs, endings = _inputs(options), (".csv",)
    page = check_output(output, overwrite=overwrite, inputs=inputs, endings=endings, page=True)
    cleaned, writers = _cleaned(**options)
    files = [page, page.with_suffix(".csv")]
    with whole_files(*files) as temporary:
        _write(writers, temporary)
    _tell(cleaned, files, started)


def _inputs(options):
    """The names of files, or what may be such, in the options of a command."""
    names = [options[name] for name in ("path", "truth", "beam", "freqs", "mask", "weights", "flags")]
    return inputs_of([*names, *options["mocks"]], options["pairs"])


def _cleaned(
    path,
    method,
    beam,
    dish,
    pairs,
    truth,
    mask,
    keep_peaks,
    mocks,
    mock_noise,
    weights,
    flags,
    patches=False,
    **reading,
):
    """A `CleanedCube`, and {ending: function that writes} its page, and its spectra where there are mocks."""
    from himap.cubes import transfer as measured
    from himap.cubes.cleaning import clean_cube, method_for
    from himap.cubes.files import read_truth
    from himap.cubes.report import patches_part, write_report
    from himap.cubes.spectra import check_truth, compared, spectra_of
    from himap.removal import create
    from himap.removal.base import SeparationWarning

    remover = create(method, **method_parameters(pairs))
    weighed = {"weights": weights, "flags": flags}
    cube, beams = cube_and_beams(
        path, remover, beam, dish, mask, reading, weighed=weighed, peaks=not keep_peaks
    )
    method_for(cube, remover, beams=beams)  # before the truth is read
    if hasattr(remover, "n_sources") and "n_sources" not in method_parameters(pairs):
        tell(
            f"{remover.name} removes {remover.n_sources} sources unless -p n_sources= says otherwise; "
            "`himap suggest` says how many this cube asks for."
        )
    true = None if truth is None else read_truth(truth, beside=cube, **reading)
    if true is not None:
        for remark in true.remarks:
            tell(f"The truth: {remark}")
        check_truth(cube, true)  # before the work
    put_in = _mocks(cube, beams, mocks, mock_noise, reading)
    peaks, more, corrected = not keep_peaks, [], None
    patches = patches and cube.layout.pixels.whole_sky  # the page of an image has it anyway
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", SeparationWarning)  # the report says it, and the line below
        cleaned = clean_cube(cube, remover, beams=beams, peaks=peaks)
        comparison = None if true is None else compared(cleaned, true)
        spectra = None if true is not None and put_in is None else spectra_of(cleaned)
        if put_in is not None:
            found = measured.measure_transfer(cleaned, put_in)
            corrected = measured.correct(spectra, found)
            more = measured.corrected_parts(corrected, len(found.mocks), comparison)
            click.echo(measured.corrected_table(corrected, comparison))
    if patches:
        more = [*more, patches_part(cleaned, true)]
    shown = spectra if comparison is None else comparison
    writers = {".html": lambda page: write_report(cleaned, page, spectra=shown, more=more)}
    if corrected is not None:
        writers[".csv"] = lambda table: measured.write_spectra(corrected, table, comparison)
    return cleaned, writers


def _write(writers, paths):
    """Each of `paths` by the function of its ending."""
    for path in paths:
        writers[path.suffix](path)


def _mocks(cube, beams, words, noise, reading):
    """The maps of mocks, one after the other, as the option says: a number, or files; None if it is empty."""
    from himap.cubes.mocks import made_mocks, read_mocks

    numbers = [word for word in words if word.lstrip("-").isdecimal()]
    if not words or (numbers and len(words) > 1):
        if words or noise is not None:
            raise InputError(
                "--mocks is one number, or a file for each mock; --mock-noise belongs to a number."
            )
        return None
    cube.check_sphere()
    if numbers:
        return made_mocks(cube, beams, int(numbers[0]), noise=noise)
    if noise is not None:
        raise InputError("--mock-noise is that of mocks that are made; those from files have their own.")
    for word in words:
        if not there_is(word):
            raise InputError(f"--mocks: there is no file {word}.")
    return read_mocks(cube, words, told=tell, **reading)


def _tell(cleaned, files, started):
    for remark in cleaned.remarks:
        tell(remark)
    click.echo(plain_text("  ".join(map(str, files))) + f"  ({time.monotonic() - started:.0f} s)")


@click.command()
@click.argument("path", metavar="CUBE")
@click.option("--method", cls=Methods, default="pca", show_default=True, metavar="NAME")
@click.option("--from", "least", type=int, default=1, show_default=True, help="Least number of sources.")
@click.option("--to", "most", type=int, help="Largest number of sources; default 10 at most.")
@click.option("-o", "--output", metavar="FILE", help="Page with the figures, .html.")
@weight_options
@cube_options
@debug
def suggest(
    path,
    method,
    beam,
    dish,
    pairs,
    mask,
    keep_peaks,
    weights,
    flags,
    least,
    most,
    output,
    overwrite,
    **reading,
):
    """Suggest how many sources to remove from the cube in CUBE, without the truth.

    \b
    himap suggest cube.h5 --method pca -o how_many.html
    himap suggest cube.h5 --method beam_subspace --beam oscillating
    """
    from himap.cubes import suggestion
    from himap.cubes.writing import check_output
    from himap.removal import create
    from himap.removal.base import SeparationWarning

    inputs = inputs_of([path, beam, reading["freqs"], mask, weights, flags], pairs)
    checked = {"overwrite": overwrite, "inputs": inputs, "page": True}
    page = None if output is None else check_output(output, **checked)
    parameters = method_parameters(pairs)
    if "n_sources" in parameters:
        raise InputError(
            "the numbers of sources to try are given with --from and --to, not with -p n_sources."
        )
    # Lines of sight must have channels enough for the largest number.
    largest = suggestion.MOST_SOURCES if most is None or most < 1 else most
    remover, weighed = create(method, n_sources=largest, **parameters), {"weights": weights, "flags": flags}
    cube, beams = cube_and_beams(
        path, remover, beam, dish, mask, reading, weighed=weighed, peaks=not keep_peaks
    )
    most = min(suggestion.MOST_SOURCES, len(cube.freqs) - 1) if most is None else most
    if most <= least:
        raise InputError(f"--to must be more than --from, got {most} and {least} sources.")
    if least < 1 or most > len(cube.freqs):
        raise InputError(
            f"--from must be at least 1, --to at most the number of channels, {len(cube.freqs)}; got {least} "
            f"and {most} sources."
        )
    counts = range(least, most + 1)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", SeparationWarning)
        result = suggestion.suggest(
            cube, method, n_sources=counts, beams=beams, peaks=not keep_peaks, **parameters
        )
    click.echo(suggestion.suggestion_table(result))
    click.echo(f"{result.n_bright} eigenvalues stand above HI and noise. {suggestion.advice(result)}")
    if page is not None:
        with whole_file(page) as temporary:
            suggestion.write_suggestion(result, temporary)
        click.echo(plain_text(str(page)))
