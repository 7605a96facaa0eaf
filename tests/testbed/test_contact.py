"""Obstacles: forces where they are known, friction that only brakes."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from pliant.errors import InputError
from pliant.testbed.laboratory import Laboratory, run_rod
from pliant.testbed.rod import actuator
from pliant.testbed.scenarios import SCENARIOS, Circle, Wall, obstacle_rows


@cache
def moved(name):
    """The motion of a in the first 1.6 s of a scenario."""
    return run_rod(replace(SCENARIOS[name], duration=1.6), actuator("a"), Laboratory())


@cache
def free():
    """The same without an obstacle: the scenarios differ in theirs alone."""
    case = SCENARIOS["contact_wall"]
    return run_rod(replace(case, duration=1.6, obstacles=()), actuator("a"), Laboratory())


@pytest.mark.parametrize("name", ["contact_circle", "contact_wall", "contact_spring"])
def test_contact_pushes_away_from_the_obstacle_and_stops_the_body(name):
    m, case = moved(name), SCENARIOS[name]
    force = m.force[-1]
    touched = np.flatnonzero(np.linalg.norm(force, axis=1) > 1e-6)
    assert touched.size > 0
    item = case.obstacles[0]
    for node in touched:
        out = np.array(item.normal) if isinstance(item, Wall) else m.position[-1, node] - item.centre
        out /= np.linalg.norm(out)
        normal = force[node] @ out
        along = abs(force[node] @ [-out[1], out[0]])
        assert normal > 0
        assert along <= item.friction * normal * 1.02 + 1e-9
    assert 0.2 < np.linalg.norm(force.sum(axis=0)) < 3.0
    assert np.linalg.norm(m.position[-1] - free().position[-1], axis=1).max() > 5e-3
    assert np.linalg.norm(m.force[:100], axis=2).max() == 0.0  # nothing touches at rest


def test_spring_force_is_its_stiffness_times_the_depth():
    m, p = moved("contact_spring"), actuator("a")
    item = SCENARIOS["contact_spring"].obstacles[0]
    depth = item.radius + p.half_width - np.linalg.norm(m.position[-1] - item.centre, axis=1)
    inside = (depth > 3e-4) & (m.arc_length > 0.002) & (m.arc_length < 0.165)
    share = p.length / p.elements / 0.005
    out = (m.position[-1] - item.centre)[inside]
    normal = np.sum(m.force[-1][inside] * out, axis=1) / np.linalg.norm(out, axis=1)
    assert normal == pytest.approx(item.stiffness * share * (depth[inside] - 1e-4), rel=1e-4)


def test_contact_scenarios_lose_energy_only():
    p = replace(actuator("a"), tube_resistance=0.0)
    m = run_rod(replace(SCENARIOS["contact_wall"], duration=1.0), p, Laboratory())
    work = np.cumsum(0.5 * (m.pressure[1:] + m.pressure[:-1]) * np.diff(m.volume))
    lost = work - (m.energy[1:] - m.energy[0]).sum(axis=1)
    assert np.diff(lost).min() > -2e-4 * m.energy.sum(axis=1).max()


def test_obstacles_without_sense_are_refused():
    for item in (Wall((1.0, 1.0), 0.0), Circle((0.0, 0.0), -1.0), Circle((0.0, 0.0), 1.0, stiffness=0.0)):
        with pytest.raises(InputError):
            obstacle_rows([item])
    assert obstacle_rows([]).shape == (0, 7)
