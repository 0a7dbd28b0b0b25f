"""The commands that judge the paper's claims, on many skies, with nothing computed."""

import json
import re
from pathlib import Path

import pytest
from ledgers import entry
from outcomes import outcome

import himap
from himap.companion import notebooks
from himap.companion.staleness import ledger_code, readings_code
from himap.paper import ledger, readings
from himap.paper.claims import FAILED, IN_PART, REPRODUCED
from himap.paper.readings_file import read_readings


@pytest.mark.parametrize(
    "command", ["claims", "readings", "record corrections", "record beam-errors", "record suggestions"]
)
def test_what_is_there_is_not_lost(himap_command, command):
    """Neither a file of one's own nor results of hours, which have the name of their parameters."""
    words = [*command.split(), "--preset", "ci"]
    name = words[-3].replace("-", "_")
    for file, option in (("mine.json", ["-o", "mine.json"]), (f"results/{name}_ci.json", [])):
        Path(file).parent.mkdir(exist_ok=True)
        Path(file).write_text("hours of work")
        code, _, err = himap_command(*words, *option)
        assert code == 2 and f"{file} exists; choose another output, or give --overwrite" in err
        assert Path(file).read_text() == "hours of work"
    code, _, err = himap_command(*words, "-o", "")
    assert code == 2 and "something.json; got" in err


class TestClaims:
    @pytest.fixture
    def command(self, himap_command, monkeypatch):
        """The command with the real parameters of 15_claims, and a ledger that is not computed."""
        monkeypatch.setattr(notebooks, "_PACKAGE", Path(himap.__file__).parent)
        seen = []

        def evaluate(skies, nudges):
            seen.append((skies, nudges))
            return [entry(*(REPRODUCED, IN_PART)[: len(skies)]), entry(FAILED, id="N1")]

        monkeypatch.setattr(ledger, "evaluate", evaluate)
        return himap_command, seen

    def test_check(self, command):
        """One realisation, without nudges, that was the first of the ledger."""
        himap_command, seen = command
        words = ["claims", "--preset", "ci"]
        assert himap_command(*words, "-p", "n_realisations=2", "-p", "seed=0", "-o", "a.json")[0] == 0
        code, out, err = himap_command(*words, "-p", "seed=0", "--check", "a.json")
        assert (code, err) == (0, "") and "a.json: 2 claims on one realisation are the same" in out
        assert len(seen[1][0]) == 1 and seen[1][1] == ()
        assert json.loads(Path("a.json").read_text())["about"]["checked"]["code"] == ledger_code()
        for more, message in ((["-o", "b.json"], "leave -o out"), (["--overwrite"], "leave -o out")):
            code, _, err = himap_command(*words, "--check", "a.json", *more)
            assert code == 2 and message in err
        code, _, err = himap_command(*words, "--check", "none.json")
        assert code == 2 and "there is no ledger none.json" in err

    def test_table_and_file(self, command):
        himap_command, seen = command
        code, out, err = himap_command("claims", "--preset", "ci", "-p", "n_realisations=2", "-p", "seed=7")
        assert (code, err) == (0, "")
        assert [sky.survey.seed for sky in seen[0][0]] == [7, 8]
        assert re.search(r"^D1 +degraded +in part \(1 of 2\) +1/2", out, re.M)
        assert "1 in part, 1 not reproduced" in out
        path = Path("results/claims_ci_n_realisations=2_seed=7.json")
        assert f"{path}  (" in out
        stored = json.loads(path.read_text())
        assert stored["about"]["preset"] == "ci" and stored["about"]["code"] == ledger_code()
        assert [row["id"] for row in stored["claims"]] == ["D1", "N1"]

    def test_five_seeds_unless_told_otherwise(self, command):
        himap_command, seen = command
        assert himap_command("claims", "--preset", "ci", "-o", "claims.json")[0] == 0
        assert len(seen[0][0]) == 5 and seen[0][1] == ledger.NUDGES
        assert Path("claims.json").exists()
        assert himap_command("claims", "--preset", "ci", "-o", "claims.json", "--overwrite")[0] == 0
        assert len(seen) == 2

    def test_without_nudges(self, command):
        himap_command, seen = command
        options = ("--preset", "ci", "-p", "n_realisations=1", "-p", "nudged=false")
        assert himap_command("claims", *options)[0] == 0
        assert seen[0][1] == ()
        about = json.loads(next(Path("results").iterdir()).read_text())["about"]
        assert ["nudged", False] in about["overrides"] and ["n_realisations", 1] in about["overrides"]

    @pytest.mark.parametrize(
        ("options", "message"),
        [
            (["-p", "method=pca"], "in the place of SDecGMCA can stand"),
            (["-p", "n_realisation=2"], "did you mean n_realisations"),
            (["-p", "n_realisations=0"], "between 1 and 1000"),
            (["-p", "galaxy=templates"], "needs template_dir"),
            (["-o", "claims.txt"], "something.json"),
            (["--preset", "huge"], "unknown preset"),
            (["--jobs", "0"], "--jobs"),
        ],
    )
    def test_bad_input_before_any_work(self, command, options, message):
        himap_command, seen = command
        code, _, err = himap_command("claims", *options)
        assert code == 2
        assert message in err
        assert not seen
        assert not list(Path().iterdir())


class TestReadings:
    @pytest.fixture
    def command(self, himap_command, monkeypatch):
        """The command with the real parameters of 15_claims, and readings that are not computed."""
        monkeypatch.setattr(notebooks, "_PACKAGE", Path(himap.__file__).parent)
        seen = []

        def evaluate(skies):
            seen.append(skies)
            found = {"D1": [REPRODUCED] * len(skies), "O3": [FAILED] * len(skies)}
            return {"default": outcome(found), "letter": outcome(found)}

        monkeypatch.setattr(readings, "evaluate", evaluate)
        return himap_command, seen

    def test_table_and_file(self, command):
        himap_command, seen = command
        code, out, err = himap_command("readings", "--preset", "ci", "-p", "seed=7")
        assert (code, err) == (0, "")
        assert [sky.survey.seed for sky in seen[0]] == [7, 8]
        assert seen[0][0].n_sources == tuple(range(2, 13))
        assert re.search(r"^letter \(thresholds = mad\) +0 +0 of 2 +1 +0 +1 +0 +1.25", out, re.M)
        path = Path("results/readings_ci_seed=7.json")
        assert f"{path}  (" in out
        outcomes, about = read_readings(path)
        assert list(outcomes) == ["default", "letter"]
        assert about["preset"] == "ci" and about["code"] == readings_code()
        assert {("n_realisations", 2), ("n_sources_max", 12)} <= set(map(tuple, about["overrides"]))

    def test_parameters_as_of_claims(self, command, tmp_path):
        himap_command, seen = command
        options = ("-p", "n_realisations=1", "-p", "n_sources_max=5", "-p", "ripple=additive", "-o", "a.json")
        assert himap_command("readings", *options)[0] == 0
        (sky,) = seen[0]
        assert sky.survey.nside == 64 and sky.oscillating.ripple == "additive" and max(sky.n_sources) == 5
        assert Path("a.json").exists()

    @pytest.mark.parametrize(
        ("options", "message"),
        [
            (["-p", "reading=code"], "unknown parameter reading"),
            (["-p", "method=beam_subspace"], "unknown parameter method"),
            (["-p", "n_realisation=2"], "did you mean n_realisations"),
            (["-p", "n_realisations=0"], "between 1 and 1000"),
            (["-p", "galaxy=templates"], "needs template_dir"),
            (["-o", "readings.txt"], "something.json"),
            (["--preset", "huge"], "unknown preset"),
        ],
    )
    def test_bad_input_before_any_work(self, command, options, message):
        himap_command, seen = command
        code, _, err = himap_command("readings", *options)
        assert code == 2
        assert message in err
        assert not seen
        assert not list(Path().iterdir())
