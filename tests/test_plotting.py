"""Figures: what they show is where it should be. How they look was looked at."""

import matplotlib
import numpy as np
import pytest

matplotlib.use("agg")

from himap.figures import plotting, styles
from himap.figures.axes import label_ends
from himap.instrument import beams
from himap.instrument.beams import Degraded
from himap.maps import sphere
from himap.paper.methods import methods_for


def test_mollweide_puts_the_sky_where_it_belongs():
    """Centre, left of it (l = 90 deg), top (the north pole), outside."""
    lon, lat = plotting.mollweide(401)
    assert (lon[100, 200], lat[100, 200]) == pytest.approx((0, 0), abs=1.5)
    assert (lon[100, 100], lat[100, 100]) == pytest.approx((90, 0), abs=1.5)
    assert lat[199, 200] == pytest.approx(90, abs=1)
    assert np.isnan(lon[2, 2])


def test_mollweide_has_equal_areas():
    lon, lat = plotting.mollweide(800)
    inside = np.isfinite(lon)
    assert (np.abs(lat[inside]) < 30).mean() == pytest.approx(0.5, abs=0.01)


def test_sky_map_shows_the_map():
    nside = 8
    pixels = sphere.pixel_latitude(nside)
    figure = plotting.sky_maps({"north": pixels, "log": pixels + 91}, unit="deg", log={"log": True})
    panels = [axes for axes in figure.axes if axes.images]
    assert [axes.get_title() for axes in panels] == ["north [deg]", "log [deg]"]
    image = panels[0].images[0].get_array()
    assert image[-20, image.shape[1] // 2] > 60
    assert image[20, image.shape[1] // 2] < -60


PANEL = {"title": "a", "xlabel": "l", "ylabel": "C", "ratio_label": "ratio"}


def test_panels_of_one_unit_share_their_scale_and_others_do_not():
    k = np.arange(1.0, 5.0)
    one = PANEL | {"true": (k, k), "curves": []}
    shared = plotting.spectrum([one, one | {"true": (k, 100 * k)}]).axes
    own = plotting.spectrum([one, one | {"true": (k, 100 * k), "ylabel": "P"}]).axes
    assert shared[0].get_ylim() == shared[1].get_ylim()
    assert own[0].get_ylim() != own[1].get_ylim()
    assert [axes.get_ylabel() for axes in own[:2]] == ["C", "P"]
    assert [axes.get_ylabel() for axes in shared[:2]] == ["C", ""]


def test_spectrum_draws_ratios_and_aligns_its_panels():
    x = np.arange(1.0, 100)
    style = {"label": "method", "color": "C0"}
    panel = PANEL | {"true": (x, x**-2), "curves": [(style, x, 1.1 * x**-2, x**-2)], "x_limits": (2, 50)}
    figure = plotting.spectrum([panel])
    top, bottom = figure.axes
    assert bottom.lines[-1].get_ydata() == pytest.approx(1.1)
    assert bottom.lines[-1].get_xdata()[[0, -1]] == pytest.approx([2, 50])
    figure.draw_without_rendering()
    assert top.get_position().x0 == pytest.approx(bottom.get_position().x0)
    assert [label.get_text() for label in bottom.get_xticklabels()] == ["2", "5", "10", "20", "50"]


def test_zero_is_left_off_a_logarithmic_axis():
    k = np.arange(5.0)
    figure = plotting.spectrum([PANEL | {"true": (k, k + 1), "curves": []}])
    assert figure.axes[0].lines[0].get_xdata()[0] == 1


def test_lines_takes_points_and_legends():
    panel = {
        "curves": [([0, 1], [0, 1], {"label": "line"})],
        "points": [([0, 1], [1, 0], {"label": "points"})],
        "legend": {"ncols": 2},
        "title": "both",
    }
    figure = plotting.lines([panel, panel, panel])
    drawn = [axes for axes in figure.axes if axes.get_visible()]
    assert len(drawn) == 3
    assert drawn[0].get_title() == "both"
    assert [text.get_text() for text in drawn[0].get_legend().get_texts()] == ["line", "points"]
    assert drawn[0].lines[1].get_linestyle() == "None"


def test_a_bundle_is_all_its_curves_with_one_name():
    """All are drawn, below the curves and faint; the legend shows one, and the numbers are percentiles."""
    x, ys = np.arange(3.0), np.outer(np.arange(101.0), [1, 2, -1])
    style = {"color": "red", "alpha": 0.02, "linewidth": 0.5, "label": "all 101"}
    panel = {"bundles": [(x, ys, style)], "curves": [(x, x, {"label": "one"})], "title": "P"}
    figure = plotting.lines([panel])
    (axes, *_) = figure.axes
    (bundle,) = axes.collections
    assert np.array_equal([segment[:, 1] for segment in bundle.get_segments()], ys)
    assert bundle.get_rasterized() and bundle.get_alpha() == 0.02
    assert all(bundle.get_zorder() < line.get_zorder() for line in axes.lines)
    assert axes.get_ylim()[0] <= -100 and axes.get_ylim()[1] >= 200
    handles, labels = axes.get_legend_handles_labels()
    assert labels == ["all 101", "one"] and handles[0].get_alpha() == 1
    rows = figure._repr_mimebundle_()["text/csv"].splitlines()[1:]
    kept = [row for row in rows if row.startswith("P,all 101")]
    assert len(rows) == 3 + len(kept) == 3 + 5 * 3
    assert kept[3:6] == ["P,all 101: 5 %,0,5", "P,all 101: 5 %,1,10", "P,all 101: 5 %,2,-95"]
    nothing = plotting.lines([panel | {"bundles": [(x, ys[:0], style)]}])
    assert len(nothing._repr_mimebundle_()["text/csv"].splitlines()) == 4


def test_image():
    figure = plotting.image(np.eye(4), x=np.arange(4.0), y=np.arange(4.0), xlabel="x", ylabel="y", unit="mK")
    assert figure.axes[0].images[0].get_extent() == [0, 3, 0, 3]


def test_stamp():
    figure = plotting.stamp(plotting.lines([{"curves": []}]), "made by a test")
    assert figure.get_supxlabel() == "made by a test"


def test_figures_are_left_to_the_caller():
    before = len(matplotlib.pyplot.get_fignums())
    plotting.lines([{"curves": []}])
    assert len(matplotlib.pyplot.get_fignums()) == before


def test_every_method_and_beam_has_a_style():
    """Of those that come with himap; a method that somebody adds gets its name and a grey of its own."""
    others = {"beam_subspace", "smooth_spectra", "gnilc", "gaussian_process"}
    assert {method.name for method in methods_for(Degraded())} | others == set(styles.METHOD_STYLES)
    assert set(beams.available()) == {*styles.BEAM_STYLES, "file"}
    for of in (styles.METHOD_STYLES, styles.BEAM_STYLES):
        looks = [(style["color"], style["linestyle"]) for style in of.values()]
        assert len({colour for colour, _ in looks}) == len(looks)
        assert len({line for _, line in looks}) == len(looks)


def test_methods_of_our_own_are_darker_than_the_others():
    """So they stand apart in grey too, between these and the black of the truth."""
    weights = 0.299, 0.587, 0.114
    grey = {
        name: np.dot(matplotlib.colors.to_rgb(style["color"]), weights)
        for name, style in styles.METHOD_STYLES.items()
    }
    subspace, smooth = grey.pop("beam_subspace"), grey.pop("smooth_spectra")
    assert 0.1 < subspace < min(grey.values()) - 0.1
    assert subspace + 0.05 < smooth < min(grey.values()) - 0.05


def test_a_sequence_gets_lighter_and_neighbours_differ_in_their_dashes():
    looks = styles.sequence(["2", "3", "5", "6", "7", "10", "20"])
    grey = [np.dot(style["color"][:3], (0.299, 0.587, 0.114)) for style in looks]
    assert np.diff(grey).min() > 0.05 and max(grey) < 0.85
    assert all(one["linestyle"] != two["linestyle"] for one, two in zip(looks, looks[1:], strict=False))
    assert [style["label"] for style in looks][-1] == "20"
    assert len(styles.sequence(["only"])) == 1


def test_short_logarithmic_axes_have_plain_ticks():
    panel = {"curves": [([2, 128], [1, 2], {})], "xscale": "log", "xlim": (2, 128)}
    axes = plotting.lines([panel]).axes[0]
    axes.figure.draw_without_rendering()
    labels = [label.get_text() for label in (*axes.get_xticklabels(), *axes.get_xticklabels(minor=True))]
    assert [label for label in labels if label] == ["2", "5", "10", "20", "50", "100"]


def test_ratios_of_spectra_are_all_there():
    """On one axis in all panels, however far from 1, and 20 % about it in any case."""
    k = np.arange(1.0, 4.0)
    near = PANEL | {"true": (k, k), "curves": [({"label": "PCA"}, k, 1.01 * k, k)]}
    far = PANEL | {"true": (k, k), "curves": [({"label": "PCA"}, k, 1e6 * k, k)]}
    for panels, top in (([near], 1.2), ([near, far], 1e6)):
        axes = plotting.spectrum(panels).axes[len(panels) :]
        assert {one.get_yscale() for one in axes} == {"function"}
        assert {one.get_ylim()[0] for one in axes} == {0.8}
        assert all(top <= one.get_ylim()[1] < 10 * top for one in axes)


def test_a_truth_of_its_own_is_kept_with_a_curve():
    """A method that ends at some l is compared with a truth that ends there."""
    k = np.arange(1.0, 4.0)
    curves = [({"label": "PCA"}, k, 2 * k, k), ({"label": "SD"}, k, 2 * k, 3 * k)]
    figure = plotting.spectrum([PANEL | {"true": (k, k), "curves": curves}])
    rows = figure._repr_mimebundle_()["text/csv"].splitlines()
    assert [row for row in rows if "truth" in row] == [f"a,SD: truth,{x},{3 * x}" for x in (1, 2, 3)]


def test_errors_are_even_about_zero():
    pixels = np.linspace(-1, 3, 768)
    figure = plotting.sky_maps({"error": pixels, "map": pixels}, diverging={"error": True})
    error, other = (axes.images[0] for axes in figure.axes[:2])
    assert error.norm.vmin == -error.norm.vmax and error.get_cmap().name == "RdBu_r"
    assert other.norm.vmin != -other.norm.vmax and other.get_cmap().name == "cividis"


def test_figures_of_curves_carry_their_numbers():
    k = np.arange(1.0, 4.0)
    style = {"label": "PCA"}
    spectrum = plotting.spectrum([PANEL | {"true": (k, k), "curves": [(style, k, 2 * k, k)]}])
    rows = spectrum._repr_mimebundle_()["text/csv"].splitlines()
    assert rows[:2] == ["panel,curve,x,y", "a,HI + noise,1,1"]
    assert rows[-1] == "a,PCA,3,6"
    points = {"curves": [([0, 1], [1 / 3, 5], {})], "points": [([2], [7], {"label": "one, two"})]}
    lines = plotting.lines([points])._repr_mimebundle_()["text/csv"].splitlines()
    assert lines[1:] == [",,0,0.33333", ",,1,5", ',"one, two",2,7']


@pytest.mark.parametrize("low", [11, 21, 70, 105])
@pytest.mark.parametrize("factor", [1.3, 2.2, 3.1, 4.5, 5.1, 8, 40, 110, 3000])
def test_a_logarithmic_bar_has_ticks_to_be_read(low, factor):
    pixels = np.geomspace(low, low * factor, 768)
    figure = plotting.sky_maps({"one": pixels}, log=True, limits=(0, 100))
    bar = figure.axes[-1]
    low, high = bar.get_xlim()
    ticks = [tick for tick in bar.get_xticks() if low <= tick <= high]
    assert 2 <= len(ticks) <= 7


def test_one_legend_above_all_panels_has_each_label_once():
    first = {"curves": [([1, 2], [1, 2], {"label": "a"}), ([1, 2], [2, 1], {"label": "b"})]}
    second = {"curves": [([1, 2], [1, 2], {"label": "a"}), ([1, 2], [2, 1], {"label": "_c"})]}
    figure = plotting.lines([first, second], legend_above=True)
    assert [text.get_text() for text in figure.legends[0].get_texts()] == ["a", "b"]
    assert not any(axes.get_legend() for axes in figure.axes)
    assert not plotting.lines([{"curves": [([1], [1], {})]}], legend_above=True).legends


def test_names_at_the_ends_of_curves_lie_apart_and_in_their_order():
    heights = {"low": 0.0, "middle": 9.9, "near": 9.95, "high": 10.0}
    panel = {"curves": [([1, 2], [1, y], {"label": f"_{name}"}) for name, y in heights.items()]}
    axes = plotting.lines([panel | {"ylim": (0, 10)}]).axes[0]
    label_ends(axes, gap=0.1)
    places = {text.get_text(): text.get_position()[1] for text in axes.texts}
    assert list(places) == list(heights)
    assert list(places.values()) == pytest.approx([0, 0.8, 0.9, 1])


def test_several_of_one_method_differ_in_lightness_and_in_their_lines():
    for name in ("pca", "sdecgmca", "beam_subspace"):
        looks = list(styles.of_methods([(name, n) for n in range(5)]).values())
        assert looks[0]["linestyle"] == styles.METHOD_STYLES[name]["linestyle"]
        assert len({look["linestyle"] for look in looks}) == 5
        lightness = [np.mean(look["color"]) for look in looks]
        assert lightness == sorted(lightness) and lightness[1] > lightness[0] + 0.1
    first, second = styles.of_methods([("pca", 5), ("pca", 6)]).values()
    assert (first["linestyle"], second["linestyle"]) == ("--", "-")
