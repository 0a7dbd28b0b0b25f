"""The parametric fit: exact on its own model, and nowhere worse than scipy's least squares."""

import numpy as np
import pytest
from numpy.polynomial import chebyshev
from scipy.optimize import least_squares

from himap.removal import parametric
from himap.removal.data import Data
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
    ("bounds", "weighted"), [((-4.0, -2.2), False), ((-3.0, -2.6), False), ((-4.0, -2.2), True)]
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
    assert inside.any() and (weighted or not inside.all())


def test_channels_without_weight_are_as_if_they_were_not_there(truth, rng):
    maps = model(*truth) + rng.standard_normal((len(FREQS), 200))
    seen = np.arange(len(FREQS)) % 7 > 1
    weights = np.tile(seen[:, None].astype(float), 200)
    weights[:, 0] = 1  # one line of sight is whole, or the weights would be of pixels
    ours = Parametric().separate(Data.of(maps, freqs=FREQS, weights=weights))
    fewer = Parametric().separate(Data.of(maps[seen], freqs=FREQS[seen]))
    assert ours.sources[2, 1:] == pytest.approx(fewer.sources[2, 1:], abs=1e-7)
    whole = Parametric().separate(Data.of(maps, freqs=FREQS))
    assert ours.sources[:, 0] == pytest.approx(whole.sources[:, 0], rel=1e-7)


def test_the_highest_peak_is_found_in_pure_noise(rng):
    """The projections of noise have several peaks; the answer is above all values of a fine grid."""
    x = np.geomspace(0.2, 3, len(FREQS))  # a band so wide that there are many
    laws = parametric._TwoPowerLaws(x, -6.0, -2.14)
    series = laws.series(rng.standard_normal((len(FREQS), 500)), np.ones((len(FREQS), 1)))
    t, at_bound, converged, _ = parametric._highest(series)
    values = np.abs(chebyshev.chebval(np.linspace(-1, 1, 5001), series))
    heights = np.abs(parametric._value(t, series))
    assert (heights >= (1 - 1e-12) * values.max(axis=1)).all()
    assert np.array_equal(at_bound, np.abs(t) == 1)
    assert converged.all() and at_bound.any() and not at_bound.all()


def test_the_basis_is_exact_for_extreme_bands_and_indices():
    """The Chebyshev series of the second direction against the direction itself."""
    x = np.geomspace(0.2, 3, 60)
    laws = parametric._TwoPowerLaws(x, -6.0, -2.14)
    for t in np.linspace(-1, 1, 41):
        beta = laws.middle + laws.half * t
        both = np.stack([x**-2.13, x**beta], axis=1)
        q2 = chebyshev.chebval(t, laws.q2)
        assert [q2 @ q2, laws.q1 @ q2] == pytest.approx([1, 0], abs=1e-11)
        rest = q2 - both @ np.linalg.lstsq(both, q2, rcond=None)[0]
        assert np.abs(rest).max() < 1e-10


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
