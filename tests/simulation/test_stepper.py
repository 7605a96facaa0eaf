"""One step at a time: the same numbers as `simulate`, no allocation."""

from __future__ import annotations

import tracemalloc
from time import perf_counter

import numpy as np
import pytest

from pliant.errors import InputError
from pliant.mechanics import mechanics_of
from pliant.model import Chamber, Memory, Valve, chain_model
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
    run = simulate(model, staircase(HELD, h), times=np.arange(HELD.size + 1) * h, time_step=h)
    assert np.abs(mechanics_of(model).joint_angles(phi) - run.joint_angle.values).max() < 1e-11
    assert np.abs(np.diff(w, axis=-1, prepend=0.0) - run.joint_rate.values).max() < 1e-9
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
    assert min(kept for kept, _ in rounds) < 1000  # not a byte a step: one number kept by each would be 24 kB
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


@pytest.mark.parametrize("wrong", [5e4, [5e4], [5e4, 0.0, 1.0], [[5e4, 0.0]]])
def test_each_input_needs_its_value(wrong):
    """As in `simulate` and `equilibrium`: one number does not fill two inputs; a single 0 does."""
    pair = Chamber(torque=(6e-7,), name="a"), Chamber(torque=(6e-7,), joint_gain=[0.0, -1.0], name="b")
    stepper = Stepper(chain_model(length=0.17, mass=0.07, links=2, stiffness=1.6, damping=8e-3, chambers=pair))
    with pytest.raises(InputError, match=r"expected 2 pressure\(s\) in Pa, one for each chamber \(a, b\)"):
        stepper.step(wrong)
    assert not stepper.pressure.any()
    stepper.step(0.0)
    stepper.step([1e4, 2e4])
    assert stepper.pressure.tolist() == [1e4, 2e4]


@pytest.mark.parametrize("valve", [Valve(dead_time=0.01), Valve(natural_frequency=5.0)])
def test_other_valves_are_refused(paper, valve):
    with pytest.raises(InputError, match="ideal or first-order valve"):
        Stepper(paper.with_(valve=valve))


@pytest.mark.parametrize("memory", [Memory(), Memory((0.2,), (0.1,), (0.2,), (0.01,))])
def test_a_snapshot_goes_on_as_if_nothing_had_been(awkward, memory):
    model = awkward.with_(valve=Valve(rise_time=0.03, fall_time=0.05), memory=memory, swell_share=0.3)
    stepper = Stepper(model, 1e-3)
    for _ in range(40):
        stepper.step(1e5)
    saved = stepper.snapshot()
    first = [stepper.step(p)[0].copy() for p in HELD]
    moment = stepper.time
    stepper.restore(saved)
    assert stepper.time == pytest.approx(0.04)
    again = [stepper.step(p)[0].copy() for p in HELD]
    assert np.array_equal(first, again)
    assert stepper.time == moment
    other = Stepper(model, 1e-3)
    other.restore(saved)
    assert np.array_equal([other.step(p)[0].copy() for p in HELD], first)
    with pytest.raises(InputError, match=r"does not fit the model: .* \(3 in the snapshot, 3 in the model\)"):
        Stepper(model.with_(memory=Memory((0.1, 0.1, 0.1), (1.0, 2.0, 3.0))), 1e-3).restore(saved)


def test_it_starts_from_any_angles_and_rates(awkward):
    stepper, h = Stepper(awkward, 1e-3), 1e-3
    q, dq = np.array([0.2, -0.1, 0.15]), np.array([1.0, 0.5, -2.0])
    stepper.reset(5e4, joint_angle=q, joint_rate=dq)
    rows = [mechanics_of(awkward).joint_angles(stepper.step(5e4)[0]).copy() for _ in range(50)]
    level = Trace(np.array([0.0]), np.array([5e4]))
    run = simulate(awkward, level, times=np.arange(51) * h, time_step=h, initial_angle=q, initial_rate=dq)
    assert np.abs(np.array(rows) - run.joint_angle.values[1:]).max() < 1e-12
    assert stepper.tips() == pytest.approx(run.tip_position.values[-1], abs=1e-12)
    places, angles = stepper.stations()
    assert places == pytest.approx(run.station_position.values[-1], abs=1e-12)
    assert angles == pytest.approx(run.station_angle.values[-1], abs=1e-12)
    with pytest.raises(InputError, match="expected 3 finite numbers"):
        stepper.reset(joint_angle=[0.1, np.nan, 0.0])


def test_several_steps_in_one_call(awkward):
    one, many = Stepper(awkward, 1e-3), Stepper(awkward, 1e-3)
    for p in HELD[::40]:
        for _ in range(40):
            one.step(p)
        many.step(p, 40)
    assert np.array_equal(one.angle, many.angle)
    assert many.time == pytest.approx(one.time)


def test_a_point_force_ends_at_the_rest_under_it(paper):
    """Pulled at the tip for long, the chain rests where the static equations have it; let go, it comes back."""
    stepper, force = Stepper(paper, 1e-3), np.array([0.3, -0.2])
    stepper.push(force)
    stepper.step(4e4, 20000)
    wanted = pytest.approx(state.equilibrium(paper, 4e4, force), abs=1e-9)
    assert mechanics_of(paper).joint_angles(stepper.angle) == wanted
    stepper.push(None)
    stepper.step(4e4, 20000)
    assert mechanics_of(paper).joint_angles(stepper.angle) == pytest.approx(state.equilibrium(paper, 4e4), abs=1e-9)


def test_a_point_force_does_the_work_that_it_gives(awkward):
    """Without pressure and dampers the energy grows by force times way of the point that is pulled."""
    model = awkward.with_(damping=[1e-9], torque=[0.0], valve=Valve())
    stepper, force = Stepper(model, 2e-5), np.array([0.05, 0.1])
    at = model.points[0]
    stepper.push(force, at.name)
    start = stepper.stations()[0][0].copy()
    from pliant.simulation.balance import stored_energy

    before = stored_energy(model, stepper.angle, stepper.rate, stepper.memory).sum()
    stepper.step(0.0, 3000)
    gained = stored_energy(model, stepper.angle, stepper.rate, stepper.memory).sum() - before
    way = stepper.stations()[0][0] - start
    assert gained == pytest.approx(float(force @ way), rel=1e-4)
    assert abs(gained) > 1e-6
    with pytest.raises(InputError, match="acts at 'nowhere'"):
        stepper.push(force, "nowhere")
    with pytest.raises(InputError, match="a known force needs one row"):
        stepper.push([1.0])
