"""Short journeys through the command line with options that no other test uses."""

from __future__ import annotations

import json

import numpy as np
import pytest
from command_line import invoke, program
from small_study import STUDY, TIMES, table, write_recording, write_study

from pliant.actuators import chen2018
from pliant.errors import InputError
from pliant.model import Station, chain_model, save_model
from pliant.recording import make_recording, read, write
from pliant.simulation import Trace, simulate
from pliant.testbed.bundle import FOLDER

BODY = chain_model(length=0.16, mass=0.1, links=2, joint_placement="midsegment", stiffness=0.1, damping=3e-3,
                   torque=[4e-7], stations=[Station("mid", 0, 0.08), Station("tip", 1, 0.04)])  # fmt: skip


def run(*words):
    done = invoke(*words)
    assert done.exit_code == 0, done.exception or done.output
    return done.stdout


def arc(path, **columns):
    """A dense shape that bends, on disk."""
    s = np.linspace(0, 0.17, 60)
    kappa = np.linspace(2, 14, 25)[:, None]
    points = np.stack([np.cos(kappa * s) - 1, np.sin(kappa * s)], axis=2) / kappa[..., None]
    return write(make_recording(np.arange(25) / 75, points, arc_length=s, frame="planar", **columns), path)


def test_order_with_another_spline_and_error(tmp_path):
    shape = arc(tmp_path / "body.nc")
    words = ("--boundary", "natural", "--placement", "best", "--metric", "closest", "--max-order", "3", "--json")
    assert list(json.loads(run("order", shape, *words))["orders"]) == ["2", "3"]


def test_shape_of_a_fibre_and_of_stations(tmp_path):
    raw, clean = FOLDER / "pulse_60.nc", tmp_path / "clean.nc"
    fibre = ("--cap-curvature", "50", "--cap-length", "30mm", "--body-length", "0.17", "--clamp-length", "12mm")
    run("shape", raw, "-o", clean, *fibre, "--gauge-length", "1.3mm")
    assert read(clean).attrs["frame"] == "planar"
    run("shape", raw, "-o", clean, "--start", "0.05", "--body-length", "100mm")
    assert float(read(clean)["arc_length"][-1]) == pytest.approx(0.1, abs=2e-3)
    rows = np.column_stack([np.arange(40) * 0.05, np.zeros((40, 3)), np.full((40, 3), [0.0, 0.1, 0.0])])
    rows[20:, 4] = 0.02
    np.savetxt(tmp_path / "p.txt", rows, delimiter=",")
    (tmp_path / "m.toml").write_text('time = 0\nlength_unit = "m"\n[stations]\nfoot = { position = [1, 2, 3] }\n'
                                     'tip = { position = [4, 5, 6] }\n')
    run("shape", tmp_path / "p.txt", "-o", clean, "--mapping", tmp_path / "m.toml", "--base", "foot")
    assert "tip" in read(clean)["station"].values.tolist()
    assert "40 frames of 2 station(s)" in run("inspect", tmp_path / "p.txt", "--mapping", tmp_path / "m.toml")


def test_new_with_a_level_that_was_not_recorded(tmp_path):
    columns = np.delete(table(60.0), 1, axis=1)
    header = ["t", *(f"{axis}_{station}" for station in ("base", "tip") for axis in "xyz")]
    write_recording(tmp_path / "a.csv", columns, header)
    run("new", tmp_path / "s.toml", "--from", tmp_path / "a.csv", "--mass", "50g", "--level-kpa", "0.6bar")
    assert "nominal_pressure = 60.0  # as you stated" in (tmp_path / "s.toml").read_text()


def test_sync_within_a_largest_offset(tmp_path):
    columns = table(60.0)
    write_recording(tmp_path / "shape.csv", columns)
    found = json.loads(run("sync", tmp_path / "shape.csv", "--largest-s", "300ms", "--json"))
    assert abs(found["delay_s"]) < 0.02


def test_estimate_without_a_disturbance_and_another_lag(tmp_path):
    save_model(BODY, tmp_path / "model.json")
    time = np.arange(0.0, 1.0, 0.02)
    pressure = Trace(time, np.where(time > 0.2, 4e4, 0.0))
    place = simulate(BODY, pressure, times=time)["station_position"].values
    place = place + 1e-4 * np.random.default_rng(1).standard_normal(place.shape)
    write(make_recording(time, place, station=["mid", "tip"], frame="planar", pressure=pressure.pressure),
          tmp_path / "a.nc")
    told = json.loads(run("estimate", tmp_path / "a.nc", "--model", tmp_path / "model.json", "--no-disturbance",
                          "--lag", "3", "--json").strip().splitlines()[-1])  # fmt: skip
    assert "largest_disturbance_mn_m" not in told


def test_contact_with_names_of_inputs_and_a_width(tmp_path):
    """The drive names an input that the model lacks: the option is read before anything is computed."""
    save_model(BODY, tmp_path / "model.json")
    arc(tmp_path / "a.nc")
    done = invoke("contact", tmp_path / "a.nc", "--model", tmp_path / "model.json", "--free", tmp_path / "a.nc",
                  "--half-width-mm", "1cm", "--drive", "left")  # fmt: skip
    assert isinstance(done.exception, InputError)
    assert "--drive must be pairs as left=p1,right=p2" in str(done.exception)


@pytest.mark.slow
def test_design_with_limits_and_a_criterion(tmp_path):
    study = write_study(tmp_path)
    plan = json.loads(run("design", study, "--max", "100kPa", "--criterion", "D", "--json"))
    assert plan["proposals"]


@pytest.mark.slow
def test_sweep_on_two_processes(tmp_path):
    save_model(BODY, tmp_path / "model.json")
    small = {"kind": "design", "duration": 0.2, "rate": 50.0, "chunk": 1,
             "parameters": {"damping": {"low": 2e-3, "high": 8e-3, "count": 3}, "level": 4e4}}
    (tmp_path / "sweep.json").write_text(json.dumps({"sweep": small}))
    told = json.loads(run("sweep", tmp_path / "sweep.json", "--model", tmp_path / "model.json", "-o", tmp_path / "out",
                          "--scheduler", "processes", "--workers", "2", "--seed", "3", "--json"))  # fmt: skip
    assert (told["samples"], told["failed_samples"]) == (3, 0)


@pytest.mark.slow
def test_the_loop_of_the_command_line(tmp_path):
    save_model(chen2018.model(), tmp_path / "model.json")
    (tmp_path / "t.toml").write_text(
        "duration_s = 0.3\nplanned = false\n[[setpoint]]\ntime_s = 0.0\ndisplacement_mm = 10.0\n"
    )
    done = program("control", "--model", tmp_path / "model.json", "--task", tmp_path / "t.toml", "--plant", "testbed:a",
                   "--estimator", "differences", "--real-time", "-o", tmp_path / "out", "--json")  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout.strip().splitlines()[-1])
    assert (tmp_path / "out" / "log.csv").is_file()


def test_a_page_for_a_log_that_is_not_there(tmp_path):
    save_model(BODY, tmp_path / "model.json")
    done = invoke("view", tmp_path / "model.json", "--loop", tmp_path / "none.csv", "--touch-mn-m", "1", "--port", "0",
                  "--no-browser", "--json")  # fmt: skip
    assert isinstance(done.exception, InputError)


def test_demonstrations_exclude_each_other(tmp_path):
    done = invoke("demo", "-o", tmp_path / "out", "--angles", "--space")
    assert "different demonstrations: choose one" in str(done.exception)
    assert not (tmp_path / "out").exists()


def test_the_list_of_recordings_as_json():
    assert isinstance(json.loads(run("data", "list", "--json")), list | dict)


def test_a_film_by_the_colour_of_its_dots(tmp_path):
    (tmp_path / "camera.toml").write_text("[camera]\nrate_hz = 30.0\npixels_per_mm = 1.0\n")
    done = invoke("track", tmp_path / "none.mp4", "-o", tmp_path / "a.nc", "--camera", tmp_path / "camera.toml",
                  "--method", "dots", "--colour", "#ff0000", "--base", "10,20")  # fmt: skip
    assert isinstance(done.exception, InputError)
    assert "none.mp4" in str(done.exception)


@pytest.mark.parametrize(("command", "given", "sentence"), [
    (("run",), "a.csv", "is a recording, not a study: look at it by `pliant inspect`, and write a study for it by"),
    (("run",), "model.json", "is a model, not a study: pass it to `pliant simulate`"),
    (("simulate",), "metrics.json", "is the metrics of a run, not a model: the model of that run is model.json"),
    (("simulate",), "study.json", "is a study, not a model: run it by `pliant run`"),
    (("inspect",), "study.json", "is a study, not a recording: run it by `pliant run`"),
    (("inspect",), "sweep.toml", "is a sweep, not a recording: pass it to `pliant sweep`"),
    (("inspect",), "m.toml", "is a mapping, which describes the columns of a table, not a recording: pass it with"),
])
def test_a_file_of_another_kind_is_sent_to_its_command(tmp_path, command, given, sentence):
    write_recording(tmp_path / "a.csv", table(60.0))
    save_model(BODY, tmp_path / "model.json")
    (tmp_path / "metrics.json").write_text(json.dumps({"schema": "pliant-metrics", "records": {}}))
    (tmp_path / "study.json").write_text(json.dumps(STUDY))
    (tmp_path / "sweep.toml").write_text('[sweep]\nkind = "design"\n')
    (tmp_path / "m.toml").write_text('time = 0\nlength_unit = "m"\n')
    done = invoke(*command, tmp_path / given)
    assert isinstance(done.exception, InputError)
    assert sentence in str(done.exception)
    assert len(str(done.exception)) < 400


def test_inspect_ends_with_the_next_command(tmp_path):
    recording = write_recording(tmp_path / "a.csv", table(60.0))
    assert run("inspect", recording).rstrip().endswith(f"next: pliant new a.toml --from {recording}")
    log = tmp_path / "a_log.csv"
    log.write_text("t,p_kpa\n" + "".join(f"{0.01 * k:.2f},{k % 7}\n" for k in range(30)))
    assert run("inspect", log).rstrip().endswith(f"next: pliant new STUDY.toml --from RECORDING {log}")


@pytest.mark.slow
def test_a_run_names_columns_that_change_and_were_left_out(tmp_path):
    study = write_study(tmp_path)
    rows = np.column_stack([table(60.0), np.sin(TIMES), np.full(TIMES.size, 3.0)])
    header = [*["t", "p_kpa"], *(f"{a}_{s}" for s in ("base", "tip") for a in "xyz"), "load_cell", "setting"]
    write_recording(tmp_path / "low.csv", rows, header)
    done = program("run", study, "-o", tmp_path / "out", "--workers", "1")
    assert done.returncode == 0, done.stderr
    assert "low: left-out column(s) of low.csv changes during the recording: load_cell" in done.stderr
    findings = json.loads((tmp_path / "out" / "metrics.json").read_text())["findings"]["low"]
    assert any("load_cell" in line and "setting" not in line for line in findings)
