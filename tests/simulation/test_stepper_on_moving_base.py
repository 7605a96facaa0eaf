"""A Stepper whose base moves as prescribed: `simulate` to rounding, and MuJoCo."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from pliant.errors import InputError
from pliant.mechanics import mechanics_of
from pliant.model import Extension, Memory, Model, Space
from pliant.simulation import BaseMotion, Pulse, Stepper, simulate

TIME = np.linspace(0.0, 0.6, 121)
PLACE = 0.03 * np.column_stack([np.sin(9.0 * TIME), np.sin(7.0 * TIME), 1.0 - np.cos(5.0 * TIME)])
TURN = np.outer(np.sin(6.0 * TIME), [0.3, 0.2, -0.4])  # rotation vectors, rad
MOTIONS = {
    2: BaseMotion(TIME, PLACE[:, :2], angle=TURN[:, 2]),
    3: BaseMotion(TIME, PLACE, quaternion=Rotation.from_rotvec(TURN).as_quat()),
}
STEP = 1e-3
REMEMBERS = Memory(creep_share=[0.2], creep_time=[0.1], slip_share=[0.1], slip_angle=[0.02])


def arm(dimension: int, **more: object) -> Model:
    space = Space(radius=0.01) if dimension == 3 else None
    gravity = [0.5, -9.81] if dimension == 2 else [0.0, 0.5, -9.81]
    sizes = {"link_length": [0.05, 0.06], "link_mass": [0.01, 0.012], "stiffness": [0.4, 0.3], "damping": 2e-3}
    return Model(**sizes | {"torque": [1e-6], "base_length": 0.03, "gravity": gravity, "space": space} | more)


@pytest.mark.parametrize(("dimension", "more"), [
    (2, {}),
    pytest.param(2, {"memory": REMEMBERS}, marks=pytest.mark.slow),
    pytest.param(2, {"extensions": [Extension(80.0, 0.3)], "axial_gain": [30.0]}, marks=pytest.mark.slow),
    pytest.param(3, {}, marks=pytest.mark.slow),
    pytest.param(3, {"memory": REMEMBERS}, marks=pytest.mark.slow),
])  # fmt: skip
def test_steps_are_those_of_a_simulation(dimension: int, more: dict[str, object]) -> None:
    """Under a constant input, one by one and several at once, from the clock of the base on."""
    model, motion, start = arm(dimension, **more), MOTIONS[dimension], 0.1
    times = start + STEP * np.array([0, 1, 2, 12, 212])
    run = simulate(model, Pulse(2e4, -1.0, 9.0), times=times, time_step=STEP, base=motion)
    stepper = Stepper(model, STEP, 2e4, base=motion, start=start)
    chain = mechanics_of(stepper.model)
    for k, steps in enumerate(np.diff(np.rint((times - start) / STEP).astype(int)).tolist()):
        stepper.step(2e4, steps)
        q = np.concatenate([run[kind.names[0]].values[k + 1].ravel() for kind in chain.kinds])
        rows = np.concatenate([np.arange(model.size)[kind.rows] for kind in chain.kinds])
        np.testing.assert_allclose(chain.joint_coordinates(stepper.position)[rows], q, atol=1e-11)
        np.testing.assert_allclose(stepper.tips(), run["tip_position"].values[k + 1], atol=1e-12)
    assert stepper.time == pytest.approx(times[-1])
    assert np.abs(q).max() > 0.05
    saved = stepper.snapshot()
    ahead = [stepper.step(2e4, 3)[0].copy()]
    stepper.restore(saved)
    np.testing.assert_array_equal(stepper.step(2e4, 3)[0], ahead[0])


def test_a_motion_that_ends_or_does_not_fit_is_refused() -> None:
    model, motion = arm(2), MOTIONS[2]
    stepper = Stepper(model, STEP, base=motion, start=0.599)
    stepper.step(0.0)
    before = stepper.position.copy()
    with pytest.raises(InputError, match=r"known from 0 to 0.6 s, but is needed from 0.6 to 0.601 s"):
        stepper.step(0.0)
    np.testing.assert_array_equal(stepper.position, before)
    later = BaseMotion(TIME + 0.3, PLACE[:, :2], angle=TURN[:, 2])
    stepper.move_base(later)
    stepper.step(0.0)
    with pytest.raises(InputError, match="moves in a plane, but the motion of its base has 3 coordinates"):
        stepper.move_base(MOTIONS[3])
    with pytest.raises(InputError, match="the base of this Stepper rests"):
        Stepper(model, STEP).move_base(motion)
    with pytest.raises(InputError, match=r"moving base.* set moving_base to false for a body whose base rests"):
        Stepper(model.with_(moving_base=True), STEP)


def test_a_reset_begins_where_newer_poses_do() -> None:
    motion = BaseMotion(TIME + 0.3, PLACE[:, :2], angle=TURN[:, 2])
    stepper, other = Stepper(arm(2), STEP, base=MOTIONS[2]), Stepper(arm(2), STEP, base=motion, start=0.4)
    stepper.step(1e4, 350)
    stepper.move_base(motion)
    with pytest.raises(InputError, match=r"known from 0.3 to 0.9 s.*to begin at another time, state its `start`"):
        stepper.reset()
    assert stepper.time == pytest.approx(0.35)
    stepper.reset(start=0.4)
    assert stepper.time == stepper.start == 0.4
    np.testing.assert_array_equal(stepper.step(1e4, 5)[0], other.step(1e4, 5)[0])
    stepper.reset()
    assert stepper.time == 0.4


@pytest.mark.slow  # MuJoCo's forces in an adaptive integration
@pytest.mark.parametrize("dimension", [2, 3])
def test_steps_are_mujocos(dimension: int) -> None:
    pytest.importorskip("mujoco")
    from oracles.moving_base import OnMovingBase

    model, motion = arm(dimension), MOTIONS[dimension]
    times, angles = np.arange(0.0, 0.31, 0.05), np.zeros(2 * (dimension - 1))
    q, _, _, _ = OnMovingBase(model, motion).run(times, angles)
    stepper = Stepper(model, 2.5e-4, base=motion)
    stepper.reset(joint_angle=angles)
    for row in q[1:]:
        stepper.step(0.0, 200)
        np.testing.assert_allclose(mechanics_of(model).joint_coordinates(stepper.position), row,
                                   atol=1e-4 * np.abs(q).max())  # fmt: skip
