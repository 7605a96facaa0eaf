"""Bands that grow away from the training: against closed forms, and not at all where a level was in training."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from pliant.identification.discrepancy import (
    BEYOND,
    FASTER,
    INSIDE,
    between,
    discrepancy,
    faster,
    rest_places,
    training_levels,
)
from pliant.identification.prediction import predict
from pliant.mechanics import mechanics_of
from pliant.model import Chamber, Extension, Model, Space, Valve, chain_model
from pliant.simulation import equilibrium

LAW = (3e-7, 3e-12)


@pytest.fixture(scope="module")
def body(truth: Model) -> Model:
    return truth.with_(torque=LAW, valve=Valve())


def lacking(model: Model, exp: Any, training: list[Any]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Discrepancy, modelled positions and pressure of a record under its own model."""
    made = predict(model, exp, {}, 2e-3)
    rows, pressure = made["position"], made["pressure"]
    return discrepancy(model, exp, {}, rows, pressure, training), rows, pressure[:, 0]


def test_levels_are_those_at_which_the_pressure_stayed(body: Model, traced: Any, pulse: Any) -> None:
    assert training_levels(body, [traced(body, "a", 6e4), traced(body, "b", 1.4e5)]) == pytest.approx([0, 6e4, 1.4e5])
    assert training_levels(body, [pulse(body, "p", 8e4)]).tolist() == [0.0, 8e4]


def test_what_the_model_curves_off_the_line_through_the_taught_levels(body: Model, traced: Any) -> None:
    """q = (a p + b p^2) / K against the chord: b (p - p1) (p - p2) / K, inside and beyond."""
    held = traced(body, "held", 2e5)
    levels = np.array([0.0, 6e4, 1.4e5])
    grid = np.array([0.0, 3e4, 6e4, 1e5, 1.4e5, 2e5])
    rests, straight = rest_places(body, held, grid, levels)
    for p, row, line in zip(grid, rests, straight, strict=True):
        low, high = ((0.0, 6e4) if p <= 6e4 else (6e4, 1.4e5))
        off = LAW[1] * (p - low) * (p - high) / body.stiffness
        for q, found in ((equilibrium(body, p), row), (equilibrium(body, p) - off, line)):
            assert found == pytest.approx(mechanics_of(body).stations(mechanics_of(body).coordinates(q))[0], abs=1e-12)
    assert between(np.array([1e5]), grid, rests)[0] == pytest.approx(rests[3])


def test_a_body_that_lengthens_rests_where_angles_and_strain_put_it(body: Model, traced: Any) -> None:
    """q = p A r / K and e = p A / EA, both straight in p: the tip by hand, and nothing that the model curves."""
    area, offset, axial = 2e-4, 2e-3, 300.0
    still = body.with_(rest_angle=np.zeros(body.n), gravity=(0.0, 0.0), base_angle=0.0)
    long = still.with_(chambers=(Chamber.at_offset(area, offset, np.ones(body.n)),), extensions=(Extension(axial),))
    held, grid = traced(body, "held", 1e5), np.array([0.0, 5e4, 1e5])
    rests, straight = rest_places(long, held, grid, np.array([0.0, 6e4, 1.4e5]))
    assert rests == pytest.approx(straight, abs=1e-9)
    for p, row in zip(grid, rests, strict=True):
        turns, stretch = np.cumsum(p * area * offset / body.stiffness), 1 + p * area / axial
        tip = body.points[-1]
        sides = stretch * np.append(body.link_length[:-1], tip.along)
        x = -(sides * np.sin(turns)).sum() - tip.across * np.cos(turns[-1])
        y = stretch * body.first_joint[1] + (sides * np.cos(turns)).sum() - tip.across * np.sin(turns[-1])
        assert row[-1] == pytest.approx([x, y], abs=1e-8)


@pytest.mark.slow
def test_a_body_in_space_that_bends_in_one_plane_lacks_what_the_planar_body_lacks(traced: Any) -> None:
    same = {"length": 0.12, "mass": 0.04, "links": 3, "stiffness": 0.9, "damping": 4e-3, "torque": LAW}
    plane = chain_model(**same, gravity=(0.5, -9.81))
    space = chain_model(**same, gravity=(0.0, 0.5, -9.81), space=Space())
    grid, levels = np.array([0.0, 3e4, 1e5, 2e5]), np.array([0.0, 6e4, 1.4e5])
    flat = rest_places(plane, traced(plane, "held", 2e5), grid, levels)
    solid = rest_places(space, traced(space, "held", 2e5), grid, levels)
    assert np.abs(flat[0] - flat[1]).max() > 1e-3
    for a, b in zip(flat, solid, strict=True):
        assert b[..., 1:] == pytest.approx(a, abs=1e-9)
        assert b[..., 0] == pytest.approx(np.zeros(a.shape[:-1]), abs=1e-12)


def test_a_band_is_as_it_was_where_the_level_was_taught_and_grows_beyond(body: Model, traced: Any) -> None:
    training = [traced(body, "low", 6e4), traced(body, "high", 1.4e5)]
    middle, _, pressure = lacking(body, traced(body, "held", 1e5), training)
    rests, straight = rest_places(body, training[0], np.array([1e5]), np.array([0.0, 6e4, 1.4e5]))
    assert middle[pressure > 9.99e4] == pytest.approx(INSIDE * np.abs(rests - straight)[[0] * 38], rel=0.05, abs=1e-7)
    known, _, pressure = lacking(body, training[1], training)
    plateau = pressure > 1.39e5
    assert known[plateau].max() < 1e-6
    sizes = []
    for level in (1.7e5, 2.0e5):
        found, rows, pressure = lacking(body, traced(body, "held", level), training)
        rests, straight = rest_places(body, training[0], np.array([level]), np.array([0.0, 6e4, 1.4e5]))
        last = np.flatnonzero(pressure > 0.999 * level)[-1]
        sizes.append(np.abs(found[last]).max())
        assert (found[last] >= 0.99 * BEYOND * np.abs(rests - straight)[0]).all()
        assert np.isfinite(found).all()
        assert found.shape == rows.shape
    assert sizes[1] > 1.5 * sizes[0] > 0


def test_a_straight_body_lacks_nothing_at_rest_and_speed_counts_beyond_what_was_taught(
    truth: Model, traced: Any,
) -> None:
    straight = truth.with_(valve=Valve(rise_time=0.2, fall_time=0.2))
    slow = [traced(straight, "slow", 1e5)]
    quick = truth.with_(valve=Valve())
    found, rows, pressure = lacking(quick, traced(quick, "quick", 1e5), slow)
    over = faster(traced(quick, "quick", 1e5), rows, slow)[:, 0, 0]
    assert over.max() > 0.3
    assert np.abs(found[over == 0]).max() < 1e-9
    grid = np.linspace(0.0, 1e5, 40)
    rest = between(pressure, grid, rest_places(quick, slow[0], grid, grid[[0, -1]])[0])
    top = int(np.argmax(over))
    assert found[top] == pytest.approx(FASTER * over[top] * np.abs(rows - rest)[top], rel=0.05, abs=1e-4)
