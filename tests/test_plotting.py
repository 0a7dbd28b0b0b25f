"""Figures: what they show is where it should be, with its numbers. How they look was looked at."""

import base64
import csv
import io

import healpy
import matplotlib
import numpy as np
import pytest

matplotlib.use("agg")

from himap.figures import axes as scale
from himap.figures import data as figure_data
from himap.figures import planes, plotting, styles
from himap.instrument import beams
from himap.instrument.beams import Degraded
from himap.maps import sphere
from himap.measures.diagnostics import Comparison
from himap.paper.methods import methods_for

K = np.arange(1.0, 4.0)
PCA = {"label": "PCA"}
PANEL = {"title": "a", "xlabel": "l", "ylabel": "C", "ratio_label": "ratio", "true": (K, K), "curves": []}


def rows_of(figure):
    """The rows of the CSV that a figure carries, without their header."""
    (text,) = figure._repr_mimebundle_().values()
    header, *rows = csv.reader(io.StringIO(text))
    assert header == ["panel", "curve", "x", "y"]
    return rows


def arrays_of(figure):
    """What the NPZ file of a figure holds."""
    ((kind, text),) = figure._repr_mimebundle_().items()
    assert figure_data.DATA_TYPES[kind] == "npz"
    with np.load(io.BytesIO(base64.b64decode(text)), allow_pickle=False) as file:
        return dict(file)


def texts(items):
    return [item.get_text() for item in items if item.get_text()]


class TestSkyMaps:
    def test_mollweide_puts_the_sky_where_it_belongs(self):
        """Centre, left of it (l = 90 deg), top (the north pole), outside; and areas are equal."""
        lon, lat = plotting.mollweide(401)
        assert (lon[100, 200], lat[100, 200]) == pytest.approx((0, 0), abs=1.5)
        assert (lon[100, 100], lat[100, 100]) == pytest.approx((90, 0), abs=1.5)
        assert lat[199, 200] == pytest.approx(90, abs=1)
        assert np.isnan(lon[2, 2])
        assert (np.abs(lat[np.isfinite(lon)]) < 30).mean() == pytest.approx(0.5, abs=0.01)

    def test_they_show_the_map(self):
        pixels = sphere.pixel_latitude(8)
        figure = plotting.sky_maps({"north": pixels, "log": pixels + 91}, unit="deg", log={"log": True})
        panels = [axes for axes in figure.axes if axes.images]
        assert [axes.get_title() for axes in panels] == ["north [deg]", "log [deg]"]
        image = panels[0].images[0].get_array()
        assert image[-20, image.shape[1] // 2] > 60 and image[20, image.shape[1] // 2] < -60

    def test_errors_are_even_about_zero(self):
        pixels = np.linspace(-1, 3, 768)
        figure = plotting.sky_maps({"error": pixels, "map": pixels}, diverging={"error": True})
        error, other = (axes.images[0] for axes in figure.axes[:2])
        assert error.norm.vmin == -error.norm.vmax and error.get_cmap().name == "RdBu_r"
        assert other.norm.vmin != -other.norm.vmax and other.get_cmap().name == "cividis"

    @pytest.mark.parametrize("factor", [1.3, 2.2, 3.1, 4.5, 5.1, 8, 40, 110, 3000])
    def test_a_logarithmic_bar_has_ticks_to_be_read(self, factor):
        lows = (11, 21, 70, 105)
        maps = {str(low): np.geomspace(low, low * factor, 192) for low in lows}
        figure = plotting.sky_maps(maps, log=True, limits=(0, 100))
        for bar in figure.axes[len(lows) :]:
            low, high = bar.get_xlim()
            assert 2 <= sum(low <= tick <= high for tick in bar.get_xticks()) <= 7


class TestSpectrum:
    def test_panels_of_one_unit_share_their_scale_and_others_do_not(self):
        bright = PANEL | {"true": (K, 100 * K)}
        shared, own = (plotting.spectrum([PANEL, one]).axes for one in (bright, bright | {"ylabel": "P"}))
        assert shared[0].get_ylim() == shared[1].get_ylim()
        assert own[0].get_ylim() != own[1].get_ylim()
        assert [axes.get_ylabel() for axes in own[:2]] == ["C", "P"]
        assert [axes.get_ylabel() for axes in shared[:2]] == ["C", ""]

    def test_ratios_are_drawn_and_panels_aligned(self):
        x = np.arange(100.0)  # 0 is not on a logarithmic axis
        truth = x + 1
        curves = [(PCA, x, 1.1 * truth, truth)]
        figure = plotting.spectrum([PANEL | {"true": (x, truth), "curves": curves}])
        top, bottom = figure.axes
        assert bottom.lines[-1].get_ydata() == pytest.approx(1.1)
        assert bottom.lines[-1].get_xdata()[[0, -1]] == pytest.approx([1, 99])
        figure.draw_without_rendering()
        assert top.get_position().x0 == pytest.approx(bottom.get_position().x0)
        assert texts(bottom.get_xticklabels()) == ["1", "2", "5", "10", "20", "50"]

    def test_all_ratios_are_there(self):
        """On one axis in all panels, however far from 1, and 20 % about it in any case."""
        near, far = (PANEL | {"curves": [(PCA, K, factor * K, K)]} for factor in (1.01, 1e6))
        for panels, top in (([near], 1.2), ([near, far], 1e6)):
            axes = plotting.spectrum(panels).axes[len(panels) :]
            assert {one.get_yscale() for one in axes} == {"function"}
            assert {one.get_ylim()[0] for one in axes} == {0.8}
            assert all(top <= one.get_ylim()[1] < 10 * top for one in axes)

    def test_it_carries_its_numbers_and_another_truth(self):
        """A method that ends at some l is compared with a truth that ends there."""
        curves = [(PCA, K, 2 * K, K), ({"label": "SD"}, K, 2 * K, 3 * K)]
        rows = rows_of(plotting.spectrum([PANEL | {"curves": curves}]))
        assert rows[0] == ["a", "HI + noise", "1", "1"] and rows[5] == ["a", "PCA", "3", "6"]
        assert rows[-3:] == [["a", "SD: truth", f"{x}", f"{3 * x}"] for x in (1, 2, 3)]
        assert sum("truth" in name for _, name, *_ in rows) == 3

    def test_an_ensemble_is_a_median_a_band_and_its_members(self):
        """The median is not drawn away by one that failed, and the axis holds that one all the same."""
        members = np.array([[0.9], [1.0], [1.1], [1e4]]) * K
        curve = ({"label": "SD", "color": "red"}, K, members, np.tile(K, (4, 1)))
        figure = plotting.spectrum([PANEL | {"curves": [curve]}])
        _, bottom = figure.axes
        assert bottom.lines[-1].get_ydata() == pytest.approx(1.05)
        assert [line.get_ydata()[0] for line in bottom.lines[1:-1]] == pytest.approx([0.9, 1, 1.1, 1e4])
        assert bottom.get_ylim()[1] > 1e4
        low, high = np.percentile(members[:, 0], (16, 84))
        (band,) = [one for one in bottom.collections if len(one.get_paths()) == 1]
        ends = band.get_paths()[0].vertices[:, 1]
        assert (ends.min(), ends.max()) == pytest.approx((low, high))
        named = {name for _, name, *_ in rows_of(figure)} - {"HI + noise"}
        assert named == {
            f"SD: {one}" for one in ("16 %", "median", "84 %", *(f"restart {k}" for k in range(4)))
        }

    def test_members_whose_masks_differ_are_drawn_on_one_axis(self):
        def one(width, factor):
            degrees = np.arange(2.0, 40, width)
            k = np.arange(1.0, 9)
            true = {"true_angular": degrees, "true_frequency": k}
            return Comparison(degrees=degrees, angular=factor * degrees, k=k, frequency=factor * k, **true)

        panel = plotting.comparison_panel("angular", [(PCA, [one(2, 1), one(3, 2)]), (PCA, one(2, 3))])
        (_, x, recovered, true), (_, fine, single, _) = panel["curves"]
        assert x.tolist() == np.arange(2.0, 40, 3).tolist()
        assert recovered / true == pytest.approx(np.outer([1, 2], np.ones(len(x))))
        assert len(fine) == 19 and single == pytest.approx(3 * fine)


class TestLines:
    def test_points_legends_and_numbers(self):
        panel = {
            "curves": [([0, 1], [1 / 3, 5], {"label": "line"})],
            "points": [([2], [7], {"label": "one, two"})],
            "legend": {"ncols": 2},
            "title": "both",
        }
        figure = plotting.lines([panel, panel, panel])
        shown = [axes for axes in figure.axes if axes.get_visible()]
        assert [axes.get_title() for axes in shown] == ["both"] * 3
        assert texts(shown[0].get_legend().get_texts()) == ["line", "one, two"]
        assert shown[0].lines[1].get_linestyle() == "None"
        name = "both, panel 1"
        assert rows_of(figure)[1:3] == [[name, "line", "1", "5"], [name, "one, two", "2", "7"]]

    def test_a_bundle_is_all_its_curves_with_one_name(self):
        """All are drawn, below the curves and faint; the legend shows one, the numbers are percentiles."""
        x, ys = np.arange(3.0), np.outer(np.arange(101.0), [1, 2, -1])
        style = {"color": "red", "alpha": 0.02, "linewidth": 0.5, "label": "all 101"}
        panel = {"bundles": [(x, ys, style)], "curves": [(x, x, {"label": "one"})], "title": "P"}
        figure = plotting.lines([panel])
        (bundle,) = figure.axes[0].collections
        assert np.array_equal([segment[:, 1] for segment in bundle.get_segments()], ys)
        assert figure.axes[0].get_ylim()[0] <= -100 and figure.axes[0].get_ylim()[1] >= 200
        assert figure.axes[0].get_legend_handles_labels()[1] == ["all 101", "one"]
        kept = [row for row in rows_of(figure) if row[1].startswith("all 101")]
        assert len(kept) == 5 * 3
        assert kept[3:6] == [["P", "all 101: 5 %", str(n), y] for n, y in enumerate(("5", "10", "-95"))]
        assert len(rows_of(plotting.lines([panel | {"bundles": [(x, ys[:0], style)]}]))) == 3

    def test_a_legend_above_all_panels_has_each_label_once(self):
        panels = [{"curves": [(K, K, {"label": "a"}), (K, -K, {"label": name})]} for name in ("b", "_c")]
        figure = plotting.lines(panels, legend_above=True)
        assert texts(figure.legends[0].get_texts()) == ["a", "b"]
        assert not any(axes.get_legend() for axes in figure.axes)
        assert not plotting.lines([{"curves": [(K, K, {})]}], legend_above=True).legends

    def test_labels_at_the_ends_lie_apart_and_in_their_order(self):
        heights = {"low": 0.0, "middle": 9.9, "near": 9.95, "high": 10.0}
        panel = {"curves": [([1, 2], [1, y], {"label": f"_{name}"}) for name, y in heights.items()]}
        axes = plotting.lines([panel | {"ylim": (0, 10)}]).axes[0]
        scale.label_ends(axes)
        places = {text.get_text(): text.get_position()[1] for text in axes.texts}
        assert list(places) == list(heights)
        assert list(places.values()) == pytest.approx([0, 0.85, 0.925, 1])

    def test_it_is_closed_and_carries_a_stamp(self):
        before = len(matplotlib.pyplot.get_fignums())
        assert plotting.stamp(plotting.lines([{"curves": []}]), "by a test").get_supxlabel() == "by a test"
        assert len(matplotlib.pyplot.get_fignums()) == before


class TestRatios:
    @pytest.mark.parametrize("limits", [(0.8, 1.2), (0.5, 100), (1e-3, 1e7), (0.9, 1.1)])
    def test_numbers_find_room(self, limits):
        shown = scale.ratio_ticks(*limits)
        assert 1 in shown and len(shown) >= 3 and limits[0] <= shown[0] <= shown[-1] <= limits[1]
        assert np.diff(scale.forward(shown)).min() >= 0.06 * np.ptp(scale.forward(limits))

    def test_five_percent_are_seen_next_to_a_factor_of_ten_million(self):
        """On an axis of 300 pixels: more than 10 of them."""
        height = np.ptp(scale.forward(scale.ratio_limits([[0.9, 1e7]])))
        assert 300 * scale.forward(1.05) / height > 10

    def test_figure(self):
        mean = np.array([0.9, 1.0, 30])
        curves = [(np.array([2.0, 10, 100]), mean, 0.9 * mean, 1.1 * mean, {"label": "one", "color": "C0"})]
        panel = {"curves": curves, "title": "sky", "xlabel": "l"}
        figure = plotting.ratios([panel, panel | {"title": "other"}], columns=2)
        first, second = figure.axes
        assert first.get_ylim() == second.get_ylim() and first.get_ylim()[1] > 33
        assert texts(first.get_yticklabels())[:2] == ["0.8", "0.9"]
        assert len(figure.legends[0].get_texts()) == 1
        rows = rows_of(figure)
        assert ["sky", "one, middle", "100", "30"] in rows and ["sky", "one, high", "100", "33"] in rows


class TestMarks:
    LOOKS = {"good": ("✓", "#004400", "white"), "bad": ("✗", "#ffddbb", "black")}
    GROUPS = {
        "first": {"A1": [["good", "good"], ["good", "bad"]]},
        "second": {"A2": [["bad"], []], "A3": [["bad", "bad"], ["good"]]},
    }

    def test_signs_and_colours_are_in_their_cells(self):
        figure = planes.marks(self.GROUPS, ["one", "two"], self.LOOKS, breaks=[1])
        (axes,) = figure.axes
        signs = [(text.get_text(), *text.get_position()) for text in axes.texts if text.get_text() in "✓✗"]
        first = [("✓", 0.5, 1), ("✓", 1.25, 1), ("✗", 1.75, 1)]
        second = [("✗", 0.5, 3), ("✗", 0.5, 4), ("✓", 1.5, 4)]
        assert [(sign, x, int(y)) for sign, x, y in signs] == first + second
        colours = [matplotlib.colors.to_hex(patch.get_facecolor()) for patch in axes.patches]
        assert colours == [{"✓": "#004400", "✗": "#ffddbb"}[sign] for sign, *_ in first + second]
        assert texts(axes.get_legend().get_texts()) == ["✓ good", "✗ bad"]


class TestData:
    @pytest.mark.parametrize("differ", ["title", "ylabel", "xlabel", "number"])
    def test_panels_are_told_apart(self, differ):
        """Whatever differs, in figures of every kind: of a label, each x has one value in a panel."""
        look, pair = {"label": "PCA", "color": "red"}, []
        for n in (1, 2):
            same = {"title": "", "xlabel": "l", "ylabel": "C"}
            labels = {key: f"{n}" if key == differ else text for key, text in same.items()}
            curves = {"curves": [(K, n * K, look)], "bundles": [(K, [n * K, K], look)]}
            ranges = {"curves": [(K, n * K, K, K, look)]}
            spectra = PANEL | {"true": (K, n * K)}
            pair.append((labels | curves, labels | ranges, spectra | labels))
        draw = plotting.lines, plotting.ratios, plotting.spectrum
        for figure in (one(list(panels)) for one, panels in zip(draw, zip(*pair, strict=True), strict=True)):
            rows = rows_of(figure)
            assert len({tuple(row[:3]) for row in rows}) == len(rows) and len({row[0] for row in rows}) == 2

    def test_maps_are_healpy_means_to_four_digits(self, rng):
        maps = {"C/C0, a": 1e5 * rng.standard_normal(12 * 64**2), "b": rng.standard_normal(12 * 64**2)}
        maps |= {"coarse": rng.lognormal(size=12 * 16**2)}
        for title, pixels in maps.items():
            file = arrays_of(figure_data.with_maps(matplotlib.figure.Figure(), {title: pixels}, ["mK"]))
            expected = healpy.ud_grade(pixels, min(32, sphere.nside_of(pixels)))
            np.testing.assert_allclose(file["maps"][0], expected, rtol=1.3e-4)
            assert file["maps"].dtype == np.float32
            assert list(file["titles"]) == [title] and list(file["units"]) == ["mK"]
            assert (str(file["ordering"]), str(file["coordinates"])) == ("RING", "Galactic")

    def test_missing_pixels_do_not_count(self):
        pixels = healpy.reorder(np.repeat(np.arange(12.0 * 32**2), 4), n2r=True)
        pixels[healpy.nest2ring(64, [4, 5, 6, 7, 8])] = np.nan  # nested block 1, and a quarter of block 2
        (mine,) = arrays_of(figure_data.with_maps(matplotlib.figure.Figure(), {"a": pixels}, [""]))["maps"]
        nested = healpy.reorder(mine, r2n=True)
        assert np.isnan(nested[1]) and np.isfinite(np.delete(nested, 1)).all()
        assert nested[2] == 2

    def test_an_image_carries_its_axes(self):
        x, y = np.linspace(900, 1400, 5), np.linspace(-180, 180, 7)
        labels = {"xlabel": "x", "ylabel": "y", "unit": "mK"}
        figure, again = (plotting.image(np.outer(y, x), x=x, y=y, **labels) for _ in range(2))
        assert figure._repr_mimebundle_() == again._repr_mimebundle_()  # the same numbers make the same file
        extent = figure.axes[0].images[0].get_extent()  # pixels lie about their middles
        assert extent == pytest.approx([900 - 62.5, 1400 + 62.5, -180 - 30, 180 + 30])
        file = arrays_of(figure)
        for name, expected in {"values": np.outer(y, x), "x": x, "y": y}.items():
            np.testing.assert_allclose(file[name], expected, rtol=1.3e-4)
        assert str(file["unit"]) == "mK"


class TestStyles:
    def test_every_method_and_beam_has_a_style(self):
        """Of those that come with himap; a method that somebody adds gets its name and a grey of its own."""
        others = {"beam_subspace", "smooth_spectra", "gnilc", "gaussian_process"}
        assert {method.name for method in methods_for(Degraded())} | others == set(styles.METHOD_STYLES)
        assert set(beams.available()) == {*styles.BEAM_STYLES, "file"}
        for looks in (styles.METHOD_STYLES.values(), styles.BEAM_STYLES.values()):
            for key in ("color", "linestyle"):
                assert len({style[key] for style in looks}) == len(looks)

    def test_a_sequence_gets_lighter_and_neighbours_differ_in_their_dashes(self):
        looks = styles.sequence(["2", "3", "5", "6", "7", "10", "20"])
        rgb = [matplotlib.colors.to_rgb(style["color"]) for style in looks]
        grey = np.dot(rgb, (0.299, 0.587, 0.114))
        assert np.diff(grey).min() > 0.05 and max(grey) < 0.85
        assert all(one["linestyle"] != two["linestyle"] for one, two in zip(looks, looks[1:], strict=False))

    @pytest.mark.parametrize("name", ["pca", "sdecgmca", "beam_subspace"])
    def test_several_of_one_method_differ_in_lightness_and_in_their_lines(self, name):
        looks = list(styles.of_methods([(name, n) for n in range(5)]).values())
        assert looks[0]["linestyle"] == styles.METHOD_STYLES[name]["linestyle"]
        assert len({look["linestyle"] for look in looks}) == 5
        lightness = [np.mean(look["color"]) for look in looks]
        assert lightness == sorted(lightness) and lightness[1] > lightness[0] + 0.1
        assert name != "pca" or looks[1]["linestyle"] == "-"
