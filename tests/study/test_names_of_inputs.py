"""Names of inputs that hold a word, letter or number which elsewhere says another quantity."""

from __future__ import annotations

import numpy as np
import pytest
from small_study import TIMES, table
from test_habits_of_tables import AXES, BASE, KPA, TIP, drafted, written

from pliant.recording import read
from pliant.study.column_guess import guessed_table
from pliant.study.draft import draft_study
from pliant.study.first_reading import read_or_guess
from pliant.study.schema import load_study

SMALL = table(1.0)[:, 1]
JITTER = np.random.default_rng(1)


def guessed(path, names, *columns):
    return guessed_table(written(path / "a.csv", ["t", *AXES, *names], TIMES, BASE, TIP, *columns))


@pytest.mark.parametrize("names", [True, False])
def test_two_plates_of_markers_without_names_from_tip_to_base(tmp_path, names):
    plate = np.array([[20.0, 0.0, 0.0], [-10.0, 17.0, 0.0], [-10.0, -17.0, 0.0]])
    markers = [TIP + 0.5 * offset for offset in plate] + [BASE + offset for offset in plate]
    head = ["t", *(f"{axis}{k}" for k in range(1, 7) for axis in "xyz"), "p_kPa"] if names else []
    trial = drafted(written(tmp_path / "a.csv", head, TIMES, *markers, *([KPA] if names else []))).inspected.first
    assert trial.stations == {"base": ["p4", "p5", "p6"], "tip": ["p1", "p2", "p3"]}
    assert (trial.base, trial.problem) == ("base", "")


def test_steps_of_poses_count_from_the_zero_of_their_motor(tmp_path):
    paths = []
    for j in range(6):
        steps = 500 * j + JITTER.integers(0, 2, len(TIMES))
        place = TIP[0] + j * (TIP[len(TIP) // 2] - TIP[0]) / 5 + 0.02 * JITTER.standard_normal((len(TIMES), 3))
        paths.append(written(tmp_path / f"pose{j}.csv", ["t", *AXES, "motor_steps"], TIMES, BASE, place, steps))
    draft = draft_study(paths, tmp_path / "s.toml", length=0.12, mass=0.05)
    assert "zero" not in draft.text
    pulled = [np.median(read_or_guess(path, None)[0]["actuation"].values) for path in paths]
    assert (np.diff(pulled) > 0).all()


def test_a_motor_position_with_a_gap_is_read(tmp_path):
    steps = 1000 + np.round(KPA)
    steps[7] = np.nan
    path = written(tmp_path / "a.csv", ["t", *AXES, "encoder"], TIMES, BASE, TIP, steps)
    actuation = read(path, mapping=guessed_table(path).neutral)["actuation"].values[:, 0]
    np.testing.assert_array_equal(np.isnan(actuation), np.isnan(steps))


@pytest.mark.parametrize(("name", "kind", "unit"), [
    ("bar_length_mm", "displacement", "mm"), ("bar2_angle_deg", "angle", "deg"), ("bar force (N)", "tension", "n"),
    ("tip_psi_deg", "angle", "deg"), ("motor_psi_rad", "angle", "rad"), ("pa_angle_deg", "angle", "deg"),
    ("tendon (left)", "displacement", "mm"), ("tendon (1)", "displacement", "mm"),
    ("Cable [left]", "displacement", "mm"), ("tension (1)", "tension", "N"), ("force (tip)", "tension", "N"),
])  # fmt: skip
def test_a_stated_unit_and_a_name_in_brackets(tmp_path, name, kind, unit):
    guess = guessed(tmp_path, [name], 1.013 * KPA)
    assert guess.mapping["inputs"] == [{"columns": [name], "kind": kind, "unit": unit}]
    assert "pressure" not in guess.mapping


@pytest.mark.parametrize("name", ["chamber (1)", "chamber [left]", "valve (left)"])
def test_a_chamber_with_a_name_in_brackets_asks_for_its_unit(tmp_path, name):
    assert guessed(tmp_path, [name], 1.013 * KPA).mapping["pressure"] == {"columns": [name], "unit": "?"}


@pytest.mark.parametrize(("names", "used"), [
    (["motor (A)", "motor (B)"], True), (["motor [A]"], False), (["tendon_f", "tendon_g"], True),
    (["motor (rpm)"], False), (["tendon [mm/s]"], False),
])  # fmt: skip
def test_a_letter_is_a_unit_unless_it_tells_columns_apart(tmp_path, names, used):
    guess = guessed(tmp_path, names, *(1.013 * KPA + k for k, _ in enumerate(names)))
    assert ("inputs" in guess.mapping) == used
    assert not used or {column for entry in guess.mapping["inputs"] for column in entry["columns"]} == {*names}


@pytest.mark.parametrize("name", ["servo_pwm", "motor_pwm"])
def test_the_duty_of_a_motor_is_no_pressure(tmp_path, name):
    guess = guessed(tmp_path, [name], np.round(10 * KPA) + 1000)
    assert [entry["columns"] for entry in guess.mapping["inputs"]] == [[name]]
    assert "pressure" not in guess.mapping


@pytest.mark.parametrize("name", ["dxl_temp", "dxl_voltage", "dxl1_velocity", "dxl1_present_current"])
@pytest.mark.parametrize("whole", [True, False])
def test_other_signals_of_a_servo_are_not_used(tmp_path, name, whole):
    guess = guessed(tmp_path, [name], np.round(10 * KPA) if whole else 1.013 * KPA)
    assert not {"inputs", "pressure"} & set(guess.mapping)
    assert any(f"not used: {name}" in note for note in guess.notes)


def test_likelihoods_of_points_are_no_pressures(tmp_path):
    sure = 0.98 + 0.01 * SMALL
    names = [f"{axis}{k}" for k in (1, 2) for axis in "xyp"]
    path = written(tmp_path / "a.csv", ["t", *names], TIMES, BASE[:, :2], sure, TIP[:, [0, 2]], sure)
    guess = guessed_table(path)
    assert guess is None or "pressure" not in guess.mapping
    assert "pressure" not in guessed(tmp_path, ["p"], sure).mapping


@pytest.mark.parametrize("name", ["dxl1", "p", "pwm"])
def test_a_stated_input_leaves_doubtful_ones_out(tmp_path, name):
    guess = guessed(tmp_path, [name, "tendon_mm"], 2048 + np.round(KPA), 1.013 * KPA)
    assert [entry["columns"] for entry in guess.mapping["inputs"]] == [["tendon_mm"]]
    assert any(f"not used: {name}" in note for note in guess.notes)
    assert not {"pressure", "linear"} & set(guess.mapping)


def test_p_beside_a_pressure_with_a_unit_is_told(tmp_path):
    guess = guessed(tmp_path, ["chamber", "p_kPa"], 2.0 * KPA, KPA)
    assert guess.mapping["pressure"] == {"columns": ["p_kPa"], "unit": "kpa"}
    assert any("not used: chamber" in note for note in guess.notes)


@pytest.mark.parametrize(("start", "every", "unit"), [(1.76e12, 20, "ms"), (4e7, 20000, None)])
@pytest.mark.parametrize("offset", [101325, 500000])
def test_a_clock_beside_whole_numbers_is_no_clock_in_two_parts(tmp_path, start, every, unit, offset):
    """Times in ms since 1970, or in us, beside pressures in Pa or counts."""
    clock = start + np.cumsum(JITTER.integers(every * 3 // 4, every * 5 // 4, len(TIMES)))
    path = tmp_path / "a.csv"
    path.write_text("\n".join(f"{t:.0f},{offset + 1e3 * p:.0f}," + ",".join(f"{v:.6f}" for v in (*b, *x))
                              for t, p, b, x in zip(clock, KPA, BASE / 1e3, TIP / 1e3, strict=True)) + "\n")
    mapping = guessed_table(path).mapping
    assert (mapping["time"], mapping.get("time_unit")) == (0, unit)
    assert mapping["inputs"][0]["columns"] == [1]


def test_whole_seconds_beside_a_pressure(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text("\n".join(f"{1_760_000_000 + k},{101325 + 1e3 * p:.0f}," + ",".join(f"{v:.6f}" for v in x)
                              for k, (p, x) in enumerate(zip(KPA, TIP / 1e3, strict=True))) + "\n")
    assert guessed_table(path).mapping.get("time") != [0, 1]


def test_channels_with_a_dot_drive_chambers_whose_parameters_can_be_named(tmp_path):
    path = written(tmp_path / "a.csv", ["t", *AXES, "p1", "p2"], TIMES, BASE, TIP, KPA, 0.4 * KPA[::-1])
    places = {"base": {"position": [1, 2, 3]}, "tip": {"position": [4, 5, 6]}}
    mapping = {"time": 0, "header": True, "length_unit": "mm", "stations": places,
               "pressure": {"columns": [7, 8], "unit": "kPa", "chamber": ["1.1", "1.2"]}}  # fmt: skip
    draft = draft_study([path], tmp_path / "s.toml", mapping=mapping, length=0.12, mass=0.05)
    (tmp_path / "s.toml").write_text(draft.text)
    study = load_study(tmp_path / "s.toml")
    assert [c.name for c in study.actuator.chambers] == ["1_1", "1_2"]
    assert study.recordings["a"].drive == {"1_1": "1.1", "1_2": "1.2"}
