"""Hysteresis of segments that lengthen: closed forms, energy balance, the kernels' texts, what refuses it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pliant.equations import extension_memory
from pliant.equations.symbols import Past
from pliant.errors import InputError, SimulationError
from pliant.mechanics import mechanics_of
from pliant.model import Chamber, Extension, Memory, Model, Space, chain_model, load_model, save_model
from pliant.simulation import Stepper, Trace, equilibrium, simulate
from pliant.simulation.balance import energy_defects
from pliant.simulation.state import relaxed

pytestmark = pytest.mark.slow  # kernels of their own are compiled first

ARM = chain_model(
    length=0.2, mass=0.15, links=3, joint_placement="midsegment", stiffness=0.9, damping=2e-2, gravity=[0.0, 9.81],
    chambers=(Chamber([2e-6], axial_gain=60.0),),
    extensions=(Extension(90.0, 2.0, 0.0, 0.1, "near"), Extension(120.0, 2.0, 0.1, None, "far")),
)
AXIAL = Memory(
    (0.1,), (0.3,), axial_creep_share=(0.3, 0.1), axial_creep_time=(0.2, 2.0), axial_slip_share=(0.2, 0.3),
    axial_slip_strain=(0.01, 0.03),
)
PUSH = 3e4  # Pa


def bar(memory: Memory, stiffness: float = 100.0, **curve: float) -> Model:
    """A light straight bar that a chamber pushes with 5 N: it lengthens without delay but for its hysteresis."""
    return Model(
        link_length=[0.1], link_mass=[1e-4], stiffness=1.0, damping=1e-3, memory=memory,
        chambers=(Chamber([1e-8], joint_gain=[0.0], axial_gain=[5.0 / (1e-8 * PUSH)]),),
        extensions=(Extension(stiffness, 0.05, **curve),),
    )


def test_creep_under_a_force_is_that_of_a_standard_linear_solid() -> None:
    """e = F/K (1 - s/(1 + s) exp(-t / (T (1 + s)))) after a force F: closed form of K e + K s (e - xi) = F."""
    share, time = 0.5, 0.4
    held = Trace([0.0, 1e-6, 2.0], [0.0, PUSH, PUSH])
    motion = simulate(bar(Memory(axial_creep_share=(share,), axial_creep_time=(time,))), held,
                      times=np.linspace(0.0, 2.0, 201), time_step=2e-4)  # fmt: skip
    t, strain = motion.time.values, motion.axial_strain.values[:, 0]
    expected = 0.05 * (1.0 - share / (1.0 + share) * np.exp(-t / (time * (1.0 + share))))
    np.testing.assert_allclose(strain[5:], expected[5:], rtol=2e-3)
    force = motion.axial_memory_force.values[:, 0]
    np.testing.assert_allclose(force[5:] + 100.0 * strain[5:], 5.0, rtol=5e-3)


@pytest.mark.parametrize(("limit", "left"), [(0.01, 0.3 * 0.01), (0.03, 0.3 * (0.041 - 0.03) / 1.3)])
def test_a_slip_element_leaves_a_set_after_the_first_load(limit: float, left: float) -> None:
    """Loaded to e_1 = F/K - s y, unloaded to s y where the element slips back, else to s (e_1 - y) / (1 + s)."""
    pulse = Trace([0.0, 0.5, 1.0, 1.5, 3.0], [0.0, PUSH, PUSH, 0.0, 0.0])
    motion = simulate(bar(Memory(axial_slip_share=(0.3,), axial_slip_strain=(limit,))), pulse,
                      times=np.linspace(0.0, 3.0, 301), time_step=3e-4)  # fmt: skip
    strain = motion.axial_strain.values[:, 0]
    assert strain[90] == pytest.approx(0.05 - 0.3 * limit, rel=1e-3)
    assert strain[-1] == pytest.approx(left, rel=1e-3)


@pytest.mark.parametrize("stiffening", [pytest.param(None, marks=pytest.mark.slow), -4.0])
def test_energy_balances_and_no_closed_cycle_gives_work(rng: np.random.Generator, stiffening: float | None) -> None:
    """Pressure cycles of random levels that end without pressure: work given equals losses plus what is still held."""
    curve = {} if stiffening is None else {"stiffening": stiffening, "stiffening_bound": 0.6, "cubic_stiffening": 9.0}
    arm = ARM.with_(memory=AXIAL, extensions=tuple(replace(e, **curve) for e in ARM.extensions))
    for _ in range(3):
        level = np.append(np.append(0.0, rng.uniform(0.0, 6e4, 6)), [0.0, 0.0])
        motion = simulate(arm, Trace(0.25 * np.arange(9), level), times=np.linspace(0.0, 2.0, 101), time_step=1e-3)
        assert max(energy_defects(motion)) < 2e-5
        assert (np.diff(motion.memory_dissipation.values) >= 0.0).all()
        work = motion.input_work.values[-1]
        assert work > 0.0
        stored = sum(motion[f"{kind}_energy"].values for kind in ("kinetic", "elastic", "gravitational", "memory"))
        lost = motion.dissipated_energy.values[-1] + motion.memory_dissipation.values[-1]
        assert work == pytest.approx(stored[-1] - stored[0] + lost, rel=1e-4)


def test_compiled_steps_are_those_of_the_text(rng: np.random.Generator) -> None:
    """A Stepper beside the plain kernel, both from rest under jumps of pressure."""
    arm = ARM.with_(memory=AXIAL, extensions=tuple(replace(e, stiffening=-3.0) for e in ARM.extensions))
    chain, stepper = mechanics_of(arm), Stepper(arm, 2e-3)
    x, v = stepper.position.copy(), stepper.velocity.copy()
    past = Past(arm.memory.law(), relaxed(arm, chain.joint_coordinates(x)), chain.held())
    body, joints, work = chain.parts()
    for pressure in rng.uniform(0.0, 6e4, 12):
        stepper.step(pressure)
        torque = arm.actuation.joint_torques(np.array([pressure]))
        assert extension_memory.step_with_axial_memory(x, v, 2e-3, torque, body, joints, past, work) >= 0.0
    np.testing.assert_allclose(stepper.position, x, rtol=1e-11, atol=1e-14)
    np.testing.assert_allclose(stepper.memory, past.state, rtol=1e-10, atol=1e-14)


@pytest.mark.slow
def test_branches_without_stiffness_change_no_bit() -> None:
    """Shares of 0 and a spring that may soften but does not: the motion of the plain body, to the last bit."""
    push = Trace([0.0, 0.1, 0.5], [0.0, 5e4, 0.0])
    plain = simulate(ARM, push, times=np.linspace(0.0, 0.5, 51), time_step=1e-3)
    still = Memory(axial_creep_share=(0.0,), axial_creep_time=(1.0,))
    for other in (ARM.with_(memory=still),
                  ARM.with_(extensions=tuple(replace(e, stiffening=0.0) for e in ARM.extensions))):
        motion = simulate(other, push, times=np.linspace(0.0, 0.5, 51), time_step=1e-3)
        assert np.array_equal(motion.tip_position.values, plain.tip_position.values)


def test_a_sudden_change_moves_what_slips_and_not_what_creeps() -> None:
    """What a filter's correction does: slip elements follow the strain up to their limit, creep stays."""
    arm = ARM.with_(memory=AXIAL)
    chain = mechanics_of(arm)
    x, change = chain.coordinates(np.zeros(5)), np.array([0.01, 0.0, 0.0, 0.02, -0.02])
    past = Past(arm.memory.law(), relaxed(arm, np.zeros(5)), chain.held())
    extension_memory.follow_all(x, change, chain.joints, past)
    np.testing.assert_allclose(past.state[3:], [[0.0, 0.0, 0.01, 0.02, 0.0], [0.0, 0.0, -0.01, -0.02, 0.0]], atol=1e-15)
    assert not past.state[:3].any()  # the joints' creep stays too
    extension_memory.relax_all(x + change, chain.joints, past)
    np.testing.assert_allclose(past.state[3:, :2], [[0.02, 0.02], [-0.02, -0.02]], atol=1e-15)


def test_a_softening_spring_refuses_a_force_that_it_cannot_hold() -> None:
    soft = bar(Memory(), stiffening=-6.0)  # holds at most K / (4 * 6) = 4.17 N
    with pytest.raises(SimulationError, match=r"segment 'body', which softens with its strain, holds at most 4\.167 N"):
        equilibrium(soft, PUSH)
    assert 0.06 < equilibrium(bar(Memory(), stiffening=-6.0, stiffening_bound=0.9), PUSH)[1] < 0.2


def test_a_model_file_keeps_the_laws(tmp_path) -> None:
    curved = replace(ARM.extensions[0], stiffening=-3.0, stiffening_bound=0.5)
    arm = ARM.with_(memory=AXIAL, extensions=(curved, ARM.extensions[1]))
    assert load_model(save_model(arm, tmp_path / "arm.json")) == arm


def test_where_the_laws_mean_nothing_they_are_refused() -> None:
    with pytest.raises(InputError, match="has no segment that lengthens"):
        chain_model(length=0.1, mass=0.1, links=2, stiffness=1.0, damping=0.1, torque=[1e-6], memory=AXIAL)
    space = {"link_length": [0.1], "link_mass": [0.1], "stiffness": 1.0, "damping": 0.1, "torque": [1e-6],
             "space": Space()}  # fmt: skip
    with pytest.raises(InputError, match="has no segment that lengthens"):
        Model(**space, memory=AXIAL)
    assert Model(**space, extensions=(Extension(9.0),), memory=AXIAL).memory == AXIAL
    tied = Extension(9.0, stiffening=-1.0, stiffens_bending=True)
    assert Model(**space, extensions=(tied,)).extensions == (tied,)
    with pytest.raises(InputError, match="has stiffens_bending, which a planar model does not support"):
        ARM.with_(extensions=(replace(ARM.extensions[0], stiffening=-1.0, stiffens_bending=True), ARM.extensions[1]))
    with pytest.raises(InputError, match="stiffens_bending needs a nonlinear axial spring"):
        Extension(9.0, stiffens_bending=True)
    with pytest.raises(InputError, match="stiffening_bound must be from 0 to below 1"):
        Extension(9.0, stiffening_bound=1.0)
    with pytest.raises(InputError, match="axial_slip_share and axial_slip_strain must have the same length"):
        Memory(axial_slip_share=(0.1,))
    with pytest.raises(InputError, match="does not support hysteresis of segments"):
        simulate(ARM.with_(memory=AXIAL), Trace([0.0, 0.1], [0.0, PUSH]), times=[0.0, 0.1], method="LSODA")
