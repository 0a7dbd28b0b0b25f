"""What others cite, archive and install by: each file in its form, and true of the project as it is."""

import hashlib
import json
import re
import runpy
from fnmatch import fnmatch

import jsonschema
import pytest
import yaml
from conftest import ROOT
from test_project import bibliography, blocks, requirements

METADATA = runpy.run_path(str(ROOT / "book" / "metadata.py"))
RECORDS = sorted((ROOT / "book" / "results").glob("**/*.json"))
FORMATS = ROOT / "tests" / "data" / "metadata"
CITATION = yaml.safe_load((ROOT / "CITATION.cff").read_text())


def read(name):
    return json.loads((ROOT / name).read_text())


@pytest.mark.parametrize("name", ["codemeta.json", ".zenodo.json", "ro-crate-metadata.json"])
def test_descriptions_are_up_to_date(name):
    expected = METADATA["text_of"](METADATA["descriptions"]()[name])
    assert (ROOT / name).read_text() == expected, "run `python book/metadata.py`"


def test_citation_fits_the_schema_of_its_format():
    """Dates are texts there."""
    content = CITATION | {"date-released": str(CITATION["date-released"])}
    schema = json.loads((FORMATS / "cff-1.2.0.schema.json").read_text())
    jsonschema.Draft7Validator(schema).validate(content)


def entities_of(value):
    """All objects of a JSON-LD document, at any depth."""
    if isinstance(value, dict):
        yield value
        value = [item for key, item in value.items() if key != "@context"]
    if isinstance(value, list):
        for item in value:
            yield from entities_of(item)


@pytest.mark.parametrize(
    "name, context",
    [
        ("codemeta.json", "codemeta-2.0.context.json"),
        ("ro-crate-metadata.json", "ro-crate-1.1.terms.json"),
    ],
)
def test_descriptions_are_linked_data(name, context):
    """Every key and type is a term of the context, so that it has an address, and addresses are such."""
    document = read(name)
    terms = json.loads((FORMATS / context).read_text())["@context"]
    stated = document["@context"] if isinstance(document["@context"], list) else [document["@context"]]
    assert re.match("https://", stated[0])
    terms |= {key: value for extra in stated[1:] for key, value in extra.items()}
    for entity in entities_of(document):
        for key, value in entity.items():
            if key == "@type":
                assert value in terms, f"{value} is no type of {stated[0]}"
            elif not key.startswith("@"):
                assert key in terms, f"{key} is no term of {stated[0]}"
                address = isinstance(terms[key], dict) and terms[key].get("@type") == "@id"
                values = value if isinstance(value, list) else [value]
                texts = [one for one in values if isinstance(one, str)]
                assert not address or all(re.match(r"https?://", one) for one in texts), f"{key}: {texts}"


def test_the_three_say_the_same():
    codemeta, zenodo, crate = map(read, ("codemeta.json", ".zenodo.json", "ro-crate-metadata.json"))
    (root,) = [one for one in crate["@graph"] if one["@id"] == "./"]
    assert codemeta["@type"] == "SoftwareSourceCode" and "codemeta" in codemeta["@context"]
    assert {codemeta["name"], zenodo["title"], root["name"]} == {CITATION["title"]}
    assert {codemeta["version"], zenodo["version"], root["version"]} == {CITATION["version"]}
    dates = {codemeta["dateModified"], zenodo["publication_date"], root["datePublished"]}
    assert dates == {str(CITATION["date-released"])}
    (author,) = CITATION["authors"]
    assert {one["name"] for one in codemeta["author"] + zenodo["creators"]} == {author["name"]}


def test_the_crate_is_complete():
    """Every reference has its entity, every part is there, and a stored result is what its checksum says."""
    graph = {one["@id"]: one for one in read("ro-crate-metadata.json")["@graph"]}
    about, root = graph["ro-crate-metadata.json"], graph["./"]
    assert about["conformsTo"]["@id"].startswith("https://w3id.org/ro/crate/")
    assert about["about"] == {"@id": "./"}
    assert {"name", "description", "datePublished", "license"} <= set(root)
    links = [value for one in graph.values() for value in one.values() if isinstance(value, dict)]
    assert {link["@id"] for link in [*links, *root["hasPart"]]} - {about["conformsTo"]["@id"]} <= set(graph)
    files = [one for one in graph.values() if one["@type"] == "File"]
    for one in files:
        data = (ROOT / one["@id"]).read_bytes()
        assert one["contentSize"] == str(len(data)) and one["sha256"] == hashlib.sha256(data).hexdigest()
    folders = {one["@id"] for one in graph.values() if one["@type"] == "Dataset"}
    assert folders == {"./", "himap/", "notebooks/", "book/", "tests/"}
    results = [path for path in RECORDS if path.stem not in ("accepted", "probes")]
    expected = {path.relative_to(ROOT).as_posix() for path in results}
    assert {one["@id"] for one in files} == expected


def test_every_stored_result_is_on_the_page_on_data():
    stored = (ROOT / "book" / "data.md").read_text().split("## Stored")[1]
    rows = [line for line in stored.splitlines() if line.startswith("| `")]
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
            versions = low, pins[name.lower()], high
            low, pinned, high = ([int(part) for part in re.findall(r"\d+", one)[:3]] for one in versions)
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
    command = json.loads(re.search(r"^CMD (.*)$", text, re.M)[1])
    assert {setup, command[1]} == {"setup", "book"} <= set(targets)
    assert text.index("COPY . .") < text.index("RUN make")
    known = {"FROM", "RUN", "WORKDIR", "COPY", "CMD"}
    lines = re.sub(r"\\\n", " ", re.sub(r"(?m)^#.*\n", "", text)).splitlines()
    assert {line.split()[0] for line in lines if line.strip()} <= known
    assert set(re.findall(r"make (\w+)", text)) <= set(targets)
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
