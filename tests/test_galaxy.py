"""The Galaxy as a choice: its fields, and what PySM gives."""

import time
from types import SimpleNamespace

import numpy as np
import pytest
from skies import lognormal

from himap.core.errors import InputError
from himap.sky.galaxy import Galaxy

# PySM


def test_pysm3_without_network_says_what_to_do():
    """Real, where there is no network; the templates in PySM's own cache also make it pass."""
    started = time.monotonic()
    try:
        sky = Galaxy(source="pysm3").components(16, np.random.default_rng(0))
    except InputError as error:
        assert "could not download" in str(error)
        assert "'synthetic'" in str(error)
        assert "'templates'" in str(error)
        assert time.monotonic() - started < 30
    else:
        assert [component.freq_ref for component in sky] == [408, 30_000]


@pytest.mark.parametrize("error", [TimeoutError("slow"), OSError("no route")])
def test_pysm3_download_errors(monkeypatch, error):
    import pysm3

    def fail(**options):
        raise error

    monkeypatch.setattr(pysm3, "Sky", fail)
    with pytest.raises(InputError, match="could not download its templates.*'synthetic'.*'templates'"):
        Galaxy(source="pysm3").components(16, np.random.default_rng(0))


@pytest.mark.parametrize(("nside", "asked"), [(16, 16), (1024, 512)])
def test_pysm3_models_become_power_laws(monkeypatch, nside, asked):
    import pysm3

    calls = []
    small = lognormal(16)

    def fake_sky(*, nside, preset_strings):
        calls.append((nside, preset_strings))
        index = -3 * np.ones(len(small)) * pysm3.units.dimensionless_unscaled
        synchrotron = SimpleNamespace(
            I_ref=2e7 * small * pysm3.units.uK_RJ, freq_ref_I=0.408 * pysm3.units.GHz, pl_index=index
        )
        free_free = SimpleNamespace(
            I_ref=100 * small * pysm3.units.uK_RJ,
            freq_ref_I=30 * pysm3.units.GHz,
            pl_index=-2.14 * pysm3.units.dimensionless_unscaled,
        )
        return SimpleNamespace(components=[synchrotron, free_free])

    monkeypatch.setattr(pysm3, "Sky", fake_sky)
    if nside == asked:
        sync, free = Galaxy(source="pysm3").components(nside, np.random.default_rng(0))
        assert sync.freq_ref == pytest.approx(408)
        assert sync.amplitude == pytest.approx(2e4 * small)
        assert np.all(sync.index == -3)
        assert (free.freq_ref, free.index) == (pytest.approx(30_000), -2.14)
        assert free.amplitude == pytest.approx(0.1 * small)
    else:
        monkeypatch.setattr("himap.sky.templates.Template.power_law", lambda self, *_, **__: self.name)
        assert Galaxy(source="pysm3").components(nside, np.random.default_rng(0)) == [
            "synchrotron",
            "free-free",
        ]
    assert calls == [(asked, ["s1", "f1"])]
    assert Galaxy(source="pysm3").digest() == pysm3.__version__


# What a Galaxy may be


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"source": "haslam"}, "there are synthetic, templates, pysm3"),
        ({"source": "templates"}, "needs template_dir.*one synchrotron index map"),
        ({"source": "templates", "template_dir": "no/such/folder"}, "no/such/folder cannot be read"),
        ({"template_dir": "."}, "leave it out or say source='templates'"),
        ({"source": "pysm3", "template_dir": "."}, "with 'pysm3'"),
        ({"small_scales": "yes"}, "True or False"),
    ],
)
def test_bad_fields_are_refused(fields, message):
    with pytest.raises(InputError, match=message):
        Galaxy(**fields)


@pytest.mark.parametrize("nside", [0, 48, 16.5])
def test_nside_is_a_power_of_two(nside, rng):
    with pytest.raises(InputError, match="power of two"):
        Galaxy().components(nside, rng)


def test_galaxy_is_hashable_and_labelled():
    assert len({Galaxy(), Galaxy(source="synthetic"), Galaxy(source="pysm3")}) == 2
    assert Galaxy(source="pysm3").label == "pysm3"
