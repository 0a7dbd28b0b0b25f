"""The parametric fit: exact on its own model, and nowhere worse than scipy's least squares."""

import numpy as np
import pytest
from scipy.optimize import least_squares

from himap.removal.parametric import Parametric

FREQS = np.linspace(902.5, 1397.5, 100)
X = FREQS / 1150


def model(first, second, beta):
    return first * X[:, None] ** -2.13 + second * X[:, None] ** np.asarray(beta)


@pytest.fixture
def truth(rng):
    """a1, a2 and beta of 200 lines of sight, as of a sky."""
    first, second = np.exp(rng.normal([[4.0], [7.0]], 1.0, (2, 200)))
    return np.stack([first, second, rng.uniform(-3.3, -2.5, 200)])


def clean(maps, **options):
    return Parametric(**options).clean(maps, freqs=FREQS)


def test_a_sky_of_two_power_laws_is_recovered(truth):
    cleaned = clean(model(*truth))
    first, second, beta = cleaned.separation.sources
    assert np.abs(cleaned.residual).max() < 1e-7 * model(*truth).max()
    # The maps are float32: their rounding, 3e-8, comes back a thousandfold in parameters that are nearly
    # degenerate, which is a property of the model and not of the fit.
    assert beta == pytest.approx(truth[2], abs=1e-3)
    assert first + second == pytest.approx(truth[0] + truth[1], rel=1e-6)
    assert second == pytest.approx(truth[1], rel=5e-3)
    assert not cleaned.separation.flagged.any()


def twin(line, bounds, weights=1.0):
    """The best of scipy's bounded fits from several starting points: its parameters and sum of squares."""
    root = np.sqrt(weights) * np.ones(len(line))

    def left(p):
        return root * (p[0] * X**-2.13 + p[1] * X ** p[2] - line)

    def jacobian(p):
        return root[:, None] * np.stack([X**-2.13, X ** p[2], p[1] * X ** p[2] * np.log(X)], axis=1)

    inf = np.inf
    limits = ([-inf, -inf, bounds[0]], [inf, inf, bounds[1]])
    tight = {"xtol": 1e-15, "ftol": 1e-15, "gtol": 1e-15, "x_scale": "jac", "max_nfev": 2000}
    fits = []
    for beta in np.linspace(*bounds, 7)[1:-1]:
        start = np.linalg.lstsq(np.stack([root * X**-2.13, root * X**beta], axis=1), root * line)[0]
        fits.append(least_squares(left, [*start, beta], jac=jacobian, bounds=limits, **tight))
    best = min(fits, key=lambda fit: fit.cost)
    return best.x, 2 * best.cost


@pytest.mark.parametrize(
    ("bounds", "weighted"),
    [((-4.0, -2.2), False), ((-3.0, -2.6), False), ((-6.0, -2.14), False), ((-4.0, -2.2), True)],
)
def test_the_minimum_is_that_of_scipy(truth, rng, bounds, weighted):
    """Noise of 1 % moves some lines of sight to the bounds; no sum of squares is above scipy's.

    With weights those of channels are unequal, a fifth have none, where the maps hold anything.
    """
    first, second, beta = truth[:, :24]
    weights = np.ones((len(FREQS), 24))
    if weighted:
        weights = rng.uniform(0.1, 10, weights.shape) * (rng.random(weights.shape) > 0.2)
    noise = rng.standard_normal(weights.shape) * np.geomspace(1e-4, 1e-2, 24) * (first + second)
    maps = model(first, second, beta) + noise / np.sqrt(np.maximum(weights, 0.1))
    given = np.where(weights > 0, maps, np.nan).astype(np.float32)
    method = Parametric(beta_min=bounds[0], beta_max=bounds[1])
    separation = method.clean(given, freqs=FREQS, weights=weights).separation
    fit = model(*separation.sources)
    assert separation.foreground.lines(slice(None)) == pytest.approx(fit, rel=1e-9)
    seen = np.where(weights > 0, given, 0).astype(float)
    squares = (weights * (seen - fit) ** 2).sum(axis=0)
    others = [twin(line, bounds, weight) for line, weight in zip(seen.T, weights.T, strict=True)]
    assert squares == pytest.approx([other[1] for other in others], rel=1e-6)
    inside = ~separation.flagged
    assert separation.sources[2][inside] == pytest.approx(
        np.array([x[2] for x, _ in others])[inside], abs=1e-4
    )
    assert inside.any() and (weighted or bounds[0] < -4 or not inside.all())


def test_a_line_of_sight_at_the_bound_is_flagged(truth):
    """Steeper than any power law within the bounds: the best beta is the bound, which is no warning."""
    truth[2, 5] = -4.6
    separation = clean(model(*truth)).separation
    assert np.flatnonzero(separation.flagged).tolist() == [5]
    assert separation.sources[2, 5] == -4
    assert separation.converged


def test_the_reference_frequency_changes_amplitudes_alone(truth):
    maps = model(*truth)
    at_1150, at_1000 = clean(maps), clean(maps, nu0=1000.0)
    assert at_1000.residual == pytest.approx(at_1150.residual, abs=1e-6 * maps.max())
    ratio = at_1000.separation.sources[1] / at_1150.separation.sources[1]
    assert ratio == pytest.approx((1000 / 1150) ** at_1000.separation.sources[2], rel=1e-4)


def test_mixing_is_the_derivative_at_the_median(truth):
    separation = clean(model(*truth)).separation
    middle = np.median(separation.sources, axis=1)
    for n, step in enumerate([1e-2, 1e-2, 1e-5]):
        up, down = middle.copy(), middle.copy()
        up[n] += step
        down[n] -= step
        slope = (model(*up[:, None]) - model(*down[:, None]))[:, 0] / (2 * step)
        assert separation.mixing[:, n] == pytest.approx(slope, rel=1e-6, abs=1e-6)


def test_no_second_power_law(truth):
    """Free-free emission alone says nothing about beta, and is removed all the same."""
    maps = model(truth[0], 0, -3.0)
    cleaned = clean(maps)
    assert np.abs(cleaned.residual).max() < 1e-6 * maps.max()
