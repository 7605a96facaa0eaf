"""`pliant new` on files as laboratories write them: the kind of experiment is recognised, and columns are described."""

from __future__ import annotations

import tomllib
from pathlib import Path

import numpy as np
import pytest
from command_line import invoke

pytestmark = pytest.mark.usefixtures("untried")

RNG = np.random.default_rng(0)


def drafted(folder: Path, *files: Path, mapping: str = "", name: str = "s", options: tuple[str, ...] = ()) -> dict:
    """The study that the program drafts for the files, and its text under "text"."""
    if mapping:
        (folder / "columns.toml").write_text(mapping, encoding="utf-8")
        options = (*options, "--mapping", str(folder / "columns.toml"))
    done = invoke("new", folder / f"{name}.toml", "--from", *files, *options)
    assert done.exit_code == 0, done.exception or done.output
    text = (folder / f"{name}.toml").read_text(encoding="utf-8")
    return {**tomllib.loads(text), "text": text, "asked": done.stdout}


def table(path: Path, columns: dict[str, np.ndarray], delimiter: str = ",", *, header: bool = True) -> Path:
    """A text table of columns (T,) by name."""
    rows = np.column_stack([*columns.values()])
    np.savetxt(path, rows, fmt="%.13g", delimiter=delimiter, comments="", header=delimiter.join(columns))
    if not header:
        path.write_text(path.read_text(encoding="utf-8").partition("\n")[2], encoding="utf-8")
    return path


def moving(count: int, rate: float = 50.0) -> tuple[np.ndarray, np.ndarray]:
    """Times, and three smooth inputs from 0 to 1 after a second of rest."""
    t = np.arange(count) / rate
    on = np.clip(t - 1.0, 0.0, None)
    return t, np.stack([np.sin(w * on) ** 2 for w in (1.1, 1.7, 2.3)], axis=1)


def tip_of(inputs: np.ndarray) -> np.ndarray:
    """Tip (T, 3) [m] of a hanging body in space under three inputs from 0 to 1."""
    azimuth = np.radians([0.0, 120.0, 240.0])
    side = 0.05 * inputs @ np.stack([np.cos(azimuth), np.sin(azimuth)], axis=1)
    place = np.column_stack([side[:, 0], -0.3 + 2.0 * (side**2).sum(axis=1), side[:, 1]])
    return place + [0.5, 1.2, 0.2] + 2e-5 * RNG.standard_normal(place.shape)


def body_columns(place: np.ndarray) -> dict[str, np.ndarray]:
    return {f"arm_tip_{a}": place[:, k] for k, a in enumerate("xyz")}


def test_pressures_in_space_with_one_body_are_found_by_name(tmp_path):
    """Commands beside measured pressures, two sister pouches on one valve, no base."""
    t, inputs = moving(1000)
    psi = 8.0 * inputs
    columns = {"time": t, **{f"Desired_pressure_seg_{k}": psi[:, k - 1] for k in (1, 2, 3)},
               "Measured_pressure_seg_1_pouch_1": psi[:, 0], "Measured_pressure_seg_1_pouch_2": psi[:, 0] + 0.01,
               "Measured_pressure_seg_2": psi[:, 1], "Measured_pressure_seg_3": psi[:, 2]}  # fmt: skip
    file = table(tmp_path / "waves.csv", {**columns, **body_columns(tip_of(inputs))})
    study = drafted(tmp_path, file)
    assert study["mapping"]["pressure"]["unit"] == "?"
    assert study["alignment"]["options"] == {"origin": "?", "tangent": "?"}
    assert study["actuator"]["space"] is True
    assert [c["name"] for c in study["actuator"]["chambers"]] == ["seg_1", "seg_2", "seg_3"]
    drive = study["recordings"]["waves"]["drive"]
    assert drive["seg_1"] in ("Measured_pressure_seg_1_pouch_1", "Measured_pressure_seg_1_pouch_2")
    assert "nominal_pressure" not in study["text"]
    assert "commands beside measured inputs are not used: Desired_pressure_seg_1" in study["text"]
    assert [line[2:].split(":")[0] for line in study["asked"].splitlines() if line.startswith("? ")] == [
        "pressure", "length", "mass", "gravity", "origin", "tangent"]  # fmt: skip


@pytest.mark.parametrize(("left_on", "warm_up"), [(0.3, 1.3), (0.0, None)])
def test_inputs_that_are_switched_on_and_stay_on_get_a_warm_up(tmp_path, left_on, warm_up):
    t, inputs = moving(1500)
    raised = np.clip(t / 1.5, 0.0, 1.0)[:, None] * left_on + (1.0 - left_on) * inputs
    psi = 8.0 * raised[:, :2]
    columns = {"time": t, "pressure_1_psi": psi[:, 0], "pressure_2_psi": psi[:, 1]}
    file = table(tmp_path / "waves.csv", {**columns, **body_columns(tip_of(raised))})
    study = drafted(tmp_path, file)
    assert study["recordings"]["waves"].get("warm_up") == (warm_up and pytest.approx(warm_up, abs=0.11))
    assert study["recordings"]["waves"].get("start") == (warm_up and "pose")
    assert study["actuator"]["links"] == 3


def test_rows_that_jump_are_settled_poses_and_the_validation_file_judges(tmp_path):
    files = []
    for name, count in (("v1_train", 300), ("v1_check", 40)):
        inputs = RNG.uniform(0.0, 1.0, (count, 3))
        place = 1e3 * (tip_of(inputs) - [0.5, 0.9, 0.2])
        columns = {"timestamp": 1.7e9 + 0.6 * np.arange(count),
                   **{f"servo_{k}_mm": 9.0 * inputs[:, k] for k in range(3)},
                   **{f"tip_{a}": place[:, k] for k, a in enumerate("xyz")}}  # fmt: skip
        files.append(table(tmp_path / f"{name}.csv", columns))
    study = drafted(tmp_path, *files)
    assert study["mapping"]["length_unit"] == "mm"
    assert [t["driven_by"] for t in study["actuator"]["tendons"]] == ["displacement"] * 3
    assert study["recordings"]["v1_train"]["poses"] is True
    assert study["model_selection"]["train"] == ["v1_train"]
    assert study["model_selection"]["held_out"] == ["v1_check"]
    assert study["model_selection"]["common"]["damping"] == {"value": 1e-3, "free": False}


def test_inspect_shows_the_proposed_columns(tmp_path):
    inputs = moving(400)[1]
    columns = {**{f"servo_{k}_mm": 9.0 * inputs[:, k] for k in range(3)}, **body_columns(1e3 * tip_of(inputs))}
    done = invoke("inspect", table(tmp_path / "run.csv", columns))
    assert done.exit_code == 0, done.exception or done.output
    assert "its columns are proposed from names, units and ranges" in done.stdout
    assert "? rate_hz: rows a second: the table has no column of time" in done.stdout
    assert "positions are taken in mm, by their range" in done.stdout
    assert "servo_0_mm: 0 to 9 mm" in done.stdout


def test_the_same_inputs_in_a_motion_are_no_poses(tmp_path):
    t, inputs = moving(3000)
    columns = {"timestamp": t, **{f"servo_{k}_mm": 9.0 * inputs[:, k] for k in range(3)},
               **body_columns(tip_of(inputs))}  # fmt: skip
    study = drafted(tmp_path, table(tmp_path / "run.csv", columns))
    assert "poses" not in study["recordings"]["run"]
    assert study["recordings"]["run"]["every"] > 1  # a slow motion at 50 Hz
    assert len(study["actuator"]["tendons"]) == 3


def test_one_file_a_pose_with_the_markers_in_any_order(tmp_path):
    """A header-less table a pose, five points each; the order of the points differs from file to file."""
    files = []
    for motor, azimuth in (("m1", 0.5), ("m2", 2.6)):
        for level in (1, 2, 3):
            s = np.array([0.0, 0.1, 0.2, 0.3])
            bend = 0.4 * level * s
            side = np.stack([np.cos(azimuth) * np.sin(bend) * s, np.sin(azimuth) * np.sin(bend) * s], axis=1)
            points = np.array([0.2, 0.05, 0.1]) + np.column_stack([side[:, 0], s * np.cos(bend), side[:, 1]])
            order = RNG.permutation(4)
            place = points[order] + 1e-5 * RNG.standard_normal((200, 4, 3))
            columns = {"frame": np.arange(200), "t": np.arange(200) / 240.0,
                       **{f"c{k}": v for k, v in enumerate(place.reshape(200, 12).T)}}  # fmt: skip
            files.append(table(tmp_path / f"{motor}_u{level}.csv", columns, header=False))
    study = drafted(tmp_path, *files, options=("--gravity", "0,9.81,0"))
    assert [t["name"] for t in study["actuator"]["tendons"]] == ["m1", "m2"]
    entry = study["recordings"]["m1_u1"]
    assert entry["poses"] == "median"
    assert entry["inputs"] == {"m1": "?", "m2": 0.0}
    assert study["alignment"]["options"]["base"] == "base"
    assert study["alignment"]["options"]["tangent"] == "+y"
    for file in files:
        own = study["recordings"][file.stem].get("mapping", study["mapping"])["stations"]
        rows = np.loadtxt(file, delimiter=",")
        distance = [np.linalg.norm(rows[:, c["position"]].mean(axis=0) - [0.2, 0.05, 0.1]) for c in own.values()]
        np.testing.assert_allclose(distance, [0.0, 0.1, 0.2, 0.3], atol=0.01)
    assert "nominal_pressure" not in study["text"]


def test_a_release_without_a_base_is_no_pulse(tmp_path):
    t = np.arange(0.0, 6.0, 0.01)
    swing = 0.1 * np.exp(-0.8 * t) * np.cos(9.0 * t)
    place = {"mid_x": 0.3 * swing, "mid_y": -0.15 + 0 * t, "mid_z": 0.1 * swing,
             "tip_x": swing, "tip_y": -0.3 + 0 * t, "tip_z": 0.5 * np.roll(swing, 20)}  # fmt: skip
    place = {n: v + 1e-5 * RNG.standard_normal(t.size) for n, v in place.items()}
    mapping = """delimiter = "\\t"
time = 0
length_unit = "m"
stations = { mid = { position = [1, 2, 3] }, tip = { position = [4, 5, 6] } }
"""
    file = table(tmp_path / "let_go.txt", {"t": t, **place}, "\t", header=False)
    study = drafted(tmp_path, file, mapping=mapping)
    assert study["recordings"]["let_go"]["excitation"] == "release"
    assert study["recordings"]["let_go"]["stations"] == ["mid", "tip"]
    assert study["alignment"]["options"]["origin"] == "?"
    assert "kPa" not in study["asked"]


@pytest.mark.parametrize("stated", [False, True])
def test_trials_of_one_table_become_recordings(tmp_path, stated):
    """A column of trial numbers, no time: the frame rate is asked, unless a mapping states it."""
    t = np.arange(0.0, 3.0, 0.01)
    trials = []
    for k, size in enumerate((0.05, 0.1, 0.08)):
        swing = size * np.exp(-t) * np.cos(12.0 * t)
        still = 0 * t
        trials.append(np.column_stack([still + k, 0.4 * swing, still - 0.1, still, swing, still - 0.3, still]))
    rows = np.concatenate(trials)
    rows[:, 1:] += 1e-5 * RNG.standard_normal((len(rows), 6))
    names = ["ID", *(f"{a}{k}" for k in (1, 2) for a in "xyz")]
    file = table(tmp_path / "decay.csv", dict(zip(names, rows.T, strict=True)))
    study = drafted(tmp_path, file, mapping="rate_hz = 100.0\n" if stated else "")
    assert study["recordings"]["decay"]["select"] == {"column": "ID", "values": [0, 1, 2]}
    assert study["mapping"]["rate_hz"] == (100.0 if stated else "?")
    assert study["model_selection"]["held_out"] == ["decay_2"]  # the middle displacement


def test_steps_of_a_motor_ask_for_their_size(tmp_path):
    t, inputs = moving(800)
    columns = {"t_s": t, **{f"stepper_{k}": np.rint(2000 * inputs[:, k]) for k in range(3)},
               **body_columns(tip_of(inputs))}  # fmt: skip
    study = drafted(tmp_path, table(tmp_path / "steps.csv", columns))
    assert study["mapping"]["linear"] == {"actuation": {"scale": "?"}}
    assert [t["driven_by"] for t in study["actuator"]["tendons"]] == ["displacement"] * 3


def test_what_a_mapping_states_is_never_overridden(tmp_path):
    """Columns that look like displacements are pressures, because the mapping says so."""
    t, inputs = moving(800)
    columns = {"time": t, "tendon_mm": 30.0 * inputs[:, 0], **body_columns(tip_of(inputs))}
    mapping = """header = true
time = "time"
length_unit = "m"
pressure = { columns = ["tendon_mm"], unit = "kPa" }
stations = { tip = { position = ["arm_tip_x", "arm_tip_y", "arm_tip_z"] } }
"""
    study = drafted(tmp_path, table(tmp_path / "run.csv", columns), mapping=mapping)
    assert "tendons" not in study["actuator"]
    assert study["recordings"]["run"]["mapping"]["pressure"]["columns"] == ["tendon_mm"]
    assert "mapping" not in study


def test_a_base_that_is_labelled_late_is_aligned_by_a_later_rest(tmp_path):
    t = np.arange(0.0, 4.0, 0.01)
    bend = 3.0 * (np.clip((t - 0.5) / 0.1, 0, 1) - np.clip((t - 2.5) / 0.1, 0, 1)) + 1e-6
    columns = {"t": t, "p_kpa": 10.0 * bend}
    for name, s in (("base", 0.0), ("mid", 0.1), ("tip", 0.2)):
        place = np.column_stack([(np.cos(bend * s) - 1) / bend, np.sin(bend * s) / bend, 0 * t])
        place += 1e-5 * RNG.standard_normal(place.shape)
        place[: 150 if name == "base" else 0] = np.nan
        columns |= {f"{name}_{a}": place[:, k] for k, a in enumerate("xyz")}
    study = drafted(tmp_path, table(tmp_path / "late.csv", columns))
    begin, end = study["recordings"]["late"]["alignment"]["options"]["rest"]
    assert 2.6 < begin < end < 4.0
    assert study["actuator"]["length"] == pytest.approx(0.2, abs=1e-3)
    assert "not all stations are labelled in the first 150 frames" in study["text"]
    assert "rest" not in study["alignment"]["options"]
