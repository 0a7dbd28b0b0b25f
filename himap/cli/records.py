"""`himap record`: what is measured on many skies beyond the paper, for its chapters."""

import time
from dataclasses import asdict

import click

from himap.checks import whole_number
from himap.cli.shared import (
    check_alone,
    debug,
    json_output,
    judging_parameters,
    overwrite_option,
    provenance_parameters,
    workers,
)
from himap.companion.notebook_files import copy_name
from himap.companion.parameters import Parameter
from himap.errors import InputError
from himap.figures.tables import Table
from himap.products.fingerprint import CodeTree
from himap.products.provenance import Provenance

__all__ = ["record"]

_SKIES = "skies, each with a seed of its own"
_WITHOUT = ("results", "lobes", "iterated", "larger")  # what the notebooks show
_ERRORS = {  # of a beam that is taken for another, by kind
    "width": [1e-4, 3e-4, 1e-3, 3e-3, 1e-2, 3e-2],
    "ripple": [1e-6, 3e-6, 1e-5, 3e-5, 1e-4, 3e-4, 1e-3],
    "amplitude": [0.003, 0.01, 0.03, 0.1, 0.3, 1.0],
    "phase": [0.003, 0.01, 0.03, 0.1, 0.3, 1.0],
    "period": [1e-5, 3e-5, 1e-4, 3e-4, 1e-3, 3e-3, 1e-2],
}


def _record_options(chapter, name):
    """The options of a command that writes a record, with the parameters of a chapter."""
    options = [
        click.option("--preset", help="ci, quick, laptop or paper; default: quick."),
        click.option(
            "-p", "pairs", metavar="NAME=VALUE", multiple=True, help=f"A parameter, as of {chapter}."
        ),
        click.option(
            "-o", "--output", help=f"Where to write the JSON; default results/{name}_PRESET_PARAMETERS.json."
        ),
        overwrite_option,
        click.option("--check", metavar="FILE", help="Measure one sky of a record again, and mark it."),
        click.option("--grow", metavar="FILE", help="Measure the skies that a record lacks, and add them."),
    ]

    def with_options(command):
        command = debug(workers(command))
        for option in reversed(options):
            command = option(command)
        return command

    return with_options


def _record(
    row,
    code_of,
    measured,
    align,
    *,
    pairs,
    preset,
    output,
    overwrite,
    check,
    grow,
    chapter,
    own,
    measure,
    n_skies=20,
):
    """Measure a record of `row`, write it, and print its table.

    `measure` gives the cases of all skies, what was chosen for them as parameters of the provenance, and the
    function that evaluates the skies of some seeds. With `check` one sky is measured again, with `grow` those
    that are not there yet.
    """
    from himap.paper.record_file import check_record, grow_record, lacking, read_record, write_record

    chosen, given = judging_parameters(
        pairs,
        preset,
        own=own,
        without=_WITHOUT,
        more=[Parameter("n_realisations", "int", n_skies, _SKIES)],
        notebook=chapter,
    )
    if check is None and grow is None:
        name = copy_name(row.command.replace("-", "_"), chosen["preset"], given, suffix=".json")
        path = json_output(output, name, overwrite=overwrite)
    else:
        path = _told_again(row, check, grow, output, overwrite)
    started = time.monotonic()
    cases, parameters, evaluate = measure(chosen)
    seeds = list(dict.fromkeys(case.survey.seed for case in cases))
    parameters = {"n_realisations": len(seeds)} | parameters | provenance_parameters(given)

    def about(since):
        made = Provenance.of(
            cases[0].survey,
            galaxy=cases[0].galaxy,
            preset=chosen["preset"],
            parameters=parameters,
            started=since,
        )
        # That ran, whatever was edited in the hours since.
        return asdict(made) | {"code": code_of(CodeTree(loaded=True))}

    if check is not None:
        rows = evaluate(seeds[:1])
        check_record(rows, path, about(started)["code"])
        click.echo(f"{path}: {len(rows)} rows of one sky are the same with today's code.")
        return
    if grow is None:
        write_record(evaluate(seeds), path, about(started))
    else:
        for seed in lacking(row, path, seeds, about(started)):
            since = time.monotonic()
            grow_record(evaluate([seed]), path, about(since))  # at once: no sky is lost
    rows, _ = read_record(row, path)
    click.echo(Table(measured.HEADER, measured.summary(rows), align=align))
    click.echo(f"{path}  ({time.monotonic() - started:.0f} s)")


def _told_again(row, check, grow, output, overwrite):
    """The path of the record that is checked or grows, which is one of `row`."""
    from himap.paper.record_file import read_record

    if check is not None and grow is not None:
        raise InputError("--check and --grow are two things; check the record, and let it grow then.")
    option, path = ("--check", check) if grow is None else ("--grow", grow)
    check_alone(option, output, overwrite)
    read_record(row, path)  # fails now
    return path


def _of(cases, seeds):
    """Those of the skies of some seeds."""
    return [case for case in cases if case.survey.seed in seeds]


@click.group(short_help="Measure what a chapter beyond the paper shows, on many skies.")
@debug
def record():
    """Measure on many skies what a chapter beyond the paper shows.

    \b
    himap record corrections --preset quick -p n_mocks=6 --jobs 2
    """


@record.command()
@_record_options("20_transfer_function", "corrections")
def corrections(**options):
    """Measure how well transfer functions correct what methods lose.

    Mocks are put into the observation of every sky and cleaned with it; the power of what comes back of them
    corrects the power of what is left, which is held against the truth. On 20 skies, with 10 mocks.

    The table tells of each band of C_l and P(k) the mean over skies of the ratio to the truth, as it is left,
    corrected, and corrected by the other definition; the scatter of what is corrected, that which the mocks
    foretell, and on how many skies the truth lies within the last.

    \b
    himap record corrections --preset laptop -p galaxy=templates -p template_dir=maps --jobs 2
    """
    # Imported here: other commands need not wait seconds for what does the work.
    from himap.companion.staleness import corrections_code
    from himap.paper import corrections as measured
    from himap.paper.mocks import first_mocks

    def measure(chosen):
        n_mocks = whole_number("n_mocks", chosen.pop("n_mocks"), 2, 1000)  # one has no scatter
        cases, removers = measured.cases_and_methods(**chosen)
        mocks = first_mocks(n_mocks, cases)
        return (
            cases,
            {"n_mocks": n_mocks},
            lambda seeds: measured.evaluate(_of(cases, seeds), removers, mocks),
        )

    methods = [["beam_subspace", 3], ["pca", 5], ["pca", 8], ["gmca", 5], ["sdecgmca", 5]]
    _record(
        measured.Correction,
        corrections_code,
        measured,
        "llr" + "r" * len(measured.HEADER),
        **options,
        chapter="20_transfer_function",
        own={"n_mocks": 10, "methods": methods},
        measure=measure,
    )


@record.command("beam-errors")
@_record_options("21_beam_errors", "beam_errors")
def beam_errors(**options):
    """Measure what it costs methods to be told a wrong beam.

    Each method cleans every sky with a beam whose width, or ripple, is wrong by so much, or with another
    beam; what is left is held against the truth. On 20 skies unless told otherwise. What was interrupted goes
    on where it stopped.

    The table tells of each method and error the ratio of power to that of the truth that is furthest from 1,
    how much HI is kept there, and the most that is left of foreground, of C_l at 10 <= l < 100 and of P(k)
    at k > 0.03.

    \b
    himap record beam-errors --preset laptop -p galaxy=templates -p template_dir=maps --jobs 2
    """
    from himap.companion.staleness import beam_errors_code
    from himap.paper import beam_errors as measured
    from himap.paper.corrections import cases_and_methods

    methods = [["beam_subspace", n] for n in (3, 4, 5, 6)] + [["sdecgmca", 5], ["pca", 6], ["pca", 8]]

    def measure(chosen):
        errors = chosen.pop("errors")
        cases, removers = cases_and_methods(**chosen)
        return cases, {}, lambda seeds: measured.evaluate(_of(cases, seeds), removers, errors)

    _record(
        measured.BeamError,
        beam_errors_code,
        measured,
        "lllrlrrl",
        **options,
        chapter="21_beam_errors",
        own={"errors": _ERRORS, "methods": methods},
        measure=measure,
    )


@record.command("side-by-side")
@_record_options("25_side_by_side", "side_by_side")
def side_by_side(**options):
    """Measure what all methods leave, side by side, through each beam.

    Power along l and k over that of the truth, as each method leaves it, and of some divided by the transfer
    function of mocks. On 20 skies unless told otherwise. What was interrupted goes on where it stopped.

    The table tells of each beam, method and band of C_l and P(k) the mean over skies, and their scatter.

    \b
    himap record side-by-side --preset laptop -p galaxy=templates -p template_dir=maps --jobs 2
    """
    from himap.companion.staleness import side_by_side_code
    from himap.paper import side_by_side as measured
    from himap.paper.mocks import first_mocks

    def measure(chosen):
        n_mocks = whole_number("n_mocks", chosen.pop("n_mocks"), 1, 1000)
        corrected = chosen.pop("corrected")
        skies = measured.skies_and_methods(**chosen)
        cases = [case for sky in skies for case in sky]
        mocks = first_mocks(n_mocks, cases)

        def evaluate(seeds):
            return measured.evaluate([sky for sky in skies if _of(sky, seeds)], mocks, corrected)

        return cases, {"n_mocks": n_mocks}, evaluate

    _record(
        measured.Curve,
        side_by_side_code,
        measured,
        "llllrr",
        **options,
        chapter="25_side_by_side",
        own={},
        measure=measure,
    )


@record.command()
@_record_options("22_how_many", "suggestions")
def suggestions(**options):
    """Measure how often criteria find the right number of sources without the truth.

    Each method cleans every sky, through every beam and with every noise, with each number of sources. On 5
    skies. What was interrupted goes on.

    The table tells of each method and criterion how often it was right, or for so many more or less, and the
    median of what is wrong in the worst band of C_l at 10 <= l < 100 and of P(k) at k > 0.03, with the number
    that it is for and with the best.

    \b
    himap record suggestions --preset quick -p galaxy=templates -p template_dir=maps --jobs 2
    """
    from himap.companion.staleness import suggestions_code
    from himap.instrument.beams import named
    from himap.paper import suggestions as measured
    from himap.paper.corrections import cases_and_methods
    from himap.paper.methods import paper_beams
    from himap.paper.mocks import first_mocks

    def measure(chosen):
        skies = chosen.pop("n_realisations")
        n_mocks = whole_number("n_mocks", chosen.pop("n_mocks"), 1, 1000)
        most = whole_number("n_sources_max", chosen.pop("n_sources_max"), 2, 100)
        beams, noises, methods = (chosen.pop(name) for name in ("beams", "noises", "methods"))
        paper = paper_beams(ripple=chosen.pop("ripple"))
        (first,), _ = cases_and_methods(**chosen, methods=(), n_realisations=1)
        beams = [paper.get(name) or named(name) for name in beams]
        cases = measured.cases_over(first, beams=beams, noises=noises, n_realisations=skies)
        mocks, counts = first_mocks(n_mocks, cases), range(1, most + 1)

        def evaluate(seeds):
            return measured.evaluate(_of(cases, seeds), methods, mocks, counts)

        return cases, {"n_mocks": n_mocks}, evaluate

    _record(
        measured.Suggested,
        suggestions_code,
        measured,
        "llrrrrrrrr",
        **options,
        chapter="22_how_many",
        own={},
        measure=measure,
        n_skies=5,
    )
