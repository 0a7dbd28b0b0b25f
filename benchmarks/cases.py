"""The options of the commands that say which observation is measured."""

from functools import wraps

import click

from himap.app.parameters import parse_texts
from himap.core.survey import PRESETS, Survey
from himap.instrument.beams import named
from himap.paper import pipeline
from himap.sky.galaxy import SOURCES, Galaxy

_OPTIONS = [
    click.option("--preset", type=click.Choice(list(PRESETS)), default="quick", show_default=True),
    click.option("--survey", "pairs", type=(str, str), multiple=True, help="Survey field and its value."),
    click.option("--galaxy", type=click.Choice(SOURCES), default="synthetic", show_default=True),
    click.option("--template-dir", help="Folder of the templates."),
    click.option("--beam", default="oscillating", show_default=True, help="Name of a beam, or a file."),
]


def case_options(command):
    """A command that takes the name of a preset and a `Case` gets the options that make them."""

    @wraps(command)
    def with_case(preset, pairs, galaxy, template_dir, beam, **others):
        survey = Survey.preset(preset, **parse_texts([], dict(pairs)))
        sky = Galaxy(source=galaxy, template_dir=template_dir)
        return command(preset, pipeline.Case(survey=survey, galaxy=sky, beam=named(beam)), **others)

    for option in reversed(_OPTIONS):
        with_case = option(with_case)
    return with_case
