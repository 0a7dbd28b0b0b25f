"""A small HTML page that needs no other file and no network: sections with a table or a figure, and notes."""

import base64
import html
import io

from himap import __version__

_STYLE = """
:root { color-scheme: light dark; }
body { font: 16px/1.5 system-ui, sans-serif; max-width: 60rem; margin: 2rem auto; padding: 0 1rem; }
img { max-width: 100%; background: white; border-radius: 4px; }
.himap-table { overflow-x: auto; }
table { border-collapse: collapse; }
td, th { padding: .2rem .8rem .2rem 0; }
figure { margin: 1.5rem 0; } figcaption { font-size: .9rem; opacity: .85; }
"""


def page(title, parts):
    """The text of a whole page of `parts`, which are HTML."""
    return "\n".join(
        [
            '<!doctype html><html lang="en"><head><meta charset="utf-8">',
            '<meta name="viewport" content="width=device-width, initial-scale=1">',
            f"<title>{html.escape(title)}</title><style>{_STYLE}</style></head><body>",
            f"<h1>{html.escape(title)}</h1>",
            f"<p>himap {__version__}</p>",
            *parts,
            "</body></html>\n",
        ]
    )


def note(text):
    """A paragraph that must not be overlooked."""
    return f"<p><strong>Note:</strong> {html.escape(text)}</p>"


def figure(picture, alt, text):
    """A matplotlib figure within the page, with a text under it."""
    buffer = io.BytesIO()
    picture.savefig(buffer, format="png", dpi=100, bbox_inches="tight")
    data = base64.b64encode(buffer.getvalue()).decode()
    return (
        f'<figure><img alt="{html.escape(alt)}" src="data:image/png;base64,{data}">'
        f"<figcaption>{html.escape(text)}</figcaption></figure>"
    )


def section(title, picture, alt, text):
    """A part of a page, a list of HTML: a title, and a figure as of `figure`."""
    return [f"<h2>{html.escape(title)}</h2>", figure(picture, alt, text)]
