"""Sphinx extensions build their tables as Markdown, so that pages and tables are written in one language."""

from docutils import nodes
from docutils.statemachine import StringList

from himap.figures.tables import Table


def table(head, rows):
    """Lines of a Markdown table."""
    return Table(head, rows).markdown()


def parsed(directive, lines):
    """The nodes of lines of Markdown, for a `directive` to return."""
    node = nodes.container()
    directive.state.nested_parse(StringList(lines, directive.name), directive.content_offset, node)
    return node.children
