"""`pliant simulate --base`: a file of poses moves the base; the reference is MuJoCo, or a base that Python states."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from command_line import invoke
from scipy.spatial.transform import Rotation

from pliant.errors import InputError
from pliant.model import Model, Space, chain_model, save_model
from pliant.recording import make_recording, write
from pliant.recording.inputs import with_base_motion
from pliant.simulation import BaseMotion, Pulse, read_base, simulate

Array = np.ndarray
TIME = np.arange(0.0, 0.5005, 0.01)
SHAKEN = 0.02 * np.column_stack([np.sin(9.0 * TIME) ** 2, 1.0 - np.cos(7.0 * TIME), np.sin(5.0 * TIME) ** 2])
TURN = np.outer(np.sin(6.0 * TIME) ** 2, [0.3, 0.1, -0.2])  # rotation vectors, rad


def arm(dimension: int) -> Model:
    space = Space(radius=0.01) if dimension == 3 else None
    return chain_model(length=0.2, mass=0.06, links=2, stiffness=0.3, damping=0.01, torque=[1e-6], space=space,
                       gravity=[0.0, 9.81] if dimension == 2 else [0.0, 0.0, 9.81])  # fmt: skip


def csv(path: Path, header: str, *columns: Array) -> Path:
    np.savetxt(path, np.column_stack(columns), delimiter=",", header=header, comments="", fmt="%.9f")
    return path


def poses(folder: Path, dimension: int, start: float = 0.0) -> Path:
    """Poses of the base on a robot that stands elsewhere, turned, on a clock that begins at `start`."""
    robot = Rotation.from_rotvec([0.0, 0.0, 0.7] if dimension == 2 else [0.4, -0.9, 0.7])
    place = np.array([0.5, -0.2, 0.0 if dimension == 2 else 0.9])
    if dimension == 2:
        moved = place + robot.apply(np.pad(SHAKEN[:, :2], ((0, 0), (0, 1))))
        angle = np.degrees(0.7 + TURN[:, 0])
        return csv(folder / "base.csv", "t_s,x_mm,y_mm,angle_deg", TIME + start, 1e3 * moved[:, :2], angle)
    quaternion = (robot * Rotation.from_rotvec(TURN)).as_quat()
    moved = place + robot.apply(SHAKEN)
    return csv(folder / "base.csv", "t_s,x_m,y_m,z_m,qx,qy,qz,qw", TIME + start, moved, quaternion)


def stated(dimension: int) -> BaseMotion:
    if dimension == 2:
        return BaseMotion(TIME, SHAKEN[:, :2], angle=TURN[:, 0])
    return BaseMotion(TIME, SHAKEN, quaternion=Rotation.from_rotvec(TURN).as_quat())


@pytest.mark.parametrize("dimension", [2, 3])
def test_a_file_of_poses_is_the_motion_from_its_first_pose(tmp_path: Path, dimension: int) -> None:
    motion, wanted = read_base(poses(tmp_path, dimension), dimension), stated(dimension)
    np.testing.assert_allclose(motion.position, wanted.position, atol=1e-8)
    np.testing.assert_allclose(motion.turn, wanted.turn * np.sign(motion.turn[0, -1] * wanted.turn[0, -1] or 1.0),
                               atol=1e-8)  # fmt: skip


@pytest.mark.parametrize("dimension", [2, 3])
def test_the_command_simulates_on_a_base_that_moves(tmp_path: Path, dimension: int) -> None:
    model = arm(dimension)
    save_model(model, tmp_path / "model.json")
    done = invoke("simulate", tmp_path / "model.json", "--level", "30", "--start", "0.1", "--width", "0.2",
                  "--time-step-ms", "2", "--base", poses(tmp_path, dimension, 1.7e9 if dimension == 2 else 0.0),
                  "-o", tmp_path / "a.nc")  # fmt: skip
    assert done.exit_code == 0, done.output
    with xr.open_dataset(tmp_path / "a.nc") as motion:
        run = simulate(model, Pulse(3e4, 0.1, 0.2), times=motion["time"].values, time_step=2e-3, base=stated(dimension))
        np.testing.assert_allclose(motion["tip_position"], run["tip_position"], atol=1e-6)
        np.testing.assert_allclose(motion["base_force"], run["base_force"], atol=1e-3)
        assert motion["time"].values[-1] == pytest.approx(0.5)
        assert motion.attrs["history"].startswith("base: poses of base.csv relative to the first; the motion of the")


@pytest.mark.slow  # MuJoCo's forces in an adaptive integration
@pytest.mark.parametrize("dimension", [2, 3])
def test_the_motion_on_a_moving_base_is_mujocos(tmp_path: Path, dimension: int) -> None:
    pytest.importorskip("mujoco")
    from oracles.moving_base import OnMovingBase

    model = arm(dimension)
    motion = read_base(poses(tmp_path, dimension), dimension)
    times = np.arange(0.0, 0.3, 0.05)
    angles = np.zeros(2 * (dimension - 1))
    q, _, _, _ = OnMovingBase(model, stated(dimension)).run(times, angles)
    how = {} if dimension == 2 else {"initial_rate": 0.0 * angles}
    run = simulate(model, Pulse(0.0), times=times, time_step=5e-4, base=motion, initial_angle=angles, **how)
    joints = run["joint_angle"].values if dimension == 2 else np.stack(
        [run["joint_angle_x"].values, run["joint_angle_y"].values], axis=-1).reshape(len(times), -1)
    assert np.abs(q).max() > 0.02
    np.testing.assert_allclose(joints, q, atol=1e-4)


def test_a_mapping_names_the_columns_of_noisy_poses(tmp_path: Path) -> None:
    save_model(arm(2), tmp_path / "model.json")
    noisy = 1e3 * SHAKEN[:, :2] + 0.05 * np.random.default_rng(1).standard_normal((TIME.size, 2))
    path, mapping = csv(tmp_path / "base.csv", "a,b,c", TIME, noisy), tmp_path / "map.toml"
    mapping.write_text('time = "a"\nlength_unit = "mm"\nstations = { base = { position = ["b", "c"] } }\n')
    options = ["--base-mapping", mapping, "--base-cutoff-hz", "8"]
    done = invoke("simulate", tmp_path / "model.json", "--base", path, *options,
                  "--time-step-ms", "2", "-o", tmp_path / "a.nc")  # fmt: skip
    assert done.exit_code == 0, done.output
    with xr.open_dataset(tmp_path / "a.nc") as motion:
        assert "passes half of 8 Hz" in motion.attrs["history"]
        off = motion["base_position"].interp(time=TIME).values - SHAKEN[:, :2]
    assert np.abs(off).max() < 1e-3


def test_what_is_no_motion_of_a_base_is_refused(tmp_path: Path) -> None:
    save_model(arm(2), tmp_path / "model.json")

    def refusal(path: Path, *more: str) -> str:
        done = invoke("simulate", tmp_path / "model.json", "--base", path, *more, "-o", tmp_path / "x.nc")
        assert done.exit_code != 0
        assert not (tmp_path / "x.nc").exists()
        return str(done.exception)

    two = csv(tmp_path / "two.csv", "t_s,x_a,y_a,z_a,x_b,y_b,z_b", TIME, SHAKEN, SHAKEN)
    assert "it holds the stations a, b: name the base as the only station" in refusal(two)
    lifted = csv(tmp_path / "lifted.csv", "t_s,x_m,y_m,z_m", TIME, SHAKEN)
    assert "the base of lifted.csv leaves its x-y plane by" in refusal(lifted)
    bare = csv(tmp_path / "bare.csv", "t_s,x_m,y_m,angle", TIME, SHAKEN[:, :2], TIME)
    assert "name the units of the base's columns, such as x_m, y_m, angle_deg" in refusal(bare)
    few = csv(tmp_path / "few.csv", "t_s,x_m,y_m,angle_deg", TIME[:4], SHAKEN[:4, :2], TIME[:4])
    assert "needs at least 6 known poses" in refusal(few)
    assert "is known from 0 to 0.5 s, but is needed from 0 to 2 s" in refusal(poses(tmp_path, 2), "--duration", "2")
    alone = invoke("simulate", tmp_path / "model.json", "--base-cutoff-hz", "5")
    assert "give it by --base" in str(alone.exception)


@pytest.mark.parametrize("header", ["t_s,x_m,y_m,theta_deg", "t_s,x_m,y_m,yaw_deg", "t_s,x_m,y_m,qx,qy,qz"])
def test_a_rotation_that_is_not_read_is_refused(tmp_path: Path, header: str) -> None:
    cells = header.count(",")
    path = tmp_path / "base.csv"
    path.write_text(header + "\n" + "".join(f"{k},{'0.1,' * (cells - 1)}{k}\n" for k in range(5)), encoding="utf-8")
    with pytest.raises(InputError, match="rotation in columns that are not read"):
        read_base(path, 2)


def test_an_angle_in_a_plane_is_refused_for_a_body_in_space(tmp_path: Path) -> None:
    path = tmp_path / "base.csv"
    path.write_text("t_s,x_m,y_m,angle_deg\n" + "".join(f"{k},0.1,0.2,{k}\n" for k in range(5)), encoding="utf-8")
    with pytest.raises(InputError, match="an angle in a plane"):
        read_base(path, 3)


@pytest.mark.parametrize("dimension", [2, pytest.param(3, marks=pytest.mark.slow)])
def test_the_command_estimates_on_a_base_that_moves(tmp_path: Path, dimension: int) -> None:
    """The recording is in the axes of the moved base; without its motion the filter misses the joint rates."""
    model, times = arm(dimension), np.arange(0.0, 0.5, 0.005)
    model = model.with_(stations=model.points)
    save_model(model, tmp_path / "model.json")
    run = simulate(model, Pulse(0.0), times=times, time_step=5e-4, base=stated(dimension))
    noise = 1e-5 * np.random.default_rng(1).standard_normal(run["station_position"].shape)
    recording = make_recording(
        times, run["station_position"].values + noise, station=[p.name for p in model.points],
        frame="planar" if dimension == 2 else "spatial", pressure_time=times, pressure=0.0 * times, source="test",
    )
    write(recording, tmp_path / "a.nc")
    off = []
    for k, more in enumerate(([], ["--base", poses(tmp_path, dimension)])):
        states = tmp_path / f"states_{k}.nc"
        done = invoke("estimate", tmp_path / "a.nc", "--model", tmp_path / "model.json", "--no-disturbance", *more,
                      "-o", states)  # fmt: skip
        assert done.exit_code == 0, done.output
        with xr.open_dataset(states) as estimated:
            rates = [name for name in run if str(name).startswith("joint_rate")]
            off.append(max(float(np.abs(estimated[f"smooth_{n}"] - run[n])[10:-10].max()) for n in rates))
            assert np.isfinite(estimated["smooth_joint_angle" if dimension == 2 else "smooth_joint_angle_x"]).all()
    largest = max(float(np.abs(run[n]).max()) for n in rates)
    assert off[1] < 0.03 * largest
    assert off[0] > 3.0 * off[1]


def test_an_estimate_with_an_unusable_motion_of_the_base_is_refused(tmp_path: Path) -> None:
    model, times = arm(2), np.arange(0.0, 0.5, 0.05)
    save_model(model, tmp_path / "model.json")
    still = np.broadcast_to([0.0, model.length], (times.size, 1, 2))
    recording = make_recording(times, still, station=["link_2"], frame="planar", pressure_time=times,
                               pressure=0.0 * times, source="test")  # fmt: skip
    write(recording, tmp_path / "a.nc")
    short = csv(tmp_path / "short.csv", "t_s,x_m,y_m", *np.zeros((3, 9)) + np.linspace(0.0, 0.2, 9))
    for more, said in (
        (["--base-cutoff-hz", "20"], "give it by --base"),
        (["--base", short], "the motion of the base is known from 0 to 0.2 s, but is needed from"),
    ):
        done = invoke("estimate", tmp_path / "a.nc", "--model", tmp_path / "model.json", *more,
                      "-o", tmp_path / "states.nc")  # fmt: skip
        assert done.exit_code != 0
        assert said in str(done.exception)
        assert not (tmp_path / "states.nc").exists()


def test_an_estimate_takes_noisy_poses_and_a_recording_that_holds_its_base(tmp_path: Path) -> None:
    """The recording holds its own poses; those of a file are stated, by a mapping that names their columns."""
    model, times = arm(2), np.arange(0.0, 0.5, 0.01)
    model, states = model.with_(stations=model.points), tmp_path / "states.nc"
    place = SHAKEN[:, :2]
    run = simulate(model, Pulse(0.0), times=times, time_step=2e-3, base=BaseMotion(TIME, place))
    recording = make_recording(times, run["station_position"].values, station=[p.name for p in model.points],
                               frame="planar", pressure_time=times, pressure=0.0 * times, source="test")  # fmt: skip
    write(with_base_motion(recording, place[: times.size]), tmp_path / "a.nc")
    noisy = 1e3 * place + 0.05 * np.random.default_rng(1).standard_normal(place.shape)
    path, mapping = csv(tmp_path / "base.csv", "a,b,c", TIME, noisy), tmp_path / "map.toml"
    mapping.write_text('time = "a"\nlength_unit = "mm"\nstations = { base = { position = ["b", "c"] } }\n')
    poses_of_file = ["--base", path, "--base-mapping", mapping, "--base-cutoff-hz", "8"]
    save_model(model, tmp_path / "model.json")
    done = invoke("estimate", tmp_path / "a.nc", "--model", tmp_path / "model.json", "--no-disturbance", *poses_of_file,
                  "-o", states)  # fmt: skip
    assert done.exit_code == 0, done.output
    with xr.open_dataset(states) as estimated:
        off = np.abs(estimated["smooth_joint_rate"] - run["joint_rate"])[10:-10].max()
    assert off < 0.1 * np.abs(run["joint_rate"]).max()
    states.unlink()
    save_model(model.with_(moving_base=True), tmp_path / "moves.json")
    write(recording, tmp_path / "bare.nc")
    for name, body, said in (
        ("a", "model", "in the axes of a base that moves: state the motion of the base by"),
        ("bare", "moves", "moving_base to false for a body whose base rests"),
    ):
        done = invoke("estimate", tmp_path / f"{name}.nc", "--model", tmp_path / f"{body}.json", "-o", states)
        assert done.exit_code != 0
        assert said in str(done.exception)
        assert "--base FILE" in str(done.exception)
        assert not states.exists()
