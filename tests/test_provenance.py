"""The provenance line under a figure."""

import json
import os
import re
import subprocess
import time
from dataclasses import asdict, replace

import numpy as np

import himap
from himap.core.survey import PRESETS, Survey
from himap.store import provenance
from himap.store.provenance import VOLATILE, Provenance


def test_provenance_names_what_differs_from_the_preset():
    survey = Survey.preset("ci", n_channels=50, seed=3)
    started = time.monotonic() - 61
    chosen = {"preset": "ci", "parameters": {"n_sources": 4}}
    made = Provenance.of(survey, galaxy="synthetic", **chosen, started=started)
    assert made.preset == "ci" and made.seed == 3
    assert made.overrides == (("n_channels", 50), ("n_sources", 4))
    assert 61 <= made.seconds < 70
    assert dict(made.packages)["numpy"] == np.__version__
    assert "\n" not in str(made)
    assert str(made).startswith("ci · n_channels = 50 · n_sources = 4 · synthetic Galaxy · seed 3 · himap ")
    assert str(made).endswith(" · 61 s")
    stored = json.loads(json.dumps(asdict(made) | {"code": "abc", "size": 3}))
    assert Provenance.of_stored(stored).footer() == made.footer()
    grown = Provenance.of_stored(stored | {"grown": ["abc1234"]}).footer()  # its time is not that of all
    assert made.footer().startswith(grown) and len(grown) < len(made.footer())


def test_the_volatile_part_is_the_commit_and_the_time():
    made = Provenance.of(PRESETS["quick"], galaxy="synthetic", preset="quick", started=time.monotonic())
    for other in [{"commit": "abc1234", "dirty": True}, {"commit": "unknown"}, {"seconds": 5000.0}]:
        line = re.sub(VOLATILE, "", str(replace(made, **other)))
        assert line == f"quick · synthetic Galaxy · seed 2025 · himap {himap.__version__}"


def test_the_commit_is_that_of_the_checkout(tmp_path, monkeypatch):
    def git(*arguments):
        command = ["git", "-c", "user.name=a", "-c", "user.email=a@b", *arguments]
        environment = {**os.environ, "GIT_CONFIG_GLOBAL": os.devnull}
        subprocess.run(command, cwd=tmp_path, check=True, env=environment, capture_output=True)

    package = tmp_path / "himap"
    package.mkdir()
    (package / "__init__.py").touch()
    monkeypatch.setattr(provenance, "_HERE", package)
    monkeypatch.setenv("GIT_CEILING_DIRECTORIES", str(tmp_path.parent))
    commit = provenance._commit.__wrapped__
    assert commit() == ("unknown", False)
    git("init")
    git("commit", "--allow-empty", "-m", "somebody else's")
    assert commit() == ("unknown", False)
    git("add", ".")
    git("commit", "-m", "himap")
    name, dirty = commit()
    assert len(name) >= 7 and not dirty
    (package / "__init__.py").write_text("x = 1")
    assert commit() == (name, True)
