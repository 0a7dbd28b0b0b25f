"""`himap measure`: records written, checked and grown on many skies, with nothing computed."""

import json
import re
from dataclasses import replace
from pathlib import Path

import pytest
from ledgers import finding

from himap.app.cli import measure
from himap.app.stored import RESULTS
from himap.core.survey import PRESETS
from himap.paper.claims import FAILED, IN_PART, REPRODUCED
from himap.paper.claims.entries import finding_rows
from himap.paper.experiments import EXPERIMENTS, authors, find_experiment, measuring_code, transfer
from himap.paper.record import Experiment, Record

CLAIMS = ("measure", "claims", "--preset", "ci")


@pytest.fixture
def seen(monkeypatch):
    """The skies of each table that was asked for; the real parameters of the chapters, nothing measured.

    Every sky has two claims: D1, which holds for two methods on even seeds and for one on odd ones, and N1,
    which holds for none.
    """
    tables = []

    def table(self, skies):
        tables.append(skies)
        rows = []
        for sky in skies:
            found = {"D1": finding((REPRODUCED, IN_PART)[sky.survey.seed % 2]), "N1": finding(FAILED)}
            for restart in {one.restart for one in sky.members}:
                rows += [{"seed": sky.survey.seed} | row for row in finding_rows(found, restart)]
        return self.frame(rows)

    monkeypatch.setattr(Experiment, "table", table)
    return tables


def stored(path):
    return Record.load(find_experiment("claims"), path)


@pytest.mark.parametrize("name", EXPERIMENTS)
def test_every_experiment_ends_with_a_table(name, monkeypatch):
    """That of what the book has stored of it: names of columns differ, and rows fit the terminal."""
    monkeypatch.setenv("COLUMNS", "180")
    paths = [
        path for path in RESULTS.glob("*.json") if json.loads(path.read_text()).get("experiment") == name
    ]
    assert paths
    experiment = find_experiment(name)
    for path in paths:
        summary = experiment.summary(Record.load(experiment, path).rows)
        assert summary.columns.is_unique
        lines = str(measure._table(summary, "a note")).splitlines()
        assert lines[-1] == "a note" and len(lines) > 2 and max(map(len, lines)) <= 180


@pytest.mark.parametrize("name", EXPERIMENTS)
def test_skies_take_the_parameters_of_the_chapter(name):
    """But for those that say where the chapter finds stored results."""
    experiment = find_experiment(name)
    chosen, _ = measure._parameters(experiment, ["n_realisations=1"], "ci", {})
    (sky,) = experiment.skies(**chosen)
    assert sky.survey.nside == 32 and sky.galaxy.digest() == ""


class TestWrite:
    def test_table_and_file(self, himap_command, seen, monkeypatch):
        monkeypatch.setenv("COLUMNS", "1000")
        code, out, err = himap_command(*CLAIMS, "-p", "n_realisations=2", "-p", "seed=7")
        assert (code, err) == (0, "")
        assert [sky.survey.seed for sky in seen[0]] == [7, 8]
        assert re.search(r"^D1 +degraded +undecided +PCA/ICA a 100%; SD a 50% \(0% to 100%\)", out, re.M)
        assert "1 undecided, 1 not reproduced" in out
        assert "Too coarse to judge: D1, E1, E2, O1, O3," in out and "end at l = 64 and not at 200" in out
        path = Path("results/claims_ci_n_realisations=2_seed=7.json")
        assert f"{path}  (" in out
        record = stored(path)
        assert record.seeds == [7, 8] and record.about["code"] == measuring_code("claims")
        assert record.made.preset == "ci" and dict(record.about["overrides"])["n_realisations"] == 2
        code, out, _ = himap_command(*CLAIMS[:-1], "laptop", "-p", "n_realisations=2", "-p", "nside=128")
        assert code == 0 and "Too coarse" not in out
        code, out, _ = himap_command(*CLAIMS, "-p", "box_cells=1024")
        assert code == 0 and "Too coarse to judge: D1," in out and "B1 to B3" not in out
        code, out, _ = himap_command(*CLAIMS[:-1], "laptop", "-p", "box_cells=128")
        assert code == 0 and "Too coarse to judge: B1 to B3" in out and " Mpc/h wide and not 1.5" in out

    def test_rows_fit_the_terminal(self, himap_command, seen, monkeypatch):
        lines = {}
        for width in (100, 150, 1000):
            monkeypatch.setenv("COLUMNS", str(width))
            out = himap_command(*CLAIMS, "-o", f"{width}.json")[1]
            lines[width] = out.partition("In brackets: the 1σ interval")[0].splitlines()
            assert "In brackets: the 1σ interval of a share" in out
        assert max(map(len, lines[100])) <= 100 < max(map(len, lines[150])) <= 150
        words = {width: sorted(" ".join(several).split()) for width, several in lines.items()}
        assert words[100] == words[150] == words[1000] and len(lines[1000]) == 4

    def test_five_skies_by_default(self, himap_command, seen):
        assert himap_command(*CLAIMS, "-o", "a.json")[0] == 0
        assert len(seen[0]) == 5 and ["n_restarts", 2] in stored("a.json").about["overrides"]
        assert himap_command(*CLAIMS, "-p", "n_restarts=1", "-o", "b.json")[0] == 0
        assert {len(several) for sky in seen[1] for several in sky.realisations.values()} == {1}
        assert ["n_restarts", 1] in stored("b.json").about["overrides"]

    @pytest.mark.parametrize("name", EXPERIMENTS)
    def test_what_exists_is_not_lost(self, himap_command, name):
        for file, option in (("mine.json", ["-o", "mine.json"]), (f"results/{name}_ci.json", [])):
            Path(file).parent.mkdir(exist_ok=True)
            Path(file).write_text("hours of work")
            code, _, err = himap_command("measure", name, "--preset", "ci", *option)
            assert code == 2 and f"{file} exists; choose another output, or give --overwrite" in err
            assert Path(file).read_text() == "hours of work"
        code, _, err = himap_command("measure", name, "--preset", "ci", "-o", "")
        assert code == 2 and "must be a file name ending in .json, got" in err


THE_SAME = "are the same with today's code"
NOT_COMPARED = "of single runs of a chaotic method are not compared"


class TestCheckAndGrow:
    @pytest.fixture
    def written(self, himap_command, seen):
        """The command, and a record of two skies in a.json."""
        assert himap_command(*CLAIMS, "-p", "n_realisations=2", "-o", "a.json")[0] == 0
        return himap_command

    def test_one_sky_again(self, written, seen):
        code, out, err = written(*CLAIMS, "--check", "a.json", "-p", "plane_weight=0.1")  # its default
        assert (code, err) == (0, "") and len(seen[-1]) == 1
        assert out == f"a.json: 4 rows of one sky {THE_SAME}; 4 {NOT_COMPARED}.\n"
        record = stored("a.json")
        assert len(record.seeds) == 2 and record.about["checked"]["code"] == measuring_code("claims")

    def test_with_the_parameters_of_the_record(self, himap_command, seen):
        options = ("-p", "n_realisations=2", "-p", "seed=7", "-p", "plane_weight=0.2", "-p", "box_cells=64")
        assert himap_command(*CLAIMS, *options, "-o", "a.json")[0] == 0
        assert himap_command("measure", "claims", "--check", "a.json")[::2] == (0, "")
        grow = ("measure", "claims", "--grow", "a.json", "-p", "n_realisations=3")
        assert himap_command(*grow)[::2] == (0, "")
        made, checked, grown = (tables[0] for tables in seen)
        assert checked == made
        assert grown.survey == replace(made.survey, seed=9)

    def test_what_a_chaotic_method_gave_once_is_not_compared(self, himap_command, monkeypatch):
        ratios = iter([1.0, 2.0])
        curve = {"beam": "evolving", "n_sources": 3, "corrected": False, "kind": "angular", "low": 2}
        curve |= {"high": 9, "step": 1.0}

        def table(self, skies):
            both = {"pca": 1.0, "sdecgmca": next(ratios)}
            rows = [curve | {"method": method, "ratio": ratio} for method, ratio in both.items()]
            return self.frame([{"seed": skies[0].survey.seed} | row for row in rows])

        monkeypatch.setattr(Experiment, "table", table)
        command = ("measure", "methods", "-p", "n_realisations=1")
        assert himap_command(*command, "-o", "a.json")[0] == 0
        code, out, err = himap_command(*command, "--check", "a.json")
        assert (code, err) == (0, "")
        assert out == f"a.json: 1 rows of one sky {THE_SAME}; 1 {NOT_COMPARED}.\n"

    def test_what_a_chaotic_run_made_of_claims_is_not_compared(self, himap_command, monkeypatch):
        """But what other methods made of them, and what replaces that method."""
        content, tables = json.loads((RESULTS / "claims_laptop_run.json").read_text()), []
        rows = Record.load(find_experiment("claims"), RESULTS / "claims_laptop_run.json").rows
        rows = rows[rows["seed"] == content["about"]["seed"]]
        cases = ("sdecgmca", "SD", 0), ("sdecgmca", "GMCA", 2), ("beam_subspace", "SD", 2)
        for method, changed, code in cases:
            tables[:] = [rows, rows.assign(value=rows["value"].where(rows["method"] != changed, 7.0))]
            monkeypatch.setattr(Experiment, "table", lambda self, skies: tables.pop(0))
            options = ("-p", f"method={method}", "-p", "n_realisations=1", "-p", "n_restarts=1")
            assert himap_command(*CLAIMS, *options, "-o", "a.json", "--overwrite")[0] == 0
            assert himap_command(*CLAIMS, "--check", "a.json")[0] == code

    @pytest.mark.parametrize(
        ("option", "n_restarts", "message"),
        [
            ("--check", 1, "a.json has only single runs of chaotic methods: measure all of it again"),
            ("--grow", 2, "has 1 restarts of every sky: give n_restarts=1."),
        ],
    )
    def test_a_record_of_single_runs(self, himap_command, monkeypatch, option, n_restarts, message):
        """Is refused before the work; and one more restart, where none is measured by itself."""
        row = {"seed": 2025, "restart": 0, "quantity": "change", "x": 150.0, "value": 0.1}
        tables = iter([authors.EXPERIMENT.frame([row])])
        monkeypatch.setattr(Experiment, "table", lambda self, skies: next(tables))
        assert himap_command("measure", "authors", "-p", "n_restarts=1", "-o", "a.json")[0] == 0
        code, _, err = himap_command("measure", "authors", option, "a.json", "-p", f"n_restarts={n_restarts}")
        assert code == 2 and message in err

    def test_only_the_skies_that_are_missing(self, written, seen):
        before = stored("a.json")
        code, out, err = written(*CLAIMS, "--grow", "a.json", "-p", "n_realisations=4")
        assert (code, err) == (0, "") and "SD a 50%" in out
        first = before.seeds[0]
        assert [[sky.survey.seed for sky in skies] for skies in seen[1:]] == [[first + 2], [first + 3]]
        record = stored("a.json")
        assert record.seeds == list(range(first, first + 4))
        assert record.about["grown"] == [before.about["commit"]]
        assert dict(record.about["overrides"])["n_realisations"] == 4
        assert written(*CLAIMS, "--grow", "a.json", "-p", "n_realisations=4")[0] == 0 and len(seen) == 3

    def test_only_the_restarts_that_are_missing(self, written, seen):
        grow = (*CLAIMS, "--grow", "a.json", "-p", "n_realisations=3", "-p", "n_restarts=4")
        assert written(*grow)[::2] == (0, "")
        first, *_ = stored("a.json").seeds
        measured = [(sky.survey.seed, [one.restart for one in sky.members]) for [sky] in seen[1:]]
        assert measured == [(first, [2, 3]), (first + 1, [2, 3]), (first + 2, [0, 1, 2, 3])]
        record = stored("a.json")
        assert dict(record.about["overrides"])["n_restarts"] == 4
        assert (record.rows.groupby("seed")["restart"].nunique() == 4).all()
        assert written(*grow)[0] == 0 and len(seen) == 4
        assert written(*CLAIMS, "--check", "a.json")[::2] == (0, "")  # the order of rows is another

    def test_the_restarts_that_it_states_are_those_of_every_sky(self, written, seen):
        """Not of the few that have more, as where growing was interrupted, of which all can be checked."""
        one_sky = (*CLAIMS, "--grow", "a.json", "-p", "n_realisations=1", "-p", "n_restarts=4")
        assert written(*one_sky)[0] == 0
        assert dict(stored("a.json").about["overrides"])["n_restarts"] == 2
        for n in (2, 4):
            assert written(*CLAIMS, "--check", "a.json", "-p", f"n_restarts={n}")[::2] == (0, "")
        n_measured = len(seen)
        code, _, err = written(*CLAIMS, "--check", "a.json", "-p", "n_restarts=5")
        assert code == 2 and "has 4 restarts of that sky: give n_restarts=4 or fewer" in err
        assert len(seen) == n_measured  # refused before the work
        assert written(*CLAIMS, "-p", "method=beam_subspace", "-o", "b.json")[0] == 0
        assert dict(stored("b.json").about["overrides"])["n_restarts"] == 1  # that method has none

    @pytest.mark.parametrize("changed", ["a default", "a beam"])
    def test_what_no_parameter_says_is_refused_too(self, himap_command, monkeypatch, changed):
        """Other defaults of himap, or another beam in the file that was given."""
        row = {"method": "pca", "n_sources": 3, "band": "C/C0, 2-4", "uncorrected": 1.0, "corrected": 1.0}
        row |= {"seed": 2025, "error_bar": 0.1, "foreground": 0.0}

        def table(self, skies):
            return self.frame([row | {"seed": sky.survey.seed} for sky in skies])

        monkeypatch.setattr(Experiment, "table", table)
        Path("beam.txt").write_text("1.0\n" * PRESETS["ci"].n_channels)
        given = ("-p", "beam=beam.txt", "--preset", "ci")
        written = himap_command("measure", "transfer", *given, "-p", "n_realisations=1", "-o", "a.json")
        assert written[::2] == (0, "")
        before = Path("a.json").read_text()
        if changed == "a beam":
            Path("beam.txt").write_text("1.1\n" * PRESETS["ci"].n_channels)
        else:
            monkeypatch.setitem(transfer.EXPERIMENT.defaults, "methods", [["pca", 4]])
        code, _, err = himap_command("measure", "transfer", "--grow", "a.json", "-p", "n_realisations=2")
        assert code == 2 and "other parameters (defaults, or files it reads)" in err
        assert Path("a.json").read_text() == before

    def test_what_is_measured_stays(self, written, monkeypatch):
        table = Experiment.table

        def interrupted(self, skies):
            if skies[0].survey.seed % 2:  # the first of the missing ones is 2027
                return table(self, skies)
            raise KeyboardInterrupt

        monkeypatch.setattr(Experiment, "table", interrupted)
        assert written(*CLAIMS, "-p", "n_realisations=4", "--grow", "a.json")[0] != 0
        record = stored("a.json")
        assert len(record.seeds) == 3 and dict(record.about["overrides"])["n_realisations"] == 3

    @pytest.mark.parametrize("option", ["--check", "--grow"])
    def test_what_another_command_adds_meanwhile_stays(self, written, monkeypatch, option):
        table = Experiment.table

        def beside(self, skies):
            monkeypatch.setattr(Experiment, "table", table)
            assert written(*CLAIMS, "--grow", "a.json", "-p", "n_realisations=3")[0] == 0
            return table(self, skies)

        monkeypatch.setattr(Experiment, "table", beside)
        more = ["-p", "n_realisations=3"] if option == "--grow" else []
        code, _, err = written(*CLAIMS, option, "a.json", *more)
        assert len(stored("a.json").seeds) == 3 and not stored("a.json").rows.duplicated().any()
        refused = code == 2 and "grown by another command meanwhile: run this one again" in err
        assert refused == (option == "--grow") and (refused or code == 0)

    @pytest.mark.parametrize(
        ("options", "message"),
        [
            (["--grow", "a.json", "-p", "plane_weight=0.2"], "other parameters (plane_weight)"),
            (["--grow", "a.json", "-p", "seed=7"], "other parameters (seed)"),
            (["--grow", "a.json", "-p", "n_restarts=1"], "give n_restarts=2 or more"),
            (["--check", "a.json", "-p", "seed=7"], "other parameters (seed)"),
            (["--check", "a.json", "--preset", "quick"], "other parameters (preset)"),
            (["--check", "a.json"], "other parameters (galaxy_files)"),
            (["--grow", "a.json", "-p", "n_realisations=3"], "other parameters (galaxy_files)"),
        ],
    )
    def test_refused_before_any_work(self, written, seen, options, message):
        """A record names no folder of templates, so another may be given, but with the same files."""
        content = json.loads(Path("a.json").read_text())
        assert content["about"]["galaxy_files"] == ""
        content["about"]["galaxy_files"] = "of other files" if "galaxy_files" in message else ""
        Path("a.json").write_text(before := json.dumps(content))
        seen.clear()
        code, _, err = written(*CLAIMS, *options)
        assert code == 2 and message in err
        assert Path("a.json").read_text() == before and not seen

    def test_a_record_of_other_code_grows_once_it_was_checked(self, written):
        content = json.loads(Path("a.json").read_text())
        content["about"]["code"] = {"code": "0" * 64}
        Path("a.json").write_text(json.dumps(content))
        grow = (*CLAIMS, "--grow", "a.json", "-p", "n_realisations=3")
        code, _, err = written(*grow)
        assert code == 2 and "was made by other code; see with --check" in err
        assert written(*CLAIMS, "--check", "a.json")[0] == 0
        assert written(*grow)[0] == 0 and len(stored("a.json").seeds) == 3
