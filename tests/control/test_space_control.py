"""Control of a tip in space: closed forms, SciPy's Riccati solution, differences, and loops on an unlike body."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.linalg import expm, solve_discrete_are
from scipy.spatial.transform import Rotation

from pliant.compiler.twin import rebuild
from pliant.control import (
    Limits,
    Lqr,
    Task,
    Tuning,
    design_lqr,
    design_outputs,
    prepare_control,
    read_task,
    steady_inputs,
)
from pliant.control.horizon import Horizon
from pliant.control.model_plant import ModelPlant
from pliant.control.steady_inputs import output_rates, output_values, rest_under, tip_geometry
from pliant.equations import spatial, spatial_observation
from pliant.equations.observation import outputs
from pliant.errors import InputError
from pliant.estimation import KalmanFilter, State
from pliant.estimation.link_angles import LinkTips, with_rest_shape
from pliant.loop import Bounds, ControlLoop, VirtualActuator, VirtualClock, Watchdog
from pliant.loop.run import streams
from pliant.loop.sample import sample
from pliant.loop.task import run_task
from pliant.mechanics import mechanics_of
from pliant.model import Chamber, Extension, Space, Tendon, Valve, chain_model
from pliant.simulation import Stepper, equilibrium

PERIOD, LIMITS, ACROSS = 8e-3, Limits(1e5), ("tip_x", "tip_y")
AZIMUTHS = dict(zip("rgb", np.radians([90.0, 210.0, 330.0]), strict=True))


@cache
def arm(lag=0.0):
    """Two links that hang, between three chambers."""
    chambers = [Chamber(torque=(2e-6,), joint_gain=np.sin(a), cross_gain=-np.cos(a), name=name,
                        valve=Valve(rise_time=lag, fall_time=lag)) for name, a in AZIMUTHS.items()]  # fmt: skip
    return chain_model(length=0.3, mass=0.1, links=2, stiffness=0.6, damping=1.5e-2, gravity=(0, 0, 9.81),
                       chambers=chambers, space=Space(stiffness_ratio=1.2))  # fmt: skip


@cache
def pulled():
    """The same body between three tendons that are drawn in."""
    cords = [Tendon.at_azimuth(a, np.ones(2), driven_by="displacement", lever=8e-3, line_stiffness=2e3, pretension=1.0,
                               name=name) for name, a in AZIMUTHS.items()]  # fmt: skip
    return arm().with_(chambers=cords)


def tip_of(q, model):
    """The tip by SciPy's rotations, m."""
    turn, place = Rotation.identity(), np.zeros(3)
    for pair, length in zip(q.reshape(-1, 2), model.link_length, strict=True):
        turn = turn * Rotation.from_rotvec([*pair, 0.0])
        place = place + turn.apply([0.0, 0.0, length])
    return place


def still(x, time=0.0, rate=None, shift=None):
    none = np.zeros_like(x)
    return State(time, x.copy(), none if rate is None else rate.copy(), none if shift is None else shift, none,
                 np.zeros((8, 8)))  # fmt: skip


def test_outputs_and_their_rates_are_those_of_rotations(rng):
    model, x, v = arm(), rng.normal(0, 0.5, 4), rng.normal(0, 2.0, 4)
    names = ("tip_z", "tip_x")
    assert np.allclose(output_values(model, x, names), tip_of(x, model)[[2, 0]], atol=1e-15)
    found, longer = np.empty(2), model.with_(extensions=(Extension(60.0, 0.05, 0.0, None, "all"),))
    own = {"place_links": spatial_observation.place_links, "look": spatial_observation.look}
    rebuild(outputs, lambda kernel: kernel, own)(x, np.array([0.2]), *tip_geometry(longer, names), found)
    assert np.allclose(found, 1.2 * tip_of(x, model)[[2, 0]], atol=1e-15)
    assert np.allclose(output_values(longer, np.append(x, 0.2), names), found, atol=1e-15)
    row, speed, row_speed = (part[0] for part in output_rates(model, x[None], v[None], names))

    def velocity(x):
        return (tip_of(x + 1e-6 * v, model) - tip_of(x - 1e-6 * v, model))[[2, 0]] / 2e-6

    assert np.allclose(speed, velocity(x), atol=1e-8)
    ends = [(tip_of(x + s, model) - tip_of(x - s, model))[[2, 0]] / 2e-6 for s in 1e-6 * np.eye(4)]
    assert np.allclose(row, np.array(ends).T, atol=1e-9)
    ends = [(velocity(x + s) - velocity(x - s)) / 2e-3 for s in 1e-3 * np.eye(4)]
    assert np.allclose(row_speed, np.array(ends).T, atol=1e-5)
    with pytest.raises(InputError, match="unknown output 'angle_sum': use one or more of tip_x, tip_y, tip_z"):
        output_values(model, x, ("angle_sum",))


def test_the_rest_of_the_body_at_hand_is_found_from_its_points(rng):
    turns = rng.normal(0, 0.2, (2, 3)) * [1.0, 1.0, 0.0]
    other = arm().with_(space=Space(stiffness_ratio=1.2, rest_turn=turns))
    chain, arc = mechanics_of(other), np.linspace(0.0, 0.3, 13)
    nodes = chain.nodes(equilibrium(other))[1:]  # its base part has no length
    points = np.stack([np.interp(arc, [0.0, 0.15, 0.3], column) for column in nodes.T], axis=1)
    frames = points + 1e-9 * rng.standard_normal((6, 13, 3))
    frames[2, 4] = np.nan
    made, places = with_rest_shape(arm(), arc, frames)
    assert np.allclose(mechanics_of(made).tips(equilibrium(made)), nodes[1:], atol=1e-6)
    seen = places.frame(points)
    assert np.allclose(seen.values, nodes[1:].ravel(), atol=1e-12)
    assert seen.rows.shape == (6, 5)
    with pytest.raises(InputError, match=r"13 points, \(x, y, z\) each"):
        places.frame(points[:, :2])
    assert LinkTips(arm(), arc).frame(frames[2]).values.size == 6


def test_steady_inputs_bring_the_tip_where_it_is_wanted():
    for model, share, unit in ((arm(), 1e5, "0, 100, 0 kPa|kPa"), (pulled(), 4e-3, "4, 0, 0 mm")):
        highest = np.full(3, share)
        level = rest_under(model, share * np.array([0.5, 0.2, 0.0]), ACROSS).value
        found = steady_inputs(model, ACROSS, level, highest, np.zeros(3))
        assert np.allclose(tip_of(equilibrium(model, found.pressure), model)[:2], level, atol=2e-6)
        assert (found.pressure >= 0).all()
        with pytest.raises(InputError, match=f"out of reach of the chambers.* ({unit})$"):
            steady_inputs(model, ACROSS, np.array([0.0, 0.29]), highest, np.zeros(3))


def test_the_gain_is_scipys_of_matrices_by_differences():
    """State space by differences of the accelerations and of SciPy's rotations; no valve, no dead time."""
    model, tuning = arm(), Tuning()
    level = rest_under(model, np.array([5e4, 2e4, 1e4]), ACROSS).value - tip_of(equilibrium(model), model)[:2]
    made = design_outputs(model, ACROSS, level[None], LIMITS, PERIOD, tuning=tuning).gains[0]
    chain, p = mechanics_of(model), made.rest.pressure
    x0, law = equilibrium(model, p), 2e-6 * model.actuation.gain

    def turning(z):
        a = np.zeros(4)
        spatial.acceleration(z[:4], z[4:8], 1e3 * z[8:] @ law, chain.body, chain.joints, chain.workspace(), a)
        return np.append(z[4:8], a)

    z = np.concatenate([x0, np.zeros(4), p / 1e3])
    whole = np.array([(turning(z + s) - turning(z - s)) / 2e-5 for s in 1e-5 * np.eye(11)]).T
    C = np.array([(tip_of(x0 + s, model) - tip_of(x0 - s, model))[:2] / 2e-6 for s in 1e-6 * np.eye(4)]).T
    step = expm(PERIOD * np.vstack([whole, np.zeros((3, 11))]))
    A, B = np.eye(10), np.vstack([step[:8, 8:], np.zeros((2, 3))])
    A[:8, :8], A[8:, :4] = step[:8, :8], PERIOD * C
    gain = -C @ np.linalg.solve(whole[:, :8], whole[:, 8:])[:4]
    Q = np.zeros((10, 10))
    Q[:4, :4], Q[4:8, 4:8] = C.T @ C, tuning.damping_time**2 * C.T @ C
    Q[8:, 8:] = np.eye(2) / tuning.integral_time**2
    R = tuning.effort * np.diag(np.sum(gain**2, axis=0))
    P = solve_discrete_are(A, B, 1e6 * Q, 1e6 * R)
    K = np.linalg.solve(1e6 * R + B.T @ P @ B, B.T @ P @ A)
    assert np.allclose(made.K, K, rtol=2e-3, atol=2e-4 * np.abs(K).max())


@pytest.mark.slow  # compiles the arithmetic of a period
def test_a_command_makes_up_for_what_the_state_and_its_rest_are_off_by(rng):
    model = arm()
    design = design_outputs(model, ACROSS, np.zeros((1, 2)), LIMITS, PERIOD)
    law, made = Lqr(design, LIMITS), design.gains[0]
    rest, x, v = equilibrium(model), 1e-4 * rng.standard_normal(4), 1e-3 * rng.standard_normal(4)
    law._integral[:] = [2e-5, -1e-5]
    away = np.concatenate([x, v, law._integral])
    asked = -1e3 * made.K @ away
    asked += 5e3 - asked.min()  # above 0 in all
    design.pressure[0] += asked + 1e3 * made.K @ away
    assert np.allclose(law.step(0.0, still(rest + x, rate=v), np.zeros(3)), asked, atol=1e-6)
    law.reset()
    shift = 1e-4 * rng.standard_normal(4)
    more = -np.linalg.pinv(made.rest.gain) @ made.rest.row[:, :4] @ shift  # least pressures against the shift
    settled = still(rest + shift + made.slope @ more, shift=shift)
    assert np.allclose(law.step(0.0, settled, np.zeros(3)), design.pressure[0] + more, rtol=1e-6)


@pytest.mark.slow  # compiles the prediction
def test_slopes_of_a_prediction_in_space_are_differences(rng):
    model = arm(0.02)
    design = design_outputs(model, ACROSS, np.zeros((1, 2)), LIMITS, PERIOD)
    horizon, nodes = Horizon(design, 3, 3), rng.uniform(1e4, 8e4, (3, 3))
    state = still(0.2 * rng.standard_normal(4), rate=rng.standard_normal(4), shift=0.05 * rng.standard_normal(4))
    valves, waiting = [np.array([2e4])] * 3, [np.zeros(0)] * 3
    ahead = horizon.predict(state, valves, waiting, nodes)
    for j in range(9):
        ends = []
        for sign in (1, -1):
            other = nodes.ravel().copy()
            other[j] += sign * 10.0
            moved = horizon.predict(state, valves, waiting, other.reshape(3, 3))
            ends.append(np.concatenate([moved.position, moved.rate], axis=1))
        slope = (ends[0] - ends[1]) / 20.0
        assert np.abs(ahead.slope[:, :, j] - slope).max() < 1e-6 * np.abs(slope).max() + 1e-12


@pytest.mark.slow  # compiles the prediction and the filter
def test_a_prediction_and_the_filter_feel_the_same_disturbance():
    """Torques that the model does not explain act unchanged where the strain multiplies the springs of joints."""
    wall = Extension(60.0, 0.5, stiffening=-1.0, cubic_stiffening=60.0, stiffens_bending=True)
    chambers = [replace(c, axial_gain=40.0) for c in arm().chambers]
    model, pressure = arm().with_(chambers=chambers, extensions=(wall,)), np.array([6e4, 5e4, 4e4])
    horizon = Horizon(design_outputs(model, ACROSS, np.zeros((1, 2)), LIMITS, PERIOD), 3, 3)
    kalman = KalmanFilter(model, time_step=PERIOD / 2)  # the steps of the prediction
    kalman.disturbance[:] = [0.02, -0.03, 0.01, 0.04]
    kalman.push_pressure(0.0, pressure)
    nothing = [np.zeros(0)] * 3
    ahead = horizon.predict(kalman.state(0.0), nothing, nothing, np.tile(pressure, (3, 1)))
    kalman.advance(horizon.periods * PERIOD)
    assert abs(kalman.strain[0]) > 0.02
    np.testing.assert_allclose(ahead.position[-1], [*kalman.angle, *kalman.strain], rtol=0, atol=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize("feedback", ["lqr", "mpc"])
def test_the_loop_brings_an_unlike_body_to_its_place(feedback):
    """A body softer by a twelfth that rests elsewhere: the rest is measured, the rehearsal settles, the tip arrives."""
    model = arm(0.03)
    unlike = model.with_(stiffness=0.55, space=Space(stiffness_ratio=1.3, rest_turn=[[0.05, -0.03, 0.0]]))
    plant = ModelPlant(unlike, period=PERIOD, time_step=2e-3)
    frames = np.array([plant.advance(np.zeros(3))[1] for _ in range(8)])
    level = rest_under(model, np.array([6e4, 2e4, 0.0]), ACROSS).value - tip_of(equilibrium(model), model)[:2]
    task = Task(np.zeros(1), level[None], 1.0, feedback=feedback, outputs=ACROSS)
    ready = prepare_control(model, plant.arc_length, frames, task, LIMITS, PERIOD, estimator="filter")
    assert ready.rehearsal.settles
    assert ready.pipeline.axes == 3
    clock, start = VirtualClock(), plant.tip
    arm_of_plant = VirtualActuator(plant, clock)
    loop = ControlLoop([arm_of_plant], arm_of_plant, ready.pipeline, Watchdog(Bounds(1.2e5)), PERIOD, clock)
    assert loop.run(1.0) == ""
    assert np.abs((plant.tip - start)[:2] - level).max() < 1e-3
    assert np.linalg.norm(level) > 0.05


@pytest.mark.slow
def test_tendons_bring_the_tip_to_its_place_and_never_push():
    model, highest = pulled(), Limits(4e-3)
    level = rest_under(model, np.array([2e-3, 8e-4, 0.0]), ACROSS).value - tip_of(equilibrium(model), model)[:2]
    law = Lqr(design_outputs(model, ACROSS, level[None], highest, PERIOD), highest)
    stepper, command, commands = Stepper(model.with_(stiffness=0.55), PERIOD / 4), np.zeros(3), []
    start = tip_of(stepper.angle.copy(), model)
    for k in range(190):
        command = law.step(k * PERIOD, still(stepper.angle, k * PERIOD, stepper.rate), command)
        commands.append(command)
        for _ in range(4):
            stepper.step(command)
    assert np.abs((tip_of(stepper.angle.copy(), model) - start)[:2] - level).max() < 1e-3
    assert np.min(commands) >= 0.0
    assert np.max(commands) <= 4e-3


def test_what_does_not_fit_is_refused(tmp_path):
    frames, task = np.zeros((8, 13, 3)), Task(np.zeros(1), np.zeros((1, 2)), 0.1, outputs=ACROSS)
    with pytest.raises(InputError, match=r"does not support a body in space.*estimator filter"):
        prepare_control(arm(), np.linspace(0, 0.3, 13), frames, task, LIMITS, PERIOD)
    with pytest.raises(InputError, match="needs a planar chain"):
        design_lqr(arm().with_(chambers=arm().chambers[:1]), 1e5, PERIOD)
    (tmp_path / "t.toml").write_text("[[setpoint]]\ntime_s = 0\ntip_x_mm = 3\ntip_z_mm = -4\n")
    wanted = read_task(tmp_path / "t.toml")
    assert wanted.task.outputs == ("tip_x", "tip_z")
    assert np.allclose(wanted.task.displacement, [[3e-3, -4e-3]])
    with pytest.raises(InputError, match=r"limits inputs by highest_kpa, but 'r' of .* takes a displacement"):
        run_task(pulled(), None, wanted, tmp_path)


def test_a_loop_takes_shapes_of_its_own_space_alone():
    flat, whole = np.zeros((5, 2)), np.zeros((5, 3))
    for axes, good, bad in ((2, flat, whole), (3, whole, flat)):
        shapes, _ = streams(0, 0, axes)
        assert shapes.accept(sample("shape", bad, 1), 1) is None
        assert shapes.accept(sample("shape", good, 1), 1) is not None
        assert shapes.rejected == 1
