"""Section 1: how much brighter the foregrounds are than HI."""

import numpy as np

from himap.paper.claims.base import claim
from himap.paper.claims.verdicts import Finding, Part

_LEAST, _LARGEST = 4, 5  # orders of magnitude


@claim(
    "F1", "none", "The foregrounds are 4 to 5 orders of magnitude above HI, at high latitude too.",
    number="log10 of the rms of the foregrounds over that of HI, all sky", paper="4 to 5",
    section="1", figure="", notebook="01_simulations",
)  # fmt: skip
def foregrounds_above_hi(realisation):
    """Of brightness temperatures, before the beam: the root mean square over channels and pixels of all
    foregrounds together over that of HI, mean brightness included. Its log10 lies from 4 to 5: over all the
    sky, and at |b| > 30 deg. Two parts, both main.
    """
    orders, words = {}, []
    for region, (foregrounds, hi) in realisation.brightness().items():
        orders[region] = float(np.log10(foregrounds / hi))
        words.append(f"{region} {orders[region]:.3g} (foregrounds {foregrounds:.3g} mK, HI {hi:.3g} mK)")
    return Finding(
        value=orders["all sky"],
        parts=tuple(
            Part(name=f"4 to 5 orders, {region}", held=_LEAST <= value <= _LARGEST)
            for region, value in orders.items()
        ),
        sentence=f"Orders of magnitude: {', '.join(words)}.",
    )
