"""Appendix A: correlation with the truth, and the scatter of errors (Figs. A.1 and A.2)."""

import numpy as np

from himap.paper.claims.base import METHODS, Finding, claim, listing

__all__ = ["correlation_highest", "variance_smallest"]

_APPENDIX = {"section": "A", "notebook": "14_diagnostics"}


@claim(
    "A1", "oscillating", "SD has the highest correlation with the truth at every frequency.",
    number="share of channels where SD is highest", paper="1", figure="A.1", **_APPENDIX,
)  # fmt: skip
def correlation_highest(realisation):
    """Parts: highest on average over channels; highest in every channel."""
    values = {short: realisation.correlation(name) for name, short in METHODS.items()}
    others = np.max([row for name, row in values.items() if name != "SD"], axis=0)
    share = float(np.mean(values["SD"] >= others))
    means = {name: row.mean() for name, row in values.items()}
    return Finding(
        value=share,
        parts={
            "highest on average": max(means, key=means.get) == "SD",
            "highest in every channel": share == 1,
        },
        sentence=f"SD is highest in {share:.0%} of the channels; mean r: {listing(means, '{:.4f}')}.",
    )


@claim(
    "A2", "oscillating", "SD has the smallest variance of R_l for 10 <= l <= 200.",
    number="share of l where SD is smallest", paper="1", figure="A.2", **_APPENDIX,
)  # fmt: skip
def variance_smallest(realisation):
    """Parts: smallest on average (geometric mean over l); smallest at every l."""
    degrees = realisation.of("oscillating")["sdecgmca"].degrees
    inside = (degrees >= 10) & (degrees <= 200)
    values = {short: realisation.variance(name)[inside] for name, short in METHODS.items()}
    others = np.min([row for name, row in values.items() if name != "SD"], axis=0)
    share = float(np.mean(values["SD"] <= others))
    means = {name: float(np.exp(np.mean(np.log(row)))) for name, row in values.items()}
    return Finding(
        value=share,
        parts={"smallest on average": min(means, key=means.get) == "SD", "smallest at every l": share == 1},
        sentence=f"SD is smallest at {share:.0%} of the l; mean variance: {listing(means, '{:.2g}')}.",
    )
