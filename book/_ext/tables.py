"""Sphinx extensions build their tables as Markdown, so that pages and tables are written in one language."""

from docutils import nodes
from docutils.statemachine import StringList

_BAR = r"\|"


def table(head, rows):
    """Lines of a Markdown table of texts; a bar in a text stays one."""
    lines = [head, ["---"] * len(head), *rows]
    return [f"| {' | '.join(str(cell).replace('|', _BAR) for cell in cells)} |" for cells in lines]


def parsed(directive, lines):
    """The nodes of lines of Markdown, for a `directive` to return."""
    node = nodes.container()
    directive.state.nested_parse(StringList(lines, directive.name), directive.content_offset, node)
    return node.children
