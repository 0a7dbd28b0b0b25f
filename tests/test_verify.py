"""Changed code that gives the numbers of former code is accepted, and nothing else is."""

import importlib.util
import json
import sys
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest

from himap.app.notebooks import notebooks
from himap.core.errors import InputError
from himap.paper import canonical
from himap.paper.experiments import EXPERIMENTS, measuring_code
from himap.store import fingerprint as code
from himap.store import verify
from himap.store.fingerprint import CodeTree, moved

LAB = """
from himap.store.store import product

def power(x):
    return (x - 1.0) ** 2

@product
def base(n=1):
    import numpy as np
    return power(np.arange(200.0) * n)

@product
def above(n=1):
    return base(n) + 1

def first():
    return base.compute()

def second():
    return above.compute()

CALLS = {"base": [first], "above": [second]}
RTOLS = {}

def further_codes(tree):
    return {}
"""


@pytest.fixture
def lab(tmp_path, monkeypatch):
    """Function to a module with products of fixed names, some of its text replaced."""
    monkeypatch.setenv("HIMAP_CACHE", str(tmp_path / "cache"))
    monkeypatch.setattr(code, "ACCEPTED", tmp_path / "accepted.json")
    monkeypatch.setattr(code, "PROBES", tmp_path / "probes.json")
    made = []

    def load(*pairs):
        text = LAB
        for old, new in pairs:
            assert old in text
            text = text.replace(old, new)
        path = tmp_path / str(len(made)) / "lab_to_verify.py"
        path.parent.mkdir()
        path.write_text(text)
        spec = importlib.util.spec_from_file_location(path.stem, path)
        made.append(importlib.util.module_from_spec(spec))
        monkeypatch.setitem(sys.modules, path.stem, made[-1])
        spec.loader.exec_module(made[-1])
        return made[-1]

    return load


EQUAL = ("(x - 1.0) ** 2", "x**2 - 2 * x + 1.0")
OTHER = ("(x - 1.0) ** 2", "(x - 1.01) ** 2")


def said_by(module, **options):
    said, sys.modules[module.__name__] = [], module
    others = verify.verify(module, report=said.append, **options)
    return others, said


def fingerprint(module):
    """Of cells that use a product, and what is behind another one by itself."""
    cells = (f"from {module.__name__} import above, power", "power(above(2))")
    return CodeTree(**{module.__name__: module.__file__}).source_fingerprint(*cells)


def test_a_formula_in_other_words_is_accepted(lab):
    before, after = lab(), lab(EQUAL)
    assert said_by(before) == ([], ["base: new", "above: new"])
    stored = fingerprint(before)
    assert moved(stored, fingerprint(after)) == ["code", "base"]  # not `above`, which counts by itself
    before.above(2)
    assert not after.above.is_cached(2)
    assert said_by(after) == ([], ["base: the stored numbers"])
    assert moved(stored, fingerprint(after)) == []
    assert after.above.is_cached(2) and after.base.is_cached(2)
    assert said_by(after) == ([], ["no product, method or beam changed"])


CURVE = """
@dataclass
class Curve:
    values: object

    def squares(self):
        return power(self.values)
"""


def test_a_method_of_what_a_product_returns_is_called_where_it_is_used(lab):
    """The numbers of the product itself are the same."""
    curve = [
        ("import product\n", "import product\nfrom dataclasses import dataclass\n" + CURVE),
        ("return power(np.arange(200.0) * n)", "return Curve(np.arange(200.0) * n)"),
        ("return base(n) + 1", "return base(n).squares() + 1"),
    ]
    before, equal, other = lab(*curve), lab(*curve, EQUAL), lab(*curve, OTHER)
    said_by(before)
    stored = fingerprint(before)
    before.above(2)
    assert said_by(equal) == ([], ["base: the stored numbers"])
    assert equal.above.is_cached(2)
    others, said = said_by(other)
    assert others == ["base"] and said[0] == "base: the stored numbers"
    assert said[1].startswith("above: [0] by")
    assert "base" in moved(stored, fingerprint(other)) and not other.above.is_cached(2)
    said_by(other, renew=True)
    assert said_by(other) == ([], ["no product, method or beam changed"])
    assert "base" in moved(stored, fingerprint(other))


def test_what_uses_other_numbers_says_nothing_of_equal_ones(lab):
    """`above` is of `base`, which differs, and of `side`, whose formula is in other words."""
    side = [
        ("@product\ndef above", "@product\ndef side():\n    return 2.0 * 3\n\n@product\ndef above"),
        ("return base(n) + 1", "return base(n) + side()"),
        ("CALLS = {", 'CALLS = {"side": [lambda: side.compute()], '),
    ]
    before, after = lab(*side), lab(*side, OTHER, ("2.0 * 3", "3.0 * 2"))
    said_by(before)
    others, said = said_by(after)
    assert others == ["base"] and "side: the stored numbers" in said
    assert moved(fingerprint(before), fingerprint(after)) == ["code", "base"]


def test_code_that_runs_on_import_and_was_not_there_is_accepted(lab):
    """Such as that of a new module: it has no former digest of its own."""
    before = lab()
    after = lab(EQUAL, ("@product\ndef base", "for one in (1.0, 2.0):\n    power(one)\n\n@product\ndef base"))
    said_by(before)
    stored = fingerprint(before)
    assert said_by(after) == ([], ["base: the stored numbers", "above: the stored numbers"])
    assert moved(stored, fingerprint(after)) == ["code"]  # of the cells, which are no product
    assert said_by(after) == ([], ["no product, method or beam changed"])
    differing = lab(
        OTHER, ("@product\ndef base", "for one in (3.0, 2.0):\n    power(one)\n\n@product\ndef base")
    )
    assert said_by(differing)[0] == ["base", "above"]
    assert {"base", "above"} <= {*moved(stored, fingerprint(differing))}


def test_skies_that_a_record_is_measured_on_are_called(monkeypatch):
    """And seen to differ, such as by another default of a parameter."""
    from himap.paper.experiments import claims

    names = [f"skies_{name}" for name in EXPERIMENTS]
    assert {*names} <= {*canonical.CALLS}
    assert not verify.compared(canonical, ["skies_claims"])["skies_claims"][1]
    monkeypatch.setitem(claims.realisations.__kwdefaults__, "plane_weight", 0.2)
    assert verify.compared(canonical, ["skies_claims"])["skies_claims"][1]


SKY = (
    """@product
def base(n=1):""",
    """from dataclasses import dataclass
from himap.core.checks import parameter

@dataclass(frozen=True)
class Sky:
    seed: int = 1

@dataclass(frozen=True)
class Ground:
    seed: int = 1

@product
def base(n=1, sky=Sky(), ground=Ground()):""",
)
SMOOTH = (
    "\n    smooth: float = parameter(0.0, 'a later field', off=0.0)\n\n@dataclass(frozen=True)\nclass Ground:"
)


def test_a_field_that_is_added_and_off_changes_nothing(lab):
    before = lab(SKY)
    after = lab(SKY, ("\n\n@dataclass(frozen=True)\nclass Ground:", SMOOTH))
    said_by(before)
    stored = fingerprint(before)
    before.base(2, before.Sky(seed=3))
    assert said_by(after)[0] == [] and moved(stored, fingerprint(after)) == []
    assert after.base.is_cached(2, after.Sky(seed=3))
    assert not after.base.is_cached(2, after.Sky(seed=3, smooth=1.0))
    assert not after.base.is_cached(2, after.Sky())
    assert not after.base.is_cached(2, after.Ground(seed=3))


def test_what_was_accepted_is_followed_all_the_way_and_back(lab):
    before, after, last = lab(), lab(EQUAL), lab((EQUAL[0], "(1.0 - x) ** 2"))
    said_by(before)
    for one in (after, last, before, after):
        assert said_by(one)[0] == []
        assert moved(fingerprint(before), fingerprint(one)) == []
    assert moved(fingerprint(after), fingerprint(last)) == []
    known = json.loads(code.ACCEPTED.read_text())
    assert len(known) == 2 and len(set(known.values())) == 1  # `power`, twice


def test_a_number_that_others_have_too_is_not_accepted_for_those(lab):
    """A seven in one place gives the numbers of a three; a seven in another place does not."""
    power, above = ("** 2", "** 2 + 0 * STEPS"), ("base(n) + 1", "base(n) + OFFSET")
    constants = "import product\n\nSTEPS = 3\nOFFSET = 7\n"
    before = lab(power, above, ("import product\n", constants))
    after = lab(power, above, ("import product\n", constants.replace("3", "7")))
    last = lab(power, above, ("import product\n", constants.replace("7", "3").replace("3", "7", 1)))
    said_by(before)
    assert said_by(after)[0] == [] and moved(fingerprint(before), fingerprint(after)) == []
    assert said_by(after) == ([], ["no product, method or beam changed"])
    assert moved(fingerprint(after), fingerprint(last)) == ["above"]
    assert said_by(last)[0] == ["above"]


def test_other_numbers_are_refused_until_they_are_stored(lab):
    before, after = lab(), lab(OTHER)
    said_by(before)
    others, (line,) = said_by(after)
    assert others == ["base"] and line.startswith("base: [0] by ") and float(line.split()[-1]) > 1e-5
    assert moved(fingerprint(before), fingerprint(after)) == ["code", "base"]
    others, said = said_by(after, renew=True)  # what uses it is renewed with it
    assert others == ["base"] and [line.split(":")[0] for line in said] == ["base", "above"]
    assert not any(differing for _, differing in verify.compared(after, after.CALLS).values())
    assert moved(fingerprint(before), fingerprint(after)) == ["code", "base"]
    assert said_by(after) == ([], ["no product, method or beam changed"])
    assert said_by(before)[0] == ["base"]


def test_nothing_that_former_code_made_is_compared(lab):
    """The call of `above` asks `base`, whose result is in the user's cache under the key of both."""
    before = lab()
    said_by(before)
    before.base()
    after = lab(OTHER, ("+ 1\n", "+ 1 + 0\n"))
    assert said_by(after)[0] == ["base", "above"]


@dataclass
class Result:
    maps: np.ndarray
    count: int
    label: str | None


RESULT = Result(np.linspace(-1, 1, 5000).reshape(50, 100), 3, None)


WHOLE = np.arange(1000)
SPECTRUM = np.geomspace(1, 1e-12, 30)


@pytest.mark.parametrize(
    "value, changed, where",
    [
        (RESULT, Result(RESULT.maps * (1 + 1e-6), 3, None), ""),
        (RESULT, Result(RESULT.maps * (1 + 1e-4), 3, None), "maps by 1.0e-04"),
        (RESULT, Result(RESULT.maps.astype(np.float32), 3, None), "maps.kind"),
        (RESULT, Result(np.where(RESULT.maps > 0.999, 5.0, RESULT.maps), 3, None), "maps by"),
        (RESULT, Result(np.where(RESULT.maps > 0.9, np.nan, RESULT.maps), 3, None), "maps by inf"),
        (RESULT, Result(RESULT.maps, 4, None), "count"),
        (RESULT, Result(RESULT.maps, 3, "x"), "label"),
        (RESULT, [RESULT], "result"),
        (WHOLE, np.where(WHOLE == 777, 778, WHOLE), "sha256"),
        (SPECTRUM, SPECTRUM * (1 + 1e-7), ""),
        (SPECTRUM, SPECTRUM + [1e-3, *[0] * 29], "result by"),
        (np.zeros((0, 3)), np.zeros((0, 3)), ""),
        (np.zeros((0, 3)), np.zeros((0, 4)), "kind"),
        (1.0, 1.001, "result by"),
    ],
)
def test_what_differs_is_named(value, changed, where):
    stored, given = (json.loads(json.dumps(verify.summary(one))) for one in (value, changed))
    found = verify.differences(stored, given)
    assert bool(found) == bool(where) and all(where in one for one in found[:1])


def test_every_product_and_named_class_has_a_call():
    tree = CodeTree()
    reached = set().union(
        *(one.fingerprint(tree) for one in notebooks()), *(measuring_code(name, tree) for name in EXPERIMENTS)
    )
    names = {name for name in reached if name not in ("code", "look") and "." not in name}
    assert names | {f"skies_{name}" for name in EXPERIMENTS} == set(canonical.CALLS)


def test_the_stored_numbers_are_of_todays_code():
    names = verify.moved_names(canonical)
    assert not names, f"{', '.join(names)} changed: run `himap verify`"


def test_what_was_accepted_still_holds():
    trees = (CodeTree(accepted=one) for one in (None, {}))
    codes, strict = (verify.codes_of(tree, canonical) for tree in trees)
    names = [name for name in canonical.CALLS if codes[name] != strict[name]]
    assert canonical.RTOLS.keys() <= canonical.CALLS.keys()
    found = verify.compared(canonical, names)
    assert not {name: differing for name, (_, differing) in found.items() if differing}


def test_the_calls_see_a_method_that_changed(monkeypatch):
    """Numbers of one method by a part in a thousand, and no other."""
    from himap.removal import polynomial

    real = polynomial.Polynomial._separate

    def other(self, data):
        return real(self, replace(data, maps=data.maps * np.float32(1.001)))

    monkeypatch.setattr(polynomial.Polynomial, "_separate", other)
    found = verify.compared(canonical, ["polynomial", "pca"])
    assert found["polynomial"][1] and not found["pca"][1]


def test_verify_needs_a_checkout(monkeypatch, himap_command):
    monkeypatch.setattr(code, "ACCEPTED", Path("nowhere") / "accepted.json")
    status, _, said = himap_command("verify")
    assert status == 2 and "checkout of himap" in said


def test_a_file_after_a_merge_is_refused_with_the_way_out(monkeypatch, tmp_path):
    (tmp_path / "accepted.json").write_text('<<<<<<< HEAD\n{"a": "b"}')
    monkeypatch.setattr(code, "ACCEPTED", tmp_path / "accepted.json")
    with pytest.raises(InputError, match="is not JSON .* after a merge: restore it with `git checkout`"):
        code.stored_dict(code.ACCEPTED)


def test_the_command_ends_with_what_differs(monkeypatch, himap_command):
    monkeypatch.setattr(verify, "verify", lambda *_, renew, **__: [] if renew else ["pca", "analysis"])
    status, _, said = himap_command("verify")
    assert status == 1 and "other numbers than those stored: pca, analysis. If" in said
    assert "`himap verify --renew` stores" in said
    assert himap_command("verify", "--renew")[0] == 0
