"""Cached products: computed once, and kept under the right key."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import psutil
import pytest

from himap.core.errors import InputError
from himap.core.survey import PRESETS
from himap.store import cache

SURVEY = PRESETS["ci"]


@pytest.mark.parametrize("is_large", [False, True])
def test_a_result_is_computed_once_and_mapped_from_disk_if_it_is_large(lab, monkeypatch, is_large):
    if is_large:
        monkeypatch.setattr("himap.store.arrays._MAPPED", 100)
    first, second = lab.base(SURVEY), lab.base(survey=SURVEY, scale=1.0)
    assert lab.computed() == ["base"]
    assert isinstance(second, np.memmap) is is_large and not second.flags.writeable
    np.testing.assert_array_equal(first, 2 * np.arange(100))
    assert second.dtype == np.float32


def test_small_results_that_somebody_holds_keep_no_file_open(lab):
    """An ensemble holds thousands, and many a machine lets a process open 1024."""
    lab.base(SURVEY)
    before = psutil.Process().num_fds()
    held = [lab.base(SURVEY) for _ in range(20)]
    assert len(held) == 20 and psutil.Process().num_fds() == before


def test_every_argument_counts(lab):
    for kwargs in [{}, {"scale": 2.0}, {"options": {"a": (1, None)}}, {"options": {"a": (1, False)}}]:
        lab.base(SURVEY, **kwargs)
    lab.base(replace(SURVEY, seed=1))
    lab.base(SURVEY, options=np.arange(3.0))
    lab.base(SURVEY, options=np.arange(3.0) + 1e-12)
    for options in [{1: 2}, {"1": 2}, {"a": 1, "b": 2}, {"a: 1, b": 2}]:
        lab.base(SURVEY, options=options)
    assert len(lab.computed()) == 11
    lab.base(SURVEY, scale=np.float64(2.0))
    lab.base(SURVEY, options={"a": [1, None]})
    assert len(lab.computed()) == 11


def test_an_argument_can_bring_a_digest(lab, tmp_path):
    template = lab.Template(str(tmp_path / "map.txt"))
    for text, n_computed in [("one", 1), ("one", 1), ("other", 2)]:
        (tmp_path / "map.txt").write_text(text)
        assert lab.of_template(template)[0] == len(text)
        assert len(lab.computed()) == n_computed


def test_arguments_that_have_no_text_are_refused(lab):
    with pytest.raises(InputError, match="got Generator"):
        lab.base(SURVEY, options=np.random.default_rng(0))
    with pytest.raises(InputError, match="scale=1.0.*unexpected keyword argument 'sclae'"):
        lab.base(SURVEY, sclae=2)


def test_all_kinds_of_values_come_back(lab):
    value = lab.odd()
    assert lab.odd.is_cached()
    first, second = value.pairs
    assert first.first.tolist() == [True, False] and first.label == "é"
    assert second.first.shape == (0, 3)
    assert value.table[1] == np.inf and value.table["a"] == 3 + 4j
    assert value.shape == (2, (3,)) and value.nothing is None
    (folder,) = cache.cache_folder().glob("*/*")
    assert sorted(path.suffix for path in folder.iterdir()) == [".json", ".json", ".npy", ".npy", ".npy"]


@pytest.mark.parametrize(
    ("what", "got"),
    [("object", "ndarray of object"), ("set", "set"), ("Local", "Local"), ("MaskedArray", "MaskedArray")],
)
def test_what_is_no_array_and_no_json_is_refused(lab, what, got):
    with pytest.raises(InputError, match=f"an array of numbers.*got {got}"):
        lab.pickled(what)
    assert not cache.cache_info()


def test_code_edited_under_a_running_process_is_not_cached(lab):
    path = Path(lab.__file__)
    source = path.read_text()
    lab.base(SURVEY)
    path.write_text(source.replace("SCALE = 2.0", "SCALE = 2.0  # a comment"))
    lab.base(SURVEY)
    assert lab.computed() == ["base"]
    path.write_text(source.replace("SCALE = 2.0", "SCALE = 3.0"))
    with pytest.warns(UserWarning, match="changed on disk since it was loaded"):
        assert lab.base(SURVEY)[1] == 2.0
    assert len(cache.cache_info()) == 1
    assert (
        lab.start("from himap.core.survey import PRESETS\nassert lab.base(PRESETS['ci'])[1] == 3").wait() == 0
    )
    assert len(cache.cache_info()) == 2


def test_the_code_of_a_dataclass_that_is_passed_counts(lab):
    for options in [{}, {"method": lab.Method()}]:
        lab.base(SURVEY, options=options)
    path = Path(lab.__file__)
    path.write_text(path.read_text().replace("return 1", "return 2"))
    calls = "for options in [{}, {'method': lab.Method()}]: lab.base(PRESETS['ci'], options=options)"
    assert lab.start(f"from himap.core.survey import PRESETS\n{calls}").wait() == 0
    assert len(lab.computed()) == 3
