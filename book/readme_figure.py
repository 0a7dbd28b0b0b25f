"""Copy one figure of an executed notebook to where the README shows it; `make book` calls this."""

import base64
from pathlib import Path

import nbformat

ROOT = Path(__file__).resolve().parents[1]
NOTEBOOK = ROOT / "notebooks" / "10_results.ipynb"
FIGURE = "fig-results-angular"
TARGET = ROOT / "book" / "_static" / "results_quick.png"


def figure(notebook, name):
    """The PNG of the cell whose figure is called `name`, bytes."""
    for cell in nbformat.read(notebook, as_version=4).cells:
        if cell.metadata.get("mystnb", {}).get("figure", {}).get("name") == name:
            images = [out.data["image/png"] for out in cell.outputs if "image/png" in out.get("data", {})]
            return base64.b64decode(images[0])
    raise SystemExit(f"{notebook.name} has no figure {name}")


if __name__ == "__main__":
    png = figure(NOTEBOOK, FIGURE)
    if not TARGET.exists() or TARGET.read_bytes() != png:
        TARGET.write_bytes(png)
