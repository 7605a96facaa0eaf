"""`pliant new` for separate logs of several chambers, and for recordings of the tip alone: a draft, and a run of it."""

from __future__ import annotations

import json
import tomllib

import numpy as np
import pytest
from command_line import invoke

from pliant.errors import InputError
from pliant.model import Chamber, Station, chain_model
from pliant.preprocessing.align import align
from pliant.recording import make_recording, write
from pliant.simulation import Trace, simulate

pytestmark = pytest.mark.usefixtures("untried")

TIME = np.arange(0.0, 2.4, 0.02)
BASE = np.array([0.53, 0.80, 0.18])  # m, of the base in the axes of the tracker


def column(values):
    return ",".join(f"{v:.6f}" for v in np.ravel(values))


@pytest.fixture
def arm(tmp_path):
    """An arm of two chambers, and the log of its pressures, whose clock begins 0.3 s earlier."""
    clock = np.arange(0.0, 2.8, 0.02)
    levels = np.column_stack([np.where((clock > 0.6) & (clock < 1.5), 4e4, 0.0), np.where((clock > 1.0) & (clock < 2.1),
                              2e4, 0.0)])  # fmt: skip
    half = np.array([1.0, 1.0, 0.0, 0.0])
    body = chain_model(
        length=0.1, mass=0.05, links=4, joint_placement="midsegment", stiffness=0.05, damping=2e-3, gravity=[0.0, 0.0],
        chambers=[Chamber([4e-7], joint_gain=half, name="left"), Chamber([4e-7], joint_gain=half - 1, name="right")],
        stations=[Station("p1", 1, 0.025), Station("tip", 3, 0.0125)],
    )
    place = simulate(body, [Trace(clock, p) for p in levels.T], times=TIME + 0.3)["station_position"].values
    rows = np.zeros((TIME.size, 3, 3))
    rows[:, 1:, :2] = place
    rows += 5e-5 * np.random.default_rng(1).standard_normal(rows.shape)
    names = ",".join(f"{axis}_{station}" for station in ("base", "p1", "tip") for axis in "xyz")
    lines = [f"{t:.3f},{column(row)}" for t, row in zip(TIME, rows, strict=True)]
    (tmp_path / "arm.csv").write_text("\n".join([f"t,{names}", *lines]) + "\n")
    log = [f"{t:.3f},{column(p / 1e3)}" for t, p in zip(clock, levels, strict=True)]
    (tmp_path / "arm_log.csv").write_text("\n".join(["t,p_kpa_left,p_kpa_right", *log]) + "\n")
    return tmp_path


def test_a_log_of_two_chambers_is_joined_on_the_clock_of_the_shape(arm):
    done = invoke("new", arm / "t.toml", "--from", arm / "arm.csv", arm / "arm_log.csv", "--mass", 0.05)
    assert done.exit_code == 0, done.exception or done.output
    content = tomllib.loads((arm / "t.toml").read_text())
    left, right = content["actuator"]["chambers"]
    assert (left["name"], right["name"], right["joint_gain"]) == ("left", "right", -1.0)
    assert "joint_gain" not in left
    entry = content["recordings"]["arm"]
    assert (entry["file"], entry["pressure_file"]) == ("arm.csv", "arm_log.csv")
    assert entry["drive"] == {"left": "left", "right": "right"}


def test_a_log_that_moves_nothing_is_a_warning_of_the_draft(arm):
    rng = np.random.default_rng(5)
    steps = np.repeat(rng.uniform(0, 40, (12, 2)), 10, axis=0)
    log = [f"{0.02 * k:.3f},{column(p)}" for k, p in enumerate(steps)]
    (arm / "arm_log.csv").write_text("\n".join(["t,p_kpa_left,p_kpa_right", *log]) + "\n")
    done = invoke("new", arm / "t.toml", "--from", arm / "arm.csv", arm / "arm_log.csv", "--mass", 0.05)
    assert done.exit_code == 0, done.exception or done.output
    assert "! arm.csv: the clock of arm_log.csv cannot be moved to that of the shape: " in done.output
    assert (arm / "t.toml").is_file()


@pytest.mark.slow
def test_typed_steps_run_as_steps(arm):
    typed = "Time (s);left (kPa);right (kPa)\n0,0;0;0\n0,6;40;0\n1,0;40;20\n1,5;0;20\n2,1;0;0\n"
    (arm / "arm_log.csv").write_text(typed)
    done = invoke("new", arm / "t.toml", "--from", arm / "arm.csv", arm / "arm_log.csv", "--mass", 0.05)
    assert done.exit_code == 0, done.exception or done.output
    assert tomllib.loads((arm / "t.toml").read_text())["recordings"]["arm"]["pressure_mapping"] == {"hold": True}
    done = invoke("run", arm / "t.toml", "-o", arm / "out", "--workers", 1)
    assert done.exit_code == 0, done.exception or done.output
    metrics = json.loads((arm / "out" / "metrics.json").read_text())
    assert metrics["records"]["arm"]["rmse_percent_of_travel"] < 5.0  # 5 links in the draft, 4 in the body
    assert any("each row keeps its value until the next row, 5 rows (hold = true)" in line
               for line in metrics["findings"]["arm"])


def tip_only(folder, markers=None):
    """Three pulses of an arm of which only the tip was tracked: one point, or the `markers` of one rigid plate."""
    body = chain_model(length=0.17, mass=0.075, links=5, joint_placement="midsegment", stiffness=1.6, damping=8e-3,
                       torque=[3e-6])  # fmt: skip
    rng, files = np.random.default_rng(4), []
    for level in (60, 90, 119):
        pressure = np.where((TIME >= 0.4) & (TIME < 1.4), level, 0.0)
        run = simulate(body, Trace(TIME, 1e3 * pressure), times=TIME)
        tip = np.zeros((TIME.size, 3))
        tip[:, :2] = run["tip_position"].values[:, -1]
        if markers is None:
            places, names = tip[:, None], ["tip"]
        else:
            turn = run["joint_angle"].values.sum(axis=1)
            c, s = np.cos(turn), np.sin(turn)
            frame = np.stack([np.stack([c, s, 0 * c], -1), np.stack([-s, c, 0 * c], -1)], axis=1)
            places = tip[:, None] + np.einsum("mk,tkd->tmd", markers, frame)
            names = [f"Tip - {k + 1}" for k in range(len(markers))]
        seen = places + BASE + 5e-5 * rng.standard_normal(places.shape)
        recording = make_recording(TIME, seen, station=names, pressure=1e3 * pressure)
        files.append(write(recording, folder / f"p{level}.csv"))
    return files


PLATE = np.array([[-0.02, 0.0], [0.02, 0.0], [0.0, 0.01]])  # m, along x and y of the last link


def draft(folder, markers):
    done = invoke("new", folder / "t.toml", "--from", *tip_only(folder, markers), "--length", 0.17, "--mass", 0.075,
                  "--json")  # fmt: skip
    assert done.exit_code == 0, done.exception or done.output
    return json.loads(done.stdout)["open"], (folder / "t.toml").read_text()


@pytest.mark.parametrize("markers", [None, PLATE], ids=["point", "plate"])
def test_one_tracked_body_asks_for_the_base(tmp_path, markers):
    questions, text = draft(tmp_path, markers)
    assert [q.partition(":")[0] for q in questions] == ["origin", "tangent"]
    alignment = tomllib.loads(text)["alignment"]
    assert alignment["options"] == {"origin": "?", "tangent": "?"}
    plate = {} if markers is None else {"tip": ["Tip - 1", "Tip - 2", "Tip - 3"]}
    assert alignment.get("stations", {}) == plate


@pytest.mark.slow
@pytest.mark.parametrize("markers", [None, PLATE], ids=["point", "plate"])
def test_the_draft_runs_with_the_base_that_was_asked_for(tmp_path, markers):
    _, text = draft(tmp_path, markers)
    for question, known in {"origin": BASE.tolist(), "tangent": '"+y"'}.items():
        text = text.replace(f'{question} = "?"', f"{question} = {known}")
    (tmp_path / "t.toml").write_text(text)
    done = invoke("run", tmp_path / "t.toml", "-o", tmp_path / "out", "--workers", 1)
    assert done.exit_code == 0, done.exception or done.output
    records = json.loads((tmp_path / "out" / "metrics.json").read_text())["records"]
    assert records["p90"]["rmse_percent_of_travel"] < 1.0


def test_the_only_station_is_not_taken_as_the_base():
    places = np.zeros((40, 1, 3)) + BASE
    places[20:, 0, 0] += 0.01
    recording = make_recording(np.arange(40) * 0.05, places, station=["tip"])
    with pytest.raises(InputError, match="the only station, tip, cannot be base and tip at once: set origin"):
        align(recording, tangent="+y")
    assert align(recording, tangent="+y", origin=BASE - [0.0, 0.1, 0.0]).sizes["station"] == 1
