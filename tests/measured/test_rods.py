"""Chains in space against rods: closed forms, published tips, and shapes and decays of a Cosserat rod."""

from __future__ import annotations

import numpy as np
import pytest
import rods


@pytest.mark.parametrize(("n", "bound"), [(3, 3.2), (5, 1.2), (8, 0.5)])
def test_the_bend_of_45_degrees(n, bound):
    """Tips of other programs with 8 to 32 elements, out of the plane of the rest shape."""
    for force, tip in rods.BEND.items():
        assert np.linalg.norm(rods.bend(n, force) - tip) < bound / 100 * 25 * np.pi


def test_two_circles():
    """Each joint of the roll-up turns by its part of 4 pi, and the polygon closes."""
    found, exact = rods.end_moment(5, 2.0, np.array([0.0, 0.0, 8 * np.pi]))
    np.testing.assert_allclose(exact, 0.0, atol=1e-15)
    np.testing.assert_allclose(found, exact, atol=1e-12)


def test_a_helix_is_reached_with_the_square_of_the_number_of_links():
    errors = []
    for n in (8, 16):
        found, exact = rods.end_moment(n, 2.0, 4 * np.pi * np.array([0.6, 0.8, 0.0]))
        errors.append(np.linalg.norm(found - exact))
    assert errors[0] < 0.016
    assert np.log2(errors[0] / errors[1]) == pytest.approx(2.0, abs=0.1)


@pytest.mark.parametrize("name", rods.RODS)
@pytest.mark.parametrize(("n", "bound"), [(5, 0.8), (8, 0.3)])
def test_static_shapes(shared_data, monkeypatch, name, n, bound):
    """Every fiftieth shape."""
    monkeypatch.setattr(rods, "DATA", shared_data / "spatial_rod_reference")
    assert np.median(rods.static_errors(name, n, 50)) < bound


@pytest.mark.parametrize(("name", "number"), [("SpringSteel", 1), ("TPU", 3)])
def test_free_decays(shared_data, monkeypatch, name, number):
    monkeypatch.setattr(rods, "DATA", shared_data / "spatial_rod_reference")
    rms, first = rods.decay_errors(name, number, 8)
    assert rms < 2.0
    assert abs(first) < 1.0
