"""The filter on motions of its own model: consistent, exact where it must be, and unmoved by the order of arrival."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from oracles.estimates import nees

from pliant.compiler.choose import twin
from pliant.compiler.trace import planar_workspace
from pliant.contact.residual import static_residual
from pliant.equations.motion import step
from pliant.errors import InputError
from pliant.estimation import KalmanFilter, Noise, estimate, rows_of
from pliant.estimation.offline import mean_bounds, whiteness
from pliant.mechanics import mechanics_of
from pliant.model import Chamber, Station, chain_model
from pliant.recording import make_recording
from pliant.simulation import Trace, equilibrium, simulate

NOISE = Noise(position=3e-4, torque=3e-4, initial_angle=0.02, initial_rate=0.2)
H, SUB = 1 / 75, 7
ON = 8 * H  # the pressure comes on between two steps of the truth
CLOCK = np.array([0.0, ON - 2e-9, ON, 10.0])


@cache
def model(links=3):
    return chain_model(length=0.15, mass=0.06, links=links, stiffness=1.2, damping=6e-3, torque=[1.2e-6])


def pressure(t):
    return 1e5 * (np.asarray(t) >= ON - 1e-12)


def noisy_run(seed, frames=60, disturbance=0.0, random_walk=0.0):
    """Frames of the model under its own torque noise, from a random start: truth (T, 3n) and tips with noise."""
    m, rng = model(), np.random.default_rng(seed)
    n, h = m.n, H / SUB
    phi = mechanics_of(m).coordinates(np.zeros(n)) + NOISE.initial_angle * rng.standard_normal(n)
    w = NOISE.initial_rate * rng.standard_normal(n)
    d = disturbance * rng.standard_normal(n)
    body, joints, work, kernel = mechanics_of(m).body, mechanics_of(m).joints, planar_workspace(n), twin(step)
    truth = np.empty((frames, 3 * n))
    for f in range(frames):
        for k in range(SUB if f else 0):
            t = (f - 1) * H + (k + 0.5) * h
            push = d + NOISE.torque / np.sqrt(h) * rng.standard_normal(n)
            torque = float(m.torque_at(float(pressure(t)))) * m.joint_gain
            kernel(phi, w, h, torque, body, joints._replace(theta0=joints.theta0 + push / joints.K), work)
            d = d + random_walk * np.sqrt(h) * rng.standard_normal(n)
        truth[f] = np.concatenate([phi, w, d])
    tips = mechanics_of(m).tips(truth[:, :n])
    return truth, tips + NOISE.position * rng.standard_normal(tips.shape)


def recorded(tips, links=3):
    time = H * np.arange(tips.shape[0])
    names = [f"link_{i + 1}" for i in range(links)]
    return make_recording(time, tips, station=names, frame="planar", pressure=pressure(CLOCK), pressure_time=CLOCK)


@pytest.mark.slow
@pytest.mark.parametrize("random_walk", [0.0, 0.05])
def test_errors_and_innovations_are_as_large_as_the_filter_says(random_walk):
    noise = Noise(**{**NOISE.__dict__, "random_walk": random_walk, "initial_disturbance": 0.02 * (random_walk > 0)})
    N = noise.states(model())
    ratios, innovations, smooth = [], [], []
    for seed in range(100, 200):
        truth, tips = noisy_run(seed, disturbance=noise.initial_disturbance, random_walk=random_walk)
        found = estimate(recorded(tips), model(), noise=noise, time_step=H / SUB * 1.001, pressure_window=0.0)
        q, dq = mechanics_of(model()).joint_angles(truth[:, :3]), np.diff(truth[:, 3:6], axis=-1, prepend=0.0)
        parts = [found.joint_angle - q, found.joint_rate - dq]
        T = np.eye(3) - np.eye(3, k=-1)
        blocks = [T, T]
        if random_walk:
            parts.append(found.disturbance - truth[:, 6:])
            blocks.append(np.eye(3))
        J = np.zeros((N, N))
        for k, block in enumerate(blocks):
            J[3 * k : 3 * k + 3, 3 * k : 3 * k + 3] = block
        error = np.concatenate(parts, axis=1)
        ratios.append(nees(error[[20, 40, 59]], J @ found.state_covariance.values[[20, 40, 59]] @ J.T))
        innovations.append(found.attrs["nis_ratio"])
        later = (found.smooth_joint_rate.values - dq)[20:40]
        smooth.append(np.mean((later / found.smooth_joint_rate_sd.values[20:40]) ** 2))
        assert np.all(found.smooth_joint_rate_sd.values <= found.joint_rate_sd.values * (1 + 1e-9))
    low, high = mean_bounds(np.full(len(ratios), N))
    for at in range(3):  # independent runs, the same moment
        assert low < np.mean([r[at] for r in ratios]) / N < high
    low, high = mean_bounds(np.full(100 * 59, 6))
    assert low < np.mean(innovations) < high
    assert 0.9 < np.mean(smooth) < 1.1


def test_innovations_are_white_where_the_model_is_right():
    tips = noisy_run(3, frames=400)[1]
    found = estimate(recorded(tips), model(), noise=NOISE, time_step=H / SUB * 1.001, pressure_window=0.0)
    assert abs(found.attrs["innovation_correlation"]) < 1.5 * found.attrs["innovation_correlation_bound"]


def test_whiteness_sees_what_lasts(rng):
    slow = np.cumsum(rng.standard_normal((200, 2)), axis=0)
    value, bound = whiteness(slow)
    assert value > 0.9 > bound


def test_a_perfect_start_and_no_noise_follow_the_simulation():
    m = model()
    time = H * np.arange(40)
    run = simulate(m, Trace(CLOCK, pressure(CLOCK)), times=time, time_step=1e-3)
    found = estimate(recorded(run.tip_position.values), m, noise=NOISE, time_step=1e-3, pressure_window=0.0)
    np.testing.assert_allclose(found.joint_rate, run.joint_rate, atol=2e-5)


def test_missing_rows_are_skipped_and_counted():
    truth, tips = noisy_run(5)
    tips[10] = np.nan
    tips[20, 1] = np.nan
    found = estimate(recorded(tips), model(), noise=NOISE, time_step=H / SUB * 1.001, pressure_window=0.0)
    assert (found.attrs["frames_skipped"], found.attrs["frames_in_part"]) == (1, 1)
    assert np.isfinite(found.joint_rate.values).all()
    assert float(found.joint_angle_sd[10, 0]) > 1.05 * float(found.joint_angle_sd[9, 0])
    assert np.abs(found.joint_angle - mechanics_of(model()).joint_angles(truth[:, :3]))[10].max() < 0.05


def test_angles_and_a_tip_pose_do_as_well_as_tips():
    m = model().with_(stations=(Station("cap", 2, 0.05, 0.01),))
    truth = noisy_run(6)[0]
    place, angle = mechanics_of(m).stations(truth[:, :3])
    rng = np.random.default_rng(0)
    seen = make_recording(
        H * np.arange(60), place + 3e-4 * rng.standard_normal(place.shape), station=["cap"], frame="planar",
        angle=angle + 2e-3 * rng.standard_normal(angle.shape), angle_reference="base",
        pressure=pressure(CLOCK), pressure_time=CLOCK,
    )
    found = estimate(seen, m, noise=NOISE, time_step=H / SUB * 1.001, pressure_window=0.0)
    assert list(found.row.values) == ["cap x", "cap y", "cap angle"]
    low, high = found.attrs["nis_bounds"]
    assert low < found.attrs["nis_ratio"] < high
    error = np.abs(found.joint_angle.values - mechanics_of(m).joint_angles(truth[:, :3]))
    assert np.all(error < 5 * found.joint_angle_sd.values)


def fed(order):
    """A running filter that got pressure and frames in this order of arrival."""
    m = model()
    tips = noisy_run(7, frames=20)[1].reshape(20, -1)
    rows = rows_of(m, m.points)
    filter_ = KalmanFilter(m, NOISE, latency=0.004, time=-0.004)
    for kind, k in order:
        if kind == "p":
            filter_.push_pressure(k * 0.005, float(pressure(k * 0.005)))
        else:
            filter_.push_frame(k * H, rows, tips[k], np.full(6, NOISE.position**2))
    filter_.advance(0.3)
    return filter_


def test_late_frames_end_in_the_same_state():
    events = sorted([("p", k) for k in range(50)] + [("f", k) for k in range(20)],
                    key=lambda e: e[1] * 0.005 if e[0] == "p" else e[1] * H - 0.004)
    straight = fed(events)
    late = [e for e in events if e != ("f", 9)]
    late.insert(late.index(("f", 13)) + 1, ("f", 9))
    held_up = fed(late)
    assert (straight.counts.late, held_up.counts.late, held_up.counts.used) == (0, 1, straight.counts.used)
    np.testing.assert_allclose(held_up.angle, straight.angle, atol=1e-12)
    np.testing.assert_allclose(held_up.covariance, straight.covariance, rtol=1e-6, atol=1e-15)


def test_a_frame_older_than_the_buffer_is_left_out_and_counted():
    filter_ = fed([("p", 0), ("p", 60), ("p", 61), ("p", 62)])
    filter_.push_frame(0.0, rows_of(model(), model().points), np.zeros(6), np.ones(6))
    assert filter_.counts.too_late == 1
    filter_.push_frame(0.31, rows_of(model(), model().points), np.full(6, np.nan), np.ones(6))
    assert filter_.counts.skipped == 1


def test_bad_input_is_told():
    with pytest.raises(InputError, match="align it"):
        estimate(make_recording([0, 1.0], np.zeros((2, 1, 3)), station=["a"]), model())
    names = ["link_1", "link_2", "link_3"]
    with pytest.raises(InputError, match="no measured pressure"):
        estimate(make_recording([0, 1.0], np.zeros((2, 3, 2)), station=names, frame="planar"), model())
    with pytest.raises(InputError, match="name them alike"):
        estimate(make_recording([0, 1.0], np.zeros((2, 1, 2)), station=["a"], frame="planar"), model())
    with pytest.raises(InputError, match="torque must be finite and positive"):
        Noise(torque=0.0)
    with pytest.raises(InputError, match="must be finite"):
        KalmanFilter(model()).push_pressure(0.0, np.nan)
    with pytest.raises(InputError, match="at least one used value"):
        mean_bounds(np.zeros(3))


def test_several_pressures_reach_the_filter_by_their_names():
    """Radau's motion of two chambers driven apart, their columns the other way round in the recording."""
    low = Chamber([1.2e-6], joint_gain=[1, 1, 0], name="low")
    m = model().with_(chambers=(low, Chamber([-9e-7], joint_gain=[0, 0, 1], name="high")))
    time = H * np.arange(40)
    traces = [Trace([0.0, 0.1, 0.14, 1.0], [0.0, 0.0, p, p]) for p in (8e4, 5e4)]
    run = simulate(m, traces, times=time, method="LSODA", rtol=1e-8)
    clock = np.linspace(0.0, 1.0, 501)
    rng = np.random.default_rng(8)
    tips = run.tip_position.values + NOISE.position * rng.standard_normal((40, 3, 2))
    seen = make_recording(
        time, tips, station=["link_1", "link_2", "link_3"], frame="planar", pressure_time=clock,
        pressure=np.stack([traces[1](clock), traces[0](clock)], axis=1), chamber=["high", "low"],
    )
    found = estimate(seen, m, noise=NOISE, pressure_window=0.0)
    assert found.pressure.dims == ("time", "input")
    assert np.abs(found.joint_angle.values - run.joint_angle.values)[-10:].max() < 4e-3  # as the tips' noise lets it
    online = KalmanFilter(m, NOISE, time_step=2e-3)
    rows = rows_of(m, m.points)
    pushed = 0
    for k, at in enumerate(time):
        while pushed < clock.size and clock[pushed] <= at:
            online.push_pressure(clock[pushed], [traces[0](clock[pushed]), traces[1](clock[pushed])])
            pushed += 1
        online.push_frame(at, rows, tips[k].ravel(), np.full(6, NOISE.position**2))
    np.testing.assert_allclose(online.angle, np.cumsum(found.joint_angle.values[-1]), atol=2e-3)
    tau = np.array([1.2e-6 * 8e4, 1.2e-6 * 8e4, -9e-7 * 5e4])
    q = equilibrium(m, [8e4, 5e4])
    np.testing.assert_allclose(
        static_residual(m, mechanics_of(m).coordinates(q)[None], np.array([[8e4, 5e4]])), np.zeros((1, 3)), atol=1e-9
    )
    at_rest = mechanics_of(m).coordinates(q)[None]
    np.testing.assert_allclose(static_residual(m, at_rest, np.zeros((1, 2)))[0], tau, atol=1e-9)
    with pytest.raises(InputError, match="one for each chamber"):
        online.push_pressure(2.0, 5e4)
    with pytest.raises(InputError, match="no chamber 'left'"):
        estimate(seen, m, drive={"low": "left"})
