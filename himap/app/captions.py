"""What a caption says of the paper's figure that it is, ``(the paper's Fig. A.1)``, or has a share in."""

import re

_REMARK = r"the paper's Fig\. ([\w.]*\w)"


def paper_figure(caption):
    """The number of the paper's figure that this one is, such as "A.2"; empty if it is none."""
    number = re.search(rf"\({_REMARK}", caption)
    return number[1] if number else ""


def named_figures(caption):
    """The numbers of all figures of the paper that a caption names, those that it has a share in too."""
    return re.findall(_REMARK, caption)


def plain_caption(caption):
    """A caption without the remark which figure of the paper it is, and without what begins after it."""
    return re.sub(rf" \({_REMARK}[^)]*\)", "", caption).partition(". ")[0].rstrip(".")


def figure_order(number):
    """Key that sorts numbers of the paper's figures: 1 to 7, then those of the appendices."""
    appendix, _, count = number.rpartition(".")
    return appendix, int(count)
