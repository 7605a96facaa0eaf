"""A soft body on a moving base, as on a robot's arm: from the tracker's file to the report."""

from __future__ import annotations

import json
from functools import cache

import numpy as np
import pytest
import small_study
from command_line import invoke, program
from scipy.spatial.transform import Rotation

from pliant.errors import InputError
from pliant.identification.from_recording import base_of
from pliant.preprocessing.align import align
from pliant.recording import make_recording, write
from pliant.recording.schema import history_of
from pliant.simulation import BaseMotion, Trace, simulate
from pliant.validation.figures import record_figure
from pliant.validation.store import load_outcome

TIMES = np.arange(0.0, 2.0, 0.01)
OPTIONS = {"base": "base", "tangent": small_study.AXES[:, 1].tolist(), "plane": small_study.AXES[:, 2].tolist()}
GRAVITY = [1.0, -4.0]


def base_motion(times):
    """At rest for 0.4 s, then a robot swings and shakes the base."""
    late = np.maximum(times - 0.4, 0.0)
    ease = 1.0 - np.exp(-((late / 0.2) ** 3))
    place = 0.05 * ease[:, None] * np.column_stack([np.sin(7 * late), np.sin(9 * late)])
    return BaseMotion(times, place, angle=0.4 * ease * np.sin(5 * late))


@cache
def tracked(level_kpa, noise=1e-5):
    """Base with orientation, a middle and a tip marker in the tracker's frame."""
    model = small_study.body().with_(gravity=GRAVITY, stations=(("middle", 0, 0.06), ("tip", 1, 0.06)))
    motion = base_motion(np.linspace(0.0, 2.0, 2001))
    pressure = Trace([0.2, 0.21, 1.2, 1.21], 1e3 * np.array([0.0, level_kpa, level_kpa, 0.0]))
    run = simulate(model, pressure, times=TIMES, time_step=5e-4, base=motion)
    states = motion.at(TIMES)
    inner = np.concatenate([np.zeros((TIMES.size, 1, 2)), run.station_position.values], axis=1)
    flat = np.einsum("tij,tsj->tsi", states.axes, inner) + states.position[:, None]
    seen = flat @ small_study.AXES[:, :2].T + small_study.ORIGIN
    rng = np.random.default_rng(int(level_kpa))
    turn = Rotation.from_rotvec(states.angle[:, None] * small_study.AXES[:, 2]) * Rotation.from_euler("x", 0.3)
    quaternion = np.full((TIMES.size, 3, 4), np.nan)
    quaternion[:, 0] = turn.as_quat()
    return make_recording(
        TIMES, seen + noise * rng.standard_normal(seen.shape), station=["base", "middle", "tip"], quaternion=quaternion,
        pressure=pressure(TIMES), pressure_time=TIMES,
    ), run, states


def study(folder, **options):
    """A study of three recordings of the body on the robot."""
    for name, level in small_study.LEVELS_KPA.items():
        write(tracked(level)[0], folder / f"{name}.nc")
    content = json.loads(json.dumps(small_study.STUDY))
    content["recordings"] = {name: {"file": f"{name}.nc"} for name in small_study.LEVELS_KPA}
    content["alignment"]["options"] = OPTIONS | options
    content["actuator"]["gravity"] = GRAVITY
    return small_study.write_study(folder, content, recordings=False)


def results(folder, path):
    run = invoke("run", path, "--output", folder / "out")
    assert run.exit_code == 0, run.output
    return json.loads((folder / "out" / "metrics.json").read_text(encoding="utf-8")), run.output


def test_alignment_keeps_the_pose_of_the_base():
    recording, run, states = tracked(60.0, 0.0)
    aligned = align(recording, **OPTIONS, bend=None, base_motion=True)
    sides = np.array([np.sign(np.dot(aligned.position.values[:, 2, 0], run.station_position.values[:, 1, 0])), 1.0])
    assert aligned.position.values[:, 1:] == pytest.approx(run.station_position.values * sides, abs=1e-7)
    assert aligned.base_position.values == pytest.approx(states.position * sides, abs=1e-7)
    assert aligned.base_angle.values == pytest.approx(states.angle * sides[0], abs=1e-7)
    assert any("the base leaves the plane by up to" in line for line in history_of(aligned))
    assert base_of(aligned).cutoff == "auto"
    assert "base_position" not in align(recording, **OPTIONS)


def test_alignment_in_space_keeps_the_pose_of_the_base():
    recording, run, states = tracked(60.0, 0.0)
    aligned = align(recording, **OPTIONS, base_motion=True, space=True, bend=None)
    assert np.linalg.norm(aligned.base_position.values, axis=1) == pytest.approx(
        np.linalg.norm(states.position, axis=1), abs=1e-7)  # fmt: skip
    found = BaseMotion(TIMES, aligned.base_position.values, quaternion=aligned.base_quaternion.values).at(TIMES)
    turned = np.degrees(Rotation.from_matrix(found.axes).as_rotvec())
    assert np.abs(turned[:, 0]) == pytest.approx(np.abs(np.degrees(states.angle)), abs=1e-4)
    assert aligned.position.values[:, 2, 2] == pytest.approx(run.station_position.values[:, 1, 1], abs=1e-7)


def test_lost_poses_of_the_base_are_counted():
    recording, *_ = tracked(60.0, 0.0)
    lost = recording.copy(deep=True)
    lost["quaternion"].values[100:104, 0] = np.nan
    aligned = align(lost, **OPTIONS, base_motion=True)
    assert "the pose of the base is unknown in 4 of 200 frames" in history_of(aligned)
    assert base_of(aligned).gaps == 4
    assert np.isnan(aligned.position.values[100:104]).all()


def test_a_base_without_an_orientation_does_not_turn_and_this_is_said():
    recording = tracked(60.0, 0.0)[0].drop_vars("quaternion")
    aligned = align(recording, **OPTIONS, base_motion=True)
    assert not aligned.base_angle.values.any()
    assert any("no orientation" in line for line in history_of(aligned))
    with pytest.raises(InputError, match="remove_base_motion needs the orientation of the base station"):
        align(recording, **OPTIONS, remove_base_motion=True)


@pytest.mark.slow
def test_study_recognises_a_moving_base_and_predicts_its_recordings(tmp_path):
    """Without a word in the study: the body's constants are found, and the recordings left out are predicted."""
    (folder := tmp_path / "robot").mkdir()
    metrics, _ = results(folder, study(folder))
    text = json.dumps(metrics)
    assert "the base carries all stations along: its motion is taken as an input" in text
    assert "the motion of the base is an input: 200 poses" in text
    fit = metrics["fits"]["linear"]
    assert fit["parameters"]["stiffness"]["value"] == pytest.approx(small_study.STIFFNESS, rel=0.03)
    assert fit["parameters"]["torque_1"]["value"] == pytest.approx(small_study.TORQUE, rel=0.03)
    assert fit["records"]["middle"]["rmse_percent_of_travel"] < 0.5
    stored = load_outcome(folder / "out")
    base = stored.fits[0].records[0].experiment.base
    assert base.position.shape == (200, 2)
    assert base.cutoff == "auto"
    figure = record_figure(stored.fits[0].records[0])
    assert [ax.get_ylabel() for ax in figure.axes][-1] == "base (mm, deg)"


def test_stated_base_motion_false_keeps_the_motion_in_the_positions(tmp_path):
    """The base then carries the tip farther than the body reaches, and the study says so."""
    run = program("run", study(tmp_path, base_motion=False), "--output", tmp_path / "out")
    assert run.returncode != 0
    assert "taken as an input" not in run.stdout + run.stderr
    assert "recording low is dropped: station tip is 187." in run.stdout + run.stderr


@pytest.mark.slow
def test_estimate_refuses_a_recording_whose_base_moves(tmp_path):
    recording, *_ = tracked(60.0)
    write(align(recording, **OPTIONS, base_motion=True), tmp_path / "moving.nc")
    from pliant.model import save_model

    model = small_study.body().with_(gravity=GRAVITY, stations=(("middle", 0, 0.06), ("tip", 1, 0.06)))
    save_model(model, tmp_path / "model.json")
    run = program("estimate", tmp_path / "moving.nc", "--model", tmp_path / "model.json")
    assert run.returncode != 0
    assert "the recording is in the axes of a base that moves: state the motion" in " ".join(run.stderr.split())
