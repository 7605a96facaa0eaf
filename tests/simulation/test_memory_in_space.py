"""Hysteresis states in space through simulations, steppers and files: energy, an adaptive solver, the plane."""

from dataclasses import replace

import numpy as np
import pytest

from pliant.errors import InputError
from pliant.model import Extension, Memory, Space, chain_model, load_model, save_model
from pliant.simulation import Pulse, Stepper, Trace, equilibrium, modes, simulate

BODY = {"length": 0.3, "mass": 0.1, "links": 3, "joint_placement": "midsegment", "stiffness": 0.5, "damping": 2e-3,
        "torque": (1e-6,), "tip_mass": 0.01}  # fmt: skip
ALL = Memory((0.1, 0.2), (0.05, 1.0), (0.5, 0.3), (0.005, 0.02), 0.3, 40.0, -20.0, 1.5)
PUSH = Pulse(100e3, 0.05, 1.0)


def arm(memory=ALL, gravity=(2.0, 0.3, -9.81), **space):
    return chain_model(**BODY, gravity=gravity, memory=memory, space=Space(**space))


def test_small_motions_ring_with_all_stiffness_and_rest_with_none():
    stiff, plain = ALL.instantaneous, arm(Memory(), (0.0, 0.0, 0.0), stiffness_ratio=1.3)
    found, expected = (modes(m)[0] for m in (plain.with_(memory=ALL), plain))
    assert found == pytest.approx(expected * np.sqrt(1.0 + stiff))
    assert equilibrium(arm(), 50e3) == pytest.approx(equilibrium(arm(Memory()), 50e3), abs=1e-15)


def test_a_file_keeps_it(tmp_path):
    assert load_model(save_model(arm(), tmp_path / "m.json")) == arm()


def test_slip_is_refused_where_a_solver_needs_smooth_laws():
    with pytest.raises(InputError, match="does not support slip element 1"):
        simulate(arm(), PUSH, duration=0.1, method="LSODA")
    with pytest.raises(InputError, match=r"\(6, 5\)"):
        simulate(arm(), PUSH, duration=0.1, time_step=1e-3, initial_memory=np.zeros((3, 5)))


@pytest.mark.slow  # compiles the step with memory
def test_a_motion_in_one_plane_is_that_of_the_planar_chain():
    plane = chain_model(**BODY, gravity=(0.3, -9.81), memory=ALL)
    a, b = (simulate(m, PUSH, duration=0.4, time_step=1e-3) for m in (plane, arm(gravity=(0.0, 0.3, -9.81))))
    assert np.abs(a.tip_position.values - b.tip_position.values[..., 1:]).max() < 1e-12
    assert b.memory_state_x.values == pytest.approx(a.memory_state.values, abs=1e-12)
    assert b.memory_torque_x.values == pytest.approx(a.memory_torque.values, abs=1e-12)
    for name in ("memory_energy", "memory_dissipation"):
        assert np.allclose(a[name], b[name], rtol=1e-9, atol=1e-15)


@pytest.mark.slow
def test_energy_balances_in_space_and_a_stepper_takes_the_same_steps():
    model = arm(twist_ratio=0.7, stiffness_ratio=1.4, radius=0.02, rest_turn=[0.0, 0.2, 0.1])
    levels, h = np.repeat([0.0, 1e5, 2e4, 8e4], 50), 1e-3
    nodes = np.arange(levels.size + 1) * h
    run = simulate(model, Trace(np.repeat(nodes, 2)[1:-1], np.repeat(levels, 2)), times=nodes, time_step=h, check=False)
    assert max(run.attrs["energy_gain"], run.attrs["energy_loss"]) < 2e-3
    assert np.diff(run.memory_dissipation).min() >= 0.0
    slip = np.hypot(run.memory_state_x, np.sqrt(1.4) * run.memory_state_y)[..., 2:4]
    assert slip.max(dim=("time", "joint")).values == pytest.approx(ALL.slip_angle)
    stepper = Stepper(model, h)
    for level in levels:
        stepper.step(level)
    assert stepper.tips()[-1] == pytest.approx(run.tip_position.values[-1, -1], abs=1e-10)
    assert stepper.memory[1:6:2, :5] == pytest.approx(run.memory_state_y.values[-1], abs=1e-10)
    assert stepper.memory[6:, :5] == pytest.approx(run.memory_state_twist.values[-1], abs=1e-10)
    assert stepper.energy_gain < 2e-3


@pytest.mark.slow  # compiles the step with memory of segments
def test_segments_of_a_chain_that_hangs_creep_as_those_of_the_planar_chain():
    """A load along the arm, then none; the states in the results, energies, and a stepper."""
    memory = replace(ALL, axial_creep_share=(1.2,), axial_creep_time=(0.8,), axial_slip_share=(0.2,),
                     axial_slip_strain=(0.004,))  # fmt: skip
    halves = Extension(90.0, 0.5, 0.0, 0.15, "upper"), Extension(60.0, 0.5, 0.15, None, "lower")
    push = Pulse(50e3, 0.05, 0.3)
    flat, hung = (
        chain_model(**BODY | {"axial_gain": 40.0}, gravity=gravity, memory=memory, extensions=halves, **more)
        for gravity, more in (((0.3, 9.81), {}), ((0.0, 0.3, 9.81), {"space": Space()}))
    )
    times = np.linspace(0.0, 0.5, 51)
    a, b = (simulate(m, push, times=times, time_step=1e-3) for m in (flat, hung))
    assert np.abs(a.tip_position.values - b.tip_position.values[..., 1:]).max() < 1e-10
    for name in ("axial_strain", "axial_memory_state", "axial_memory_force"):
        assert b[name].dims == a[name].dims
        np.testing.assert_allclose(b[name], a[name], rtol=0, atol=1e-9)
    for name in ("memory_energy", "memory_dissipation"):
        np.testing.assert_allclose(b[name], a[name], rtol=1e-8, atol=1e-13)
    assert list(b.axial_memory.values) == ["creep_1", "slip_1"]
    assert np.ptp(b.axial_memory_state.values[:, :, 1]) == pytest.approx(0.008, rel=0.02)  # it slipped both ways
    assert max(b.attrs["energy_gain"], b.attrs["energy_loss"]) < 2e-3
    stepper = Stepper(hung, 1e-3)
    for time in np.arange(500) * 1e-3:
        stepper.step(50e3 if 0.05 <= time < 0.35 else 0.0)
    assert np.abs(stepper.memory[-2:, :2] - b.axial_memory_state.values[-1]).max() < 1e-3


def walled(model):
    """The arm with a wall whose strain changes its bending stiffness, but not its creep."""
    wall = Extension(60.0, 0.05, stiffening=-1.0, cubic_stiffening=20.0, stiffens_bending=True)
    return model.with_(extensions=(wall,), chambers=(replace(model.chambers[0], axial_gain=30.0),))


@pytest.mark.slow
@pytest.mark.parametrize("change", [lambda model: model, walled], ids=["fixed", "walled"])
def test_creep_in_space_against_an_adaptive_solver(change):
    model = change(arm(Memory((0.3, 0.2), (0.05, 1.0)), stiffness_ratio=1.4))
    times = np.linspace(0.0, 0.3, 31)
    exact = simulate(model, PUSH, times=times, method="LSODA")
    tips = [simulate(model, PUSH, times=times, time_step=h, check=False).tip_position for h in (2e-3, 1e-3)]
    errors = [float(np.abs(tip - exact.tip_position).max()) for tip in tips]
    assert errors[1] < 1e-4
    assert np.log2(errors[0] / errors[1]) == pytest.approx(2.0, abs=0.3)
    last = simulate(model, PUSH, times=times, time_step=1e-3, check=False).memory_state_y.values[-1, :, 0]
    assert last == pytest.approx(exact.memory_state_y.values[-1, :, 0], abs=1e-4)
