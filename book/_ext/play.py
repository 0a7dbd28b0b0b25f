"""Sphinx extension: figures to play with. A figure that is in `SPECTRA` or `LINES` gets a button, which puts
curves to toggle, zoom and read values from in the place of the picture. The picture stays where there is no
script, and in print.

The numbers become ``_static/play/NAME.js``, which a page asks for when the button is pressed; the library
that draws (uPlot, MIT licence, in ``_static/uplot``) is loaded by pages that have such a figure only.
"""

import json
from pathlib import Path

import pandas as pd
import play_data
import play_looks
from docutils import nodes

from himap.app.notebook_files import STAMP, figures, read_notebook
from himap.app.stored import stored_figures
from himap.figures import styles
from himap.paper.experiments import find_experiment
from himap.paper.readings import CURVES, outcomes, readings
from himap.paper.record import Record
from himap.removal.sdecgmca.readings import READINGS

SPECTRA = {
    "fig-results-angular": {"kind": "angular", "panel": "Beam"},
    "fig-results-frequency": {"kind": "frequency", "panel": "Beam"},
    "fig-ns-scan-spectra": {"looks": play_looks.sequence, "slider": "curve"},
    "fig-post-spectra": {},
    "fig-dimmed-spectra": {},
    "fig-transfer-corrected": {"looks": play_looks.corrected},
}
"""Figures of spectra: {name: what differs}; each curve comes with its ratio to the truth."""

_SKY = "across the sky"
LINES = {
    "fig-ns-scan-mse": {
        "n_panels": 1,  # the other is a part of it
        "axes": {"x": "number of sources nₛ", "y": "total MSE", "y_log": True},
        "slider": "x",
    },
    "fig-transfer-functions": {
        "looks": play_looks.sequence,
        "axes": {"y": "share of the power that comes back, T", "x_log": True, "y_range": [0, 1.1]},
    },
    "fig-transfer-mocks": {
        "looks": play_looks.apart,
        "axes": {"y": "T over the usual T", "x_log": True, "y_range": [0.97, 1.03]},
    },
}
"""Figures of other curves."""

READINGS_FIGURE = "fig-readings-curves"
_SCRIPTS = ("uplot/uPlot.iife.min.js", "play_chart.js", "play.js")


def add_buttons(app, doctree, docname):
    """Write the numbers of a page's figures to play with, and a button under each."""
    source = Path(app.env.doc2path(docname))
    if source.suffix != ".ipynb" or app.builder.format != "html":
        return
    there = {figure.name: figure for figure in figures(source)}
    for node in doctree.findall(nodes.figure):
        for name in set(node["ids"]) & set(there) & {*SPECTRA, *LINES, READINGS_FIGURE}:
            path = Path(app.outdir, "_static", "play", f"{name}.js")
            _write(path, name, content_of(Path(app.srcdir), there[name]))
            button = f'<button type="button" class="himap-play" data-figure="{name}" hidden></button>'
            legend = next(node.findall(nodes.legend))
            legend.insert(0, nodes.raw("", button, format="html"))
            app.env.metadata[docname]["himap-plays"] = True


def add_library(app, pagename, templatename, context, doctree):
    """The scripts, on pages with such a figure."""
    if app.env.metadata.get(pagename, {}).get("himap-plays"):
        for script in _SCRIPTS:
            app.add_js_file(script, loading_method="defer")
        app.add_css_file("uplot/uPlot.min.css")


def _write(path, name, content):
    path.parent.mkdir(parents=True, exist_ok=True)
    text = json.dumps(content, ensure_ascii=False, separators=(",", ":"))
    path.write_text(f"himapPlay.arrived({json.dumps(name)}, {text});\n", encoding="utf-8")


def content_of(root, figure):
    """What the script gets of one `Figure` of the book in the folder `root`, a dict."""
    results = root / "book" / "results"
    if figure.name == READINGS_FIGURE:
        return _of_readings(results / "readings.json")
    is_spectrum = figure.name in SPECTRA
    about = (SPECTRA if is_spectrum else LINES)[figure.name]
    notebook = root / "notebooks" / f"{figure.notebook}.ipynb"
    parameters = read_notebook(notebook).metadata[STAMP]["parameters"]
    sources = [(parameters, play_data.of_notebook(figure))]
    for rows in stored_figures(results).values():
        if row := rows.get(figure.name):
            sources.append((row["parameters"], play_data.of_stored(row)))
    views = []
    for made, panels in sources:
        chosen = dict(list(panels.items())[: about.get("n_panels")])
        if about.get("slider") == "curve":
            chosen = {title: play_data.medians(curves) for title, curves in chosen.items()}
        label = f"{made.get('preset', 'quick')}, {made.get('galaxy', 'synthetic')} Galaxy"
        views.append(play_data.view(label, chosen, about.get("looks", play_looks.methods), is_spectrum))
    for one in views:
        for panel in one["panels"]:
            panel |= _axes(panel["title"], about)
    names = {"view": "Size and Galaxy", "panel": about.get("panel", "Direction")}
    return {"names": names, "slider": about.get("slider"), "views": views}


def _labels(title, kind=None):
    """Labels of x, y and the ratio, of a panel of that kind or of that title."""
    found = styles.AXES[kind or ("angular" if title.endswith(_SKY) else "frequency")]
    return [play_data.plain(found[key]) for key in ("xlabel", "ylabel", "ratio_label")]


def _axes(title, about):
    """Labels and scales of one panel."""
    x, y, ratio = _labels(title, about.get("kind"))
    if "axes" not in about:  # spectra
        return {"x_label": x, "y_label": y, "x_log": True, "y_log": True, "ratio_label": ratio}
    given = about["axes"]
    axes = {"x_label": x} | {f"{one}_label": given[one] for one in "xy" if one in given}
    return axes | {one: given[one] for one in ("x_log", "y_log", "y_range") if one in given}


def _of_readings(path):
    """SDecGMCA under every reading: a view for each restart, those with a name shown at first."""
    found = outcomes(Record.load(find_experiment("readings"), path).rows)
    known = readings()
    rows = pd.concat({label: one.curves for label, one in found.items()}, names=["label"])
    titles = {label: known[label].title for label in found}
    views = []
    for restart, of_restart in rows.groupby("restart"):
        panels = {}
        for seed, of_seed in of_restart.groupby("seed", sort=False):
            for curve, across in zip(CURVES, (_SKY, "along the line of sight"), strict=True):
                curves = of_seed[of_seed["quantity"] == curve].groupby("label", sort=False)
                panels[f"seed {seed}, {across}"] = [
                    (titles[label], list(zip(one["x"], one["value"], strict=True))) for label, one in curves
                ]
        one = play_data.view(f"restart {restart}", panels, play_looks.apart)
        for panel in one["panels"]:
            x, _, ratio = _labels(panel["title"])
            panel |= {"x_label": x, "y_label": ratio, "x_log": True, "y_range": [0.4, 2.2], "band": 0.1}
        views.append(one)
    hidden = [titles[label] for label in found if label not in READINGS]
    names = {"view": "Restart", "panel": "Sky and direction"}
    return {"names": names, "slider": None, "views": views, "hidden": hidden}


def setup(app):
    app.connect("doctree-resolved", add_buttons, priority=600)  # below the links of figure_links
    app.connect("html-page-context", add_library)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
