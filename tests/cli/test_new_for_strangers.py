"""What `pliant new` asks, states and says next for files that nobody described, up to what only a laboratory knows."""

from __future__ import annotations

import json
import tomllib
from pathlib import Path

import numpy as np
import pytest
from command_line import invoke

RNG = np.random.default_rng(3)
T = np.arange(0.0, 6.0, 0.02)
PLACES = "t,base_x,base_y,base_z,tip_x,tip_y,tip_z"


def text_table(path: Path, rows: np.ndarray, header: str = "") -> Path:
    np.savetxt(path, rows, fmt="%.10g", delimiter=",", header=header, comments="")
    return path


def new(folder: Path, *arguments: str | Path) -> tuple[dict, str]:
    """The study that the program drafts, and what it says."""
    done = invoke("new", folder / "s.toml", *arguments)
    assert done.exit_code == 0, done.exception or done.output
    return tomllib.loads((folder / "s.toml").read_text(encoding="utf-8")), done.stdout


def steps_of(said: str) -> list[str]:
    return [line.partition(": ")[2] for line in said.splitlines() if line.startswith(("next: ", "then: "))]


def pressed(folder: Path) -> Path:
    """Two poses with quaternions and three columns that change, without a header: a command, its pressure, a wire."""
    level = np.where((T > 1.0) & (T < 3.5), 10.0, 0.0)
    bend = 0.01 * np.convolve(level, np.exp(-np.arange(40) / 8.0) / 8.0)[: T.size]
    turn = np.column_stack([0 * T, np.sin(bend), 0 * T, np.cos(bend)])
    base = np.column_stack([0 * T, 0 * T, 0 * T + 0.7, 0 * T, 0 * T, 0 * T, 0 * T + 1.0])
    tip = np.column_stack([0.2 * np.sin(bend), 0 * T, 0.7 - 0.2 * np.cos(bend), turn])
    noise = 1e-5 * RNG.standard_normal((T.size, 3))
    tip[:, :3] += noise
    base[:, :3] += noise[::-1]
    return text_table(folder / "push.txt", np.column_stack([T, level, level + 0.1 * np.sin(T), 1.5 + bend, base, tip]))


def test_a_table_that_does_not_show_its_inputs_is_drafted_by_one_line(tmp_path):
    """The draft is written, and the steps that it prints lead to one that can be filled in."""
    file = pressed(tmp_path)
    _, said = new(tmp_path, "--from", file)
    assert "? pressure: columns (from 0) of the measured pressures, as [4, 5], and their unit; 1, 2, 3 change" in said
    assert "its table does not show which columns are the inputs" in said
    write, remove, again = steps_of(said)
    assert write.startswith("write into columns.toml the columns")
    assert remove == f"remove {tmp_path / 's.toml'}"
    assert again == f"pliant new {tmp_path / 's.toml'} --from {file} --mapping columns.toml"
    (tmp_path / "s.toml").unlink()
    (tmp_path / "columns.toml").write_text('pressure = { columns = [2], unit = "psi" }\n')
    study, said = new(tmp_path, "--from", file, "--mapping", tmp_path / "columns.toml")
    assert study["mapping"]["pressure"] == {"columns": [2], "unit": "psi"}
    assert list(study["mapping"]["stations"]) == ["p1", "p2"]
    assert "? pressure" not in said
    assert "the inputs change" in (tmp_path / "s.toml").read_text(encoding="utf-8")


@pytest.mark.usefixtures("untried")
def test_a_run_is_the_next_step_only_where_nothing_is_open(tmp_path):
    file = pressed(tmp_path)
    (tmp_path / "columns.toml").write_text('pressure = { columns = [2], unit = "psi" }\n')
    mapped = ("--from", file, "--mapping", tmp_path / "columns.toml")
    study, run = tmp_path / "s.toml", f"pliant run {tmp_path / 's.toml'} -o results/s"
    said = new(tmp_path, *mapped)[1]
    assert steps_of(said) == [f'replace each "?" in {study}: mass', run]
    study.unlink()
    said = new(tmp_path, *mapped, "--mass", "50g", "--json")[1]
    assert json.loads(said)["next"] == [run]


def test_a_motion_that_nothing_explains_is_no_release(tmp_path):
    """A hand moves a body to the end of the recording: its shape can be studied, its dynamics cannot."""
    t = np.arange(0.0, 20.0, 0.05)
    bend = np.sin(0.9 * t + 3.0) + 0.7 * np.sin(2.3 * t + 1.0) + 0.6 * np.sin(0.31 * t)
    s = np.array([0.05, 0.1, 0.15])
    side = 0.7 * bend[:, None] * s**2
    place = np.stack([side, 0 * side, s - 0 * side], axis=2) + 1e-5 * RNG.standard_normal((t.size, 3, 3))
    rows = np.concatenate([np.zeros((t.size, 1, 3)), place], axis=1).reshape(t.size, 12)
    rows[:, :3] += 1e-5 * RNG.standard_normal((t.size, 3))
    file = text_table(tmp_path / "wave.csv", np.column_stack([t, rows]))
    study, said = new(tmp_path, "--from", file)
    assert "excitation" not in study["recordings"]["wave"]
    assert "nothing in its recordings shows what moves the body" in said
    assert steps_of(said) == [
        f"add the log of the inputs to the recordings of pliant new; without one: pliant order {file}"]  # fmt: skip
    done = invoke("order", file, "--max-order", 2)
    assert done.exit_code == 0, done.exception or done.output
    assert "its columns are proposed from names, units and ranges" in done.stderr
    assert "4 stations" in done.stdout


def ringing(amplitude: float, decay: float) -> np.ndarray:
    return amplitude * np.exp(-decay * T) * np.cos(9.0 * T)


def released(folder: Path, name: str, swing: np.ndarray) -> Path:
    """A base and a tip after a release, with a header."""
    places = np.column_stack([0 * T, 0 * T, 0 * T, 0.05 + swing, 0 * T, -0.2 + 0 * T])
    rows = np.column_stack([T, places + 1e-5 * RNG.standard_normal(places.shape)])
    return text_table(folder / f"{name}.csv", rows, PLACES)


@pytest.mark.usefixtures("untried")
@pytest.mark.parametrize("decay", [0.02, 0.5])
def test_a_vibration_that_hardly_decays_is_still_a_release(tmp_path, decay):
    study, said = new(tmp_path, "--from", released(tmp_path, "let_go", ringing(0.05, decay)))
    assert study["recordings"]["let_go"]["excitation"] == "release"
    assert "? gravity: " in said


@pytest.mark.usefixtures("untried")
@pytest.mark.parametrize(("name", "known", "asks"), [
    ("decay_200g", {"tip_mass": 0.2}, False), ("beam_load52", {"tip_mass": "?"}, True), ("decay_0g", None, False),
    ("beam_v2", None, False),
])  # fmt: skip
def test_the_load_that_a_file_is_named_after_is_known_or_asked(tmp_path, name, known, asks):
    study, said = new(tmp_path, "--from", released(tmp_path, name, ringing(0.05, 0.5)))
    assert study["recordings"][name].get("known") == known
    assert ("? tip_mass: " in said) is asks


@pytest.mark.usefixtures("untried")
def test_a_recording_that_begins_with_the_motion_rests_in_its_first_frames(tmp_path):
    """It ends under pressure, and the body is longest at rest there: no rest of the alignment."""
    rise = 0.05 * (1.0 - np.exp(-np.clip(T - 0.06, 0.0, None) / 0.4))
    places = np.column_stack([0 * T, 0 * T, 0 * T, rise, 0 * T, 0.2 - rise])
    rows = np.column_stack([T, places + 1e-5 * RNG.standard_normal(places.shape)])
    file = text_table(tmp_path / "fill_40kPa.csv", rows, PLACES)
    study, _ = new(tmp_path, "--from", file)
    entry = study["recordings"]["fill_40kPa"]
    assert entry["excitation"] == "step"
    assert entry["alignment"] == {"options": {"rest": [0.0, 0.1]}}
    assert study["actuator"]["length"] == pytest.approx(0.2, abs=0.002)


def bent(total: np.ndarray, azimuth: np.ndarray | float, s: np.ndarray) -> np.ndarray:
    """Points (..., S, 3) [m] at the distances s along a body of 0.12 m with even curvature, base along +z."""
    curve = np.maximum(np.abs(total)[..., None], 1e-9) / 0.12
    out = (1.0 - np.cos(curve * s)) / curve
    return np.stack([np.cos(azimuth)[..., None] * out, np.sin(azimuth)[..., None] * out, np.sin(curve * s) / curve], -1)


@pytest.mark.usefixtures("untried")
def test_settled_poses_keep_a_station_that_hardly_moves(tmp_path):
    """In one file the second point stands as still as the base: nothing moves in any of them."""
    s, files = np.array([0.0, 0.04, 0.08, 0.12]), []
    for motor, azimuth in (("m1", 0.3), ("m2", 1.9)):
        for level in (1, 2, 3):
            points = bent(np.array(0.5 * level), np.array(azimuth), s)
            noise = np.array([1e-6, 1e-6, 1e-4, 1e-4])[:, None] * RNG.standard_normal((120, 4, 3))
            rows = np.column_stack([np.arange(120) / 100.0, (points + noise).reshape(120, 12)])
            files.append(text_table(tmp_path / f"{motor}_u{level}.csv", rows))
    study, said = new(tmp_path, *(part for file in files for part in ("--from", file)))
    assert all("stations" not in entry for entry in study["recordings"].values())
    assert study["actuator"]["length"] == "?"
    assert study["alignment"]["options"] == {"base": "base", "tangent": "+z", "plane": "+x"}  # no file shows its x axis
    assert "? length: m, of the part that bends: no pose shows the body at rest; the farthest reaches 0.119 m" in said
    common = study["model_selection"]["common"]
    assert {"p1.along", "p1.across", "p1.aside", "p2.along", "tip.along"} <= set(common)


def pulled_by_steps(folder: Path, *, slack: bool) -> Path:
    """Steps of three motors and a tip [mm], without header and time."""
    steps = RNG.integers(-400, 400, (80, 3))
    drawn = np.maximum(steps, 0) if slack else steps
    towards = np.radians([90.0, 210.0, 330.0])
    bend = 2e-3 * np.column_stack([drawn @ np.cos(towards), drawn @ np.sin(towards)])
    tip = bent(np.linalg.norm(bend, axis=1), np.arctan2(bend[:, 1], bend[:, 0]), np.array([0.12]))[:, 0]
    tip = 1e3 * tip + 0.05 * RNG.standard_normal(tip.shape) + [120.0, -40.0, 305.0]
    return text_table(folder / "session.txt", np.column_stack([steps, np.round(tip, 3)]))


@pytest.mark.usefixtures("untried")
@pytest.mark.parametrize("slack", [False, True])
def test_whole_numbers_beside_places_are_steps_of_motors(tmp_path, slack):
    study, said = new(tmp_path, "--from", pulled_by_steps(tmp_path, slack=slack))
    mapping = study["mapping"]
    assert mapping["inputs"] == [{"columns": [0, 1, 2], "kind": "displacement", "unit": "mm"}]
    assert mapping["linear"] == {"actuation": {"scale": "?"}}
    assert mapping["rate_hz"] == 1.0  # of settled poses, whose times have no effect
    assert "rate_hz" not in said
    tendons, common = study["actuator"]["tendons"], study["model_selection"]["common"]
    assert [t.get("pair", False) for t in tendons] == [not slack] * 3
    assert ("column_1.pretension" in common) is slack
    assert {t["line_stiffness"] for t in tendons} == {1000.0}  # stated: the poses show only ratios to it
    assert "only ratios of stiffnesses" in (tmp_path / "s.toml").read_text(encoding="utf-8")
    assert "? gravity: " in said


@pytest.mark.slow  # the draft is tried
def test_the_values_assumed_for_a_trial_let_the_body_reach_all_places(tmp_path):
    said = new(tmp_path, "--from", pulled_by_steps(tmp_path, slack=False))[1]
    assert "this study can be run" in said
    assert "length, mass, gravity, lever, origin, tangent" in said


@pytest.mark.usefixtures("untried")
@pytest.mark.parametrize(("unit", "kind", "value"), [
    ("N", "tension", 2.5), ("mm", "displacement", 2.5e-3), ("deg", "angle", np.radians(2.5)),
])  # fmt: skip
def test_inputs_in_the_names_of_files_are_those_of_the_tendons(tmp_path, unit, kind, value):
    s, files = np.array([0.0, 0.06, 0.12]), []
    for motor, azimuth in (("m1", 0.3), ("m2", 1.9)):
        for level in (1, 2.5):
            points = bent(np.array(0.4 * level), np.array(azimuth), s) + 1e-6 * RNG.standard_normal((60, 3, 3))
            rows = np.column_stack([np.arange(60) / 100.0, points.reshape(60, 9)])
            files.append(text_table(tmp_path / f"{motor}_{level}{unit}.csv", rows))
    study, said = new(tmp_path, *(part for file in files for part in ("--from", file)))
    assert study["recordings"][f"m1_2_5{unit}"]["inputs"] == {"m1": pytest.approx(value), "m2": 0.0}
    assert [t["driven_by"] for t in study["actuator"]["tendons"]] == [kind] * 2
    assert ("pulley" in study["actuator"]["tendon_defaults"]) is (kind == "angle")
    assert "? inputs" not in said


@pytest.mark.usefixtures("untried")
@pytest.mark.parametrize("rigid", [True, False])
def test_markers_without_names_on_two_plates_are_a_base_and_a_tip(tmp_path, rigid):
    """Three stand still, and three move with constant distances; on a soft body they would not keep these."""
    bend = np.where((T > 1.0) & (T < 4.0), 1.0, 0.0)
    bend = 0.6 * np.convolve(bend, np.exp(-np.arange(30) / 6.0) / 6.0)[: T.size]
    plate = np.array([[0.015, 0.0, 0.0], [-0.008, 0.013, 0.0], [-0.008, -0.013, 0.002]])
    turned = np.stack([plate[:, 0] * np.cos(bend)[:, None] + plate[:, 2] * np.sin(bend)[:, None],
                       plate[:, 1] + 0 * bend[:, None],
                       plate[:, 2] * np.cos(bend)[:, None] - plate[:, 0] * np.sin(bend)[:, None]], axis=2)  # fmt: skip
    if not rigid:
        turned[:, 0, 0] += 0.01 * bend
    tip = np.column_stack([0.06 * bend, 0 * T, 0.12 - 0.02 * bend**2])[:, None] + turned
    places = np.concatenate([np.broadcast_to(plate, tip.shape), tip], axis=1).reshape(T.size, 18)
    places += 1e-5 * RNG.standard_normal(places.shape)
    study, _ = new(tmp_path, "--from", text_table(tmp_path / "arm_40kPa.csv", np.column_stack([T, places])))
    stations = {"base": ["p1", "p2", "p3"], "tip": ["p4", "p5", "p6"]} if rigid else None
    assert study["alignment"].get("stations") == stations


def swinging(folder: Path, name: str, high: float) -> Path:
    """A base and a tip at the height `high` [m] below it, under a pressure that swings."""
    push = 10.0 * np.sin(1.5 * np.clip(T - 1.0, 0.0, None)) ** 2
    side = 3e-3 * np.convolve(push, np.exp(-np.arange(20) / 4.0) / 4.0)[: T.size]
    places = np.column_stack([0 * T, 0 * T, 0 * T, side, 0 * T, side**2 - high])
    rows = np.column_stack([T, push, places + 1e-5 * RNG.standard_normal(places.shape)])
    return text_table(folder / f"{name}.csv", rows, f"t,p_kpa,{PLACES[2:]}")


@pytest.mark.usefixtures("untried")
def test_the_body_is_as_long_as_the_recording_that_shows_it_longest(tmp_path):
    files = [swinging(tmp_path, "later", 0.15), swinging(tmp_path, "first", 0.2)]
    study, _ = new(tmp_path, *(part for file in files for part in ("--from", file)))
    assert study["actuator"]["length"] == pytest.approx(0.2, rel=0.01)
    assert "from base to tip at rest in first.csv" in (tmp_path / "s.toml").read_text(encoding="utf-8")


@pytest.mark.slow  # the draft is tried
def test_a_trial_names_the_recordings_that_a_run_would_leave_out(tmp_path):
    files = [swinging(tmp_path, "train", 0.15), swinging(tmp_path, "validation", 0.2)]
    said = new(tmp_path, *(part for file in files for part in ("--from", file)), "--length", "0.14", "--mass", "50g")[1]
    assert "this study can be run" in said
    assert "1 recording(s) are left out: recording validation is dropped: station tip is" in said


@pytest.mark.usefixtures("untried")
@pytest.mark.parametrize(("count", "tendons", "every"), [(700, 6, 2), (200, 3, None)])
def test_tendons_of_several_segments_are_asked_for_their_ends(tmp_path, count, tendons, every):
    """One tracked body does not show where they end. Of very many poses a part is used."""
    drawn = RNG.uniform(0.0, 8.0, (count, tendons))
    towards = np.radians(120.0) * np.arange(tendons)
    bend = 0.1 * np.column_stack([drawn @ np.cos(towards), drawn @ np.sin(towards)])
    tip = bent(np.linalg.norm(bend, axis=1), np.arctan2(bend[:, 1], bend[:, 0]), np.array([0.12]))[:, 0]
    names = [*(f"tendon_{k}_mm" for k in range(tendons)), "tip_x_m", "tip_y_m", "tip_z_m"]
    file = text_table(tmp_path / "poses.csv", np.column_stack([0.6 * np.arange(count), drawn, tip]),
                      ",".join(["time", *names]))  # fmt: skip
    study, said = new(tmp_path, "--from", file)
    assert study["recordings"]["poses"]["poses"] is True
    assert study["recordings"]["poses"].get("every") == every
    assert [t.get("stop") for t in study["actuator"]["tendons"]] == ["?" if tendons == 6 else None] * tendons
    assert ("? stop: m from the base, where it ends" in said) is (tendons == 6)


@pytest.mark.usefixtures("untried")
def test_a_file_whose_rows_are_in_another_one_judges_nothing(tmp_path):
    """The rest is divided: the later poses judge."""
    whole = pulled_by_steps(tmp_path, slack=False)
    rows = np.loadtxt(whole, delimiter=",")
    copy = text_table(tmp_path / "validation.csv", rows[:30])
    (whole := whole.rename(tmp_path / "train.txt")).write_bytes(text_table(tmp_path / "a.csv", rows).read_bytes())
    study, said = new(tmp_path, "--from", whole, "--from", copy)
    assert "hold the same numbers in 30 frames" in said
    parts = {name: entry.get("part") for name, entry in study["recordings"].items()}
    assert parts == {"train": [0.0, 0.8], "train_later": [0.8, 1.0], "validation": None}
    assert study["model_selection"]["train"] == ["train"]
    assert study["model_selection"]["held_out"] == ["train_later"]
    assert "validation is left out: train holds its frames" in (tmp_path / "s.toml").read_text(encoding="utf-8")


@pytest.mark.usefixtures("untried")
def test_chambers_that_are_driven_together_bend_to_one_side(tmp_path):
    """What both move cannot be told apart: neither is drafted against the motion that they share."""
    push = 40.0 * np.sin(1.5 * np.clip(T - 1.0, 0.0, None)) ** 2
    side = 8e-4 * np.convolve(push, np.exp(-np.arange(20) / 4.0) / 4.0)[: T.size]
    late = np.roll(push, 3)
    places = np.column_stack([0 * T, 0 * T, 0 * T, side, 0 * T, side**2 - 0.2])
    both = np.column_stack([push, 0.9 * late]) + 0.2 * RNG.standard_normal((T.size, 2))
    rows = np.column_stack([T, both, places + 1e-5 * RNG.standard_normal(places.shape)])
    file = text_table(tmp_path / "both.csv", rows, f"t,p_kpa_left,p_kpa_right,{PLACES[2:]}")
    study, _ = new(tmp_path, "--from", file)
    assert len({chamber.get("joint_gain", 1.0) for chamber in study["actuator"]["chambers"]}) == 1
