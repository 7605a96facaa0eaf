"""The filter of a chain in space: a textbook filter, the planar one, and what it claims of its own errors."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
import typer
import xarray as xr
from oracles.derivatives import plain_slopes
from oracles.estimates import nees
from scipy.spatial.transform import Rotation
from typer.testing import CliRunner

from pliant.cli.estimate import estimate as command
from pliant.cli.estimate import report
from pliant.compiler.choose import twin
from pliant.compiler.twin import rebuild
from pliant.equations import linearised, spatial, spatial_observation
from pliant.errors import InputError
from pliant.estimation import KalmanFilter, Noise, estimate, kalman_loops, rows_of
from pliant.estimation.measurement import measurement_of
from pliant.estimation.noise import scales
from pliant.estimation.offline import chain_of, mean_bounds
from pliant.estimation.symbols import FilterNoise, FilterState, make_workspace
from pliant.mechanics import mechanics_of
from pliant.model import Chamber, Extension, Memory, Space, Station, chain_model, save_model
from pliant.recording import make_recording, write
from pliant.simulation import Trace, simulate, state

NOISE = Noise(position=3e-4, torque=3e-4, initial_angle=0.02, initial_rate=0.2)
H, SUB = 1 / 75, 4
CLOCK = np.arange(0.0, 1.5, 0.05)
BODY = {"length": 0.15, "mass": 0.06, "links": 2, "stiffness": 1.2, "damping": 6e-3}


def bend(azimuth, name):
    return Chamber(torque=(1.2e-6,), joint_gain=np.sin(azimuth), cross_gain=-np.cos(azimuth), name=name)


@cache
def arm():
    chambers = [bend(a, name) for a, name in zip(np.radians([90, 210, 330]), "abc", strict=True)]
    stations = [Station("middle", 0, 0.075, 0.01, 0.004), Station("tip", 1, 0.075, 0.0, -0.01)]
    return chain_model(**BODY, gravity=(0.5, 0.0, -9.81), chambers=chambers, space=Space(stiffness_ratio=1.4),
                       stations=stations)  # fmt: skip


def pressures():
    return np.stack([4e4 * (1.0 + np.sin(2 * np.pi * f * CLOCK)) for f in (0.8, 1.3, 2.1)], axis=1)


def recorded(places, time, **more):
    return make_recording(time, places, station=["middle", "tip"], frame="spatial",
                          pressure=pressures(), pressure_time=CLOCK, chamber=list("abc"), **more)  # fmt: skip


def noisy_run(seed, frames=40):
    """Frames of the arm under torque noise of its own, from a random start: truth (T, 2N) and stations with noise."""
    m, rng = arm(), np.random.default_rng(seed)
    chain, h = mechanics_of(m), H / SUB
    x, v = NOISE.initial_angle * rng.standard_normal(4), NOISE.initial_rate * rng.standard_normal(4)
    rest = KalmanFilter(m, NOISE, pressure=pressures()[0]).angle
    x += rest
    size = NOISE.torque / np.sqrt(h) * scales(m)
    parts, kernel, truth = chain.parts(), twin(spatial.step), np.empty((frames, 8))
    level = np.array([np.interp(h * (np.arange(SUB * frames) + 0.5), CLOCK, p) for p in pressures().T])
    torque = 1.2e-6 * level.T @ m.actuation.gain
    for f in range(frames):
        for k in range((f - 1) * SUB, f * SUB) if f else ():
            kernel(x, v, h, torque[k] + size * rng.standard_normal(4), *parts)
        truth[f] = np.append(x, v)
    places = chain.stations(truth[:, :4])[0]
    return truth, places + NOISE.position * rng.standard_normal(places.shape)


def test_rows_in_space_see_three_coordinates_and_three_of_an_orientation():
    rows = rows_of(arm(), arm().points[:1], angle=True)
    place = [[kind, 0, 0.075, 0.01, 0.004] for kind in (1, 2, 4)]
    assert rows.tolist() == [*place, *([kind, 0, 0.0, 0.0, 0.0] for kind in (5, 6, 7))]


def test_recordings_of_another_space_or_other_stations_are_refused():
    flat = make_recording(CLOCK, np.zeros((30, 1, 2)), station=["tip"], frame="planar")
    with pytest.raises(InputError, match="--space"):
        measurement_of(flat, arm(), NOISE)
    other = make_recording(CLOCK, np.zeros((30, 9, 3)), station=[f"p{k}" for k in range(9)], frame="spatial")
    with pytest.raises(InputError, match=r"name them alike$"):
        measurement_of(other, arm(), NOISE)


def test_what_is_unknown_of_a_torque_goes_with_its_stiffness():
    made = arm().with_(space=Space(stiffness_ratio=1.4, twist_ratio=0.7, radius=0.01))
    assert np.allclose(scales(made), [1.0, 1.4, 1.0, 1.4, 0.7, 0.7])


def test_a_disturbance_pushes_turns_and_strains_alike(rng):
    """The text of a prediction, not compiled, against a step under so much more torque."""
    model = arm().with_(extensions=(Extension(60.0, 0.05, 0.0, None, "all"),))
    chain, N = mechanics_of(model), 5
    x, v, d = (size * rng.normal(size=N) * [1, 1, 1, 1, 0.1] for size in (0.2, 1.0, 0.02))
    torque, P = rng.normal(0, 0.02, N), np.eye(3 * N)
    state = FilterState(x.copy(), v.copy(), d, P, np.zeros((2, 0)))
    densities = FilterNoise(*Noise(random_walk=0.1).densities(model), np.zeros(1))
    own = {"step_jacobian": rebuild(linearised.step_jacobian, lambda kernel: kernel, {"step": spatial.step})}
    own["motion_of"] = spatial_observation.motion_of
    predict = rebuild(kalman_loops.predict, lambda kernel: kernel, own)
    workspace, slopes = make_workspace(model, 3 * N, 3), plain_slopes(chain.workspace(complex))
    workspace = workspace._replace(slopes=slopes, J=slopes.J)
    assert predict(state, chain_of(model), 2e-3, torque, densities, workspace) == 0
    spatial.step(x, v, 2e-3, torque + d, chain.body, chain.joints, chain.workspace())
    assert np.allclose(state.angle, x, rtol=0, atol=1e-13)
    assert np.allclose(state.rate, v, rtol=0, atol=1e-10)


def test_a_shift_of_the_rest_holds_memory_and_disturbance(rng):
    """The springs of the body without memory, their rest shifted, hold what springs, creep and slip hold."""
    memory = Memory(creep_share=(0.3,), creep_time=(0.5,), slip_share=(0.2,), slip_angle=(0.02,))
    run = KalmanFilter(arm().with_(memory=memory), NOISE, time=0.0)
    creep, slip, q, d = rng.normal(0, 0.02, (4, 4))
    run.memory[:, 0], run.memory[:, 1], run.angle[:], run.disturbance[:] = creep, slip, q, d
    K = mechanics_of(arm()).joints.K
    found = run.state(0.0)
    assert np.allclose(1.5 * K * (q - found.rest_shift), K * (q + 0.3 * (q - creep) + 0.2 * slip) - d, atol=1e-14)


@pytest.mark.slow  # compiles the filter, as all below
def test_it_is_the_textbook_filter_about_its_own_estimate():
    """F, G and H are central differences of the step and of the stations; the update inverts the whole S."""
    m = arm()
    chain = mechanics_of(m)
    body, joints, work = chain.parts()
    noise = Noise(position=3e-4, torque=2e-3, random_walk=0.05, initial_disturbance=0.02)
    run = KalmanFilter(m, noise, time=0.0, time_step=H)
    state, P, rng = np.concatenate([run.angle, np.zeros(8)]), run.covariance.copy(), np.random.default_rng(4)
    rows, variance, level = rows_of(m, m.points), np.full(6, noise.position**2), np.array([6e4, 1e4, 2e4])
    run.push_pressure(0.0, level)
    drive, sizes = 1.2e-6 * level @ m.actuation.gain, scales(m)

    def moved(s):
        x, v = s[:4].copy(), s[4:8].copy()
        twin(spatial.step)(x, v, H, drive + s[8:], body, joints, work)
        return np.concatenate([x, v, s[8:]])

    def seen(s):
        return chain.stations(s[:4])[0].ravel()

    def slope(function, s):
        return np.array([(function(s + d) - function(s - d)) / 2e-5 for d in 1e-5 * np.eye(12)]).T

    for f in range(1, 6):
        F, state = slope(moved, state), moved(state)
        G = F[:, 8:] - np.eye(12)[:, 8:]
        P = F @ P @ F.T + G @ np.diag((noise.torque * sizes) ** 2 / H) @ G.T
        P[8:, 8:] += np.diag((noise.random_walk * sizes) ** 2 * H)
        z, C = seen(state) + 1e-3 * rng.standard_normal(6), slope(seen, state)
        gain = P @ C.T @ np.linalg.inv(C @ P @ C.T + np.diag(variance))
        state, P = state + gain @ (z - seen(state)), P - gain @ C @ P
        run.push_frame(f * H, rows, z, variance)
        own = np.concatenate([run.angle, run.rate, run.disturbance])
        assert np.abs(own - state).max() < 1e-6 * np.abs(state).max()
        assert np.abs(run.covariance - P).max() < 1e-6 * np.abs(P).max()
    shift = run.state(5 * H).rest_shift
    assert np.allclose(shift, state[8:] / joints.K, rtol=1e-4)


@pytest.mark.slow
@pytest.mark.parametrize("memory", [
    Memory(), Memory(creep_share=(0.3,), creep_time=(0.1,), slip_share=(0.4,), slip_angle=(0.01,), boucwen_share=0.5),
])  # fmt: skip
def test_a_motion_in_a_plane_is_filtered_as_the_planar_filter_does(memory):
    plane = chain_model(**BODY, gravity=(0.3, -9.81), torque=(1.2e-6,), memory=memory)
    space = chain_model(**BODY, gravity=(0.0, 0.3, -9.81), torque=(1.2e-6,), space=True, memory=memory)
    noise = Noise(torque=2e-3, random_walk=0.05, motion_growth=3.0, initial_disturbance=0.02)
    flat, whole = (KalmanFilter(m, noise, time=0.0) for m in (plane, space))
    T, inner = mechanics_of(plane).to_joints, np.ix_(np.arange(0, 12, 2), np.arange(0, 12, 2))
    turn = np.kron(np.diag([1.0, 1.0, 0.0]), T) + np.kron(np.diag([0.0, 0.0, 1.0]), np.eye(2))
    whole.covariance[inner] = turn @ flat.covariance @ turn.T  # the planar filter starts from absolute angles
    rng, across, up = np.random.default_rng(2), rows_of(plane, plane.points), rows_of(space, space.points)
    for run in (flat, whole):
        run.push_pressure(0.0, 7e4)
    for f in range(1, 25):
        places = mechanics_of(plane).stations(flat.angle)[0] + 1e-3 * rng.standard_normal((2, 2))
        flat.push_frame(f * H, across, places.ravel(), np.full(4, 1e-7))
        whole.push_frame(f * H, up, np.pad(places, ((0, 0), (1, 0))).ravel(), np.full(6, 1e-7))
        assert np.allclose(whole.angle[::2], mechanics_of(plane).joint_angles(flat.angle), rtol=0, atol=1e-11)
        assert np.allclose(whole.rate[::2], mechanics_of(plane).joint_rates(flat.rate), rtol=0, atol=1e-9)
        assert np.allclose(whole.disturbance[::2], flat.disturbance, rtol=0, atol=1e-10)
        assert np.allclose(whole.covariance[inner], turn @ flat.covariance @ turn.T, rtol=1e-7, atol=1e-12)
        assert np.allclose(whole.memory[::2], flat.memory, rtol=0, atol=1e-10)
    assert np.abs(whole.angle[1::2]).max() < 1e-14
    assert np.abs(whole.angle).max() > 0.02


@pytest.mark.slow
def test_segments_that_remember_are_filtered_as_the_planar_filter_does():
    """Frames that disagree with the prediction: slip elements of the strain follow each correction, creep stays."""
    memory = Memory(creep_share=(0.3,), creep_time=(0.1,), axial_creep_share=(1.3,), axial_creep_time=(0.2,),
                    axial_slip_share=(0.4,), axial_slip_strain=(0.004,))  # fmt: skip
    shared = {**BODY, "torque": (1.2e-6,), "axial_gain": 30.0, "memory": memory,
              "extensions": (Extension(60.0, 0.2, 0.0, None, "whole"),)}  # fmt: skip
    plane = chain_model(**shared, gravity=(0.3, -9.81))
    space = chain_model(**shared, gravity=(0.0, 0.3, -9.81), space=True)
    noise = Noise(torque=2e-3, random_walk=0.05, initial_disturbance=0.02)
    flat, whole = (KalmanFilter(m, noise, time=0.0) for m in (plane, space))
    chain = mechanics_of(plane)
    rows = np.concatenate([np.array([0, 2, 4]) + k for k in (0, 5, 10)])
    inner, turn = np.ix_(rows, rows), np.kron(np.diag([1.0, 1.0, 0.0]), chain.to_joints)
    turn[6:, 6:] = np.eye(3)
    whole.covariance[inner] = turn @ flat.covariance @ turn.T  # the planar filter starts from absolute angles
    rng, across, up, slip = np.random.default_rng(2), rows_of(plane, plane.points), rows_of(space, space.points), []
    for run in (flat, whole):
        run.push_pressure(0.0, 7e4)
    for f in range(1, 25):
        x = np.append(flat.angle, flat.strain)
        places = chain.stations(x)[0] + 1e-3 * rng.standard_normal((2, 2))
        flat.push_frame(f * H, across, places.ravel(), np.full(4, 1e-7))
        whole.push_frame(f * H, up, np.pad(places, ((0, 0), (1, 0))).ravel(), np.full(6, 1e-7))
        np.testing.assert_allclose(whole.strain, flat.strain, rtol=0, atol=1e-11)
        np.testing.assert_allclose(whole.strain_rate, flat.strain_rate, rtol=0, atol=1e-9)
        np.testing.assert_allclose(whole.memory[[0, 2, 4]], flat.memory, rtol=0, atol=1e-10)
        np.testing.assert_allclose(whole.covariance[inner], turn @ flat.covariance @ turn.T, rtol=1e-7, atol=1e-12)
        shifts = [run.state(f * H).strain_shift for run in (flat, whole)]
        np.testing.assert_allclose(*shifts, rtol=0, atol=1e-10)
        slip.append(flat.memory[2, 1])
    assert np.ptp(slip) == pytest.approx(0.008)  # from limit to limit


@pytest.mark.slow
def test_errors_and_innovations_are_as_large_as_the_filter_says():
    ratios, innovations, smooth = [], [], []
    for seed in range(60):
        truth, places = noisy_run(seed)
        seen = recorded(places, H * np.arange(40))
        found = estimate(seen, arm(), noise=NOISE, time_step=H / SUB * 1.001, pressure_window=0.0)
        named = ("joint_angle_x", "joint_angle_y", "joint_rate_x", "joint_rate_y")
        assert all(np.all(found[f"smooth_{n}_sd"] <= found[f"{n}_sd"] * (1 + 1e-9)) for n in named)
        error = np.zeros((40, 8))
        for k, n in enumerate(named):
            error[:, 4 * (k // 2) + k % 2 : 4 * (k // 2) + 4 : 2] = found[n]
        ratios.append(nees((error - truth)[[20, 39]], found.state_covariance.values[[20, 39]]))
        innovations.append(found.attrs["nis_ratio"])
        later = (found.smooth_joint_rate_x.values - truth[:, 4::2])[10:25]
        smooth.append(np.mean((later / found.smooth_joint_rate_x_sd.values[10:25]) ** 2))
    low, high = mean_bounds(np.full(60, 8))
    assert all(low < np.mean([r[k] for r in ratios]) / 8 < high for k in range(2))
    low, high = mean_bounds(np.full(60 * 39, 6))
    assert low < np.mean(innovations) < high
    assert 0.88 < np.mean(smooth) < 1.12


@pytest.mark.slow
def test_unseen_stations_are_skipped_and_latency_is_undone():
    time = H * np.arange(30)
    motion = simulate(arm(), [Trace(CLOCK, p) for p in pressures().T], times=time, time_step=1e-3)
    places = motion.station_position.values.copy()
    assert list(motion.station.values) == ["middle", "tip"]
    places[10], places[20, 1] = np.nan, np.nan
    late = recorded(places, time + 0.02)
    found = estimate(late, arm(), noise=NOISE, time_step=2e-3, pressure_window=0.0, latency=0.02)
    assert (found.attrs["frames_skipped"], found.attrs["frames_in_part"]) == (1, 1)
    assert list(found.row.values[:3]) == ["middle x", "middle y", "middle z"]
    assert float(np.abs(found.joint_rate_y - motion.joint_rate_y.values).max()) < 2e-3
    wrong = estimate(late, arm(), noise=NOISE, time_step=2e-3, pressure_window=0.0)
    assert float(np.abs(wrong.joint_rate_y.values - motion.joint_rate_y.values).max()) > 0.05


@pytest.mark.slow
def test_frames_that_arrive_late_change_nothing_in_the_end():
    _, places = noisy_run(3, frames=12)
    rows, variance = rows_of(arm(), arm().points), np.full(6, NOISE.position**2)
    events = [(H * f, places[f].ravel()) for f in range(12)]
    runs = []
    for order in (events, [*events[:6], events[7], events[6], events[8], *events[10:], events[9]]):
        run = KalmanFilter(arm(), NOISE, time=0.0, latency=0.0, pressure=pressures()[0])
        for time, values in order:
            run.push_frame(time, rows, values, variance)
        runs.append(run)
    assert runs[1].counts.late == 2
    assert np.allclose(runs[0].angle, runs[1].angle, rtol=0, atol=1e-13)
    assert np.allclose(runs[0].covariance, runs[1].covariance, rtol=1e-9, atol=1e-16)


@pytest.mark.slow
def test_the_command_reports_writes_and_draws_an_arm_in_space(tmp_path):
    save_model(arm(), tmp_path / "model.json")
    write(recorded(noisy_run(1)[1], H * np.arange(40)), tmp_path / "arm.nc")
    app, files = typer.Typer(), {name: str(tmp_path / name) for name in ("arm.nc", "model.json", "s.nc", "s.png")}
    app.command()(command)
    words = [files["arm.nc"], "--model", files["model.json"], "-o", files["s.nc"], "--figure", files["s.png"], "--json"]
    done = CliRunner().invoke(app, words)
    assert done.exit_code == 0, done.output
    summary = json.loads(done.stdout)
    with xr.open_dataset(files["s.nc"], engine="h5netcdf") as states:
        rates = [np.abs(states[f"smooth_joint_rate_{axis}"].values).max() for axis in "xy"]
        torque = [np.abs(states[f"disturbance_{axis}"].values).max() for axis in "xy"]
        assert states.sizes["axis"] == 3
    assert summary["frames"] == 40
    assert summary["largest_rate_rad_s"] == pytest.approx(max(rates))
    assert summary["largest_disturbance_mn_m"] == pytest.approx(1e3 * max(torque))
    assert (tmp_path / "s.png").stat().st_size > 5000


def turned(truth, noise, rng):
    """Quaternions (T, 2, 4) of a body on the last link since rest, each turned by noise [rad]; none on the first."""
    chain = mechanics_of(arm())
    rest = Rotation.from_matrix(chain.posed(state.equilibrium(arm())).R[2])
    links = Rotation.from_matrix(np.moveaxis(chain.posed(truth[:, :4]).R[2], -1, 0))
    quaternion = np.full((len(truth), 2, 4), np.nan)
    shaken = links * Rotation.from_rotvec(noise * rng.standard_normal((len(truth), 3)))
    quaternion[:, 1] = (shaken * rest.inv()).as_quat()
    return quaternion


@pytest.mark.slow
def test_orientations_are_used_as_they_deserve_and_show_what_the_tip_does_not():
    """NEES and NIS of 60 runs that see the tip, with its orientation and without; the true errors with and without."""
    noise, ratios, innovations, errors = replace(NOISE, angle=1e-3), [], [], []
    for seed in range(60):
        truth, places = noisy_run(seed)
        quaternion = turned(truth, noise.angle, np.random.default_rng([seed, 1]))
        runs = []
        for more in ({"quaternion": quaternion}, {}):
            seen = recorded(places, H * np.arange(40), **more)
            runs.append(estimate(seen, arm(), noise=noise, time_step=H / SUB * 1.001, pressure_window=0.0,
                                 stations=("tip",)))  # fmt: skip
        error = [np.stack([r.joint_angle_x, r.joint_angle_y], axis=2).reshape(40, 4) - truth[:, :4] for r in runs]
        errors.append([np.mean(e[5:] ** 2) for e in error])
        P = runs[0].state_covariance.values
        ratios.append(nees(error[0][[20, 39]], P[[20, 39], :4, :4]))
        innovations.append(runs[0].attrs["nis_ratio"])
    assert list(runs[0].row.values[3:]) == ["tip turn x", "tip turn y", "tip turn z"]
    low, high = mean_bounds(np.full(60, 4))
    assert all(low < np.mean([r[k] for r in ratios]) / 4 < high for k in range(2))
    low, high = mean_bounds(np.full(60 * 39, 6))
    assert low < np.mean(innovations) < high
    better, worse = np.sqrt(np.mean(errors, axis=0))
    assert better < 0.85 * worse


@pytest.mark.slow
def test_flips_of_a_quaternion_change_nothing_and_those_of_markers_are_left_out():
    truth, places = noisy_run(2)
    plain = turned(truth, 1e-3, np.random.default_rng(7))
    signs, markers, without = plain.copy(), plain.copy(), plain.copy()
    signs[10:20] *= -1.0
    body = Rotation.from_rotvec([0.0, 0.0, np.pi])
    for f in (12, 13, 30):
        markers[f, 1] = (Rotation.from_quat(plain[f, 1]) * body).as_quat()
        without[f] = np.nan
    runs = [estimate(recorded(places, H * np.arange(40), quaternion=q), arm(), noise=NOISE, pressure_window=0.0)
            for q in (plain, signs, markers, without)]  # fmt: skip
    assert [run.attrs["orientations_flipped"] for run in runs] == [0, 0, 3, 0]
    assert np.allclose(runs[0].joint_angle_x, runs[1].joint_angle_x, rtol=0, atol=1e-12)
    assert np.array_equal(runs[2].joint_angle_x, runs[3].joint_angle_x)
    assert float(np.abs(runs[2].joint_angle_x - runs[0].joint_angle_x).max()) > 1e-5
    assert report(runs[2])["orientations_flipped"] == 3


@pytest.mark.slow
def test_the_running_filter_takes_orientations_and_counts_flips():
    m = arm()
    run, rows = KalmanFilter(m, NOISE, time=0.0), rows_of(m, m.points[1:], position=False, angle=True)
    x, variance = np.array([0.02, -0.03, 0.01, 0.02]) + run.angle, np.full(3, 1e-8)
    turn = Rotation.from_matrix(mechanics_of(m).posed(x).R[2])
    for flip, used in ((0.0, 3), (np.pi, 0)):
        before = run.angle.copy()
        run.push_frame(0.0, rows, (turn * Rotation.from_rotvec([0.0, 0.0, flip])).as_rotvec(), variance)
        seen = Rotation.from_matrix(mechanics_of(m).posed(run.angle).R[2])
        assert np.isfinite(run.innovation).sum() == used
    assert np.array_equal(run.angle, before)
    assert (seen.inv() * turn).magnitude() < 5e-4
    assert (run.counts.flipped, run.fault) == (1, "")
    with pytest.raises(InputError, match="three consecutive rows of one link"):
        run.push_frame(0.1, rows[:2], np.zeros(2), variance[:2])
    with pytest.raises(InputError, match="at most half a turn"):
        run.push_frame(0.1, rows, np.array([3.0, 3.0, 0.0]), variance)
