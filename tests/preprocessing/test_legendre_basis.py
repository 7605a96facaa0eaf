import numpy as np
import pytest

from pliant.preprocessing.curvature import legendre_basis, legendre_integrals, legendre_roughness


@pytest.mark.parametrize("terms", [1, 2, 5, 12])
def test_integrals_and_roughness_by_quadrature(terms):
    length = 0.17
    fine = np.linspace(0, length, 20001)
    values = legendre_basis(fine, length, terms)
    h = fine[1]
    summed = np.concatenate((np.zeros((1, terms)), np.cumsum((values[1:] + values[:-1]) / 2 * h, axis=0)))
    np.testing.assert_allclose(legendre_integrals(fine, length, terms), summed, atol=2e-8)
    second = np.gradient(np.gradient(values, h, axis=0, edge_order=2), h, axis=0, edge_order=2)
    approximate = np.trapezoid(second[:, :, None] * second[:, None, :], dx=h, axis=0)
    exact = legendre_roughness(length, terms)
    np.testing.assert_allclose(exact, approximate, rtol=2e-2, atol=1e-4 * max(exact.max(), 1))
    assert (np.linalg.eigvalsh(exact) > -1e-9 * max(exact.max(), 1)).all()
