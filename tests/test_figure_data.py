"""The numbers that figures carry."""

import base64
import io

import healpy
import matplotlib.figure
import numpy as np
import pytest

from himap.figures import data as figure_data
from himap.figures import plotting


def arrays(figure):
    """What the NPZ file of a figure holds."""
    ((kind, text),) = figure._repr_mimebundle_().items()
    assert figure_data.DATA_TYPES[kind] == "npz"
    with np.load(io.BytesIO(base64.b64decode(text)), allow_pickle=False) as file:
        return dict(file)


@pytest.fixture
def figure():
    return matplotlib.figure.Figure()


def test_maps_are_healpy_means_to_four_digits(figure, rng):
    maps = {"C/C0, a": 1e5 * rng.standard_normal(12 * 64**2), "b": rng.standard_normal(12 * 64**2)}
    file = arrays(figure_data.with_maps(figure, maps, ["mK", ""]))
    assert file["maps"].dtype == np.float32
    for mine, pixels in zip(file["maps"], maps.values(), strict=True):
        np.testing.assert_allclose(mine, healpy.ud_grade(pixels, 32), rtol=1.3e-4)
    assert list(file["titles"]) == list(maps) and list(file["units"]) == ["mK", ""]
    assert (str(file["ordering"]), str(file["coordinates"])) == ("RING", "Galactic")


def test_coarse_maps_stay_as_they_are(figure, rng):
    pixels = rng.lognormal(size=12 * 16**2)
    (mine,) = arrays(figure_data.with_maps(figure, {"a": pixels}, ["mK"]))["maps"]
    np.testing.assert_allclose(mine, pixels, rtol=1.3e-4)


def test_missing_pixels_do_not_count(figure):
    pixels = healpy.reorder(np.repeat(np.arange(12.0 * 32**2), 4), n2r=True)
    block = healpy.nest2ring(64, [4, 5, 6, 7, 8])
    pixels[block] = np.nan  # the whole of nested block 1, and a quarter of block 2
    (mine,) = arrays(figure_data.with_maps(figure, {"a": pixels}, [""]))["maps"]
    nested = healpy.reorder(mine, r2n=True)
    assert np.isnan(nested[1]) and np.isfinite(np.delete(nested, 1)).all()
    assert nested[2] == 2


def test_an_image_carries_its_axes():
    x, y = np.linspace(900, 1400, 5), np.linspace(-180, 180, 7)
    values = np.outer(y, x)
    figure = plotting.image(values, x=x, y=y, xlabel="x", ylabel="y", unit="mK")
    file = arrays(figure)
    np.testing.assert_allclose(file["values"], values, rtol=1.3e-4)
    np.testing.assert_allclose(file["x"], x, rtol=1.3e-4)
    assert file["values"].shape == (7, 5) and str(file["unit"]) == "mK"


def test_the_same_numbers_make_the_same_file(figure):
    pixels = {"a": np.arange(48.0)}
    one, two = (figure_data.with_maps(figure, pixels, [""])._repr_mimebundle_() for _ in range(2))
    assert one == two
