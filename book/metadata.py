"""Write codemeta.json, .zenodo.json and ro-crate-metadata.json anew, from CITATION.cff and what there is.

    python book/metadata.py

The crate lists the book and its stored results, each with its checksum and what made it.
"""

import hashlib
import json
import re
import tomllib
from pathlib import Path

import yaml

ROOT = Path(__file__).resolve().parents[1]
ACCOUNTS = ("accepted.json", "probes.json")  # of the code, not results
CRATE = "https://w3id.org/ro/crate/1.1"
PARTS = {
    "himap/": "the library and the command",
    "notebooks/": "the chapters: .py as edited, .ipynb as executed",
    "book/": "the other pages of the book",
    "tests/": "tests of the library, the chapters and the book",
}


def descriptions(root=ROOT):
    """{name of a file in `root`: what it should hold, for JSON}."""
    citation = yaml.safe_load((root / "CITATION.cff").read_text())
    project = tomllib.loads((root / "pyproject.toml").read_text())["project"]
    return {
        "codemeta.json": codemeta(citation, project),
        ".zenodo.json": zenodo(citation),
        "ro-crate-metadata.json": crate(citation, root),
    }


def codemeta(citation, project):
    """The software as CodeMeta 2.0 has it."""
    return {
        "@context": "https://doi.org/10.5063/schema/codemeta-2.0",
        "@type": "SoftwareSourceCode",
        "name": citation["title"],
        "description": citation["abstract"],
        "version": citation["version"],
        "dateModified": str(citation["date-released"]),
        "license": f"https://spdx.org/licenses/{citation['license']}",
        "author": [{"@type": "Organization", "name": one["name"]} for one in citation["authors"]],
        "keywords": citation["keywords"],
        "programmingLanguage": "Python",
        "runtimePlatform": f"Python {project['requires-python']}",
        "softwareRequirements": [requirement(line) for line in project["dependencies"]],
        "referencePublication": citation["references"][0]["url"],
    }


def requirement(line):
    """A dependency such as "numpy>=2.1,<3" as an entity; a text would be read as an address."""
    name, versions = re.fullmatch(r"([\w.-]+)(.*)", line).groups()
    return {"@type": "SoftwareApplication", "name": name, "version": versions}


def zenodo(citation):
    """What an archive asks of a deposit."""
    (paper,) = citation["references"]
    return {
        "title": citation["title"],
        "description": citation["abstract"],
        "upload_type": "software",
        "version": citation["version"],
        "publication_date": str(citation["date-released"]),
        "license": citation["license"],
        "creators": [{"name": one["name"]} for one in citation["authors"]],
        "keywords": citation["keywords"],
        "related_identifiers": [
            {
                "identifier": paper["url"].replace("https://arxiv.org/abs/", "arXiv:"),
                "relation": "isSupplementTo",
            }
        ],
    }


def crate(citation, root):
    """An RO-Crate 1.1 of the book: its folders, and each stored result."""
    results = sorted(root.glob("book/results/**/*.json"))
    files = [stored(path, root) for path in results if path.name not in ACCOUNTS]
    folders = [{"@id": name, "@type": "Dataset", "name": what} for name, what in PARTS.items()]
    (author,), (paper,) = citation["authors"], citation["references"]
    whole = {
        "@id": "./",
        "@type": "Dataset",
        "name": citation["title"],
        "description": citation["abstract"],
        "version": citation["version"],
        "datePublished": str(citation["date-released"]),
        "license": {"@id": f"https://spdx.org/licenses/{citation['license']}"},
        "author": {"@id": "#authors"},
        "citation": {"@id": paper["url"]},
        "keywords": ", ".join(citation["keywords"]),
        "hasPart": [{"@id": one["@id"]} for one in [*folders, *files]],
    }
    about = {
        "@id": "ro-crate-metadata.json",
        "@type": "CreativeWork",
        "conformsTo": {"@id": CRATE},
        "about": {"@id": "./"},
    }
    others = [
        {"@id": "#authors", "@type": "Organization", "name": author["name"]},
        {"@id": whole["license"]["@id"], "@type": "CreativeWork", "name": f"{citation['license']} License"},
        {"@id": paper["url"], "@type": "ScholarlyArticle", "name": paper["title"]},
    ]
    context = [f"{CRATE}/context", {"sha256": "http://schema.org/sha256"}]  # younger than the context
    return {"@context": context, "@graph": [about, whole, *folders, *files, *others]}


def stored(path, root):
    """The entity of a stored result: its size, its checksum and what made it."""
    data = path.read_bytes()
    made = json.loads(data).get("about")
    entity = {
        "@id": path.relative_to(root).as_posix(),
        "@type": "File",
        "name": path.stem if made else f"figures of {path.parent.name}",
        "encodingFormat": "application/json",
        "contentSize": str(len(data)),
        "sha256": hashlib.sha256(data).hexdigest(),
    }
    if made:
        changed = "".join(f", {name} = {json.dumps(value)}" for name, value in made["overrides"])
        origin = f"preset {made['preset']}{changed}, {made['galaxy']} Galaxy, seed {made['seed']}"
        entity["description"] = f"{origin}, himap {made['version']}, commit {made['commit']}"
    return entity


def text_of(description):
    """The text of a file."""
    text = json.dumps(description, indent=1, ensure_ascii=False)
    return re.sub(r"\{\s+(\"@id\": \"[^\"]+\")\s+\}", r"{\1}", text) + "\n"


if __name__ == "__main__":
    for name, description in descriptions().items():
        (ROOT / name).write_text(text_of(description), encoding="utf-8")
