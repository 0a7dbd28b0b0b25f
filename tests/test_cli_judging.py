"""The commands that measure on many skies, from claims to suggestions, with nothing computed."""

import json
import re
from pathlib import Path

import pytest
from click.testing import CliRunner
from ledgers import entry
from outcomes import outcome

import himap
from himap.cli.main import main
from himap.companion import notebooks
from himap.companion.staleness import (
    beam_errors_code,
    corrections_code,
    ledger_code,
    readings_code,
    suggestions_code,
)
from himap.paper import beam_errors, corrections, ledger, readings, suggestions
from himap.paper.claims import FAILED, IN_PART, REPRODUCED
from himap.paper.readings_file import read_readings
from himap.paper.record_file import read_record


@pytest.fixture
def himap_command(tmp_path, monkeypatch):
    """Call the command in an empty folder; gives exit code, stdout and stderr."""
    monkeypatch.chdir(tmp_path)

    def call(*arguments):
        result = CliRunner().invoke(main, arguments)
        return result.exit_code, result.stdout, result.stderr

    return call


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
            return [entry(REPRODUCED, IN_PART), entry(FAILED, id="N1")]

        monkeypatch.setattr(ledger, "evaluate", evaluate)
        return himap_command, seen

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


class TestCorrections:
    @pytest.fixture
    def command(self, himap_command, monkeypatch):
        """The command with the real parameters of 20_transfer_function, and corrections not computed."""
        monkeypatch.setattr(notebooks, "_PACKAGE", Path(himap.__file__).parent)
        seen = []

        def evaluate(cases, removers, mocks):
            seen.append((cases, removers, mocks))
            row = {"method": "pca", "n_sources": 5, "band": "C/C0, 2-4", "raw": 0.9, "corrected": 1.0}
            return [corrections.Correction(seed=n, by_auto=1.0, sigma=0.1, **row) for n in (7, 8)]

        monkeypatch.setattr(corrections, "evaluate", evaluate)
        return himap_command, seen

    def test_table_and_file(self, command):
        himap_command, seen = command
        code, out, err = himap_command("record", "corrections", "--preset", "ci", "-p", "seed=7")
        assert (code, err) == (0, "")
        ((cases, removers, mocks),) = seen
        assert [case.survey.seed for case in cases] == list(range(7, 27))
        assert [mock.seed for mock in mocks] == [*range(1, 7), *range(27, 31)]  # of other skies
        assert [(one.name, one.n_sources) for one in removers] == [
            ("beam_subspace", 3),
            ("pca", 5),
            ("pca", 8),
            ("gmca", 5),
            ("sdecgmca", 5),
        ]
        assert re.search(r"^pca 5 +C/C0, 2-4 +0.9000 +1.0000 +1.0000 +0.0000 +0.1000 +2 of 2$", out, re.M)
        path = Path("results/corrections_ci_seed=7.json")
        assert f"{path}  (" in out
        rows, about = read_record(corrections.Correction, path)
        assert len(rows) == 2 and about["code"] == corrections_code()
        assert {("n_realisations", 20), ("n_mocks", 10)} <= {tuple(one) for one in about["overrides"]}

    def test_chosen(self, command):
        himap_command, seen = command
        options = ("-p", 'methods=[["pca", 4]]', "-p", "n_mocks=2", "-p", "beam=degraded", "-o", "a.json")
        assert himap_command("record", "corrections", *options)[0] == 0
        ((cases, removers, mocks),) = seen
        assert cases[0].beam.name == "degraded" and len(mocks) == 2
        assert [one.n_sources for one in removers] == [4]

    @pytest.mark.parametrize(
        ("options", "message"),
        [
            (["-p", "results=[]"], "unknown parameter results"),
            (["-p", "n_mock=2"], "did you mean n_mocks"),
            (["-p", "n_mocks=1"], "between 2 and 1000, got 1"),
            (["-p", 'methods=[["pca", 500]]'], "at most the number of channels"),
            (["-p", "galaxy=templates"], "needs template_dir"),
            (["-o", "corrections.txt"], "something.json"),
        ],
    )
    def test_bad_input_before_any_work(self, command, options, message):
        himap_command, seen = command
        code, _, err = himap_command("record", "corrections", "--preset", "ci", *options)
        assert code == 2
        assert message in err
        assert not seen
        assert not list(Path().iterdir())


class TestCheck:
    @pytest.fixture
    def command(self, himap_command, monkeypatch):
        monkeypatch.setattr(notebooks, "_PACKAGE", Path(himap.__file__).parent)
        seen = []

        def evaluate(cases, removers, mocks):
            seen.append(cases)
            row = {"method": "pca", "n_sources": 5, "band": "C/C0, 2-4", "raw": 0.9, "corrected": 1.0}
            own = [case.survey.seed for case in cases]
            return [corrections.Correction(seed=seed, by_auto=1.0, sigma=0.1, **row) for seed in own]

        monkeypatch.setattr(corrections, "evaluate", evaluate)
        assert himap_command("record", "corrections", "--preset", "ci", "-o", "a.json")[0] == 0
        return himap_command, seen

    def test_one_sky_again(self, command):
        himap_command, seen = command
        code, out, err = himap_command("record", "corrections", "--preset", "ci", "--check", "a.json")
        assert (code, err) == (0, "") and len(seen[-1]) == 1
        assert out == "a.json: 1 rows of one sky are the same with today's code.\n"
        rows, about = read_record(corrections.Correction, "a.json")
        assert len(rows) == 20 and about["checked"]["code"] == corrections_code()

    @pytest.mark.parametrize(
        ("options", "message"),
        [
            (["--check", "a.json", "-o", "b.json"], "leave -o out"),
            (["--check", "b.json"], "there is no stored record b.json"),
            (["--check", "a.json", "-p", "seed=7"], "has 0 rows of the seed 7"),
        ],
    )
    def test_refused(self, command, options, message):
        himap_command, _ = command
        before = Path("a.json").read_text()
        code, _, err = himap_command("record", "corrections", "--preset", "ci", *options)
        assert code == 2 and message in err
        assert Path("a.json").read_text() == before


class TestBeamErrors:
    @pytest.fixture
    def command(self, himap_command, monkeypatch):
        """The command with the real parameters of 21_beam_errors, and nothing cleaned."""
        monkeypatch.setattr(notebooks, "_PACKAGE", Path(himap.__file__).parent)
        seen = []

        def evaluate(cases, removers, errors):
            seen.append((cases, removers, errors))
            told = {
                "kind": "width",
                "error": 0.01,
                "band": "C/C0, 10-19",
                "ratio": 0.9,
                "kept": 0.8,
                "excess": 0.1,
            }
            return [beam_errors.BeamError(seed=7, method="pca", n_sources=5, **told)]

        monkeypatch.setattr(beam_errors, "evaluate", evaluate)
        return himap_command, seen

    def test_table_and_file(self, command):
        himap_command, seen = command
        code, out, err = himap_command("record", "beam-errors", "--preset", "ci", "-p", "n_realisations=2")
        assert (code, err) == (0, "")
        ((cases, removers, errors),) = seen
        assert len(cases) == 2 and {one.name for one in removers} == {"beam_subspace", "sdecgmca", "pca"}
        assert set(errors) == {"width", "ripple", "amplitude", "phase", "period"}
        assert re.search(r"^pca 5 +width +0.01 +0.9 +C/C0, 10-19 +0.800 +10.00% +C/C0, 10-19$", out, re.M)
        rows, about = read_record(beam_errors.BeamError, "results/beam_errors_ci_n_realisations=2.json")
        assert len(rows) == 1 and about["code"] == beam_errors_code()

    def test_chosen(self, command):
        himap_command, seen = command
        options = ("-p", 'errors={"beam": ["meerkat"]}', "-p", "beam=meerkat_lobes", "-o", "a.json")
        assert himap_command("record", "beam-errors", *options)[0] == 0
        ((cases, _, errors),) = seen
        assert cases[0].beam.name == "meerkat_lobes" and errors == {"beam": ["meerkat"]}

    @pytest.mark.parametrize("option", ["results=[]", "lobes=[]"])
    def test_what_the_notebook_shows_is_no_parameter(self, command, option):
        code, _, err = command[0]("record", "beam-errors", "--preset", "ci", "-p", option)
        assert code == 2 and "unknown parameter" in err


class TestSuggestions:
    @pytest.fixture
    def command(self, himap_command, monkeypatch):
        """The command with the real parameters of 22_how_many, and nothing cleaned."""
        monkeypatch.setattr(notebooks, "_PACKAGE", Path(himap.__file__).parent)
        seen = []

        def evaluate(cases, methods, mocks, counts):
            seen.append((cases, methods, mocks, counts))
            told = {"criterion": "bic", "advised": 4, "best": 3, "cost": 0.2, "least": 0.1}
            return [suggestions.Suggested(seed=7, beam="degraded", noise=1.0, method="pca", **told)]

        monkeypatch.setattr(suggestions, "evaluate", evaluate)
        return himap_command, seen

    def test_table_and_file(self, command):
        himap_command, seen = command
        code, out, err = himap_command("record", "suggestions", "--preset", "ci", "-p", "noises=[1, 3]")
        assert (code, err) == (0, "")
        ((cases, methods, mocks, counts),) = seen
        assert len(cases) == 5 * 3 * 2 and methods == ["pca", "beam_subspace"]
        assert len(mocks) == 2 and list(counts) == list(range(1, 9))
        assert not {mock.seed for mock in mocks} & {case.survey.seed for case in cases}
        assert re.search(r"^pca +information criterion \(BIC\) +0 +1 +0 +0 +0 +0 +0.200 +0.100$", out, re.M)
        (path,) = Path("results").iterdir()
        rows, about = read_record(suggestions.Suggested, path)
        assert len(rows) == 1 and about["code"] == suggestions_code()

    @pytest.mark.parametrize(
        ("option", "message"),
        [
            ("n_sources_max=1", "n_sources_max"),
            ("n_mocks=0", "n_mocks"),
            ("noises=[3]", "1 first"),
            ('beams=["square"]', "unknown beam"),
        ],
    )
    def test_bad_input_before_any_work(self, command, option, message):
        himap_command, seen = command
        code, _, err = himap_command("record", "suggestions", "--preset", "ci", "-p", option)
        assert code == 2 and message in err and not seen
        assert not list(Path().iterdir())
