"""Cached products: computed once, whole or not at all, under the right key."""

import json
import os
import pickle
import signal
import socket
import subprocess
import sys
import time
import zlib
from dataclasses import replace
from pathlib import Path

import joblib
import numpy as np
import pytest
from joblib.externals.loky import get_reusable_executor

import himap
from himap.errors import InputError
from himap.products import cache
from himap.survey import PRESETS

ROOT = Path(himap.__file__).parents[1]

MODULE = '''
import os
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from himap.products.store import product
from himap.survey import Survey

SCALE = 2.0


@dataclass(frozen=True)
class Pair:
    first: np.ndarray
    label: str


@dataclass(frozen=True)
class Method:
    n_sources: int = 3

    def clean(self):
        return 1


@dataclass(frozen=True)
class Template:
    path: str

    def digest(self):
        return Path(self.path).read_text()


def note(name):
    """Called when something is computed."""
    with open(os.environ["NOTES"], "a") as file:
        print(name, file=file)


@product
def base(survey, *, scale=1.0, options=None):
    note("base")
    return np.arange(survey.n_channels, dtype=np.float32) * SCALE * scale


@product
def pair(survey, *, scale=1.0):
    note("pair")
    return Pair(first=base(survey, scale=scale) + 1, label="sum")


@product
def of_template(template):
    note("template")
    return np.array([len(template.digest())])


@product
def slow(size, gate=""):
    note("slow")
    while gate and not Path(gate).exists():
        time.sleep(0.01)
    return np.ones(size)


@dataclass(frozen=True)
class Odd:
    pairs: list
    table: dict
    shape: tuple
    nothing: None = None


@product
def odd():
    first = Pair(first=np.array([True, False]), label="é")
    second = Pair(first=np.empty((0, 3)), label="")
    table = {1: np.float64(np.inf), "a": np.array(3 + 4j)}
    return Odd(pairs=[first, second], table=table, shape=(2, (3,)))


@product
def pickled(what):
    @dataclass
    class Local:
        n: int = 1

    odd = {"object": np.array([{}], dtype=object), "set": {1}, "Local": Local()}
    return (odd | {"MaskedArray": np.ma.array([1.0])})[what]


@product
def failing():
    raise KeyError("mine")
'''


@pytest.fixture
def lab(tmp_path, monkeypatch, request):
    """A module with products, in a file of its own, and the list of what was computed."""
    name = "lab_" + request.node.name.partition("[")[0]
    (tmp_path / f"{name}.py").write_text(MODULE)
    monkeypatch.setenv("HIMAP_CACHE", str(tmp_path / "cache"))
    monkeypatch.setenv("NOTES", str(tmp_path / "notes"))
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(tmp_path), str(ROOT)]))
    monkeypatch.syspath_prepend(str(tmp_path))
    module = __import__(name)
    (tmp_path / "notes").touch()
    module.computed = lambda: (tmp_path / "notes").read_text().split()
    yield module
    del sys.modules[name]


SURVEY = PRESETS["ci"]


def test_a_result_is_computed_once_and_mapped_from_disk(lab):
    first, second = lab.base(SURVEY), lab.base(survey=SURVEY, scale=1.0)
    assert lab.computed() == ["base"]
    assert isinstance(second, np.memmap) and not second.flags.writeable
    np.testing.assert_array_equal(first, 2 * np.arange(100))
    assert second.dtype == np.float32


def test_once_reads_what_is_kept_and_keeps_nothing_itself(lab):
    assert not isinstance(lab.base.once(SURVEY), np.memmap) and not lab.base.is_cached(SURVEY)
    lab.base(SURVEY)
    assert isinstance(lab.base.once(SURVEY), np.memmap)


def test_every_argument_counts(lab):
    for kwargs in [{}, {"scale": 2.0}, {"options": {"a": (1, None)}}, {"options": {"a": (1, False)}}]:
        lab.base(SURVEY, **kwargs)
    lab.base(replace(SURVEY, seed=1))
    lab.base(SURVEY, options=np.arange(3.0))
    lab.base(SURVEY, options=np.arange(3.0) + 1e-12)
    assert len(lab.computed()) == 7
    lab.base(SURVEY, scale=np.float64(2.0))
    lab.base(SURVEY, options={"a": [1, None]})
    assert len(lab.computed()) == 7


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


def test_a_product_travels_by_name(lab):
    assert pickle.loads(pickle.dumps(lab.base)) is lab.base


def test_products_nest_also_in_workers(lab):
    get_reusable_executor().shutdown()  # workers of other tests do not know the folder of the lab
    with joblib.Parallel(n_jobs=2) as parallel:
        results = parallel(joblib.delayed(lab.pair)(SURVEY, scale=scale) for scale in (1.0, 3.0))
    assert sorted(lab.computed()) == ["base", "base", "pair", "pair"]
    np.testing.assert_array_equal(results[1].first, 6 * np.arange(100) + 1)
    assert results[1].label == "sum"
    again = lab.pair(SURVEY, scale=3.0)
    assert isinstance(again.first, np.memmap)
    assert len(lab.computed()) == 4


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


@pytest.mark.parametrize("name", [["antigravity", "fly"], ["os", "system"], ["himap.errors", "InputError"]])
def test_reading_a_result_runs_and_imports_nothing(lab, name):
    """A class that is no dataclass of a loaded module: damaged, and computed again."""
    lab.pair(SURVEY)
    (tree,) = (path for path in cache.cache_folder().glob("*.pair/*/value.json"))
    content = json.loads(tree.read_text())
    tree.write_text(json.dumps(content | {"class": name}))
    note = json.loads(tree.with_name("note.json").read_text())
    note["files"]["value.json"] = [tree.stat().st_size, zlib.crc32(tree.read_bytes())]
    tree.with_name("note.json").write_text(json.dumps(note))
    with pytest.warns(UserWarning, match="is damaged and is computed again .there is no class"):
        assert lab.pair(SURVEY).label == "sum"
    assert name[0] == "os" or name[0].startswith("himap") or name[0] not in sys.modules


def _value_file():
    (file,) = cache.cache_folder().rglob("0.npy")
    return file


def _cut(file):
    file.write_bytes(file.read_bytes()[:-8])


def _alter(file):
    content = bytearray(file.read_bytes())
    content[len(content) // 2] ^= 1
    file.write_bytes(content)


@pytest.mark.parametrize(
    ("harm", "why"),
    [(_cut, "it has .* of .* bytes"), (_alter, "its checksum is another"), (Path.unlink, "No such file")],
)
def test_a_damaged_result_is_computed_again_with_a_warning(lab, harm, why):
    lab.base(SURVEY)
    harm(_value_file())
    with pytest.warns(UserWarning, match=f"cached .*base is damaged and is computed again .*{why}"):
        again = lab.base(SURVEY)
    np.testing.assert_array_equal(again, 2 * np.arange(100))
    assert lab.computed() == ["base", "base"]
    lab.base(SURVEY)
    assert len(lab.computed()) == 2


def test_a_damaged_note_is_noticed(lab):
    lab.base(SURVEY)
    _value_file().with_name("note.json").write_text("{")
    with pytest.warns(UserWarning, match="is damaged and is computed again"):
        lab.base(SURVEY)
    assert lab.computed() == ["base", "base"]


def test_what_the_machine_refuses_is_no_damage(lab, monkeypatch):
    lab.base(SURVEY)

    def refuse(*args, **options):
        raise OSError(24, "too many open files")

    with monkeypatch.context() as patched, pytest.raises(OSError, match="too many open files"):
        patched.setattr("numpy.load", refuse)
        lab.base(SURVEY)
    lab.base(SURVEY)
    assert lab.computed() == ["base"]


def _start(lab, code):
    return subprocess.Popen([sys.executable, "-c", f"import {lab.__name__} as lab\n{code}"])


def _wait_for(condition):
    deadline = time.monotonic() + 20
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.01)


def _unfinished():
    return [path for path in cache.cache_folder().glob("*/*") if path.name.startswith("unfinished")]


def test_a_writer_that_is_killed_leaves_no_result(lab):
    size = 400_000_000 // 8
    process = _start(lab, f"lab.slow({size})")
    _wait_for(_unfinished)
    process.send_signal(signal.SIGKILL)
    process.wait()
    assert not lab.slow.is_cached(size)
    (left,) = cache.cache_info()
    assert left.product == "unfinished" and left.n_bytes < size * 8
    assert lab.slow(1000).sum() == 1000  # the next writer tidies up
    assert not _unfinished()


def test_what_an_earlier_himap_kept_is_listed_and_cleared(lab):
    folder = cache.cache_folder() / "pipeline.cleaned" / ("0" * 32)
    folder.mkdir(parents=True)
    (folder / "value.pkl").write_bytes(b"0" * 1000)
    (folder / "note.json").write_text('{"product": "pipeline.cleaned"}')
    (entry,) = cache.cache_info()
    assert entry.product == "pipeline.cleaned" and entry.n_bytes > 1000
    cache.clear_cache()
    assert not folder.exists()


def test_writers_at_work_are_left_alone(lab):
    lab.base(SURVEY)
    folder = _value_file().parents[1]
    names = {
        host: f"unfinished-{host}-{os.getpid()}-0123abcd" for host in (socket.gethostname(), "elsewhere")
    }
    for name in names.values():
        (folder / name).mkdir()
    lab.base(SURVEY, scale=2.0)
    assert {path.name for path in _unfinished()} == set(names.values())
    assert cache.clear_cache(["unfinished"]) == 0 and not _unfinished()


def test_two_processes_at_once(lab, tmp_path):
    gate = str(tmp_path / "gate")
    check = f"assert lab.slow(1000, gate={gate!r}).sum() == 1000"
    processes = [_start(lab, check) for _ in range(2)]
    _wait_for(lambda: lab.computed() == ["slow", "slow"])
    Path(gate).touch()
    assert [process.wait() for process in processes] == [0, 0]
    assert lab.slow(1000, gate=gate).sum() == 1000
    assert len(lab.computed()) == 2
    assert not _unfinished()


def test_a_disk_that_is_full_is_one_clear_error(lab):
    """A limit on the size of files stands for the end of the disk."""
    limit = "import resource; resource.setrlimit(resource.RLIMIT_FSIZE, (10**6,) * 2)"
    code = f"{limit}; import {lab.__name__} as lab; lab.slow(10**6)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
    error = done.stderr.strip().splitlines()[-1]
    assert "slow cannot be kept in" in error and "GB are free. Free space with `himap cache clear`" in error
    assert not _unfinished() and not cache.cache_info()


def test_an_error_of_the_function_is_its_own(lab):
    with pytest.raises(KeyError, match="mine"):
        lab.failing()


def test_code_edited_under_a_running_process_is_not_cached(lab):
    path = Path(lab.__file__)
    lab.base(SURVEY)
    path.write_text(MODULE.replace("SCALE = 2.0", "SCALE = 2.0  # a comment"))
    lab.base(SURVEY)
    assert lab.computed() == ["base"]
    path.write_text(MODULE.replace("SCALE = 2.0", "SCALE = 3.0"))
    with pytest.warns(UserWarning, match="changed on disk since it was loaded"):
        assert lab.base(SURVEY)[1] == 2.0
    assert len(cache.cache_info()) == 1
    assert _start(lab, "from himap.survey import PRESETS\nassert lab.base(PRESETS['ci'])[1] == 3").wait() == 0
    assert len(cache.cache_info()) == 2


def test_the_code_of_a_dataclass_that_is_passed_counts(lab):
    for options in [{}, {"method": lab.Method()}]:
        lab.base(SURVEY, options=options)
    Path(lab.__file__).write_text(MODULE.replace("return 1", "return 2"))
    calls = "for options in [{}, {'method': lab.Method()}]: lab.base(PRESETS['ci'], options=options)"
    assert _start(lab, f"from himap.survey import PRESETS\n{calls}").wait() == 0
    assert len(lab.computed()) == 3


def test_info_and_clear(lab):
    lab.base(SURVEY, scale=4.0)
    lab.pair(SURVEY)
    newest, *_, oldest = cache.cache_info()
    assert newest.product.endswith("pair") and oldest.product.endswith("base")
    assert "scale=4.0" in oldest.arguments.replace(": ", "=") and "n_channels=100" in oldest.arguments
    assert oldest.n_bytes > 400 and time.time() - oldest.created.timestamp() < 60
    assert cache.clear_cache([newest.product]) == newest.n_bytes
    assert {entry.product for entry in cache.cache_info()} == {oldest.product}
    with pytest.raises(InputError, match=f"no spectra; it holds {oldest.product}"):
        cache.clear_cache(["spectra"])
    lab.pair(SURVEY)
    assert lab.computed() == ["base", "pair", "base", "pair"]


def test_a_cache_folder_that_cannot_be(lab, monkeypatch, tmp_path):
    (tmp_path / "file").touch()
    monkeypatch.setenv("HIMAP_CACHE", str(tmp_path / "file" / "cache"))
    with pytest.raises(InputError, match="HIMAP_CACHE"):
        lab.base(SURVEY)


def test_what_himap_did_not_make_is_not_cleared(lab):
    """HIMAP_CACHE may name a folder that holds other things too."""
    lab.base(SURVEY)
    others = [
        cache.cache_folder() / "project" / name
        for name in ("data/thesis.txt", "unfinished-draft/note.json", "models/value.pkl")
    ]
    for path in others:
        path.parent.mkdir(parents=True)
        path.write_text("{}")
    assert len(cache.cache_info()) == 1
    cache.clear_cache()
    assert all(path.exists() for path in others) and not cache.cache_info()
