"""Records: one file for all experiments, read strictly, checked against one sky, and grown."""

import json
import math
from dataclasses import dataclass, replace
from types import SimpleNamespace

import ledgers
import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st

from himap.core.errors import InputError
from himap.paper import record as record_module
from himap.paper.experiments import EXPERIMENTS, find_experiment, measuring_code
from himap.paper.record import Experiment, Record
from himap.store.fingerprint import CodeTree
from himap.store.sources import LOADED

ABOUT = ledgers.ABOUT | {"overrides": [["n_realisations", 2], ["n_mocks", 3]], "seed": 7}
TOMORROW = {"code": "tomorrow"}


@dataclass(frozen=True)
class Sky:
    seed: int
    rows: tuple

    @property
    def survey(self):
        return SimpleNamespace(seed=self.seed)


def rows_of(seed):
    curve = [{"method": "pca", "x": n, "ratio": 0.9 + seed / 100 + n / 30, "note": None} for n in range(3)]
    single = {"method": "gmca", "x": 0, "ratio": math.nan, "note": f"seed {seed}"}
    return (*curve, single)


EXPERIMENT = Experiment(
    name="toy",
    chapter="20_transfer_function",
    columns={"method": str, "x": int, "ratio": float, "note": str},
    key=("method",),
    skies=lambda **settings: [Sky(seed, rows_of(seed)) for seed in (7, 8)],
    measure=lambda sky: sky.rows,
    summary=lambda rows: rows,
    words=("note",),
)


@pytest.fixture
def record():
    return Record(experiment=EXPERIMENT, rows=EXPERIMENT.table(EXPERIMENT.skies()), about=ABOUT)


def changed(record, **cells):
    """The rows of the first sky, with some cells of its second row changed."""
    rows = record.rows[record.rows["seed"] == 7].copy()
    for name, value in cells.items():
        rows.loc[1, name] = value
    return rows


class TestFile:
    def test_there_and_back(self, record, tmp_path):
        path = tmp_path / "new" / "a.json"
        record.save(path)
        again = Record.load(EXPERIMENT, path)
        pd.testing.assert_frame_equal(again.rows, record.rows, rtol=1e-5)
        assert again.about == ABOUT and again.seeds == [7, 8] and again.made.seed == 7
        assert [file.name for file in path.parent.iterdir()] == ["a.json"]
        content = json.loads(path.read_text())  # which has no NaN
        assert content["rows"][0] == [7, "pca", [0, 1, 2], [0.97, 1.00333, 1.03667], None]  # six digits
        assert content["rows"][1] == [7, "gmca", 0, None, "seed 7"]

    def test_numbers_of_numpy_are_numbers(self):
        row = {"seed": 1, "method": "pca", "x": np.int64(2), "ratio": np.float32(0.5), "note": None}
        frame = EXPERIMENT.frame([row])
        assert frame["ratio"].tolist() == [0.5] and frame["x"].dtype == "int64"

    @pytest.mark.parametrize(
        ("change", "message"),
        [
            (lambda content: content.update(format=2), "format 2 of 'toy'"),
            (lambda content: content.update(experiment="other"), "of 'other'"),
            (lambda content: content.pop("about"), "about"),
            (lambda content: content["about"].pop("code"), "code"),
            (lambda content: content["about"].update(code=3), "nothing says what made it"),
            (lambda content: content["about"].pop("seed"), "seed"),
            (lambda content: content.update(rows=[]), "no row"),
            (lambda content: content["rows"][0].pop(), "shorter|longer"),
            (lambda content: content["columns"].__setitem__(1, "way"), "the columns are not"),
            (lambda content: content["rows"][0].__setitem__(1, 5), "a value of method is 5"),
            (lambda content: content["rows"][1].__setitem__(2, 0.5), "a value of x is 0.5"),
            (lambda content: content["rows"][1].__setitem__(2, None), "a value of x is None"),
            (lambda content: content["rows"][1].__setitem__(2, True), "a value of x is True"),
            (lambda content: content["rows"][1].__setitem__(3, "high"), "a value of ratio is 'high'"),
            (lambda content: content["rows"][0].__setitem__(2, [0, 1]), "lists of 2 and 3 values"),
        ],
    )
    def test_another_kind_of_file(self, record, tmp_path, change, message):
        path = tmp_path / "a.json"
        record.save(path)
        content = json.loads(path.read_text())
        change(content)
        path.write_text(json.dumps(content))
        with pytest.raises(InputError, match=f"is not a record that `himap measure toy` wrote .*({message})"):
            Record.load(EXPERIMENT, path)

    @given(st.binary(max_size=200))
    def test_any_bytes(self, tmp_path_factory, content):
        path = tmp_path_factory.getbasetemp() / "any.json"
        path.write_bytes(content)
        with pytest.raises(InputError, match="is not a record"):
            Record.load(EXPERIMENT, path)

    def test_no_file_and_no_place(self, record, tmp_path):
        with pytest.raises(InputError, match="there is no record .*none.json; `himap measure toy` writes"):
            Record.load(EXPERIMENT, tmp_path / "none.json")
        (tmp_path / "file").write_text("")
        with pytest.raises(InputError, match="cannot be written"):
            record.save(tmp_path / "file" / "a.json")


class TestCheck:
    def test_the_same_numbers_mark_it(self, record):
        rows = changed(record, ratio=record.rows["ratio"][1] * 1.0009, note="other words")
        marked = record.check(rows, ABOUT | {"code": TOMORROW, "overrides": [["n_mocks", 3]]})
        assert marked.about["checked"]["code"] == TOMORROW and marked.codes == [ABOUT["code"], TOMORROW]
        assert marked.rows is record.rows and "checked" not in record.about

    @pytest.mark.parametrize(("factor", "same"), [(1.0009, True), (1.01, False), (9, False)])
    @pytest.mark.parametrize("size", [1e-6, 1e-2])
    def test_small_numbers_by_their_own_size(self, record, factor, same, size):
        """Also those that are small among those of their key, to a thousandth of these."""
        small = replace(record, rows=record.rows.assign(ratio=size * record.rows["ratio"]))
        rows = changed(small, ratio=factor * small.rows["ratio"][1])
        if same:
            assert small.check(rows, ABOUT).about["checked"]
        else:
            with pytest.raises(InputError, match="1 of 4 rows of the seed 7 have changed"):
                small.check(rows, ABOUT)
        tiny = replace(
            record, rows=record.rows.assign(ratio=record.rows["ratio"].where(record.rows["x"] != 1, 1e-9))
        )
        assert tiny.check(changed(tiny, ratio=1e-4), ABOUT).about["checked"]

    def test_an_infinity_is_what_a_file_keeps_of_it(self, record, tmp_path):
        """JSON has none: it is stored as an absent number."""
        rows = record.rows.assign(ratio=record.rows["ratio"].where(record.rows["x"] > 0, math.inf))
        replace(record, rows=rows).save(tmp_path / "a.json")
        stored = Record.load(EXPERIMENT, tmp_path / "a.json")
        assert stored.check(rows[rows["seed"] == 7], ABOUT).about["checked"]
        with pytest.raises(InputError, match="have changed"):
            stored.check(record.rows[record.rows["seed"] == 7], ABOUT)

    @pytest.mark.parametrize(
        ("cells", "n_rows", "message"),
        [
            ({"ratio": 1.01}, 4, "1 of 4 rows of the seed 7 have changed.*'ratio': 1.01"),
            ({"ratio": math.nan}, 4, "1 of 4 rows of the seed 7 have changed"),
            ({"x": 5}, 4, "have changed"),
            ({"method": "ica"}, 4, "have changed"),
            ({}, 3, "the record has 4 rows of the seed 7, 3 were measured"),
        ],
    )
    def test_other_numbers_or_rows(self, record, cells, n_rows, message):
        with pytest.raises(InputError, match=message):
            record.check(changed(record, **cells)[:n_rows], ABOUT)


class TestExperiments:
    def test_no_sky(self):
        with pytest.raises(InputError, match="toy needs one sky or more"):
            EXPERIMENT.table([])

    def test_a_cluster_gets_all_skies_at_once(self, monkeypatch):
        prepared = []
        shared = replace(EXPERIMENT, prepare=prepared.append)
        shared.table(EXPERIMENT.skies())
        assert [[sky.seed for sky in skies] for skies in prepared] == [[7], [8]]
        prepared.clear()
        monkeypatch.setattr(record_module, "dask_address", lambda: "tcp://host:8786")
        shared.table(EXPERIMENT.skies())
        assert [[sky.seed for sky in skies] for skies in prepared] == [[7, 8]]

    def test_a_measure_that_gives_other_columns(self):
        wrong = replace(EXPERIMENT, measure=lambda sky: [{"method": "pca"}])
        with pytest.raises(ValueError, match="the columns are not seed, method, x, ratio, note"):
            wrong.table(EXPERIMENT.skies())

    def test_each_is_found_and_knows_its_code(self):
        on_disk, loaded = CodeTree(), CodeTree(texts=LOADED)
        for name in EXPERIMENTS:
            experiment = find_experiment(name)
            assert experiment.name == name and set(experiment.key) <= set(experiment.columns)
            assert measuring_code(name, on_disk) == measuring_code(name, loaded)
