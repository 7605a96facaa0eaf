"""Chains that remember: what a trajectory tells of them, its balance, its references, and one step at a time."""

from __future__ import annotations

import numpy as np
import pytest

from pliant.errors import InputError, SimulationError
from pliant.mechanics import mechanics_of
from pliant.model import Memory, Valve, load_model, save_model
from pliant.simulation import Pulse, Step, Stepper, Trace, equilibrium, modes, simulate, state, triangle
from pliant.simulation.drive import drive
from pliant.simulation.initial_value import march

pytestmark = pytest.mark.slow  # kernels of their own are compiled first

CREEP = Memory(creep_share=(0.1, 0.2), creep_time=(0.05, 1.0))
SLIP = Memory(slip_share=(0.1, 0.2), slip_angle=(0.005, 0.02))
BOUC_WEN = Memory(boucwen_share=0.3, boucwen_beta=40.0, boucwen_gamma=20.0)
ALL = Memory((0.1, 0.2), (0.05, 1.0), (0.1, 0.2), (0.005, 0.02), 0.3, 40.0, -20.0, 1.5)
PULSE = Pulse(1.19e5, 0.05, 0.5)


@pytest.mark.parametrize("memory", [Memory(), Memory((0.0,), (1.0,), (0.0,), (0.1,))])
def test_no_memory_marches_bit_for_bit_as_without(paper, awkward, memory):
    for model in (paper, awkward):
        times = np.linspace(0.0, 0.3, 151)
        plan = drive(model, Pulse(8e4, 0.05, 0.1), times, 2e-3)
        start = (mechanics_of(model).coordinates(equilibrium(model)), np.zeros(model.n))
        mute = model.with_(memory=memory)
        with_memory = march(mute, plan, start, times.size, state.relaxed(mute, np.zeros(model.n)))
        for a, b in zip(march(model, plan, start, times.size), with_memory, strict=False):
            assert np.array_equal(a, b[..., : a.shape[-1]])


@pytest.mark.parametrize("memory", [CREEP, SLIP, BOUC_WEN, ALL])
def test_energy_balance_is_as_good_as_without_memory(paper, memory):
    """Kinetic + elastic + held by the memory = work - both losses, to the step's own error; losses only grow."""
    def gap(model):
        run = simulate(model, PULSE, duration=1.0)
        held, lost = run.kinetic_energy + run.elastic_energy, run.dissipated_energy
        if model.memory:
            held, lost = held + run.memory_energy, lost + run.memory_dissipation
            assert np.diff(run.memory_dissipation).min() >= 0.0
            assert run.memory_dissipation[-1] > 0.0
        return np.abs(held + lost - run.input_work).max()

    assert gap(paper.with_(memory=memory)) < 3.0 * gap(paper)


def test_a_trajectory_names_its_states(paper):
    run = simulate(paper.with_(memory=ALL), PULSE, duration=0.2)
    assert run.memory.values.tolist() == ["creep_1", "creep_2", "slip_1", "slip_2", "boucwen"]
    assert run.memory_state.dims == ("time", "joint", "memory")
    assert run.memory_state.attrs["units"] == "rad"
    q, states = run.joint_angle.values, run.memory_state.values
    r = np.tensordot(q[..., None] - states[..., :2], ALL.creep_share, 1)
    r = r + np.tensordot(states[..., 2:4], ALL.slip_share, 1) + 0.3 * states[..., 4]
    assert run.memory_torque.values == pytest.approx(paper.stiffness * r, rel=1e-12, abs=1e-15)
    assert "memory_state" not in simulate(paper, PULSE, duration=0.2)


@pytest.mark.parametrize("swell", [0.0, 0.5])
@pytest.mark.parametrize("valve", [Valve(), Valve(rise_time=0.03, fall_time=0.05, fall_rate=4e5)])
def test_creep_and_swelling_against_an_adaptive_solver(awkward, errors_mm, swell, valve):
    model = awkward.with_(memory=CREEP, swell_share=swell, swell_time=0.2, valve=valve)
    coarse, fine = errors_mm(model, Pulse(8e4, 0.03, 0.2), np.linspace(0.0, 0.4, 41), [1e-3, 5e-4])
    assert fine < 0.02
    assert np.log2(coarse / fine) == pytest.approx(2.0, abs=0.3)


def test_creep_ends_where_the_spring_alone_would_hold(paper):
    """The branch has relaxed after many times its own; before, it adds its stiffness."""
    share = 0.25
    model = paper.with_(memory=Memory((share,), (5.0,)), damping=0.05)
    q = simulate(model, Step(1e5), times=np.array([0.0, 0.4, 0.5, 60.0, 80.0])).joint_angle.values[:, 0]
    final = equilibrium(model, 1e5)[0]
    assert q[-1] == pytest.approx(final, rel=1e-6)
    assert q[2] == pytest.approx(final / (1 + share), rel=0.04)


def test_slow_cycles_between_two_levels_close_their_loops(paper):
    """Rate-independent: the same pressures in twice the time leave the same states."""
    model = paper.with_(memory=SLIP, damping=0.05)
    ends = []
    for period in (20.0, 40.0):
        times = np.linspace(0.0, 3 * period, 121)
        run = simulate(model, triangle(1.2e5, period, 3), times=times, time_step=4e-3)
        ends.append(run.memory_state.values[[40, 80, 120]])
        loss = np.diff(run.memory_dissipation.values[[40, 80, 120]])
        assert loss[0] > 0
        assert loss[1] == pytest.approx(loss[0], rel=1e-2)
    assert ends[1] == pytest.approx(ends[0], abs=2e-5)
    assert ends[0][2] == pytest.approx(ends[0][1], abs=2e-5)


@pytest.mark.parametrize("memory", [SLIP, ALL])
def test_steps_are_those_of_simulate(paper, memory):
    model = paper.with_(memory=memory, swell_share=0.4, swell_time=0.1, torque=[6e-7, 1e-12], valve=Valve(0.02, 0.04))
    levels, h = np.repeat([0.0, 1e5, 4e4, 1.2e5], 40), 2e-3
    stepper = Stepper(model, h)
    found = np.array([stepper.step(p)[0].copy() for p in levels])
    nodes = np.arange(levels.size + 1) * h
    run = simulate(model, Trace(np.repeat(nodes, 2)[1:-1], np.repeat(levels, 2)), times=nodes, time_step=h)
    assert mechanics_of(model).joint_angles(found) == pytest.approx(run.joint_angle.values[1:], abs=1e-10)
    assert stepper.memory[:, : len(memory.labels)] == pytest.approx(run.memory_state.values[-1], abs=1e-10)
    stepper.reset()
    assert not stepper.memory.any()


INFLATES = {"inflation_limit": 2e5, "inflation_time": 0.05, "swell_share": 0.4, "swell_time": 0.1}


def test_an_inflating_chamber_against_an_adaptive_solver(awkward, errors_mm):
    model = awkward.with_(memory=CREEP, valve=Valve(0.03, 0.05, fall_rate=4e5), **INFLATES)
    coarse, fine = errors_mm(model, Pulse(8e4, 0.03, 0.2), np.linspace(0.0, 0.4, 41), [1e-3, 5e-4])
    assert fine < 0.02
    assert np.log2(coarse / fine) == pytest.approx(2.0, abs=0.3)


def test_an_inflating_chamber_rests_as_its_wall_and_remembers_its_stretch(paper, tmp_path):
    model = paper.with_(inflation_limit=2e5, inflation_time=0.02, damping=0.1)
    run = simulate(model, Step(1e5, 0.01), times=np.array([0.0, 2.0, 3.0]), time_step=2e-3)
    assert run.hoop_stretch.values[:, 0] == pytest.approx([1.0, 2**0.25, 2**0.25])
    assert run.joint_angle.values[-1] == pytest.approx(equilibrium(paper, 1e5) * 2**0.75)
    assert run.joint_angle.values[-1] == pytest.approx(equilibrium(model, 1e5))
    assert load_model(save_model(model, tmp_path / "m.json")) == model
    with pytest.raises(SimulationError, match="expands without bound"):
        equilibrium(model, 2e5)
    bounded = model.with_(inflation_jm=1.0)
    run = simulate(bounded, Step(3e5, 0.01), times=np.array([0.0, 2.0, 3.0]), time_step=2e-3)
    assert run.joint_angle.values[-1] == pytest.approx(equilibrium(bounded, 3e5))
    x = run.hoop_stretch.values[-1, 0]
    push = (1.0 - x**-4) / (1.0 - (x**2 + x**-2 - 2.0))
    assert push == pytest.approx(1.5, rel=1e-6)  # 3e5 Pa in parts of the limit


def test_steps_of_an_inflating_chamber_are_those_of_simulate(paper):
    """The stretch goes on from step to step, behind a valve that fills and vents at limited rates."""
    model = paper.with_(memory=ALL, valve=Valve(0.02, 0.04, rise_rate=3e6, fall_rate=1e6), **INFLATES)
    levels, h = np.repeat([0.0, 1e5, 4e4], 40), 2e-3
    stepper = Stepper(model, h)
    found = np.array([stepper.step(p)[0].copy() for p in levels])
    nodes = np.arange(levels.size + 1) * h
    run = simulate(model, Trace(np.repeat(nodes, 2)[1:-1], np.repeat(levels, 2)), times=nodes, time_step=h)
    assert mechanics_of(model).joint_angles(found) == pytest.approx(run.joint_angle.values[1:], abs=1e-10)
    assert stepper.stretch == pytest.approx(run.hoop_stretch.values[-1], rel=1e-12)
    stepper.reset(1e5)
    assert stepper.stretch == pytest.approx(2**0.25)


def test_a_pressure_that_settles_late_comes_whole_in_the_end(paper):
    model = paper.with_(valve=Valve(settle_share=0.2, settle_time=0.1))
    run = simulate(model, Step(1e5), times=np.array([0.0, 0.1, 0.2, 3.0]), time_step=1e-3)
    expected = 1e5 * (1.0 - 0.2 * np.exp(-np.array([0.1, 0.2, 3.0]) / 0.1))
    assert run.pressure.values[1:, 0] == pytest.approx(expected, rel=1e-9)
    with pytest.raises(InputError, match="settle_share"):
        simulate(model, Step(1e5), duration=0.1, method="LSODA")
    with pytest.raises(InputError, match="settle_share must be at most 1"):
        Valve(settle_share=1.5)


def test_memory_rings_with_all_its_stiffness(paper):
    stiff = paper.with_(stiffness=paper.stiffness * 1.6)
    assert modes(paper.with_(memory=Memory((0.1,), (1.0,), (0.2,), (0.1,), 0.3)))[0] == pytest.approx(modes(stiff)[0])


def test_a_start_goes_on_where_another_run_ended(paper):
    model = paper.with_(memory=ALL)
    whole = simulate(model, Step(1e5), times=np.array([0.0, 0.1, 0.2]), time_step=1e-3)
    at = whole.isel(time=1)
    rest = simulate(
        model, Step(1e5, -1.0), times=np.array([0.1, 0.2]), time_step=1e-3, initial_angle=at.joint_angle.values,
        initial_rate=at.joint_rate.values, initial_memory=at.memory_state.values,
    )
    assert rest.joint_angle.values[-1] == pytest.approx(whole.joint_angle.values[-1], abs=1e-9)
    with pytest.raises(InputError, match=r"\(5, 5\)"):
        simulate(model, Step(1e5), duration=0.1, initial_memory=np.zeros((5, 2)))
    with pytest.raises(InputError, match=r"initial_memory must be finite, but \d+ of its \d+ angles are not"):
        simulate(model, Step(1e5), duration=0.1, initial_memory=np.nan * at.memory_state.values)


def test_a_file_keeps_it_and_older_files_have_none(paper, tmp_path):
    model = paper.with_(memory=ALL, swell_share=0.3, swell_time=2.0, valve=Valve(fall_rate=2e5))
    assert load_model(save_model(model, tmp_path / "m.json")) == model
    assert model != paper.with_(memory=ALL)
    assert not load_model(save_model(paper, tmp_path / "p.json")).memory


@pytest.mark.parametrize(
    ("entries", "sentence"),
    [
        ({"boucwen_beta": 10.0, "boucwen_gamma": -11.0}, "could generate energy"),
        ({"boucwen_beta": 0.0, "boucwen_gamma": 0.0}, "their sum positive"),
        ({"boucwen_exponent": 0.5}, "at least 1"),
        ({"creep_share": (0.1,)}, "must have the same length, got 1 and 0"),
        ({"creep_share": (0.1,), "creep_time": (0.0,)}, "creep_time must be positive"),
        ({"slip_share": (-0.1,), "slip_angle": (0.1,)}, "slip_share must be finite and not negative"),
        ({"slip_share": "much", "slip_angle": (0.1,)}, "must be numbers"),
        ({"boucwen_share": (0.1, 0.2)}, "must be one number"),
    ],
)  # fmt: skip
def test_what_is_not_passive_or_not_a_number_is_refused(entries, sentence):
    with pytest.raises(InputError, match=sentence):
        Memory(**entries)


def test_refusals(paper):
    with pytest.raises(InputError, match="does not support slip element 1"):
        simulate(paper.with_(memory=SLIP), PULSE, duration=0.1, method="LSODA")
    with pytest.raises(InputError, match="swell_share must be at most 1"):
        paper.with_(swell_share=1.2)
    with pytest.raises(SimulationError, match="more than a radian"):
        simulate(paper.with_(memory=ALL), Step(3e8), duration=0.1)
    with pytest.raises(InputError, match="first-order valve"):
        Stepper(paper.with_(valve=Valve(settle_share=0.1)))


def test_a_limited_valve_falls_in_a_straight_line(paper):
    model = paper.with_(valve=Valve(rise_time=0.02, fall_time=0.02, fall_rate=4e5))
    run = simulate(model, Pulse(1e5, 0.0, 0.3), times=np.linspace(0.0, 1.0, 1001))
    p = run.pressure.values[:, 0]
    falling = p[300:500]
    straight = falling > 0.02 * 4e5 + 500.0
    assert falling[straight] == pytest.approx(p[300] - 4e5 * 1e-3 * np.arange(200)[straight], rel=1e-9)
    assert p[600] == pytest.approx(8e3 * np.exp(-(0.3 - (p[300] - 8e3) / 4e5) / 0.02), rel=1e-6)
    assert p[200] == pytest.approx(1e5 * (1 - np.exp(-10.0)), rel=1e-9)
