"""Captions that say which figure of the paper they are."""

import pytest

from himap.app.captions import figure_order, named_figures, paper_figure, plain_caption

WHOLE = "Pearson r, for six methods (the paper's Fig. A.1). Left: all."
SHARE = "Angular power spectrum. (PCA's share of the paper's Fig. 1.)"


@pytest.mark.parametrize(
    ("caption", "whole", "named"), [(WHOLE, "A.1", ["A.1"]), (SHARE, "", ["1"]), ("A map.", "", [])]
)
def test_numbers(caption, whole, named):
    assert paper_figure(caption) == whole
    assert named_figures(caption) == named


def test_plain():
    assert plain_caption(WHOLE) == "Pearson r, for six methods"
    assert plain_caption("A map.") == "A map"


def test_order():
    assert sorted(["B.1", "7", "A.2", "1", "A.1"], key=figure_order) == ["1", "7", "A.1", "A.2", "B.1"]
