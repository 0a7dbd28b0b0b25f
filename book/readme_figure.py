"""Copy one figure of an executed notebook to where the README shows it; `make book` calls this."""

from pathlib import Path

from himap.app.notebook_files import figures

ROOT = Path(__file__).resolve().parents[1]
NOTEBOOK = ROOT / "notebooks" / "00_the_answer.ipynb"
FIGURE = "fig-answer-angular"
TARGET = ROOT / "book" / "_static" / "answer.png"


if __name__ == "__main__":
    (png,) = (one.png for one in figures(NOTEBOOK) if one.name == FIGURE)
    if not TARGET.exists() or TARGET.read_bytes() != png:
        TARGET.write_bytes(png)
