"""Scenarios, recordings, files, the bundled set, the command line, and the wall around the truth."""

from __future__ import annotations

import ast
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import typer
from typer.testing import CliRunner

import pliant.testbed
from pliant.cli.demo import run_testbed
from pliant.errors import InputError
from pliant.recording import check_recording, read
from pliant.testbed import BUNDLED, SCENARIOS, Laboratory, bundled_recording, generate, generate_file, generate_set
from pliant.testbed.bundle import FOLDER, QUANTUM, bundle_recording
from pliant.testbed.fibre import FibreSensor
from pliant.testbed.rod import actuator
from pliant.testbed.scenarios import scenario
from pliant.testbed.space import COMMANDS
from pliant.testbed.truth import read_truth, write_truth
from pliant.testbed.valve import Iso6358

HOME = Path(pliant.testbed.__file__).parent
BRIEF = replace(SCENARIOS["pulse_119_short"], duration=0.5)
QUIET = FibreSensor(noise=0, bias=0, gain_error=0, twist=0, out_of_plane=0, misalignment=0, displacement=0, jitter=0,
                    drop_out=0, latency=0, offset=0)  # fmt: skip


@pytest.mark.parametrize("name", list(SCENARIOS))
def test_every_scenario_runs_and_can_be_commanded(name):
    case = SCENARIOS[name]
    several = isinstance(case.command, tuple)
    for command in case.command if several else (case.command,):
        pressure = command(np.linspace(0.0, case.duration, 20_001))
        assert pressure.min() >= 0.0
        assert pressure.max() <= 3e5
        assert name == "still" or pressure.max() > 5e4
    made = generate(replace(case, duration=0.32), "two_segment" if several else "a", 3)
    check_recording(made.recording)
    assert made.recording.sizes["time"] == round(0.32 * case.rate) == made.truth.sizes["time"]


def test_a_recording_looks_like_a_laboratorys():
    ds = generate(BRIEF, "b", 5).recording
    assert ds.attrs["frame"] == "tracker"
    assert ds["position"].dims == ("time", "station", "axis")
    assert list(ds["station"].to_numpy()[:2]) == ["000", "001"]
    assert np.median(np.diff(ds["pressure_time"])) == pytest.approx(1 / 750)
    steps = np.linalg.norm(np.diff(ds["position"], axis=1), axis=2)
    assert np.nanmax(np.abs(steps - 0.8e-3)) < 1e-6
    assert "stiffness" not in str(ds.attrs)


def test_without_imperfections_the_recording_is_the_truth():
    made = generate(BRIEF, "a", 1, lab=Laboratory(fibre=replace(QUIET, gauge=0.8e-3)))
    shape, truth = made.recording["position"].to_numpy(), made.truth["position"].to_numpy()
    tip = shape[:, round((0.016 + 0.17) / 0.8e-3)]
    station = round((0.016 + 0.17) / 0.8e-3) * 0.8e-3 - 0.016
    along = (station - 0.17) * np.diff(truth[:, 99:101], axis=1)[:, 0] / (0.17 / 100)
    expected = truth[:, 100] + along
    assert np.abs(tip[:, 0] - 0.016 - expected[:, 1]).max() < 5e-5
    assert np.abs(tip[:, 1] + expected[:, 0]).max() < 5e-5
    assert np.abs(made.recording["time"] - made.truth["time"]).max() == 0.0


def test_seed_decides_the_sensors_and_nothing_else():
    first, again, other = generate(BRIEF, "a", 7), generate(BRIEF, "a", 7), generate(BRIEF, "a", 8)
    assert first.recording.identical(again.recording)
    assert first.truth["position"].equals(other.truth["position"])
    assert not first.recording["position"].equals(other.recording["position"])


def test_instruments_keep_their_systematic_errors_between_scenarios():
    lab = Laboratory(fibre=replace(QUIET, misalignment=0.02, displacement=1e-3))
    one, two = (generate(c, "a", 2, lab=lab).recording["position"] for c in (BRIEF, replace(BRIEF, name="other")))
    assert np.array_equal(one, two)


@pytest.mark.parametrize("output", ["strain", "markers"])
def test_other_outputs_are_recordings_too(output):
    ds = generate(BRIEF, "a", 1, lab=Laboratory(output=output)).recording
    check_recording(ds)
    if output == "strain":
        assert ds["strain"].dims == ("time", "core", "gauge")
        assert ds.sizes["core"] == len(ds.attrs["core_angle"]) == 4
    else:
        assert ds.sizes["station"] == 8
        assert np.diff(ds["time"])[0] == pytest.approx(0.01)


def test_strain_and_positions_tell_the_same_shape():
    """The strain of the same gauges, integrated by the package's own sensing room, up to the sensor's pose."""
    from scipy.spatial.transform import Rotation

    from pliant.sensing.cores import shape_from_strain
    from pliant.sensing.strain import CoreLayout

    seen, strained = (generate(BRIEF, "a", 1, lab=Laboratory(output=o)).recording for o in ("position", "strain"))
    layout = CoreLayout(np.array(strained.attrs["core_radius"]), np.array(strained.attrs["core_angle"]))
    other = shape_from_strain(strained, layout)["position"].to_numpy()
    for frame in (0, 20, 36):
        points = seen["position"].to_numpy()[frame]
        turn, _ = Rotation.align_vectors(points - points[0], other[frame] - other[frame][0])
        assert np.abs(turn.apply(other[frame] - other[frame][0]) - (points - points[0])).max() < 2e-5


def test_another_valve_moves_the_actuator_too():
    made = generate(BRIEF, "a", 1, lab=Laboratory(valve=Iso6358()))
    assert made.truth["pressure"].max() == pytest.approx(1.2e5, rel=0.06)


@pytest.mark.slow
def test_files_are_kept_when_current_and_remade_when_not(tmp_path):
    path, truth = tmp_path / "rec.nc", tmp_path / "truth.nc"
    assert generate_file(BRIEF, path, truth=truth)
    stamp = path.stat().st_mtime_ns
    assert not generate_file(BRIEF, path, truth=truth)
    assert path.stat().st_mtime_ns == stamp
    assert generate_file(BRIEF, path, truth=truth, seed=2)
    truth.write_bytes(b"damaged")
    assert generate_file(BRIEF, path, truth=truth, seed=2)
    kept = read_truth(truth)
    assert json.loads(kept.attrs["parameters"])["seed"] == 1
    assert json.loads(kept.attrs["scenario_settings"])["duration"] == 0.5
    assert kept.attrs["content_key"] == read(path).attrs["content_key"]
    assert sorted(p.name for p in tmp_path.iterdir()) == ["rec.nc", "truth.nc"]


def test_a_set_goes_on_where_it_stopped(tmp_path, monkeypatch):
    monkeypatch.setitem(SCENARIOS, "brief", replace(BRIEF, name="brief"))
    todo = [("brief", "a", 1), ("brief", "b", 1)]
    generate_set(todo[:1], tmp_path)
    stamp = (tmp_path / "brief-a-1.nc").stat().st_mtime_ns
    seen = []
    made = generate_set(todo, tmp_path, progress=lambda done, total, name: seen.append((done, total, name)))
    assert [p.name for p in made] == ["brief-a-1.nc", "brief-b-1.nc"]
    assert made[0].stat().st_mtime_ns == stamp
    assert seen[-1] == (1, 2, "brief-b-1.nc")
    assert len(list((tmp_path / "truth").iterdir())) == 2


def test_bad_requests_are_refused(tmp_path):
    with pytest.raises(InputError, match="unknown scenario 'pulse'"):
        scenario("pulse")
    with pytest.raises(InputError, match="unknown scenario 'pulse_900_100ms'"):
        scenario("pulse_900_100ms")
    with pytest.raises(InputError, match="seed must be >= 0"):
        generate(BRIEF, "a", -1)
    with pytest.raises(InputError, match=r"ending in \.nc"):
        generate_file(BRIEF, tmp_path / "rec.csv")
    with pytest.raises(InputError, match="two different files"):
        generate_file(BRIEF, tmp_path / "rec.nc", truth=tmp_path / "rec.nc")
    with pytest.raises(InputError, match="no bundled recording"):
        bundled_recording("pulse_1")
    with pytest.raises(InputError, match="cannot read the file of true motion"):
        read_truth(tmp_path / "absent.nc")
    generate_file(BRIEF, tmp_path / "rec.nc")
    with pytest.raises(InputError, match="not a file of true motion"):
        read_truth(tmp_path / "rec.nc")


def test_progress_runs_to_one():
    seen = []
    generate(BRIEF, "a", 1, progress=seen.append)
    assert seen == sorted(seen)
    assert seen[-1] == 1.0


def test_bundled_recordings_are_small_and_complete():
    assert sum(p.stat().st_size for p in FOLDER.iterdir()) <= 3_000_000
    assert {p.stem for p in FOLDER.glob("*.nc")} == {*BUNDLED, *(f"space_{name}" for name in COMMANDS)}
    for name in BUNDLED:
        ds = bundled_recording(name)
        assert ds.attrs["actuator"] == "a"
        assert ds["pressure"].size > 3000


@pytest.mark.slow
@pytest.mark.parametrize("name", ["pulse_119", "triangle"])
def test_bundled_recordings_come_from_the_committed_command(name):
    """Tolerance between machines: one step of the storage's rounding, 7.6 um."""
    new, kept = bundle_recording(name), bundled_recording(name)
    assert np.allclose(new["position"], kept["position"], rtol=0, atol=1.01 * QUANTUM, equal_nan=True)
    assert np.allclose(new["pressure"], kept["pressure"], rtol=0, atol=100.0)
    assert np.array_equal(new["time"], kept["time"])


def test_truth_is_written_whole_and_read_back(tmp_path):
    truth = generate(replace(SCENARIOS["contact_wall"], duration=0.4), "a", 1).truth
    write_truth(truth, tmp_path / "t.nc")
    back = read_truth(tmp_path / "t.nc")
    assert np.abs(back["position"] - truth["position"]).max() < 1e-7
    assert float(back["force"].max()) > 0


@pytest.mark.slow
def test_command_line(tmp_path):
    app = typer.Typer()
    app.command()(run_testbed)
    runner = CliRunner()
    listed = runner.invoke(app, ["--list"])
    assert listed.exit_code == 0
    assert all(name in listed.output for name in SCENARIOS)
    path = tmp_path / "r.nc"
    arguments = ["pulse_60_100ms", "--actuator", "c", "--seed", "4", "-o", str(path), "--truth", str(tmp_path / "t.nc")]
    assert "recorded" in runner.invoke(app, arguments).output
    assert "exists with this content" in runner.invoke(app, arguments).output
    assert read(path).attrs["seed"] == 4
    assert isinstance(runner.invoke(app, []).exception, InputError)
    assert isinstance(runner.invoke(app, ["still", "--record", "smell"]).exception, InputError)


def test_the_test_bed_shares_no_code_with_the_link_model():
    foreign = ("equations", "model", "simulation", "reduction", "identification", "basic", "actuators")
    for path in HOME.rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text())):
            names = [a.name for a in node.names] if isinstance(node, ast.Import) else []
            names += [node.module or ""] if isinstance(node, ast.ImportFrom) else []
            for name in names:
                assert not name.startswith(tuple(f"pliant.{room}" for room in foreign)), f"{path.name}: {name}"


def test_nobody_but_the_laboratory_opens_the_truth():
    package = HOME.parent
    for path in package.rglob("*.py"):
        if HOME in path.parents or path.relative_to(package).as_posix() == "validation/truth.py":
            continue
        assert "testbed.truth" not in path.read_text(), path


def test_actuators_b_and_c_follow_the_strongest_scenario():
    for name in "bc":
        truth = generate(replace(SCENARIOS["step_240"], duration=1.2), name, 1).truth
        assert float(truth["curvature"].max()) < 0.8 * actuator(name).cap_curvature
