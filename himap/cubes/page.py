"""Pieces of a small HTML page that needs no other file and no network, and what pages on cubes share."""

import base64
import html
import io

import numpy as np

from himap import __version__

__all__ = ["figure", "maps_of_residual", "mean_ratio", "note", "page"]

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


def mean_ratio(x, values, low, high):
    """The mean of `values` at `x` between two limits, as text."""
    inside = (x > low) & (x < high)
    return f"{values[inside].mean():.3f}" if inside.any() else "no such scale"


def maps_of_residual(cleaned):
    """What is left in the channel in the middle, and its rms over channels, of a `CleanedCube`.

    Returns
    -------
    (dict, dict)
        By title: maps (n_pix,) in mK, NaN where nothing is seen, and the span of their colours.
    """
    cube, middle = cleaned.cube, len(cleaned.cube.freqs) // 2
    seen = {
        f"left at {cube.freqs[middle]:g} MHz": cleaned.residual[middle],
        "rms over channels": np.sqrt(np.einsum("cp,cp->p", *[cleaned.residual] * 2) / len(cube.freqs)),
    }
    maps = {title: np.full(len(cube.mask), np.nan) for title in seen}
    for title, pixels in seen.items():
        maps[title][cube.mask] = pixels
    return maps, {title: tuple(np.percentile(pixels, (1, 99))) for title, pixels in seen.items()}
