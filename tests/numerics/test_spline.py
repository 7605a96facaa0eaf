import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from pliant.numerics.spline import BOUNDARIES, local_cubic_matrix, polynomial_slope_weights, spline_matrix

KNOTS = np.array([0.0, 0.02, 0.07, 0.1, 0.17])


@pytest.mark.parametrize("derivative", [0, 1, 2, 3])
@pytest.mark.parametrize("boundary", BOUNDARIES)
def test_matrix_is_scipys_spline(boundary, derivative, rng):
    nodes = rng.normal(size=(KNOTS.size, 3))
    tangent = np.array([0.6, 0.0, 0.8])
    at = np.linspace(0, 0.17, 50)
    B, slope = spline_matrix(KNOTS, at, boundary, derivative)
    condition = ((1, tangent), "not-a-knot") if boundary == "clamped+not-a-knot" else boundary
    expected = CubicSpline(KNOTS, nodes, bc_type=condition)(at, derivative)
    np.testing.assert_allclose(B @ nodes + slope[:, None] * tangent, expected, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("boundary", BOUNDARIES)
def test_spline_passes_through_its_nodes(boundary):
    B, slope = spline_matrix(KNOTS, KNOTS, boundary)
    np.testing.assert_allclose(B, np.eye(KNOTS.size), atol=1e-12)
    np.testing.assert_allclose(slope, 0, atol=1e-14)


def test_clamped_spline_starts_along_the_given_tangent():
    B, slope = spline_matrix(KNOTS, KNOTS[:1], "clamped+not-a-knot", 1)
    np.testing.assert_allclose(B, 0, atol=1e-10)
    np.testing.assert_allclose(slope, 1, rtol=1e-12)


def test_a_cubic_is_reproduced_where_the_ends_allow_it():
    at = np.linspace(0, 0.17, 40)

    def cubic(x):
        return 1 + 2 * x - 30 * x**2 + 400 * x**3

    for boundary in ("not-a-knot", "clamped+not-a-knot"):
        B, slope = spline_matrix(KNOTS, at, boundary)
        np.testing.assert_allclose(B @ cubic(KNOTS) + slope * 2, cubic(at), rtol=1e-12)


def test_local_cubic_is_exact_for_cubics_and_at_stations():
    x = np.sort(np.random.default_rng(3).uniform(0, 1, 20))
    p = np.linspace(x[0], x[-1], 77)
    Q = local_cubic_matrix(x, p)
    for power in range(4):
        np.testing.assert_allclose(Q @ x**power, p**power, atol=1e-12)
    assert (np.count_nonzero(Q, axis=1) <= 4).all()
    np.testing.assert_array_equal(local_cubic_matrix(x, x), np.eye(20))


def test_slope_weights_are_exact_for_their_degree():
    x = np.array([0.1, 0.15, 0.3, 0.32])
    np.testing.assert_allclose(polynomial_slope_weights(x, 2) @ (3 + 5 * x - 7 * x**2), 5 - 14 * 0.1, rtol=1e-12)


def test_too_few_knots_and_unknown_ends_are_refused():
    with pytest.raises(ValueError, match="at least 3 knots"):
        spline_matrix([0, 1], [0], "natural")
    with pytest.raises(ValueError, match="boundary must be one of"):
        spline_matrix(KNOTS, [0], "periodic")
