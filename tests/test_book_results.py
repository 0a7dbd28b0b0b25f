"""The chapters of what was measured once say what the files in book/results say, and draw their curves."""

import json
import re
import subprocess
from dataclasses import replace

import nbformat
import numpy as np
import pytest
from conftest import ROOT
from ledgers import ABOUT, entry, finding
from PIL import Image

from benchmarks.whole import COMMANDS
from himap.app.notebooks import find
from himap.app.stored import LEDGER, RESULTS, extrapolated, other_records, read_ledger, read_stored
from himap.app.stored_tables import (
    angular_ratios,
    choices_table,
    endurance_table,
    ledgers_table,
    picture,
    pictures,
    steps_table,
    stored_curves,
    verdicts_table,
)
from himap.core.errors import InputError
from himap.core.memory import estimate
from himap.core.survey import PRESETS
from himap.paper.claims import CLAIMS, FAILED, IN_PART, INAPPLICABLE, REPRODUCED
from himap.paper.claims.entries import finding_rows
from himap.paper.experiments import find_experiment
from himap.paper.readings import outcomes as outcomes_of
from himap.paper.realisation import Realisation
from himap.paper.record import Record

PAPER = {*"1234567", "A.1", "A.2", "B.1", "B.2", "B.3"}  # its figures
LARGER = {"nside": 512, "n_channels": 4000, "box_cells": 2048}


def tables(text):
    """[[[text of a cell]]] of the tables in Markdown."""
    found = []
    for block in re.findall(r"(?:^\|.*\|$\n?)+", text, re.M):
        head, _, *rows = [re.split(r"(?<!\\)\|", line)[1:-1] for line in block.splitlines()]
        found.append([[cell.strip() for cell in line] for line in (head, *rows)])
    return found


def number(cell):
    """The number that a cell begins with; no number is written with an exponent."""
    return float(re.match(r"[\d.,]+(?=\s|$)", cell.strip("*"))[0].replace(",", ""))


def markdown(name):
    """What the executed notebook shows as Markdown."""
    cells = nbformat.read(ROOT / "notebooks" / f"{name}.ipynb", as_version=4).cells
    bundles = [output.get("data", {}) for cell in cells for output in cell.get("outputs", [])]
    return "\n\n".join(data["text/markdown"] for data in bundles if "text/markdown" in data)


def shown_at_paper_size():
    """Names of what the chapter shows: the ledgers, the one of a smoothed box, the folders of figures."""
    chosen = {parameter.name: parameter.default for parameter in find("18_paper_size").parameters}
    ledgers = [chosen["smaller"], chosen["ensemble"], f"claims_{chosen['real']}"]
    return ledgers, chosen["smoothed"], [chosen["real"], chosen["synthetic"]]


def test_the_chapters_show_what_is_stored_today():
    names, with_smoothing, folders = shown_at_paper_size()
    *ledgers, smoother = (read_ledger(RESULTS / f"{name}.json") for name in (*names, with_smoothing))
    shown, others = markdown("18_paper_size"), other_records(ledgers[0][1])
    sides = ledgers_table(ledgers, others=others)
    of_the_box = ("F1", "E2", "E3", "D3", "B1", "B2", "B3")
    smoothed = ledgers_table([*ledgers[1:], smoother], lambda several: several[0].claim.id in of_the_box)
    for expected in (verdicts_table(ledgers[:2]), sides, smoothed, pictures(folders)):
        assert expected in shown
    experiment, apart = find_experiment("claims"), ("claims_laptop_beam_subspace", "claims_laptop_run")
    paths = [path for path in sorted(RESULTS.glob("claims_laptop_*.json")) if path.stem not in apart]
    run, *others = (Record.load(experiment, path) for path in (RESULTS / f"{apart[1]}.json", LEDGER, *paths))
    assert choices_table(run, others) in markdown("15_claims")
    shown = markdown("19_scale")
    assert all(steps_table(read_stored(name)) in shown for name in ("steps_paper", "steps_laptop"))


@pytest.mark.parametrize("name", ["steps_paper", "steps_laptop"])
def test_every_step_has_a_row(name):
    """What misses its goal is bold."""
    found = read_stored(name)
    ((head, *rows),) = tables(steps_table(found))
    assert len(rows) == len(found["steps"]) == 12
    assert ("Goal" in head) == (name == "steps_paper")
    for row, step in zip(rows, found["steps"], strict=True):
        # Of two goals, the first, that of time, is kept.
        cells = dict(zip(reversed(head), reversed(row), strict=True))
        assert row[0] == step["step"]
        assert number(cells["Time"]) == pytest.approx(step["seconds"], rel=0.006)
        assert number(cells["Memory"]) == pytest.approx(step["memory_gb"], abs=0.05)
        assert number(cells["Floor"]) == pytest.approx(step["floor_seconds"], rel=0.06)
        assert number(cells["Over it"]) == pytest.approx(step["seconds"] / step["floor_seconds"], rel=0.06)
        assert bool(cells["Alternative"]) == ("alternative" in step)
        if "alternative" in step:
            times = step["alternative"]["seconds"] / step["seconds"]
            assert number(cells["Alternative"]) == pytest.approx(times, rel=0.06)
        if "Goal" in cells:
            assert number(cells["Goal"]) == step["goal_seconds"]
            assert ("**" in cells["Time"]) == (step["seconds"] > step["goal_seconds"])
            assert ("**" in cells["Memory"]) == (step["memory_gb"] > step["goal_gb"])


def test_the_whole_paper_is_as_it_was_timed():
    found = read_stored("whole_paper")
    head, *rows, (_, time, memory) = tables(markdown("19_scale"))[1]
    assert head == ["Part", "Time", "Memory"]
    assert [row[0] for row in rows] == list(COMMANDS) == [one["step"] for one in found["commands"]]
    assert number(time) == pytest.approx(sum(one["seconds"] for one in found["commands"]) / 60, rel=0.02)
    assert number(memory) == max(number(row[2]) for row in rows)


def test_what_disturbances_led_to():
    counts = {"kills": 34, "finished": 9, "reruns_that_failed": 0, "other_results": 0, "left_in_the_cache": 0}
    disk = {"full_disks": 4, "finished": 4}
    disk |= {"told_in_a_sentence": 3, "processes_left": 2}
    about = read_stored("scaling")["about"]
    text = endurance_table({"about": about, "found": {"run_killed": counts, "full_disk_clean": disk}})
    _, killed, full = tables(text)[0]
    assert killed[1:] == ["34", "0", "0", "0"]
    assert full[1:] == ["4", "**1**", "0", "**2**"]


def test_exponents_are_those_of_the_figure():
    _, *rows = tables(markdown("19_scale"))[3]
    found = read_stored("scaling")["found"]
    assert len(rows) == 12
    for name, *exponents in rows:
        assert exponents == [f"{found[way][name]['exponent']:.2f}" for way in ("nside", "n_channels")]


def test_a_larger_survey_costs_what_the_exponents_say():
    """nside 512, 4000 channels: once more what lay between laptop and paper, then four times the channels.

    Twice the pixels make nothing faster, not even what a method does up to some l alone.
    """
    laptop, paper, scaling = map(read_stored, ("steps_laptop", "steps_paper", "scaling"))
    rows = extrapolated(laptop, paper, scaling, n_realisations=100, **LARGER)
    memory = estimate(replace(PRESETS["paper"], **LARGER))
    hours = 0
    pairs = zip(laptop["steps"], paper["steps"], strict=True)
    used = [pair for pair in pairs if pair[0]["step"] != "BeamSubspace"]  # no method of Figs. 1 and 2
    for row, (before, after) in zip(rows, used, strict=True):
        with_channels = 2 ** scaling["found"]["n_channels"][row["step"]]["exponent"]
        growth = max(after["seconds"] / before["seconds"], with_channels)
        once = after["seconds"] * growth * with_channels**2
        hours += 2 * 100 * row["times"] * once / 3600
        assert row["minutes"] == pytest.approx(once / 60)
        assert row["gigabytes"] * 1e9 in memory.values() and row["gigabytes"] > 100  # a cube has 50
    times = {row["step"]: row["times"] for row in rows}
    assert times.pop("HI light cone") == times.pop("observations, three beams") == 1
    assert times.pop("all measures") == 18 and "BeamSubspace" not in times and set(times.values()) == {3}
    assert sum(row["core_hours"] for row in rows) == pytest.approx(hours)
    _, *shown, (*_, total, _) = tables(markdown("19_scale"))[-1]
    assert number(total) == pytest.approx(hours, abs=1)
    for cells, row in zip(shown, rows, strict=True):
        assert cells[0] == row["step"] and int(cells[2]) == row["times"]
        assert number(cells[1]) == pytest.approx(row["minutes"], rel=0.06)


def test_all_that_is_stored_is_shown():
    others = {path.stem for path in RESULTS.glob("claims_laptop_*.json")}  # chapter 15 shows these
    choices = "run", "ratios", "middle", "hann", "logarithm", "contrast"
    assert others <= {f"claims_laptop_{place}" for place in ("letter", "code", "beam_subspace", *choices)}
    ledgers = [*RESULTS.glob("claims_*.json"), *RESULTS.glob("restarts_paper_*.json")]
    others |= {"restarts_paper_code_rounding"}  # chapter 27 has its failures
    names, with_smoothing, folders = shown_at_paper_size()
    assert {*names, with_smoothing} | others == {path.stem for path in ledgers}
    assert set(folders) == {path.parent.name for path in RESULTS.glob("*/figures.json")}


def ledger_of(verdict, *, overrides=()):
    """A ledger (entries, about) of three claims; D1 has `verdict`."""
    entries = [
        entry(verdict, values=[0.25]),
        entry(REPRODUCED, id="O3"),
        entry(INAPPLICABLE, id="M2", values=[None]),
    ]
    return entries, ABOUT | {"overrides": [list(one) for one in overrides]}


def test_ledgers_stand_side_by_side():
    columns = [ledger_of(FAILED), ledger_of(REPRODUCED, overrides=[("reading", "letter")])]
    ((head, *rows, last),) = tables(ledgers_table(columns))
    assert head[3:] == ["ci, 1 sky, one run", "ci, letter, 1 sky, one run"]
    smoothed = ledger_of(REPRODUCED, overrides=[("r_smooth", 2.0), ("box_cells", 64)])
    title = "ci, HI box of 64³ cells, HI smoothed by 2 Mpc/h, 1 sky, one run"
    assert title in ledgers_table([columns[0], smoothed])
    named = ledgers_table([ledger_of(FAILED, overrides=[("reading", "default")])])
    assert tables(named)[0][0][3:] == ["ci, 1 sky, one run"]  # as records of restarts state it
    assert [row[0].strip("*") for row in rows] == ["D1", "O3", "M2"]
    failed = "one run, ✗ 0.25<br>holds in: PCA/ICA a 0% (0% to 50%); SD a 0% (0% to 50%)"
    assert rows[0][3:] == [failed, "one run, ✓ 0.25"] and rows[2][3:] == 2 * ["– does not apply"]
    assert last[3:] == ["one run", "one run"]  # draws are not counted
    ((_, *rows),) = tables(ledgers_table(columns, lambda judged: judged[0].claim.id == "O3"))
    assert [row[0].strip("*") for row in rows] == ["O3"]
    older = columns[1][0][:1], columns[1][1]  # it may lack a claim
    ((_, *rows, _),) = tables(ledgers_table([columns[0], older]))
    assert [row[4] for row in rows] == ["one run, ✓ 0.25", "not judged", "not judged"]
    ((_, *rows),) = tables(verdicts_table(columns))
    assert {row[1] for row in rows} == {"1 sky, one run"}
    assert [row[2:] for row in rows] == [["1", "0", "0", "1", "1"], ["2", "0", "0", "0", "1"]]
    parts = [entry(IN_PART, IN_PART), entry(*[REPRODUCED] * 9, FAILED, id="O3")]
    ((_, *rows, last),) = tables(ledgers_table([(parts, columns[0][1])]))
    assert [row[3].partition("<br>")[2] for row in rows] == ["holds in: SD a 0%", ""]
    assert last[3] == "✓ 1 · ≈ 1"


def test_choices_that_change_a_verdict():
    """Each record is compared with the ledger on the skies that both have."""
    experiment = find_experiment("claims")

    def frame(*verdicts):
        """Of claim D1 on the seeds 1, 2, ..."""
        rows = []
        for seed, verdict in enumerate(verdicts, 1):
            found = finding_rows({"D1": finding(verdict), "O3": finding(FAILED)}, 0)
            rows += [{"seed": seed} | row for row in found]
        return experiment.frame(rows)

    ledger = Record(experiment=experiment, rows=frame(REPRODUCED, FAILED), about=ABOUT)
    first, other = frame(REPRODUCED), frame(IN_PART)
    choices = (first, ["polynomial", "logarithm"]), (other, ["taper", "hann"]), (other, ["average", "means"])
    records = [replace(ledger, rows=rows, about=ABOUT | {"overrides": [one]}) for rows, one in choices]
    ((head, *rows),) = tables(choices_table(ledger, records))
    assert head[1:] == ["Members", "Verdicts that change (methods whose parts do)"]
    assert [[cell.replace("\N{NO-BREAK SPACE}", " ") for cell in row] for row in rows] == [
        ["polynomial of log T in log ν", "1 sky, one run", "none"],
        ["Hann taper along frequency", "1 sky, one run", "D1 ✓ → ≈ (SD)"],
        ["none: another run of SDecGMCA", "1 sky, one run", "D1 ✓ → ≈ (SD)"],
    ]


def test_what_ledgers_have_in_common_is_said_once():
    (entries, about), other = ledger_of(FAILED), ledger_of(FAILED, overrides=[("reading", "letter")])
    *_, shared, first, second = ledgers_table([(entries, about), other]).split("\n\n")
    assert shared.startswith("*All: ci · synthetic Galaxy · seed ") and "ci ·" not in first + second
    assert second.startswith("*ci, letter, 1 sky, one run: reading = letter")
    alone = ledgers_table([(entries, about)]).split("\n\n")
    assert len(alone) == 2 and alone[1].startswith("*ci, 1 sky, one run: ci · synthetic Galaxy · ")
    real = about | {"preset": "laptop", "galaxy": "templates (nside 64)"}
    ((head, *_),) = tables(ledgers_table([(entries, about), (entries, real)]))
    assert head[3:] == ["ci, synthetic Galaxy, 1 sky, one run", "half size, real Galaxy, 1 sky, one run"]


def test_every_figure_is_shown_with_what_made_it():
    """And leads to itself, in full size."""
    *_, folders = shown_at_paper_size()
    text, folder = pictures(folders), ROOT / "notebooks"
    shown = re.findall(r"^\[!\[(.+)\]\((.+)\)\]\(\2\)\n\n\*(.+)\*$", text, re.M)
    paths = [(folder / path).resolve() for _, path, _ in shown]
    assert len(paths) == len(set(paths)) and set(paths) == {*RESULTS.glob("*/*.png")}
    for alternative, path, made in shown:
        assert made in alternative and ("templates" in made) == ("paper_templates" in path)
        with Image.open(folder / path) as picture:
            assert picture.width >= 600
    assert list(dict.fromkeys(re.findall(r"\*\*Fig\. ([\w.]+)\.\*\* ", text))) == sorted(PAPER)
    for name in folders:
        for row in read_stored(f"{name}/figures")["figures"]:
            assert row["parameters"]["preset"] == "paper" and not row["execution"]["dirty"]


@pytest.mark.parametrize("path", sorted(RESULTS.glob("readings*.json")), ids=lambda path: path.stem)
def test_stored_readings_can_be_read(path):
    """They are of one size and are small; every claim is judged under every reading that is there."""
    outcomes = outcomes_of(Record.load(find_experiment("readings"), path).rows)
    assert "letter" in outcomes
    assert all(set(one.entries) == set(CLAIMS) for one in outcomes.values())
    assert path.stat().st_size < 6e5


def test_a_ledger_makes_as_many_separations_as_the_chapter_says():
    assert find("19_scale").path.read_text().count(f"{len(Realisation().assessments)} separations") == 1


def test_what_is_not_stored_is_told(tmp_path):
    with pytest.raises(InputError, match="there is no .*steps_quick.json; the page on contributing explains"):
        read_stored("steps_quick", tmp_path)
    (tmp_path / "steps_quick.json").write_text("{")
    with pytest.raises(InputError, match="steps_quick.json is not a stored result"):
        read_stored("steps_quick", tmp_path)


def git(*arguments, given=None):
    """What git prints of this checkout."""
    command = ["git", "-C", str(ROOT), *arguments]
    return subprocess.run(command, input=given, capture_output=True, text=True, check=True).stdout


def test_stored_results_are_of_commits_that_there_are():
    """A reader can look at the code that measured them."""
    try:
        complete = git("rev-parse", "--is-shallow-repository").strip() == "false"
    except (OSError, subprocess.CalledProcessError):
        complete = False
    if not complete:
        pytest.skip("the history of this checkout is not complete")
    commits = {}
    for path in RESULTS.glob("*.json"):
        about = json.loads(path.read_text()).get("about", {})
        for commit in filter(None, [about.get("commit"), *about.get("grown", [])]):
            commits.setdefault(commit, []).append(path.name)
    asked = "".join(f"{commit}^{{commit}}\n" for commit in commits)
    answers = git("cat-file", "--batch-check", given=asked).splitlines()
    pairs = zip(commits.items(), answers, strict=True)
    assert commits and not [found for found, answer in pairs if answer.endswith(("missing", "ambiguous"))]


def test_ratios_to_the_truth_of_the_book():
    """At the paper's size every panel has six methods, at every l from 2 to 200."""
    for title, curves in stored_curves("paper_templates", "fig-results-angular").items():
        panel, (_, true) = angular_ratios(curves, title=title), curves["HI + noise"]
        assert panel["title"] == title and len(panel["curves"]) == 6
        for degrees, ratio, *_, look in panel["curves"]:
            name = look["label"]
            _, power = curves[name] if name in curves else curves[f"{name}: median"]
            assert degrees.tolist() == list(range(2, 201))
            assert ratio == pytest.approx((power / true)[curves["HI + noise"][0] <= 200][-199:])


@pytest.mark.parametrize(
    ("figure", "panel", "case"),
    [
        ("fig-results-angular", "degraded, 3 components", "degraded"),
        ("fig-results-angular", "evolving, 4 components", "evolving"),
        ("fig-results-angular", "oscillating, 5 components", "oscillating"),
        ("fig-dimmed-spectra", "across the sky", "dimmed"),
    ],
)
def test_figures_at_the_papers_size_have_the_runs_of_the_ledger(figure, panel, case):
    """The real Galaxy, its first sky: so says the chapter on this size."""
    rows = Record.load(find_experiment("restarts"), RESULTS / "restarts_paper_default.json").rows
    rows = rows[(rows["seed"] == rows["seed"].min()) & (rows["case"] == case)]
    expected = rows[rows["quantity"] == "mean error"].sort_values("restart")["value"]
    curves = stored_curves("paper_templates", figure)[panel]
    degrees, true = curves["HI + noise"]
    inside = (degrees > 10) & (degrees < 200)
    powers = [power[inside] for name, (_, power) in curves.items() if ": restart " in name]
    errors = [np.abs(power / true[inside] - 1).mean() for power in powers]
    assert errors == pytest.approx(expected.to_list(), rel=0.05)


def test_ratios_of_an_ensemble_are_its_median_and_its_band():
    """At those l that it has, of more of the truth; what is no method is not drawn."""
    degrees, name = np.arange(5, 202), "SDecGMCA, median of 4 (1 failed)"
    parts = {"16 %": 0.9, "median": 1.0, "84 %": 1.2, "restart 0": 30.0}
    curves = {f"{name}: {part}": (degrees, np.full(197, value)) for part, value in parts.items()}
    curves |= {"HI + noise": (np.arange(1, 400), np.full(399, 2.0)), "other": (degrees, np.ones(197))}
    ((drawn, *ratios, look),) = angular_ratios(curves)["curves"]
    assert look["label"] == name and drawn.tolist() == list(range(5, 201))
    assert [ratio.tolist() for ratio in ratios] == [[value] * 196 for value in (0.5, 0.45, 0.6)]


def test_one_picture():
    text = picture("paper_templates", "fig-results-frequency")
    assert text.count("paper_templates/fig-results-frequency.png") == 2
    assert "*The paper's Fig. 2, reproduced: Frequency power spectrum" in text
    assert re.search(r"\n\n\*paper, templates \(nside 64\) Galaxy · .*himap [\d.]+, commit \w+\*$", text)
    with pytest.raises(InputError, match="no stored figure fig-two in paper_templates; there are fig-"):
        picture("paper_templates", "fig-two")
