"""Gather the paper's figures from executed copies of the notebooks, for the book to show with its own.

    python book/collect_figures.py results/*_paper_*templates*.ipynb book/results/paper_templates

takes the figures of the paper among them and writes each as NAME.png, and ``figures.json`` with what made
them and the numbers of their curves. All figures of the folder are written anew together.
"""

import json
import math
from contextlib import suppress
from pathlib import Path

import click

from himap.app.notebook_files import STAMP, figures, read_notebook
from himap.app.notebooks import notebooks
from himap.core.errors import InputError
from himap.core.files import atomic_files
from himap.sky.galaxy import Galaxy
from himap.store.fingerprint import moved

PLACES = {"template_dir"}  # parameters that say where something lies on one machine


@click.command()
@click.argument("copies", nargs=-1, required=True, type=click.Path(exists=True, dir_okay=False))
@click.argument("target", type=click.Path(file_okay=False))
def main(copies, target):
    """Gather the figures of COPIES, executed notebooks, in the folder TARGET."""
    rows = []
    for copy in sorted(copies, key=lambda path: Path(path).name):
        stamp = read_notebook(copy).metadata[STAMP]
        made = without_places(stamp["parameters"])
        for figure in figures(copy):
            if figure.paper:
                with atomic_files(Path(target, f"{figure.name}.png")) as (temporary,):
                    temporary.write_bytes(figure.png)
                about = {"name": figure.name, "paper": figure.paper, "parameters": made}
                about |= {"code": code_of(figure, stamp), "execution": stamp["execution"]}
                rows.append(about | {"panels": curves(figure)})
    if not rows:
        raise click.ClickException("none of these notebooks has a figure of the paper.")
    with atomic_files(Path(target, "figures.json")) as (temporary,):
        temporary.write_text(json.dumps({"figures": rows}, separators=(",", ":")) + "\n")


def code_of(figure, stamp):
    """Fingerprint of the code behind a figure; of all of its notebook where that has changed since it ran."""
    (notebook,) = (one for one in notebooks() if figure.name in one.captions)
    is_today = not moved(stamp["fingerprint"], notebook.fingerprint())
    return notebook.figure_fingerprint(figure.name) if is_today else stamp["fingerprint"]


def without_places(parameters):
    """Parameters that mean something elsewhere; of templates that are still there, with their nside."""
    made = {name: value for name, value in parameters.items() if name not in PLACES}
    if "template_dir" in parameters:
        with suppress(InputError):
            made["galaxy"] = Galaxy(source="templates", template_dir=parameters["template_dir"]).label
    return made


def curves(figure):
    """{panel: [{"x": [...], "y": {curve: [...]}}]} of a figure, curves with the same x together."""
    panels = {}
    for panel, named in figure.curves.items():
        groups = {}
        for curve, points in named.items():
            xs, ys = zip(*points, strict=True)
            groups.setdefault(xs, {})[curve] = [_rounded(y) for y in ys]
        panels[panel] = [{"x": list(xs), "y": ys} for xs, ys in groups.items()]
    return panels


def _rounded(value):
    """Four digits; None, which JSON has, for what is no number."""
    return float(f"{value:.4g}") if math.isfinite(value) else None


if __name__ == "__main__":
    main()
