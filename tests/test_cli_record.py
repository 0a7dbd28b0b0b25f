"""`himap record`: what is measured on many skies beyond the paper, with nothing computed."""

import json
import re
from pathlib import Path

import pytest

import himap
from himap.companion import notebooks
from himap.companion.staleness import (
    beam_errors_code,
    corrections_code,
    side_by_side_code,
    suggestions_code,
)
from himap.paper import beam_errors, corrections, side_by_side, suggestions
from himap.paper.record_file import read_record


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
        assert re.search(r"^PCA 5 +C/C0, 2-4 +0.9000 +1.0000 +1.0000 +0.0000 +0.1000 +2 of 2$", out, re.M)
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


class TestGrow:
    @pytest.fixture
    def command(self, himap_command, monkeypatch):
        """The command with corrections not computed, two skies of them recorded in a.json."""
        monkeypatch.setattr(notebooks, "_PACKAGE", Path(himap.__file__).parent)
        seen = []

        def evaluate(cases, removers, mocks):
            seen.append(([case.survey.seed for case in cases], mocks))
            row = {"method": "pca", "n_sources": 5, "band": "C/C0, 2-4", "raw": 0.9, "corrected": 1.0}
            return [corrections.Correction(seed=n, by_auto=1.0, sigma=0.1, **row) for n in seen[-1][0]]

        monkeypatch.setattr(corrections, "evaluate", evaluate)
        assert himap_command(*self.COMMAND, "-p", "n_realisations=2", "-o", "a.json")[0] == 0
        return himap_command, seen

    COMMAND = ("record", "corrections", "--preset", "ci")

    def test_only_the_skies_that_are_not_there(self, command):
        himap_command, seen = command
        before, told = read_record(corrections.Correction, "a.json")
        grow = (*self.COMMAND, "--grow", "a.json")
        code, out, err = himap_command(*grow, "-p", "n_realisations=4")
        assert (code, err) == (0, "") and "4 of 4" in out
        (first, mocks), *more = seen
        assert [seeds for seeds, _ in more] == [[first[1] + 1], [first[1] + 2]]
        assert all(one == mocks for _, one in more)
        rows, about = read_record(corrections.Correction, "a.json")
        assert rows[:2] == before and [row.seed for row in rows] == list(range(first[0], first[0] + 4))
        assert about["code"] == told["code"] and about["seconds"] > told["seconds"]
        assert dict(about["overrides"]) == dict(told["overrides"]) | {"n_realisations": 4}
        assert about["grown"] == [told["commit"]]
        assert himap_command(*grow, "-p", "n_realisations=4")[0] == 0 and len(seen) == 3  # nothing is left

    def test_what_is_measured_stays(self, command, monkeypatch):
        himap_command, _ = command
        evaluate = corrections.evaluate

        def fails(cases, *others):
            if cases[0].survey.seed % 2:  # the first of those that are not there is 2027
                return evaluate(cases, *others)
            raise KeyboardInterrupt

        monkeypatch.setattr(corrections, "evaluate", fails)
        assert himap_command(*self.COMMAND, "-p", "n_realisations=4", "--grow", "a.json")[0] != 0
        rows, about = read_record(corrections.Correction, "a.json")
        assert len(rows) == 3 and dict(about["overrides"])["n_realisations"] == 3

    @pytest.mark.parametrize(
        ("options", "message"),
        [
            (["-p", "n_mocks=3"], r"other parameters (n_mocks)"),
            (["-p", 'methods=[["pca", 4]]'], "other parameters (methods)"),
            (["-p", "seed=7"], "other parameters (seed)"),
            (["-o", "b.json"], "leave -o out"),
            (["--check", "a.json"], "--check and --grow are two things"),
        ],
    )
    def test_refused(self, command, options, message):
        himap_command, seen = command
        before = Path("a.json").read_text()
        code, _, err = himap_command(*self.COMMAND, "--grow", "a.json", *options)
        assert code == 2 and message in err and len(seen) == 1
        assert Path("a.json").read_text() == before

    def test_a_parameter_of_the_record_must_be_given_again(self, command):
        himap_command, seen = command
        chosen = ("-p", 'methods=[["pca", 4]]', "-p", "n_realisations=2")
        assert himap_command(*self.COMMAND, *chosen, "-o", "b.json")[0] == 0
        code, _, err = himap_command(*self.COMMAND, "--grow", "b.json", "-p", "n_realisations=3")
        assert code == 2 and "other parameters (methods)" in err and len(seen) == 2

    def test_other_code_is_checked_first(self, command):
        himap_command, seen = command
        content = json.loads(Path("a.json").read_text())
        content["about"]["code"] |= {"code": "0" * 16}
        Path("a.json").write_text(json.dumps(content))
        grow = (*self.COMMAND, "--grow", "a.json", "-p", "n_realisations=3")
        code, _, err = himap_command(*grow)
        assert code == 2 and "was made by other code; see with --check" in err and len(seen) == 1
        assert himap_command(*self.COMMAND, "-p", "n_realisations=2", "--check", "a.json")[0] == 0
        assert himap_command(*grow)[0] == 0
        rows, about = read_record(corrections.Correction, "a.json")
        assert len(rows) == 3 and about["code"]["code"] == "0" * 16
        assert about["checked"]["code"] == corrections_code()


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
        assert re.search(r"^PCA +information criterion \(BIC\) +0 +1 +0 +0 +0 +0 +0.200 +0.100$", out, re.M)
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


class TestSideBySide:
    @pytest.fixture
    def command(self, himap_command, monkeypatch):
        """The command with the real parameters of 25_side_by_side, and nothing cleaned."""
        monkeypatch.setattr(notebooks, "_PACKAGE", Path(himap.__file__).parent)
        seen = []

        def evaluate(skies, mocks, corrected):
            seen.append((skies, mocks, corrected))
            curve = {"kind": "angular", "step": 1.0, "edges": [2, 5], "ratio": [0.9]}
            case = next(iter(skies[0]))
            told = {"beam": "degraded", "method": "pca", "n_sources": 3, "corrected": False}
            return [side_by_side.Curve(seed=case.survey.seed, **told, **curve)]

        monkeypatch.setattr(side_by_side, "evaluate", evaluate)
        return himap_command, seen

    def test_table_and_file(self, command):
        himap_command, seen = command
        code, out, err = himap_command("record", "side-by-side", "--preset", "ci", "-p", "n_realisations=2")
        assert (code, err) == (0, "")
        ((skies, mocks, corrected),) = seen
        assert [[case.beam.name for case in sky] for sky in skies] == [
            ["degraded", "evolving", "oscillating"]
        ] * 2
        numbers = [[getattr(one, "n_sources", None) for one in removers] for removers in skies[0].values()]
        assert numbers == [[3, 3, 3, 4, None], [4, 4, 5, 3, 4, None], [5, 5, 6, 3, 4, None]]
        assert corrected == ["pca", "beam_subspace", "smooth_spectra"] and len(mocks) == 3
        assert not {mock.seed for mock in mocks} & {case.survey.seed for sky in skies for case in sky}
        assert re.search(r"^degraded +pca 3 +as left +C/C0, 2-4 +0.9000 +nan$", out, re.M)
        (path,) = Path("results").iterdir()
        rows, about = read_record(side_by_side.Curve, path)
        assert len(rows) == 1 and about["code"] == side_by_side_code()
        assert {("n_realisations", 2), ("n_mocks", 3)} <= set(map(tuple, about["overrides"]))
        assert himap_command("record", "side-by-side", "--preset", "ci", "--check", str(path))[0] == 0

    @pytest.mark.parametrize(
        ("option", "message"),
        [
            ("n_mocks=0", "n_mocks"),
            ("beams=[]", "each once"),
            ('methods=[["pca", [3]]]', "numbers of sources for 3 beams"),
            ("results=null", "unknown parameter results"),
        ],
    )
    def test_bad_input_before_any_work(self, command, option, message):
        himap_command, seen = command
        code, _, err = himap_command("record", "side-by-side", "--preset", "ci", "-p", option)
        assert code == 2 and message in err and not seen
        assert not list(Path().iterdir())
