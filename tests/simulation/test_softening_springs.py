"""Chains whose springs soften with the angle: against adaptive solvers and closed forms, and where they give way."""

from __future__ import annotations

from collections import deque

import numpy as np
import pytest

from pliant.batch import simulate_batch
from pliant.equations import spatial_springs
from pliant.errors import SimulationError
from pliant.mechanics import mechanics_of
from pliant.mechanics.springs import springs_of
from pliant.model import Extension, Memory, Model, Space, chain_model
from pliant.simulation import Pulse, Stepper, equilibrium, modes, simulate
from pliant.simulation.reference import softest
from pliant.simulation.state import given_way

PULSE = Pulse(9e4, 0.05, 0.2)
TIMES = np.linspace(0.0, 0.3, 24)


@pytest.fixture(scope="module")
def soft(paper):
    """The paper's chain, softening, with nothing that takes energy."""
    return paper.with_(stiffening=[-2.0, -1.0, -1.5, -0.5, -1.5], damping=0.0)


def balance(run):
    stored = run.kinetic_energy + run.elastic_energy + run.gravitational_energy
    return np.abs((stored - run.input_work - stored[0]).values).max() / float(stored.max())


@pytest.mark.parametrize("cubic", [0.0, 30.0])
def test_an_undamped_chain_keeps_its_energy_to_second_order(soft, cubic):
    """Let go from a bent pose: LSODA keeps the energy of the curved potential, the step keeps it to its own order."""
    soft = soft.with_(cubic_stiffening=cubic)
    bent = {"times": np.linspace(0.0, 0.1, 9), "initial_angle": np.full(5, 0.05)}
    assert balance(simulate(soft, Pulse(0.0), method="LSODA", rtol=1e-8, **bent)) < 1e-6
    gaps = [balance(simulate(soft, Pulse(0.0), time_step=h, **bent)) for h in (2.5e-4, 1.25e-4)]
    assert 3.0 < gaps[0] / gaps[1] < 5.0
    assert gaps[1] < 1e-4


def order(model):
    """Errors of the tips at two steps against LSODA, m, and what springs without softening would err."""
    tight = simulate(model, PULSE, times=TIMES, method="LSODA", rtol=1e-9).tip_position
    runs = [simulate(m, PULSE, times=TIMES, time_step=h) for m, h in (
        (model, 1e-3), (model, 5e-4), (model.with_(stiffening=0.0), 5e-4)
    )]  # fmt: skip
    return [float(np.abs(run.tip_position - tight).max()) for run in runs]


@pytest.mark.parametrize("cubic", [0.0, 5.0])
@pytest.mark.parametrize("memory", [Memory(), Memory(creep_share=(0.2,), creep_time=(0.3,))])
def test_second_order_against_lsoda(soft, memory, cubic):
    """Branches of memory stay straight beside springs that bend."""
    coarse, fine, straight = order(soft.with_(damping=8e-3, memory=memory, cubic_stiffening=cubic))
    assert 3.4 < coarse / fine < 4.6
    assert fine < 1e-3 * straight


def test_frequency_about_a_bent_pose_is_lower_by_the_root_of_the_tangent():
    arm = Model(link_length=0.1, link_mass=0.02, stiffness=0.4, damping=1e-3, torque=[1e-6], stiffening=-0.8)
    rest = modes(arm)[0][0]
    assert modes(arm, np.array([0.3]))[0][0] == pytest.approx(rest * np.sqrt(1 - 2 * 0.8 * 0.3), rel=1e-12)
    assert rest == pytest.approx(np.sqrt(0.4 / (0.02 * 0.1**2 / 3)) / (2 * np.pi), rel=1e-12)


def test_rest_under_pressure_and_gravity(soft):
    q = equilibrium(soft, 1e5)
    torque = soft.torque_at(1e5)
    assert soft.stiffness * q * (1 + soft.stiffening * q) == pytest.approx(np.full(5, torque), rel=1e-13)
    fallen = soft.with_(gravity=[0.0, -9.81])
    held = simulate(fallen, Pulse(6e4, -1.0, 9.0), duration=0.05)
    assert np.abs(held.joint_rate.values).max() < 1e-9
    near = soft.with_(gravity=[0.0, -1e-12])  # the search of gravity ends where the closed form does
    assert equilibrium(near, 1e5) == pytest.approx(q, rel=1e-9)


def test_rest_where_springs_stiffen_again(soft):
    """The torque of the springs is the pressure's, on the branch from 0; a side that never gives way holds anything."""
    again = soft.with_(cubic_stiffening=[4.0, 1.0, 2.0, 0.1, 1.0])
    for level in (1e5, -1e5, 6e5):
        q = equilibrium(again, level)
        held = again.stiffness * q * (1 + again.stiffening * q + again.cubic_stiffening * q**2)
        assert held == pytest.approx(again.joint_gain * again.torque_at(level), rel=1e-13)
        assert (springs_of(again).slope(q) > 0).all()
    with pytest.raises(SimulationError, match=r"joint 1, which softens with its angle, holds at most"):
        equilibrium(again.with_(cubic_stiffening=[0.01, 1.0, 2.0, 0.1, 1.0]), 6e5)
    batch = simulate_batch(
        again.with_(damping=8e-3), Pulse(9e4, -1.0, 9.0), parameters={"cubic_stiffening": np.array([0.0, 3.0])},
        times=TIMES[:3],
    )
    assert batch["joint_angle"].values[1, 0] == pytest.approx(equilibrium(soft.with_(cubic_stiffening=3.0), 9e4))


def test_without_stiffening_rest_is_the_linear_one_bit_for_bit(paper):
    assert np.array_equal(equilibrium(paper, 1.19e5), paper.joint_gain * paper.torque_at(1.19e5) / paper.stiffness)


def test_a_batch_is_its_single_runs_and_tells_which_gave_way(soft):
    damped = soft.with_(damping=8e-3)
    values = np.repeat(np.linspace(-0.6, 0.4, 3)[:, None], 5, axis=1)
    batch = simulate_batch(damped, PULSE, parameters={"stiffening": values}, times=TIMES)
    for row, found in zip(values, batch["tip_position"].values, strict=True):
        alone = simulate(damped.with_(stiffening=row), PULSE, times=TIMES)["tip_position"].values[:, -1]
        assert found.reshape(len(TIMES), -1)[:, -2:] == pytest.approx(alone, abs=1e-12)
    some = {"stiffening": np.array([-0.3, -8.0])}
    lost = simulate_batch(damped, PULSE, parameters=some, times=TIMES, failures="mark")
    assert np.isnan(lost["failed_at"].values).tolist() == [True, False]


def test_bounded_springs_never_give_way_and_a_batch_is_its_single_runs(soft):
    """What ends the simulation of springs without a bound is a motion with one; the rest is the torque's."""
    weak = soft.with_(stiffening=-8.0, stiffening_bound=0.75, damping=8e-3)
    batch = simulate_batch(weak, PULSE, parameters={"stiffening": np.array([-0.3, -8.0])}, times=TIMES)
    alone = simulate(weak, PULSE, times=TIMES)
    assert batch["tip_position"].values[1].reshape(len(TIMES), -1)[:, -2:] == pytest.approx(
        alone["tip_position"].values[:, -1], abs=1e-12)
    q = equilibrium(weak, 6e5)
    root = np.sqrt(1.0 + (4 * 8.0 / (3 * 0.75)) ** 2 * q * q)
    held = weak.stiffness * (q - 8.0 * q * q * (2 / 3) * (1 + 2 * root) / (root * (1 + root)))
    assert held == pytest.approx(weak.torque_at(6e5) * weak.joint_gain, rel=1e-12)


def test_springs_that_give_way_end_the_simulation_in_a_sentence(soft):
    weak = soft.with_(stiffening=-8.0)
    with pytest.raises(SimulationError, match=r"after the start the spring of joint \d has lost its stiffness at"):
        simulate(weak, PULSE, times=TIMES)
    with pytest.raises(SimulationError, match="has lost its stiffness"):
        simulate(weak.with_(memory=Memory(creep_share=(0.1,), creep_time=(0.3,))), PULSE, times=TIMES)
    with pytest.raises(SimulationError, match="has lost its stiffness"):
        simulate(weak, PULSE, times=TIMES, method="LSODA")
    with pytest.raises(SimulationError, match=r"joint 1, which softens with its angle, holds at most 0\.05"):
        equilibrium(weak, 1e5)
    stepper = Stepper(weak)
    with pytest.raises(SimulationError, match="has lost its stiffness"):
        deque((stepper.step(9e4) for _ in range(500)), maxlen=0)


def test_an_adaptive_solver_looks_at_every_spring_of_a_body_in_space():
    """With K q (1 - q/2) and EA e (1 - 5 e), the slopes vanish at a swing of 1 rad and at a strain of 0.1."""
    parts = (Extension(60.0, 0.1, stiffening=-5.0),)
    model = chain_model(length=0.3, mass=0.1, links=3, stiffness=0.5, damping=1e-3, torque=(1e-6,), space=True,
                        stiffening=-0.5, extensions=parts)  # fmt: skip
    least, x = softest(model), np.zeros(2 * model.size)
    assert least(0.0, x) == 1.0
    for i, per_unit in ((0, 1.0), (3, 1.0), (5, 1.0), (6, 10.0)):
        assert least(0.0, np.where(np.arange(x.size) == i, 0.5 / per_unit, x)) == pytest.approx(0.5), i
    straight = model.with_(stiffening=0.0, extensions=(Extension(60.0, 0.1),))
    assert softest(straight) is None


def test_a_spring_in_space_gives_way_where_the_step_says_so(rng):
    """The size of a swing weighs its part about y by the ratio of the stiffnesses: here 1.8 rad about y are as 1."""
    model = chain_model(length=0.3, mass=0.1, links=2, stiffness=0.5, damping=1e-3, torque=(1e-6,), stiffening=-0.5,
                        space=Space(stiffness_ratio=0.3))  # fmt: skip
    still, seen = np.zeros(4), set()
    for x in [np.array([0.0, 1.7, 0.0, 0.0]), np.array([0.0, 0.0, 0.0, 1.9]), *rng.normal(0, 0.7, (100, 4))]:
        follows = spatial_springs.follows(x, still, 1e-3, mechanics_of(model).joints)
        assert follows == (not given_way(model, x)), x
        seen.add(follows)
    assert seen == {True, False}
