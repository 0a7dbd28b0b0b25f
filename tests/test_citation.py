"""What others cite, archive and install by: each file in its form, and true of the project as it is."""

import hashlib
import json
import re
import runpy
from fnmatch import fnmatch
from pathlib import Path

import pytest
import yaml
from test_project import bibliography, blocks, requirements

ROOT = Path(__file__).resolve().parents[1]
METADATA = runpy.run_path(str(ROOT / "book" / "metadata.py"))
RECORDS = sorted((ROOT / "book" / "results").glob("**/*.json"))
CITATION = yaml.safe_load((ROOT / "CITATION.cff").read_text())


def read(name):
    return json.loads((ROOT / name).read_text())


@pytest.mark.parametrize("name", ["codemeta.json", ".zenodo.json", "ro-crate-metadata.json"])
def test_descriptions_are_up_to_date(name):
    expected = METADATA["text_of"](METADATA["descriptions"]()[name])
    assert (ROOT / name).read_text() == expected, "run `python book/metadata.py`"


def test_citation_is_as_the_format_has_it():
    """The keys and forms of version 1.2.0 of the format, as far as they are used."""
    required = {"cff-version", "message", "title", "authors"}
    known = required | {
        "abstract",
        "date-released",
        "doi",
        "keywords",
        "license",
        "license-url",
        "references",
    }
    known |= {"repository", "repository-code", "type", "url", "version"}
    assert required <= set(CITATION) <= known
    assert CITATION["cff-version"] == "1.2.0" and CITATION["type"] == "software"
    assert re.fullmatch(r"\d{4}-\d\d-\d\d", str(CITATION["date-released"]))
    persons = {"family-names", "given-names", "orcid", "affiliation"}
    for author in CITATION["authors"]:
        assert set(author) <= persons or set(author) <= {"name", "website", "email"}
    for reference in CITATION["references"]:
        assert {"authors", "title", "type"} <= set(reference) and isinstance(reference["year"], int)
        assert all(set(author) <= persons for author in reference["authors"])
        assert reference["status"] in {"in-preparation", "in-press", "preprint", "submitted"}
    assert all(
        isinstance(CITATION[key], str) for key in ("message", "title", "abstract", "version", "license")
    )


def test_the_three_say_the_same():
    codemeta, zenodo, crate = map(read, ("codemeta.json", ".zenodo.json", "ro-crate-metadata.json"))
    (whole,) = [one for one in crate["@graph"] if one["@id"] == "./"]
    assert codemeta["@type"] == "SoftwareSourceCode" and "codemeta" in codemeta["@context"]
    assert {codemeta["name"], zenodo["title"], whole["name"]} == {CITATION["title"]}
    assert {codemeta["version"], zenodo["version"], whole["version"]} == {CITATION["version"]}
    dates = {codemeta["dateModified"], zenodo["publication_date"], whole["datePublished"]}
    assert dates == {str(CITATION["date-released"])}
    assert {one["name"] for one in codemeta["author"] + zenodo["creators"]} == {
        CITATION["authors"][0]["name"]
    }


def test_the_crate_is_whole():
    """Every reference has its entity, every part is there, and a stored result is what its checksum says."""
    graph = {one["@id"]: one for one in read("ro-crate-metadata.json")["@graph"]}
    about, whole = graph["ro-crate-metadata.json"], graph["./"]
    assert about["conformsTo"]["@id"].startswith("https://w3id.org/ro/crate/") and about["about"] == {
        "@id": "./"
    }
    assert {"name", "description", "datePublished", "license"} <= set(whole)
    links = [value for one in graph.values() for value in one.values() if isinstance(value, dict)]
    assert {link["@id"] for link in [*links, *whole["hasPart"]]} - {about["conformsTo"]["@id"]} <= set(graph)
    files = [one for one in graph.values() if one["@type"] == "File"]
    for one in files:
        data = (ROOT / one["@id"]).read_bytes()
        assert one["contentSize"] == str(len(data)) and one["sha256"] == hashlib.sha256(data).hexdigest()
    assert {one["@id"] for one in graph.values() if one["@type"] == "Dataset"} == {
        "./",
        *(f"{name}/" for name in ("himap", "notebooks", "book", "tests")),
    }
    expected = {
        path.relative_to(ROOT).as_posix() for path in RECORDS if path.stem not in ("accepted", "probes")
    }
    assert {one["@id"] for one in files} == expected


def test_every_stored_result_is_on_the_page_on_data():
    rows = [line for line in (ROOT / "book" / "data.md").read_text().splitlines() if line.startswith("| `")]
    patterns = [name for row in rows for name in re.findall(r"`([^`]+)`", row.split("|")[1])]
    names = [path.relative_to(ROOT / "book" / "results").with_suffix("").as_posix() for path in RECORDS]
    for name in names:
        assert any(fnmatch(name, pattern) for pattern in patterns), name
    for pattern in patterns:
        assert any(fnmatch(name, pattern) for name in names), pattern


def test_every_measured_record_has_its_command():
    page = (ROOT / "book" / "contributing.md").read_text()
    for path in RECORDS:
        if "experiment" in json.loads(path.read_text()):
            names = {path.name, path.name.replace("templates", "synthetic")}
            assert any(f"book/results/{name}" in page for name in names), path.name


class TestLock:
    TEXT = (ROOT / "requirements.lock").read_text()
    PINS = re.findall(r"^([\w.-]+)==([^\s;]+)(.*(?:\n    --hash=sha256:\w{64}(?: \\)?)*)", TEXT, re.M)

    def test_whole(self):
        assert len(self.PINS) == len(re.findall("^[^#\\s]", self.TEXT, flags=re.M)) > 100
        assert all("--hash=" in rest for _, _, rest in self.PINS)
        assert "//" not in self.TEXT

    def test_holds_what_is_required(self):
        pins = {name.lower().replace("_", "-"): version for name, version, _ in self.PINS}
        for line in requirements("test"):
            name, low, high = re.fullmatch(r"([\w-]+)>=([\d.]+),<([\d.]+)", line).groups()
            low, pinned, high = (
                [int(part) for part in re.findall(r"\d+", version)[:3]]
                for version in (low, pins[name.lower()], high)
            )
            assert low <= pinned < high, line

    def test_made_by_the_command_that_is_written_down(self):
        command = re.search(r"^#    (uv pip compile .*)$", self.TEXT, re.M)[1]
        page = blocks((ROOT / "book" / "contributing.md").read_text(), "bash")
        assert any(command in block for block in page)


def test_a_container_with_the_lock_runs_both_commands():
    text = (ROOT / "Containerfile").read_text()
    (base,) = re.findall(r"^FROM (.*)$", text, re.M)
    assert re.fullmatch(r"python:3\.1[123]\.\d+-slim-\w+", base)
    (setup,) = re.findall(r"^RUN make (\w+) LOCK=1$", text, re.M)
    targets = re.findall(r"^(\w+):", (ROOT / "Makefile").read_text(), re.M)
    assert (
        {setup, json.loads(re.search(r"^CMD (.*)$", text, re.M)[1])[1]} == {"setup", "book"} <= set(targets)
    )
    assert text.index("COPY . .") < text.index("RUN make")
    assert {".venv", "_build", "results"} <= set((ROOT / ".dockerignore").read_text().splitlines())


def test_the_paper_has_the_form_of_a_journal_of_software():
    _, head, text = (ROOT / "paper.md").read_text().split("---\n", 2)
    about = yaml.safe_load(head)
    assert {"title", "tags", "authors", "affiliations", "date", "bibliography"} <= set(about)
    assert about["title"] == CITATION["title"] and (ROOT / about["bibliography"]).is_file()
    assert {one["index"] for one in about["affiliations"]} == {one["affiliation"] for one in about["authors"]}
    assert {"Summary", "Statement of need", "References"} <= set(re.findall(r"^# (.*)$", text, re.M))
    cited = set(re.findall(r"@([\w-]+)", text))
    assert cited and cited <= set(bibliography())
    assert 250 <= len(text.split()) <= 1000
