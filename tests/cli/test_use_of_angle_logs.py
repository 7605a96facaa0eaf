"""`pliant estimate` and `pliant contact` on logs of angles, such as those of inertial sensors, without any position."""

from __future__ import annotations

import json

import numpy as np
import pytest
import xarray as xr
from command_line import invoke

from pliant.errors import InputError
from pliant.model import Station, chain_model, save_model
from pliant.recording import make_recording, write
from pliant.simulation import PointForce, Trace, simulate

pytestmark = pytest.mark.slow  # kernels of their own are compiled first

NOISE_DEG, MOUNTED_DEG = np.array([0.15, 0.1]), np.array([3.0, -2.0])
BODY = chain_model(length=0.16, mass=0.1, links=2, joint_placement="midsegment", stiffness=0.1, damping=3e-3,
                   torque=[4e-7], stations=[Station("imu1", 0, 0.08), Station("imu2", 1, 0.04)])  # fmt: skip


def angle_log(path, seed, level, force=(), seconds=6.0):
    """A log of two inclinations [degrees] and one pressure, mounted at angles that are not zero at rest."""
    rng = np.random.default_rng(seed)
    time = np.arange(0.0, seconds, 0.01)
    pressure = level * 1e3 * np.interp(time, [0, 1.0, 1.3, 3.0, 3.3, 9.0], [0, 0, 1.0, 1.0, 0.3, 0.3])
    run = simulate(BODY, Trace(time, pressure), times=time, forces=force)
    angles = np.cumsum(run["joint_angle"].values, axis=1)
    degrees = np.degrees(angles) + MOUNTED_DEG + NOISE_DEG * rng.standard_normal(angles.shape)
    rows = [f"{t:.2f};{a:.3f};{b:.3f};{p:.3f}" for t, (a, b), p in zip(time, degrees, pressure / 1e3, strict=True)]
    path.write_text("\n".join(["time;angle_imu1_deg;angle_imu2_deg;pressure (kPa)", *rows]) + "\n")
    return angles


def test_angles_are_estimated_with_the_noise_that_they_show(tmp_path):
    save_model(BODY, tmp_path / "model.json")
    truth = angle_log(tmp_path / "imu.txt", 1, 55.0, seconds=3.0)
    log, model, states = (tmp_path / name for name in ("imu.txt", "model.json", "s.nc"))
    done = invoke("estimate", log, "--model", model, "--json", "-o", states)
    assert done.exit_code == 0, done.exception or done.output
    report = json.loads(done.stdout.strip().splitlines()[-1])
    assert report["frames"] == 300
    assert report["normalised_innovation"] == pytest.approx(1.0, abs=0.35)
    with xr.open_dataset(states, engine="h5netcdf") as estimated:
        error = np.cumsum(estimated["joint_angle"].values, axis=1) - truth
    assert np.degrees(np.sqrt(np.mean(error[20:] ** 2))) < 0.12  # the sensors' own noise is 0.13 degrees


@pytest.mark.slow
def test_a_push_is_found_in_angles(tmp_path):
    save_model(BODY, tmp_path / "model.json")
    for seed, level in ((2, 55.0), (3, 40.0), (4, 48.0)):
        angle_log(tmp_path / f"free{seed}.txt", seed, level)
    push = PointForce(np.array([0.0, 4.0, 4.1, 5.2, 5.3, 6.0]), np.array([[0, 0], [0, 0], [0.2, 0], [0.2, 0], [0, 0],
                      [0, 0]]), "imu2")  # fmt: skip
    angle_log(tmp_path / "push.txt", 5, 50.0, (push,))
    free = [word for seed in (2, 3, 4) for word in ("--free", tmp_path / f"free{seed}.txt")]
    done = invoke("contact", tmp_path / "push.txt", "--model", tmp_path / "model.json", *free, "--json", "--figure",
                  tmp_path / "push.png", "-o", tmp_path / "push.nc", "--map", tmp_path / "map.csv")  # fmt: skip
    assert done.exit_code == 0, done.exception or done.output
    report = json.loads(done.stdout.strip().splitlines()[-1])
    assert report["contacts"] >= 1
    assert report["first_onset_s"] == pytest.approx(4.05, abs=0.1)
    assert abs(report["normal_force_n"]) == pytest.approx(0.2, rel=0.3)
    assert (tmp_path / "map.csv").stat().st_size > 100


def test_many_angles_with_other_names_are_no_curve(tmp_path):
    save_model(BODY, tmp_path / "model.json")
    angles = np.zeros((30, 6))
    angles[15:] = 0.1
    other = make_recording(np.arange(30) * 0.02, angle=angles, station=[f"s{k}" for k in range(6)], frame="planar",
                           pressure=np.repeat([0.0, 1e4], 15))  # fmt: skip
    write(other, tmp_path / "a.nc")
    done = invoke("estimate", tmp_path / "a.nc", "--model", tmp_path / "model.json")
    assert isinstance(done.exception, InputError)
    assert "no station of the recording (s0, s1, s2, s3, s4) is one of the model's" in str(done.exception)


def test_the_shape_of_angles_needs_no_alignment(tmp_path):
    angle_log(tmp_path / "imu.txt", 1, 55.0, seconds=2.0)
    done = invoke("shape", tmp_path / "imu.txt", "-o", tmp_path / "a.nc")
    assert isinstance(done.exception, InputError)
    assert "holds angles alone, which need no alignment" in str(done.exception)
    assert not (tmp_path / "a.nc").exists()
