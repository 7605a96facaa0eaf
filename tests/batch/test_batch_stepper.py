"""Chains held in lanes move as `Stepper` moves each, whatever their valves, chambers and springs."""

from __future__ import annotations

import numpy as np
import pytest

from pliant.actuators import chen2018
from pliant.batch.stepper import OneByOne, OnSpaceLanes, batch_stepper
from pliant.errors import InputError
from pliant.model import Chamber, Extension, Memory, Model, Space, Valve, chain_model
from pliant.simulation import Stepper


def test_every_lane_is_a_stepper():
    plain = chen2018.model(valve=Valve(rise_time=0.02, fall_time=0.03))
    soft = chen2018.model(
        stiffness=2.0, gravity=[1.0, -9.0], swell_share=0.3, swell_time=0.4, inflation_limit=9e5, stiffening=-0.1,
        cubic_stiffening=0.3, stiffening_bound=0.6,
        torque=[1e-6, 1e-12], valve=Valve(rise_time=0.05, rise_rate=4e5, fall_rate=8e5),
    )
    which = np.array([3, 9])
    batch = batch_stepper([plain, soft], 11, 1e-3)
    batch.reset(which, np.ones(2, dtype=int))
    alone = [Stepper(soft if k in which else plain, 1e-3) for k in range(11)]
    for pressure in np.random.default_rng(1).uniform(0.0, 1e5, (4, 11, 1)):
        assert not batch.hold(pressure, 20).any()
        for stepper, p in zip(alone, pressure, strict=True):
            stepper.step(float(p[0]), 20)
    assert batch.position == pytest.approx(np.array([s.angle for s in alone]), abs=1e-13)
    assert batch.velocity == pytest.approx(np.array([s.rate for s in alone]), abs=1e-11)
    assert np.abs(batch.position).max() > 0.1


def around(torque=(2e-6,), **fields) -> Model:
    chambers = [Chamber(torque, joint_gain=np.sin(a), cross_gain=-np.cos(a), name=f"c{k}", **fields)
                for k, a in enumerate(np.radians([90.0, 210.0, 330.0]))]  # fmt: skip
    return chain_model(length=0.3, mass=0.1, links=2, stiffness=0.5, damping=5e-3, gravity=(0.5, 0.2, -9.8),
                       chambers=chambers, space=Space(stiffness_ratio=1.2, radius=0.012))  # fmt: skip


IN_SPACE = {
    "valves": lambda: around(valve=Valve(rise_time=0.05, rise_rate=4e5, fall_rate=8e5)),
    "walls": lambda: around(swell_share=0.3, swell_time=0.1, inflation_limit=9e5, inflation_time=0.05),
    "saturating": lambda: around([2e-6, 1e5], law="saturating").with_(
        space=Space(twist_ratio=0.7, radius=0.012), stiffening=-0.2),
    "lengthens": lambda: around(axial_gain=40.0).with_(extensions=(Extension(60.0, 0.4, 0.0, None, "whole"),)),
}  # fmt: skip


@pytest.mark.slow  # compiles the steps of bodies of several sizes
@pytest.mark.parametrize("body", list(IN_SPACE))
def test_every_chain_in_space_is_a_stepper(body):
    first = IN_SPACE[body]()
    second = first.with_(stiffness=0.7, gravity=(0.0, -3.0, 5.0))
    which = np.array([3, 9])
    batch = batch_stepper([first, second], 11, 1e-3)
    assert isinstance(batch, OnSpaceLanes)
    batch.reset(which, np.ones(2, dtype=int))
    alone = [Stepper(second if k in which else first, 1e-3, np.zeros(3)) for k in range(11)]
    for pressure in np.random.default_rng(1).uniform(0.0, 6e4, (4, 11, 3)):
        assert not batch.hold(pressure, 20).any()
        for stepper, p in zip(alone, pressure, strict=True):
            stepper.step(p, 20)
    assert batch.position == pytest.approx(np.array([s.position for s in alone]), abs=1e-12)
    assert batch.velocity == pytest.approx(np.array([s.velocity for s in alone]), abs=1e-10)
    assert np.ptp(batch.position, axis=0).max() > 0.05
    batch.reset(np.array([9]), np.zeros(1, dtype=int))
    assert batch.position[9] == pytest.approx(Stepper(first, 1e-3, np.zeros(3)).position, abs=1e-15)


@pytest.mark.slow  # compiles the steps
def test_a_chain_in_space_that_fails_leaves_its_neighbours():
    soft = around().with_(stiffening=-0.5)
    batch, failed = batch_stepper([soft], 3, 1e-3), np.zeros(3, dtype=bool)
    assert isinstance(batch, OnSpaceLanes)
    still, burst = [1e3, 0.0, 0.0], [1e9, 0.0, 0.0]
    failed |= batch.hold(np.array([still, burst, still]), 20)
    assert failed.tolist() == [False, True, False]
    alone = Stepper(soft, 1e-3, np.zeros(3))
    alone.step(np.array(still), 20)
    assert batch.position[2] == pytest.approx(alone.position, abs=1e-12)
    with pytest.raises(InputError, match=r"expected pressures \(3, 3\)"):
        batch.hold(np.zeros((2, 3)), 1)


def test_chains_in_space_that_share_no_vector():
    assert isinstance(batch_stepper([around().with_(memory=Memory((0.1,), (0.3,)))], 2, 1e-3), OneByOne)


def test_two_chambers():
    two = (
        Chamber(torque=[6e-7], joint_gain=[1.0, 1.0, 0.0, 0.0, 0.0], valve=Valve(rise_time=0.02), name="near"),
        Chamber(torque=[-5e-7], joint_gain=[0.0, 0.0, 1.0, 1.0, 1.0], name="far"),
    )
    model = chen2018.model().with_(chambers=two)
    batch, alone = batch_stepper([model], 3, 1e-3), Stepper(model, 1e-3, np.zeros(2))
    batch.hold(np.array([[0.0, 0.0], [8e4, 3e4], [1e4, 0.0]]), 50)
    alone.step(np.array([8e4, 3e4]), 50)
    assert batch.position[1] == pytest.approx(alone.angle, abs=1e-13)
    assert not np.any(batch.position[0])


def test_what_no_batch_is_refused():
    model = chen2018.model()
    with pytest.raises(InputError, match="must share n"):
        batch_stepper([model, chen2018.model(links=3)], 2, 1e-3)
    with pytest.raises(InputError, match="must share memory"):
        batch_stepper([model, chen2018.model(memory=Memory((0.1,), (0.5,)))], 2, 1e-3)
    two = tuple(Chamber([1e-6], joint_gain=np.ones(5), name=name) for name in "ab")
    with pytest.raises(InputError, match="must have equally many chambers"):
        batch_stepper([model, model.with_(chambers=two)], 2, 1e-3)
    with pytest.raises(InputError, match="too long"):
        batch_stepper([model, chen2018.model(stiffness=1e4)], 2, 1e-3)


def test_chains_that_remember_are_steppers_of_their_own():
    soft = chen2018.model(memory=Memory(slip_share=(0.3,), slip_angle=(0.02,)))
    stiff = soft.with_(stiffness=2.0)
    batch, pressure = batch_stepper([soft, stiff], 3, 1e-3), np.array([[6e4], [3e4], [9e4]])
    batch.reset(np.array([1]), np.array([1]))
    alone = [Stepper(stiff if k == 1 else soft, 1e-3) for k in range(3)]
    for _ in range(2):
        assert batch.hold(pressure, 15).tolist() == [False] * 3
    for stepper, p in zip(alone, pressure, strict=True):
        stepper.step(float(p[0]), 30)
    np.testing.assert_array_equal(batch.position, [s.angle for s in alone])
    np.testing.assert_array_equal(batch.velocity, [s.rate for s in alone])
    batch.reset(np.array([0, 1, 2]), np.array([0, 0, 1]))  # as the body that it was, as another one
    assert np.abs(batch.position).max() == np.abs(batch.velocity).max() == 0.0
    batch.hold(np.full((3, 1), 3e4), 10)
    np.testing.assert_array_equal(batch.position[0], batch.position[1])
    assert abs(batch.position[2, -1]) < abs(batch.position[0, -1])


@pytest.mark.parametrize("memory", [Memory(), Memory(slip_share=(0.3,), slip_angle=(0.02,))], ids=["none", "slip"])
def test_a_chain_that_fails_is_told_and_goes_on_after_a_reset(memory):
    model = chen2018.model(stiffening=-0.45, memory=memory)
    batch = batch_stepper([model], 2, 1e-3)
    failed = np.zeros(2, dtype=bool)
    for _ in range(20):
        failed |= batch.hold(np.array([[1e4], [9e6]]), 20)
    assert failed.tolist() == [False, True]
    batch.reset(np.array([1]), np.array([0]))
    assert not batch.hold(np.array([[1e4], [1e4]]), 20).any()
    assert np.isfinite(batch.position).all()
