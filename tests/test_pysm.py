"""The files that `himap templates` writes, of a PySM whose maps are known."""

import sys
from importlib import import_module
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest
from skies import lognormal

from himap.core.errors import InputError
from himap.maps import sphere
from himap.maps.healpix_io import read_maps
from himap.sky import galaxy, templates
from himap.sky.emission import emission_maps
from himap.sky.galaxy import Galaxy
from himap.sky.templates import digest_of, write_templates

NSIDE = 16
SYNCHROTRON = 20 * lognormal(NSIDE)  # K at 408 MHz
INDEX = -3 + 0.1 * np.log(lognormal(NSIDE, 3))
FREE_FREE = 1e-4 * lognormal(NSIDE, 2)  # K at 30 GHz
FILES = [
    "freefree_30GHz_K_nside16.fits",
    "synchrotron_408MHz_K_nside16.fits",
    "synchrotron_beta_nside16.fits",
]


@pytest.fixture
def pysm3(monkeypatch):
    """A stand-in for the module, with its units and another Sky, which notes what is `asked` of it."""
    module = ModuleType("pysm3")
    module.units = u = import_module("pysm3").units
    module.free_free_index, module.asked = -2.14, []

    def sky(*, nside, preset_strings):
        module.asked.append((nside, preset_strings))
        rows = (SYNCHROTRON, 0.408, INDEX), (FREE_FREE, 30, module.free_free_index)
        parts = [
            SimpleNamespace(I_ref=1e6 * kelvin * u.uK_RJ, freq_ref_I=freq * u.GHz, pl_index=index * u.one)
            for kelvin, freq, index in rows
        ]
        return SimpleNamespace(components=parts)

    module.Sky = sky
    monkeypatch.setitem(sys.modules, "pysm3", module)
    monkeypatch.setattr(templates, "pysm_version", lambda: "3.4.6")
    return module


def names(folder):
    return sorted(path.name for path in folder.iterdir())


def test_files(pysm3, tmp_path):
    paths = write_templates(tmp_path / "new" / "maps", NSIDE)
    assert sorted(path.name for path in paths) == names(tmp_path / "new" / "maps") == FILES
    free_free, synchrotron, index = (read_maps(tmp_path / "new" / "maps" / name) for name in FILES)
    columns = (synchrotron, SYNCHROTRON, "K_RJ"), (free_free, FREE_FREE, "K_RJ"), (index, INDEX, None)
    for file, pixels, unit in columns:
        assert file.maps.shape == (1, 12 * NSIDE**2) and file.maps.dtype == np.float32
        assert file.maps[0] == pytest.approx(pixels, rel=1e-6)
        assert (file.units, file.nested, file.frame, file.partial) == ((unit,), False, "G", False)
        assert file.header["PYSM3"] == "3.4.6"


def test_the_sky_of_the_files_is_the_closed_form(pysm3, tmp_path):
    """T (nu / nu_0)^beta of both, and that of PySM itself."""
    write_templates(tmp_path, NSIDE)
    galaxy = Galaxy(source="templates", template_dir=str(tmp_path))
    assert galaxy.label == "templates (nside 16)"
    freqs = np.array([900.0, 1150.0, 1400.0])
    seen = emission_maps(galaxy.components(NSIDE, np.random.default_rng(0)), freqs)
    scale = freqs[:, None]
    expected = 1e3 * (SYNCHROTRON * (scale / 408) ** INDEX + FREE_FREE * (scale / 30_000) ** -2.14)
    assert seen == pytest.approx(expected, rel=1e-5)
    direct = emission_maps(Galaxy(source="pysm3").components(NSIDE, np.random.default_rng(0)), freqs)
    assert seen == pytest.approx(direct, rel=1e-5)
    assert pysm3.asked == 2 * [(NSIDE, ["s1", "f1"])]
    assert Galaxy(source="pysm3").digest() == "3.4.6"


def test_no_finer_maps_are_asked_for_than_pysm_has(pysm3, monkeypatch):
    monkeypatch.setattr(galaxy, "refine_template", lambda template, *_, **__: template.name)
    components = Galaxy(source="pysm3").components(1024, np.random.default_rng(0))
    assert components == ["synchrotron", "free-free"] and pysm3.asked == [(512, ["s1", "f1"])]


def test_one_index_for_all_pixels(pysm3, tmp_path, monkeypatch):
    monkeypatch.setattr(sys.modules[__name__], "INDEX", -3.0)
    write_templates(tmp_path, NSIDE)
    (index,) = read_maps(tmp_path / "synchrotron_beta_nside16.fits").maps
    assert sphere.nside_of(index) == NSIDE and (index == -3).all()


def test_another_free_free_index_has_no_place_in_files(pysm3, tmp_path):
    pysm3.free_free_index = -2.1
    with pytest.raises(InputError, match="free-free index of -2.14.*source='pysm3'"):
        write_templates(tmp_path / "maps", NSIDE)
    assert names(tmp_path) == []


def test_a_folder_that_holds_something_is_not_changed(pysm3, tmp_path):
    (tmp_path / "notes.txt").write_text("mine")
    with pytest.raises(InputError, match="new or an empty folder, but .* holds notes.txt; give another"):
        write_templates(tmp_path, NSIDE)
    assert names(tmp_path) == ["notes.txt"]
    write_templates(tmp_path / "maps", NSIDE)
    with pytest.raises(InputError, match=f"holds {', '.join(FILES)}; give"):
        write_templates(tmp_path / "maps", NSIDE)
    with pytest.raises(InputError, match=r"notes.txt cannot be a folder of templates \(Not a directory\)"):
        write_templates(tmp_path / "notes.txt", NSIDE)


def test_three_files_or_none(pysm3, tmp_path, monkeypatch):
    write_maps, written = templates.write_maps, []

    def fail_at_the_third(path, *args, **options):
        if len(written) == 2:
            raise OSError(28, "No space left on device")
        written.append(path)
        write_maps(path, *args, **options)

    monkeypatch.setattr(templates, "write_maps", fail_at_the_third)
    with pytest.raises(InputError, match="cannot be written .No space left"):
        write_templates(tmp_path / "maps", NSIDE)
    assert len(written) == 2 and names(tmp_path / "maps") == []


@pytest.mark.parametrize(("nside", "message"), [(48, "try 32 or 64"), (1024, "between 4 and 512, got 1024")])
def test_an_nside_that_cannot_be(pysm3, tmp_path, nside, message):
    with pytest.raises(InputError, match=message):
        write_templates(tmp_path / "maps", nside)
    assert names(tmp_path) == []


class TestCommand:
    def test_files_are_named(self, pysm3, himap_command, tmp_path):
        code, out, err = himap_command("templates", "maps", "--nside", "16")
        assert (code, err) == (0, "") and names(tmp_path / "maps") == FILES
        *paths, checksum, last = out.splitlines()
        assert sorted(paths) == [f"maps/{name}" for name in FILES]
        assert checksum == f"checksum {digest_of(tmp_path / 'maps')}"
        assert last.startswith("for -p galaxy=templates -p template_dir=maps  (")

    @pytest.mark.parametrize(
        ("installed", "reason"),
        [(False, "cannot be imported"), (True, "could not download its templates (no route to host)")],
    )
    def test_without_pysm3_or_network(self, pysm3, himap_command, tmp_path, monkeypatch, installed, reason):
        def sky(**options):
            raise OSError("no route to host")

        pysm3.Sky = sky
        monkeypatch.setitem(sys.modules, "pysm3", pysm3 if installed else None)
        code, out, err = himap_command("templates", "maps")
        assert (code, out) == (2, "") and reason in err and "Traceback" not in err
        assert all(word in err for word in ("pip install", "go online once", "'synthetic'", "'templates'"))
        assert names(tmp_path) == []
