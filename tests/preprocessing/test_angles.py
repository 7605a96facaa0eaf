"""Angles without places: brought to the rest pose and the side of the pressure; the steps that sensors count in."""

from __future__ import annotations

import numpy as np
import pytest

from pliant.preprocessing.angles import angle_facts, angle_sentences, from_rest, turns_back
from pliant.recording import make_recording

TIME = np.arange(0.0, 2.0, 0.01)
BEND = np.clip((TIME - 0.5) / 0.3, 0.0, 1.0)


def angles(*columns, pressure=None, **more):
    """A recording of angles [rad] alone."""
    if pressure is not None:
        more |= {"pressure": pressure, "pressure_time": TIME}
    names = [f"s{k + 1}" for k in range(len(columns))]
    return make_recording(TIME, angle=np.stack(columns, axis=1), station=names, frame="planar", **more)


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_angles_start_at_zero_and_turn_with_the_pressure(side):
    ds = angles(0.3 + side * 0.5 * BEND, -0.2 + 0.8 * BEND, pressure=4e4 * BEND)
    made = from_rest(ds)
    np.testing.assert_allclose(made["angle"], np.stack([0.5 * BEND, 0.8 * BEND], axis=1), atol=1e-12)
    assert made["angle"].attrs["reference"] == "rest"
    told = made.attrs["history"]
    assert "subtracted degrees: s1 17.2, s2 -11.5" in told
    assert ("positive pressure turned s1 to the negative side: the sign was changed" in told) == (side < 0)
    np.testing.assert_allclose(ds["angle"][:, 0], 0.3 + side * 0.5 * BEND)  # what was given stays


def test_the_rest_that_is_given_is_taken_and_gaps_in_it_are_passed_over():
    column = 0.1 + 0.5 * BEND
    column[:30] = np.nan
    late = from_rest(angles(column, pressure=4e4 * BEND), rest=(1.0, 1.5))
    assert np.nanmax(np.abs(late["angle"][100:])) < 1e-12
    assert "rest at 1 to 1.5 s" in late.attrs["history"]
    blind = np.where(TIME < 0.45, np.nan, 0.1 + 0.5 * BEND)  # never seen at rest: nothing to take off
    np.testing.assert_allclose(from_rest(angles(blind), rest=(0.0, 0.4))["angle"][:, 0], blind)


def test_without_a_pressure_the_larger_side_is_positive():
    angle = 0.4 * BEND
    assert not turns_back(angles(angle), angle)
    assert turns_back(angles(angle), -angle)
    assert turns_back(angles(angle), np.where(TIME < 0.2, 0.1, -angle))
    assert not turns_back(angles(angle), np.full(TIME.size, np.nan))
    two = np.stack([4e4 * BEND, np.zeros(TIME.size)], axis=1)
    ds = angles(angle, pressure=two, chamber=["a", "b"])
    assert not turns_back(ds, -angle)  # of several chambers each may bend to its own side


def test_a_sensor_that_counts_in_coarse_steps_is_told_with_its_noise():
    step = np.radians(0.5)
    coarse, fine = step * np.round(0.3 * np.sin(6 * TIME) / step), 0.3 * np.sin(6 * TIME)
    facts = angle_facts(angles(coarse, fine))
    assert facts["step_deg"] == pytest.approx({"s1": 0.5})
    assert facts["noise_deg"]["s1"] == pytest.approx(0.5 / np.sqrt(12))
    assert facts["noise_deg"]["s2"] < 0.01
    assert facts["stations"] == 2
    (line,) = angle_sentences(facts["step_deg"])
    assert line == "the angle of s1 has a resolution of 0.5 degrees, which acts as 0.14 degrees of noise"
    assert angle_facts(angles(np.where(TIME < 0.1, np.nan, fine)))["missing"] == {"s1": 10}
