"""Appendix A: correlation with the truth, and the scatter of errors (Figs. A.1 and A.2)."""

import numpy as np

from himap.paper.claims.base import METHODS, claim, listing
from himap.paper.claims.verdicts import CONSISTENT, Finding, Part

_APPENDIX = {"section": "A", "notebook": "14_diagnostics"}


@claim(
    "A1", "oscillating", "SD has the highest correlation with the truth, consistently over frequency.",
    number="share of channels where SD is highest", paper="1", figure="A.1", **_APPENDIX,
)  # fmt: skip
def correlation_highest(realisation):
    """Consistently is in 95 % of the channels or more: the main part. Another: highest on average over
    them.
    """
    values = {short: realisation.correlation(name) for name, short in METHODS.items()}
    others = np.max([row for name, row in values.items() if name != "SD"], axis=0)
    share = float(np.mean(values["SD"] >= others))
    means = {name: row.mean() for name, row in values.items()}
    return Finding(
        value=share,
        parts=(
            Part(name="SD highest in 95 % of the channels", held=share >= CONSISTENT),
            Part(name="SD highest on average", held=max(means, key=means.get) == "SD", main=False),
        ),
        sentence=f"SD is highest in {share:.0%} of the channels; mean r: {listing(means, '{:.4f}')}.",
    )


@claim(
    "A2", "oscillating", "SD has the smallest variance of R_l for 10 <= l <= 200.",
    number="share of l where SD is smallest", paper="1", figure="A.2", **_APPENDIX,
)  # fmt: skip
def variance_smallest(realisation):
    """Smallest over a range is read as consistently so, at 95 % of the l or more: the main part. Another:
    smallest on average, the geometric mean over l.
    """
    values = {}
    for name, short in METHODS.items():
        degrees = realisation.of("oscillating")[name].degrees
        values[short] = realisation.variance(name)[(degrees >= 10) & (degrees <= 200)]
    others = np.min([row for name, row in values.items() if name != "SD"], axis=0)
    share = float(np.mean(values["SD"] <= others))
    means = {name: float(np.exp(np.mean(np.log(row)))) for name, row in values.items()}
    return Finding(
        value=share,
        parts=(
            Part(name="SD smallest at 95 % of the l", held=share >= CONSISTENT),
            Part(name="SD smallest on average", held=min(means, key=means.get) == "SD", main=False),
        ),
        sentence=f"SD is smallest at {share:.0%} of the l; mean variance: {listing(means, '{:.2g}')}.",
    )
