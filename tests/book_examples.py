"""What tests read in pages of the book: the method and the beam that these add, code, and tables of HTML."""

import re
import sys
import tempfile
from contextlib import contextmanager
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]


def blocks(text, language):
    """The fenced blocks of a page in `language`."""
    return re.findall(rf"^```{language}\n(.*?)^```", text, flags=re.M | re.S)


def cells(page):
    """[[HTML of a cell]] of the tables of a page of HTML."""
    rows = re.findall(r"<tr\b.*?</tr>", page, re.S)
    return [re.findall(r"<t[dh]\b[^>]*>(.*?)</t[dh]>", row, re.S) for row in rows]


def example_of(page):
    """The source of the method or the beam that a page of the book adds."""
    (source,) = blocks((ROOT / "book" / f"{page}.md").read_text(), "python")
    return source


@contextmanager
def added(page, package, name, registry):
    """The example of a page as a file `name` of a package of himap, found as those that are there."""
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder).joinpath(*package.__name__.split("."))  # its root is searched for code
        place.mkdir(parents=True)
        (place / f"{name}.py").write_text(example_of(page))
        package.__path__.append(str(place))
        try:
            package.create(name)
            yield
        finally:
            package.__path__.remove(str(place))
            registry.pop(name, None)
            sys.modules.pop(f"{package.__name__}.{name}", None)
