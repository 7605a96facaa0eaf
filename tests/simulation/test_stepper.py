"""One step at a time: the same numbers as `simulate`, no allocation."""

from __future__ import annotations

import tracemalloc
from time import perf_counter

import numpy as np
import pytest

from pliant.errors import InputError
from pliant.model import Valve
from pliant.simulation import Stepper, Trace, simulate, state

HELD = np.repeat([0.0, 4e4, 1.2e5, 3e4, 9e4, 0.0], 40)
VALVES = [Valve(), Valve(rise_time=0.03, fall_time=0.05), Valve(fall_time=0.02), Valve(rise_time=2e-4, fall_time=1e-4)]


def staircase(levels, h):
    """The same held pressures as a trace that jumps."""
    nodes = np.arange(levels.size + 1) * h
    return Trace(np.repeat(nodes, 2)[1:-1], np.repeat(levels, 2))


@pytest.mark.parametrize("which", ["paper", "awkward"])
@pytest.mark.parametrize("valve", VALVES)
def test_held_pressures_give_the_trajectory_of_simulate(request, which, valve):
    model, h = request.getfixturevalue(which).with_(valve=valve), 2e-3
    stepper = Stepper(model, h)
    rows = [(stepper.angle.copy(), stepper.rate.copy(), stepper.pressure)]
    for p in HELD:
        angle, rate = stepper.step(p)
        rows.append((angle.copy(), rate.copy(), stepper.pressure))
    phi, w, shown = (np.array(column) for column in zip(*rows, strict=True))
    run = simulate(model, staircase(HELD, h), times=np.arange(HELD.size + 1) * h, step=h)
    assert np.abs(state.joint_angles(model, phi) - run.joint_angle.values).max() < 1e-11
    assert np.abs(state.joint_rates(w) - run.joint_rate.values).max() < 1e-9
    if valve.rise_time:
        assert shown == pytest.approx(run.pressure.values, abs=1e-6)
    assert stepper.time == pytest.approx(HELD.size * h)


def test_the_first_order_valve_is_exact(paper):
    stepper = Stepper(paper.with_(valve=Valve(rise_time=0.04, fall_time=0.09)), 1e-3)
    for _ in range(200):
        stepper.step(1e5)
    top = 1e5 * (1 - np.exp(-0.2 / 0.04))
    assert stepper.pressure == pytest.approx(top, rel=1e-12)
    for _ in range(100):
        stepper.step(0.0)
    assert stepper.pressure == pytest.approx(top * np.exp(-0.1 / 0.09), rel=1e-12)


def test_it_starts_at_rest_and_reset_brings_it_back(awkward):
    stepper = Stepper(awkward, 1e-3, 5e4)
    before = stepper.angle.copy()
    for _ in range(50):
        stepper.step(5e4)
    assert stepper.angle == pytest.approx(before, abs=1e-12)
    first = [stepper.step(1e5)[0].copy() for _ in range(30)][-1]
    stepper.reset(5e4)
    assert stepper.time == 0.0
    assert np.array_equal(stepper.angle, before)
    assert not stepper.rate.any()
    again = [stepper.step(1e5)[0].copy() for _ in range(30)][-1]
    assert again == pytest.approx(first, abs=1e-12)


def memory_of_steps(stepper):
    """Bytes that 1000 steps leave, and that they hold at most."""
    tracemalloc.start()
    try:
        for _ in range(10):
            stepper.step(1e5)
        before, _ = tracemalloc.get_traced_memory()
        tracemalloc.reset_peak()
        for _ in range(1000):
            stepper.step(1e5)
        after, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    return after - before, peak - before


def test_steps_allocate_nothing(paper):
    stepper = Stepper(paper.with_(valve=Valve(rise_time=0.03, fall_time=0.05)), 1e-3)
    angle, rate = stepper.angle, stepper.rate
    for _ in range(100):
        stepper.step(1e5)
    rounds = [memory_of_steps(stepper) for _ in range(5)]  # what other threads allocate meanwhile is not in every round
    assert min(kept for kept, _ in rounds) < 256  # a float or two; 1000 steps of one array would be 100 kB
    assert min(peak for _, peak in rounds) < 4096
    assert stepper.angle is angle
    assert stepper.rate is rate


def test_a_loose_budget(paper):
    """A step takes some 4 microseconds; fifty times that is a fault."""
    stepper = Stepper(paper)
    began = perf_counter()
    for _ in range(1000):
        stepper.step(1e5)
    assert perf_counter() - began < 0.2


@pytest.mark.parametrize("valve", [Valve(dead_time=0.01), Valve(natural_frequency=5.0)])
def test_other_valves_are_refused(paper, valve):
    with pytest.raises(InputError, match="ideal or first-order valve"):
        Stepper(paper.with_(valve=valve))
