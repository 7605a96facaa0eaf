"""A Kalman filter whose base moves as prescribed: it follows the motion that `simulate` gives on the same base."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from pliant.errors import InputError
from pliant.estimation import KalmanFilter, rows_of
from pliant.mechanics import mechanics_of
from pliant.model import Memory, Model, Space
from pliant.simulation import BaseMotion, Pulse, simulate

TIME = np.linspace(0.0, 0.6, 121)
PLACE = 0.03 * np.column_stack([np.sin(9.0 * TIME) ** 2, np.sin(7.0 * TIME), 1.0 - np.cos(5.0 * TIME)])
TURN = np.outer(np.sin(6.0 * TIME), [0.3, 0.2, -0.4])  # rotation vectors, rad
MOTIONS = {
    2: BaseMotion(TIME, PLACE[:, :2], angle=TURN[:, 2]),
    3: BaseMotion(TIME, PLACE, quaternion=Rotation.from_rotvec(TURN).as_quat()),
}
FRAMES = np.arange(0.0, 0.55, 0.01)


def arm(dimension: int, **more: object) -> Model:
    space = Space(radius=0.01) if dimension == 3 else None
    gravity = [0.5, -9.81] if dimension == 2 else [0.0, 0.5, -9.81]
    sizes = {"link_length": [0.05, 0.06], "link_mass": [0.01, 0.012], "stiffness": [0.4, 0.3], "damping": 2e-3}
    return Model(**sizes | {"torque": [1e-6], "base_length": 0.03, "gravity": gravity, "space": space} | more)


def joints(run, model: Model) -> np.ndarray:
    chain = mechanics_of(model)
    values = np.empty((len(run.time), model.size))
    for kind in chain.kinds:
        values[:, kind.rows] = run[kind.names[0]].values
    return values


@pytest.mark.parametrize(("dimension", "more"), [
    (2, {}),
    pytest.param(2, {"memory": Memory(creep_share=[0.2], creep_time=[0.1])}, marks=pytest.mark.slow),
    pytest.param(3, {}, marks=pytest.mark.slow),
])  # fmt: skip
def test_predictions_follow_a_body_on_a_moving_base(dimension: int, more: dict[str, object]) -> None:
    """Without any frame, as a simulation does; with frames, from a wrong start too. At rest, they do not."""
    model, motion = arm(dimension, **more), MOTIONS[dimension]
    run = simulate(model, Pulse(2e4, -1.0, 9.0), times=FRAMES, time_step=5e-4, base=motion)
    q, chain = joints(run, model), mechanics_of(model)
    alone = KalmanFilter(model, time_step=1e-3, pressure=2e4, base=motion)
    rests = KalmanFilter(model, time_step=1e-3, pressure=2e4)
    seeing = KalmanFilter(model, time_step=1e-3, pressure=0.0, base=motion)
    seeing.push_pressure(0.0, 2e4)
    rows = rows_of(model, model.points[-1:])
    for time, tip in zip(FRAMES[1:], run["tip_position"].values[1:, -1], strict=True):
        seeing.push_frame(time, rows, tip, np.full(dimension, 1e-8))
    estimates = [f.state(FRAMES[-1]) for f in (alone, rests, seeing)]
    off = [np.abs(chain.joint_coordinates(e.angle) - q[-1]).max() / np.abs(q).max() for e in estimates]
    assert off[0] < 2e-3
    assert off[1] > 0.05
    assert off[2] < 1e-2  # creep, which begins with another input, is left to the disturbance
    assert seeing.counts.used == len(FRAMES) - 1
    assert not seeing.fault


def test_a_late_frame_is_applied_on_the_moving_base() -> None:
    model, motion = arm(2), MOTIONS[2]
    tips = simulate(model, Pulse(0.0), times=FRAMES[:20], time_step=5e-4, base=motion)["tip_position"].values[:, -1]
    rows, order = rows_of(model, model.points[-1:]), np.arange(1, 20)
    late = order.copy()
    late[[8, 9, 10]] = late[[10, 8, 9]]
    states = []
    for arrivals in (order, late):
        tracked = KalmanFilter(model, time_step=1e-3, base=motion)
        for k in arrivals:
            tracked.push_frame(FRAMES[k], rows, tips[k] + 1e-4 * (-1.0) ** k, np.full(2, 1e-8))
        states.append(tracked.state(FRAMES[19]).angle)
    np.testing.assert_allclose(states[1], states[0], atol=1e-6)


def test_a_motion_that_ends_or_is_missing_is_refused() -> None:
    model, motion = arm(2), MOTIONS[2]
    tracked = KalmanFilter(model, base=motion)
    with pytest.raises(InputError, match=r"known from 0 to 0.6 s, but is needed from 0 to 0.7 s"):
        tracked.state(0.7)
    assert tracked.time == 0.0
    with pytest.raises(InputError, match=r"moving base.* set moving_base to false for a body whose base rests"):
        KalmanFilter(model.with_(moving_base=True))
    with pytest.raises(InputError, match="moves in a plane"):
        KalmanFilter(model, base=MOTIONS[3])


def test_the_turn_of_the_base_is_no_motion_of_the_joints() -> None:
    """A stiff arm on a base that turns at 3 rad/s: the noise of the disturbance grows with the joint rates alone."""
    stiff = arm(2, stiffness=[400.0, 300.0], damping=0.5)
    turning = BaseMotion(TIME, np.zeros((TIME.size, 2)), angle=3.0 * TIME)
    tracked = KalmanFilter(stiff, time_step=1e-3, base=turning)
    tracked.advance(0.3)
    assert np.abs(tracked.rate).max() < 0.03
    assert tracked._densities.recent[0] < 1e-3


def test_a_frame_beyond_the_known_motion_is_not_kept() -> None:
    model = arm(2)
    rows, tracked = rows_of(model, model.points[-1:]), KalmanFilter(model, time_step=5e-3, base=MOTIONS[2])
    tip = np.array([0.0, 0.14])
    tracked.push_frame(0.55, rows, tip, np.full(2, 1e-6))
    with pytest.raises(InputError, match=r"known from 0 to 0.6 s"):
        tracked.push_frame(0.7, rows, tip, np.full(2, 1e-6))
    with pytest.raises(InputError, match=r"known from 0 to 0.6 s"):
        tracked.push_pressure(0.7, 1e4)
    tracked.push_frame(0.58, rows, tip, np.full(2, 1e-6))
    tracked.push_frame(0.56, rows, tip, np.full(2, 1e-6))
    assert (tracked.time, tracked.counts.used, tracked.counts.late) == (0.58, 3, 1)
    assert tracked.pressure.tolist() == [0.0]
