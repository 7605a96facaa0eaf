"""Habits of tables that would be read as something else: another quantity, body, unit or order."""

from __future__ import annotations

import tomllib

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from small_study import TIMES, table

from pliant.errors import InputError
from pliant.recording import read
from pliant.study.column_guess import guessed_table
from pliant.study.draft import draft_study
from pliant.study.inspected import like_another

DATA = table(90.0)
KPA, BASE, TIP = DATA[:, 1], 1e3 * DATA[:, 2:5], 1e3 * DATA[:, 5:8]  # mm
AXES = [f"{station}_{axis}_mm" for station in ("base", "tip") for axis in "xyz"]


def written(path, names, *columns, delimiter=","):
    rows = [delimiter.join(f"{v:.9g}" for v in row) for row in np.column_stack(columns)]
    head = [delimiter.join(names)] if names else []
    path.write_text("\n".join([*head, *rows, ""]), encoding="utf-8")
    return path


def drafted(path):
    return draft_study([path], path.with_name("s.toml"), length=0.12, mass=0.05)


def test_a_desired_pressure_is_no_chamber(tmp_path):
    path = written(tmp_path / "a.csv", ["t", *AXES, "p_des_kPa", "p_kPa"], TIMES, BASE, TIP, 1.1 * KPA, KPA)
    ds = read(path)
    assert ds["pressure"].ndim == 1
    np.testing.assert_allclose(ds["pressure"], 1e3 * KPA, rtol=1e-6)
    assert "left out: p_des_kPa" in ds.attrs["history"]


@pytest.mark.parametrize(("name", "values", "unit", "asked"), [
    ("chamber_psia", 14.696 + KPA / 6.894757, "psi", "zero"),
    ("/chamber_kpa/data", KPA, "kpa", ""),
    ("p", KPA, "?", "unit"),
])  # fmt: skip
def test_the_unit_of_a_pressure_is_in_its_name_or_asked(tmp_path, name, values, unit, asked):
    path = written(tmp_path / "a.csv", ["t", *AXES, name], TIMES, BASE, TIP, values)
    guess = guessed_table(path)
    assert guess.mapping["pressure"]["columns"] == [name]
    assert guess.mapping["pressure"]["unit"] == unit
    assert guess.questions.get("pressure", "").startswith(asked)
    assert bool(asked) == ("pressure" in guess.questions)


def test_p_beside_q_and_r_is_a_rate_of_turning(tmp_path):
    path = written(tmp_path / "a.csv", ["t", *AXES, "p", "q", "r"], TIMES, BASE, TIP, KPA, KPA, KPA)
    assert "pressure" not in guessed_table(path).mapping


def test_seconds_and_their_fraction_need_no_header(tmp_path):
    """The fraction repeats in each second; it numbers no bodies."""
    seconds = 1_760_000_000.3 + TIMES
    whole, turn = np.floor(seconds + 1e-7), Rotation.from_rotvec(np.outer(0.01 * KPA, [0.0, 0.0, 1.0])).as_quat()
    path = tmp_path / "a.txt"
    path.write_text("\n".join(
        f"{s:.0f} {round(1e6 * f):06d} 0 " + " ".join(f"{v:.6f}" for v in (*p, *q))
        for s, f, p, q in zip(whole, seconds - whole, 1e-3 * TIP, turn, strict=True)) + "\n")  # fmt: skip
    guess = guessed_table(path)
    assert (guess.mapping["time"], guess.mapping["time_unit"]) == ([0, 1], "us")
    assert guess.mapping["stations"]["p1"]["position"] == [3, 4, 5]
    np.testing.assert_allclose(np.diff(read(path, mapping=guess.neutral)["time"]), np.diff(TIMES), atol=2e-6)


def test_a_base_in_the_last_columns_comes_first(tmp_path):
    middle = BASE + 0.5 * (TIP - BASE)
    names = [f"m{k}_{axis}_mm" for k in (1, 2, 3) for axis in "xyz"]
    draft = drafted(written(tmp_path / "a.csv", ["t", *names, "p_kPa"], TIMES, TIP, middle, BASE, KPA))
    trial = draft.inspected.first
    assert (trial.base, trial.names, trial.problem) == ("m3", ["m3", "m2", "m1"], "")
    np.testing.assert_allclose(trial.peak_motion, np.nanmax(np.linalg.norm(TIP - TIP[0], axis=1)) / 1e3, rtol=0.2)
    assert draft.questions == ()


def test_a_plate_that_stands_still_is_the_base(tmp_path):
    plate = np.array([[20.0, 0.0, 0.0], [-10.0, 17.0, 0.0], [-10.0, -17.0, 0.0]])
    markers = [BASE + offset for offset in plate] + [TIP + 0.5 * offset for offset in plate]
    names = [f"{name}_{axis}_mm" for name in ("b4", "b5", "b6", "t1", "t2", "t3") for axis in "xyz"]
    draft = drafted(written(tmp_path / "a.csv", ["t", *names, "p_kPa"], TIMES, *markers, KPA))
    assert draft.inspected.first.base == "b"
    assert draft.questions == ()


def test_many_markers_are_ordered_by_their_distances():
    """Ten markers along a helix that bends further: the order is found, and is sure only if the markers differ."""
    s = np.linspace(0.0, 0.4, 10)

    def helix(k):
        return np.stack([(1 - np.cos(k * s)) / k, np.sin(k * s) / k, 0.1 * s**2], axis=1)

    first, shuffled = helix(2.0), np.random.default_rng(3).permutation(10)
    order, sure = like_another(helix(4.0)[shuffled], first)
    assert [int(shuffled[k]) for k in order] == [*range(10)]
    assert sure
    pair = first.copy()
    pair[6] = pair[5] + [0.0, 0.0, 1e-4]
    noisy = pair + 1e-4 * np.random.default_rng(4).standard_normal(pair.shape)
    assert not like_another(noisy[shuffled], pair)[1]


@pytest.mark.parametrize(("name", "remedy"), [
    ("a.xlsx", "save its sheet as CSV"), ("a.npy", r"numpy\.savez"), ("a.bag", "rosbags-convert"),
    ("a.jsonl", "one row for each time"),
])  # fmt: skip
def test_files_of_other_programs_are_refused_with_the_way_out(tmp_path, name, remedy):
    (tmp_path / name).write_bytes(b"PK\x03\x04 something else")
    with pytest.raises(InputError, match=remedy):
        read(tmp_path / name)


def test_a_log_without_a_unit_names_its_column(tmp_path):
    path = written(tmp_path / "log.csv", ["t", "chamber pressure"], TIMES, KPA)
    with pytest.raises(InputError, match="state pressure_unit in its mapping for 'chamber pressure'"):
        read(path)


@pytest.mark.parametrize(("step", "links"), [(0.0, 3), (2.0, None)])
def test_one_fine_angle_takes_alike_joints(tmp_path, step, links):
    angle = 0.5 * np.cumsum(KPA - KPA.mean()) / 90.0 + 0.01 * np.random.default_rng(2).standard_normal(len(KPA))
    if step:
        angle = step * np.round(angle / step)
    text = drafted(written(tmp_path / "a.csv", ["t", "angle_deg", "p_kPa"], TIMES, angle, KPA)).text
    content = tomllib.loads(text)
    assert content["actuator"].get("links") == links
    assert content["model_selection"].get("without") == (["joints"] if links else None)


def test_left_handed_axes_are_refused_for_angles(tmp_path):
    path = written(tmp_path / "a.csv", ["t", "angle", "p_kPa"], TIMES, KPA, KPA)
    with pytest.raises(InputError, match="left_handed is for positions"):
        read(path, mapping={"time": "t", "angles": {"tip": "angle"}, "angle_unit": "deg", "left_handed": True})


@pytest.mark.parametrize(("name", "newton"), [
    ("tendon load (g)", 9.80665e-3), ("tendon_load_g", 9.80665e-3), ("load_kg", 9.80665), ("tendon load (N)", 1.0),
    ("tendon load (lb)", 4.4482216),
])  # fmt: skip
def test_load_cells_in_units_of_weight_become_newtons(tmp_path, name, newton):
    path = written(tmp_path / "a.csv", ["t", *AXES, name], TIMES, BASE, TIP, KPA)
    guess = guessed_table(path)
    pulled = read(path, mapping=guess.neutral)["actuation"].values[:, 0]
    np.testing.assert_allclose(pulled, newton * KPA, rtol=1e-6)


def test_an_input_in_the_unit_of_another_quantity_is_not_used(tmp_path):
    path = written(tmp_path / "a.csv", ["t", *AXES, "tendon [Ohm]"], TIMES, BASE, TIP, 1.013 * KPA)
    guess = guessed_table(path)
    assert "inputs" not in guess.mapping
    assert any("not used: tendon [Ohm]" in note for note in guess.notes)


@pytest.mark.parametrize("begin", [0, 2048])
def test_a_servo_that_begins_far_from_zero_is_told(tmp_path, begin):
    path = written(tmp_path / "a.csv", ["t", *AXES, "dxl1_present_position"], TIMES, BASE, TIP, begin + np.round(KPA))
    guess = guessed_table(path)
    assert [(e["kind"], "zero" in e) for e in guess.mapping["inputs"]] == [("displacement", False)]
    assert any("if nothing pulls then, add zero" in note for note in guess.notes) == bool(begin)


@pytest.mark.parametrize("axes", ["xy", "yx"])
def test_components_of_curvature_are_recognised(tmp_path, axes):
    """An even bend of 0.1 m with 3 and 4 1/m reaches as far across as a circle of 5 1/m."""
    arcs = [f"{s:g} mm" for s in range(0, 101, 20)]
    names = ["t", *(f"K{axis} {s} (1/m)" for axis in axes for s in arcs), "p_kPa"]
    flat = np.ones((len(TIMES), len(arcs)))
    path = written(tmp_path / "a.txt", names, TIMES, *((3.0 if axis == "x" else 4.0) * flat for axis in axes), KPA,
                   delimiter="\t")
    guess = guessed_table(path)
    assert guess.mapping["components"] == ["Kx ", "Ky "]
    tip = drafted(path).inspected.first.recording["position"].values[0, -1]
    assert np.hypot(tip[0], tip[2]) == pytest.approx((1 - np.cos(0.5)) / 5.0, rel=1e-3)


def test_a_shape_from_tip_to_base_is_turned_round(tmp_path):
    share = np.linspace(1.0, 0.0, 13)
    places = [BASE + s * (TIP - BASE) for s in share]
    names = [f"{axis}{k}" for k in range(1, 14) for axis in "xyz"]
    draft = drafted(written(tmp_path / "a.csv", ["t", *names, "p [kPa]"], TIMES, *places, KPA))
    assert draft.inspected.first.base == "p13"


@pytest.mark.parametrize(("name", "entry"), [("valve pwm", {"unit": "kPa", "scale": "?"})])
def test_a_duty_asks_for_its_scale(tmp_path, name, entry):
    path = written(tmp_path / "a.csv", ["t", *AXES, name], TIMES, BASE, TIP, np.round(2.0 * KPA))
    assert guessed_table(path).mapping["pressure"] == {"columns": [name], **entry}


def test_names_of_bend_sensors_and_of_milliseconds(tmp_path):
    bent = read(written(tmp_path / "a.csv", ["time_ms", "bend_deg", "pressure_kPa"], 1e3 * TIMES, KPA, KPA))
    np.testing.assert_allclose(bent["angle"].values[:, 0], np.radians(KPA), rtol=1e-6)
    log = read(written(tmp_path / "log.csv", ["ms", "kPa"], 1e3 * TIMES, KPA))
    np.testing.assert_allclose(np.diff(log["pressure_time"]), np.diff(TIMES), atol=1e-9)
    np.testing.assert_allclose(log["pressure"], 1e3 * KPA)


@pytest.mark.parametrize(("others", "angles"), [
    (["angle_deg", "bend"], True), (["angle_deg", "bend_radius_mm"], True), (["angle_deg", "bend_deg"], True),
    (["bend"], False), (["bend_V"], False),
])  # fmt: skip
def test_a_bend_without_its_unit_or_beside_an_angle_is_none(tmp_path, others, angles):
    columns = [KPA, 50.0 + KPA][: len(others)]
    ds = read(written(tmp_path / "a.csv", ["t", *others, "p_kPa"], TIMES, *columns, KPA))
    assert "pressure" in ds
    assert ("angle" in ds) == angles
    if angles:
        np.testing.assert_allclose(ds["angle"].values, np.radians(KPA)[:, None], rtol=1e-6)


def test_the_milliseconds_of_a_second_are_no_clock(tmp_path):
    second = np.floor(TIMES + 1e-9)
    path = written(tmp_path / "a.csv", ["sec", "ms", *AXES, "p_kPa"], second, 1e3 * (TIMES - second), BASE, TIP, KPA)
    guess = guessed_table(path)
    assert "time" not in guess.mapping
    assert "rate_hz" in guess.questions
