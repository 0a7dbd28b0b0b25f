"""Sphinx extension: tables of notebooks without the tolerance of re-execution.

A notebook keeps ``value ± tolerance``, by which a test judges whether it comes out the same elsewhere
(`himap.figures.numbers`). On a page that reads like an error bar, so a number is shown there as in the prose:
to the digits that the tolerance is sure of, the rest in a text that shows when one points at it.
"""

import re

from docutils import nodes

from himap.figures.numbers import quoted

_NUMBER = r"(?:nan|-?inf|[-+]?\d+(?:\.\d*)?(?:[eE][-+]?\d+)?)"
_STATED = re.compile(rf"({_NUMBER}) ± ({_NUMBER})")
TABLE = 'class="himap-table"'


def without_tolerance(table):
    """The HTML of a table, numbers with a tolerance as prose has them.

    >>> without_tolerance("<td>0.964 ± 0.020</td>")
    '<td><span title="0.964, to within 0.020">0.96</span></td>'
    """
    return _STATED.sub(_shown, table)


def _shown(stated):
    value, tolerance = stated.groups()
    text = quoted((float(value), float(tolerance)))
    return f'<span title="{value}, to within {tolerance}">{"–" if text == "nan" else text}</span>'


def shorten(app, doctree):
    for node in list(doctree.findall(nodes.raw)):
        if TABLE in node.astext():
            node.replace_self(nodes.raw("", without_tolerance(node.astext()), format=node["format"]))


def setup(app):
    app.connect("doctree-read", shorten)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
