"""An axis of ratios: even near 1, so that 5 % can be seen, and logarithmic far from it.

A ratio r stands at asinh(ln(r) / w), w = `NEAR`: as r - 1 for what is nearer to 1 than w, and as the
logarithm of the logarithm beyond, so that a factor of ten million still is on the axis. A ratio and its
inverse are as far from 1.
"""

import numpy as np

NEAR = 0.1
"""Distance from 1, relative, within which the axis is even."""

_LEAST = 1e-4  # what is below is drawn there
_WANTED = (1, 10, 0.1, 1.1, 0.9, 1.2, 0.8, 2, 0.5, 100, 0.01, 1e4, 1e6, 1.5, 1e3, 0.3, 5, 1e8, 0.95, 1.05)
_APART = 0.06  # of the axis: two numbers beside it


def forward(ratio):
    """Where ratios stand on the axis."""
    return np.arcsinh(np.log(np.maximum(ratio, _LEAST)) / NEAR)


def backward(place):
    """The ratios at some places of the axis."""
    return np.exp(NEAR * np.sinh(place))


def limits_of(ratios, least=0.2):
    """(low, high) of an axis that shows all `ratios`, and 1 by this much on either side."""
    values = np.concatenate([[1.0], *map(np.ravel, ratios)])
    values = values[np.isfinite(values)]
    low, high = (forward(function(values)) for function in (np.min, np.max))
    room = 0.02 * (high - low)
    return (
        min(1 - least, float(backward(low - room))),
        max(1 + least, float(backward(high + room))),
    )


def ticks(low, high):
    """Ratios to write beside an axis from `low` to `high`, as many as find room, ascending."""
    height = forward(high) - forward(low)
    kept = []
    for ratio in _WANTED:
        apart = [abs(forward(ratio) - forward(other)) for other in kept]
        if low <= ratio <= high and min(apart, default=height) >= _APART * height:
            kept.append(ratio)
    return sorted(kept)
