"""Files of laboratories in habits that were once misread, crashed or were refused without a way out."""

from __future__ import annotations

import struct
import tomllib

import h5py
import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from small_study import TIMES, table

from pliant.errors import InputError
from pliant.recording import make_recording, read
from pliant.study.aligned import with_log
from pliant.study.column_guess import guessed_table
from pliant.study.draft import draft_study
from pliant.study.first_reading import read_or_guess, with_logs

DATA = table(90.0)
KPA, BASE, TIP = DATA[:, 1], DATA[:, 2:5], DATA[:, 5:8]  # m
PLACES = [f"{station}_{axis}" for station in ("base", "tip") for axis in "xyz"]
TURN = Rotation.from_rotvec(np.outer(KPA / 90.0, [0.3, 0.1, 0.0])).as_quat()  # x, y, z, w
STEPS = [1.0, 0.0, 0.5, 1.0, 0.3]


def written(path, names, *columns, delimiter=",", above=()):
    rows = [delimiter.join(f"{v:.9g}" for v in row) for row in np.column_stack(columns)]
    path.write_text("\n".join([*above, delimiter.join(names), *rows, ""]), encoding="utf-8")
    return path


def drafted(*paths, **options):
    draft = draft_study(paths, paths[0].with_name("s.toml"), length=0.12, mass=0.05, **options)
    return draft, tomllib.loads(draft.text)


def test_whole_seconds_and_their_fraction_under_one_name(tmp_path):
    total = np.round(1e6 * (1.7e9 + 0.4 + TIMES))
    parts = [total // 1e6, total % 1e6]
    path = tmp_path / "a.txt"
    rows = [" ".join([f"{s:.0f} {u:.0f}", *(f"{v:.6f}" for v in x)]) for s, u, x in zip(*parts, TIP, strict=True)]
    path.write_text("\n".join(["stamp_s", *rows]).replace("stamp_s", "Timestamp_s Timestamp_us X Y Z", 1) + "\n")
    ds = read_or_guess(path, None).recording
    np.testing.assert_allclose(np.diff(ds["time"]), np.diff(TIMES), atol=2e-6)
    np.testing.assert_allclose(ds["position"].values[:, 0], TIP, atol=1e-6)
    same = written(tmp_path / "b.csv", ["t_s", "t_us", *PLACES], TIMES, 1e6 * TIMES, BASE, TIP)
    assert guessed_table(same).mapping["time"] == "t_s"  # the whole time twice
    other = written(tmp_path / "c.csv", ["t", "timestamp_s", "timestamp_us", *PLACES], TIMES,
                    5.0 + 2.0 * TIMES // 1, np.round(1e6 * (2.0 * TIMES % 1)), BASE, TIP)  # fmt: skip
    assert guessed_table(other).mapping["time"] == "t"


def test_points_of_sleap_in_text_are_pixels_with_y_downwards(tmp_path):
    pixels = 1e3 * np.column_stack([BASE[:, :2], TIP[:, :2]])
    score = np.full(len(KPA), 0.9)
    names = ["frame_idx", "instance.score", "base.x", "base.y", "tip.x", "tip.y", "base.score", "tip.score"]
    reading = read_or_guess(written(tmp_path / "a.csv", names, np.arange(len(KPA)), score, pixels, score, score), None)
    assert reading.guess is not None
    assert reading.guess.mapping["camera"] == {"pixels_per_mm": "?"}
    assert "length_unit" not in reading.guess.mapping
    moved = np.diff(reading.recording["position"].values[:, 1, 1])
    np.testing.assert_allclose(moved, -1e-3 * np.diff(pixels[:, 3]), atol=1e-9)


@pytest.mark.parametrize("ending", ["_mm", " [mm]"])
def test_a_unit_in_the_names_of_points_of_sleap_takes_precedence(tmp_path, ending):
    names = ["frame_idx", "instance.score", *(f"{s}.{axis}{ending}" for s in ("base", "tip") for axis in "xy")]
    columns = 1e3 * np.column_stack([BASE[:, :2], TIP[:, :2]])
    path = written(tmp_path / "a.csv", names, np.arange(len(KPA)), np.full(len(KPA), 0.9), columns)
    ds = read_or_guess(path, None).recording
    np.testing.assert_allclose(ds["position"].values[:, 1, :2], TIP[:, :2], atol=1e-8)


@pytest.mark.parametrize("above", [["Protocol of the arm;;;;;;;", "Operator;Ann;;;;;;", ";;;;;;;"], ["Arm 3;;;;;;;"]])
def test_titles_that_a_spreadsheet_filled_up_are_no_names(tmp_path, above):
    names = ["time [s]", *(f"{name} [m]" for name in PLACES), "p [kPa]"]
    plain, titled = (read(written(tmp_path / f"{k}.csv", names, TIMES, BASE, TIP, KPA, delimiter=";", above=lines))
                     for k, lines in enumerate(([], above)))  # fmt: skip
    for variable in ("time", "position", "pressure"):
        np.testing.assert_array_equal(plain[variable], titled[variable])
    assert titled["station"].values.tolist() == ["base", "tip"]


def test_a_row_of_bodies_above_coordinates_is_no_title(tmp_path):
    path = written(tmp_path / "a.csv", ["t", *"xyzxyz", "p [kPa]"], TIMES, BASE, TIP, KPA,
                   above=[",base,,,tip,,,"])  # fmt: skip
    assert read(path)["station"].values.tolist() == ["base", "tip"]


def test_quaternions_q0_to_q3_of_a_sensor_have_the_scalar_first(tmp_path):
    names = ["t", "Quat_q0", "Quat_q1", "Quat_q2", "Quat_q3"]
    shown = read_or_guess(written(tmp_path / "a.csv", names, TIMES, TURN[:, [3, 0, 1, 2]]), None).recording
    plain = ["t", "qx", "qy", "qz", "qw"]
    known = read_or_guess(written(tmp_path / "b.csv", plain, TIMES, TURN), None).recording
    np.testing.assert_allclose(shown["angle"], known["angle"], atol=1e-7)
    with pytest.raises(InputError):  # angles of joints
        read_or_guess(written(tmp_path / "c.csv", ["t", "q0", "q1", "q2", "q3"], TIMES, 2.0 + TURN), None)


@pytest.mark.parametrize(("sensor", "more"), [
    ("ax ay az", "gx gy gz A0"), ("gx gy gz", "A0 A1"), ("ax ay az", "a0"), ("gx gy gz", "a A0"),
    ("qw qx qy qz", "q1 q2"),
])  # fmt: skip
def test_numbered_columns_beside_a_sensor_do_not_join_it(tmp_path, sensor, more):
    axes, others = sensor.split(), more.split()
    values = TURN[:, [3, 0, 1, 2]] if len(axes) > 3 else Rotation.from_quat(TURN).apply([0.0, 0.0, 9.81])
    beside = np.outer(KPA, 1.0 + np.arange(len(others)))
    alone, among = (read_or_guess(written(tmp_path / f"{k}.csv", ["t", *axes, *names], TIMES, values, *columns), None)
                    for k, (names, columns) in enumerate((([], []), (others, [beside]))))  # fmt: skip
    np.testing.assert_array_equal(among.recording["angle"], alone.recording["angle"])


@pytest.mark.parametrize("name", ["adc0", "Dev1/ai1 (V)", "adc_3"])
def test_readings_of_a_converter_ask_for_their_scale_where_no_other_input_is(tmp_path, name):
    counts = np.rint(100.0 + 8.0 * KPA)
    alone = written(tmp_path / "a.csv", ["t", *PLACES, name], TIMES, BASE, TIP, counts)
    assert guessed_table(alone).mapping["pressure"] == {"columns": [name], "unit": "kPa", "scale": "?", "zero": "?"}
    beside = written(tmp_path / "b.csv", ["t", *PLACES, name, "p_kPa"], TIMES, BASE, TIP, counts, KPA)
    assert guessed_table(beside).mapping["pressure"]["columns"] == ["p_kPa"]


@pytest.mark.parametrize("beside", ["p", "pwm", "dxl_1_position"])
def test_readings_of_a_converter_are_no_input_beside_another_or_where_they_are_noise(tmp_path, beside, rng):
    names, moves = ["t", *PLACES, "adc0"], np.rint(100.0 + 8.0 * KPA)
    path = written(tmp_path / "a.csv", [*names, beside], TIMES, BASE, TIP, moves, np.rint(5.0 * KPA))
    assert "adc0" not in str(guessed_table(path).mapping)
    path = written(tmp_path / "b.csv", names, TIMES, BASE, TIP, 100.0 + rng.integers(0, 3, len(KPA)))
    assert "pressure" not in guessed_table(path).mapping


def test_present_positions_of_servos_are_steps_and_their_goals_are_left_out(tmp_path):
    ticks = np.rint(2048.0 + 5.0 * KPA)
    path = written(tmp_path / "a.csv", ["t", *PLACES, "goal_pos_1", "present_pos_1"], TIMES, BASE, TIP, ticks, ticks)
    assert guessed_table(path).mapping["inputs"][0]["columns"] == ["present_pos_1"]


def test_axes_before_the_letter_of_a_station(tmp_path):
    path = written(tmp_path / "a.csv", ["t", "p_kPa", "xb", "yb", "zb", "xt", "yt", "zt"], TIMES, KPA, BASE, TIP)
    np.testing.assert_allclose(read(path)["position"].values[:, 1], TIP, atol=1e-8)


def test_a_log_that_shows_no_pressure_names_its_columns_and_the_entry(tmp_path):
    path = written(tmp_path / "a.csv", ["Time", "Dev1/ai0 (V)"], TIMES, KPA)
    with pytest.raises(InputError, match=r"for sensors: pressure = \{ columns = \[.Dev1/ai0 \(V\).\], unit = .kPa"):
        read(path)


def test_a_copy_of_a_column_is_named_once(tmp_path):
    path = written(tmp_path / "a.csv", ["t", *PLACES, "p_kPa", "p_kPa"], TIMES, BASE, TIP, KPA, KPA)
    history = read(path).attrs["history"]
    assert "1 column(s) of a.csv repeat another by name and in every row" in history
    assert "unknown names" not in history
    assert "copy" not in history


def test_stations_and_tendons_whose_names_hold_dots_can_be_named(tmp_path):
    names = ["t", *(f"arm.{name.replace('_', '.')}" for name in PLACES), "cable.1 [N]", "cable_1 [N]"]
    path = written(tmp_path / "a.csv", names, TIMES, BASE, TIP, 0.1 * KPA, 0.1 * KPA[::-1])
    assert read_or_guess(path, None).recording["station"].values.tolist() == ["arm_base", "arm_tip"]
    _, study = drafted(path)
    tendons = [tendon["name"] for tendon in study["actuator"]["tendons"]]
    assert len(set(tendons)) == 2
    assert sorted(study["recordings"]["a"]["drive"]) == sorted(tendons)


@pytest.mark.parametrize(("titles", "stations"), [
    (("m.1", "m_1"), {"m.1", "m_1"}), (("base.pose", "tip.pose"), {"base", "tip"}),
    (("/mocap/base.pose.position", "/mocap/tip.pose.position"), {"mocap_base", "mocap_tip"}),
])  # fmt: skip
def test_no_station_is_lost_by_the_dots_of_its_name(tmp_path, titles, stations):
    names = [f"{title}{'_' if title.startswith('m') else '.'}{axis}" for title in titles for axis in "xyz"]
    ds = read_or_guess(written(tmp_path / "a.csv", ["t", *names, "p_kPa"], TIMES, BASE, TIP, KPA), None).recording
    assert {*ds["station"].values} == stations


def test_set_points_are_commanded(tmp_path):
    for name, signal in (("cable_cmd [N]", "commanded"), ("cable [N]", "measured"), ("cable_set [N]", "commanded"),
                         ("cable_set1 [N]", "measured")):
        path = written(tmp_path / "a.csv", ["t", *PLACES, name], TIMES, BASE, TIP, 0.1 * KPA)
        assert drafted(path)[1]["recordings"]["a"]["signal"] == signal


def test_stations_on_two_bodies_are_doubted(tmp_path):
    names = ["t", "p_kPa", *(f"arm{body}_{name}" for body in "AB" for name in PLACES)]
    path = written(tmp_path / "a.csv", names, TIMES, KPA, BASE, TIP, 0.4 + BASE, 0.4 + TIP)
    assert any("armA_base and armB_base say base" in doubt for doubt in drafted(path)[0].doubts)
    names = ["t", "p_kPa", *(f"robot{body}_{name}" for body in (1, 2) for name in PLACES)]
    path = written(tmp_path / "a.csv", names, TIMES, KPA, BASE, TIP, 0.4 + BASE, 0.4 + TIP)
    assert any("robot1_base and robot2_base say base" in doubt for doubt in drafted(path)[0].doubts)
    plates = [f"base_{k}_{axis}" for k in (1, 2) for axis in "xyz"]
    path = written(tmp_path / "a.csv", ["t", "p_kPa", *plates, *PLACES[3:]], TIMES, KPA, BASE, BASE + 0.01, TIP)
    assert not any("say base" in doubt for doubt in drafted(path)[0].doubts)


def test_settled_poses_without_a_base_name_their_stations(tmp_path):
    pulls = np.random.default_rng(0).uniform(0.0, 3.0, (60, 2))
    mid = np.column_stack([0.01 * pulls, np.full(60, 0.05)])
    tip = np.column_stack([0.03 * pulls, 0.1 - 0.002 * (pulls**2).sum(axis=1)])
    names = ["F1_N", "F2_N", *(f"{s}_{axis}_m" for s in ("mid", "tip") for axis in "xyz")]
    _, study = drafted(written(tmp_path / "a.csv", names, pulls, mid, tip))
    parts = {name.partition(".")[0] for name in study["model_selection"]["common"]} - {"damping"}
    assert study["recordings"]["a"]["poses"] is True
    assert parts <= set(study["recordings"]["a"]["stations"])


def test_a_log_of_a_film_belongs_to_the_name_with_which_it_begins(tmp_path):
    films = [written(tmp_path / f"cam{k}DLC_net50_arm1_5000.csv", ["t", *PLACES], TIMES, BASE, TIP) for k in (0, 1)]
    logs = [written(tmp_path / f"cam{k}_log.csv", ["t", "p_kPa"], TIMES, KPA) for k in (0, 1)]
    assert [pair.log for pair in with_logs([*films, *logs])] == logs


@pytest.mark.parametrize(("shapes", "log"), [
    (("arm_low", "arm_high"), "arm_log"), (("push_slow", "push_fast"), "push_sensor"),
    (("run_12", "run_20"), "run_1_p"),
])  # fmt: skip
def test_letters_within_a_word_or_a_number_join_no_log_to_a_recording(tmp_path, shapes, log):
    files = [written(tmp_path / f"{name}.csv", ["t", *PLACES], TIMES, BASE, TIP) for name in shapes]
    files.append(written(tmp_path / f"{log}.csv", ["t", "p_kPa"], TIMES, KPA))
    with pytest.raises(InputError, match=f"{log}.csv holds inputs alone"):
        with_logs(files)


@pytest.mark.parametrize("vented", [False, True])
def test_typed_steps_keep_their_last_level_to_the_end_of_a_shape_that_does_not_return(tmp_path, vented):
    """The last step of a table of typed steps is its last row: without its effect another offset fits as well."""
    time = np.arange(0.0, 5.0, 0.02)
    begins = np.array([0.0, 0.8, 1.5, 2.7, 3.2])
    level = np.array(STEPS)[np.searchsorted(begins, time, side="right") - 1]
    level[time > 4.0] *= not vented
    bent = np.zeros_like(time)
    for k in range(1, len(time)):
        bent[k] = bent[k - 1] + 0.02 / 0.05 * (level[k] - bent[k - 1])
    places = np.stack([np.zeros((len(time), 3)), np.column_stack([-0.03 * bent, 0.1 - 0.01 * bent, 0.0 * bent])], 1)
    shape = make_recording(time, places, station=["base", "tip"])
    log = written(tmp_path / "film_log.csv", ["t_s", "p_kPa"], begins, 20.0 * np.array(STEPS))
    joined, problem = with_log(shape, log, "film")
    assert ("the last row of pressure is held" in joined.attrs["history"]) != vented
    if vented:
        return
    assert not problem
    assert "the last row of pressure is held for 1.78 s more, to the end of the shape" in joined.attrs["history"]
    clock = joined["pressure_time"].values
    assert abs(clock[0]) < 0.1  # the clocks agree
    assert np.ptp(clock) == pytest.approx(np.ptp(time), rel=0.05)


def test_typed_steps_that_end_where_they_begin_are_let_off_by_their_last_row(tmp_path):
    """The shape returns after the last row: without its effect the steps fit some seconds later as well."""
    time = np.arange(0.0, 12.0, 1.0 / 30.0)
    level = np.select([time < 1.0, time < 4.0, time < 8.0], [0.0, 12.0, 24.0], 0.0)
    bent = np.zeros_like(time)
    for k in range(1, len(time)):
        bent[k] = bent[k - 1] + 0.3 * (level[k] - bent[k - 1])
    places = np.stack([np.zeros((len(time), 3)), np.column_stack([-0.003 * bent, 0.2 - 0.001 * bent, 0.0 * bent])], 1)
    shape = make_recording(time, places, station=["base", "tip"])
    log = written(tmp_path / "film_log.csv", ["t_s", "p_kPa"], np.array([0.0, 1.0, 4.0, 8.0]),
                  np.array([0.0, 12.0, 24.0, 0.0]))  # fmt: skip
    joined, problem = with_log(shape, log, "film")
    assert not problem
    assert abs(joined["pressure_time"].values[0]) < 0.15


def test_typed_steps_that_end_at_a_level_are_not_held_where_the_shape_returns(tmp_path):
    time = np.arange(0.0, 10.0, 0.02)
    bent = np.select([time < 1.0, time < 3.0, time < 5.0, time < 7.0], [0.0, 20.0, 40.0, 20.0], 0.0)
    places = np.stack([np.zeros((len(time), 3)), np.column_stack([-0.001 * bent, 0.1 - 0.0005 * bent, 0.0 * bent])], 1)
    shape = make_recording(time, places, station=["base", "tip"])
    log = written(tmp_path / "film_log.csv", ["t_s", "p_kPa"], np.array([0.0, 2.0, 4.0, 6.0]),
                  np.array([20.0, 40.0, 20.0, 20.0]))  # fmt: skip
    joined, _ = with_log(shape, log, "film")
    assert "is held" not in joined.attrs["history"]


ARRAYS = {"time": "mocap.time", "position": {"base": "mocap.base", "tip": "mocap.tip"}, "pressure": "daq.pressure"}


def stored(path, tip="mm"):
    arrays = [("mocap/base", 1e3 * BASE, "mm"), ("mocap/tip", 1e3 * TIP, tip), ("mocap/time", 1e3 * TIMES, "ms"),
              ("daq/pressure", KPA / 100.0, "bar"), ("daq/time_ms", 1e3 * TIMES, "ms"), ("daq/pull", KPA, "cm")]
    with h5py.File(path, "w") as file:
        for name, values, unit in arrays:
            file.create_dataset(name, data=values).attrs["unit"] = unit
    return path


@pytest.mark.parametrize("clock", ["mocap.time", "daq.time_ms"])
def test_arrays_of_an_hdf5_file_are_read_by_name_and_unit(tmp_path, clock):
    ds = read(stored(tmp_path / "a.h5"), mapping={**ARRAYS, "time": clock})
    np.testing.assert_allclose(ds["time"], TIMES, atol=1e-12)
    np.testing.assert_allclose(ds["position"].values, np.stack([BASE, TIP], axis=1), atol=1e-12)
    np.testing.assert_allclose(ds["pressure"], 1e3 * KPA, atol=1e-6)


def test_an_hdf5_file_lists_its_arrays_and_refuses_positions_in_several_units(tmp_path):
    path = stored(tmp_path / "a.h5", tip="cm")
    with pytest.raises(InputError, match=r"name them in the mapping. Its arrays are: .*mocap\.tip \(160, 3\)"):
        read(path)
    with pytest.raises(InputError, match=r"arrays of position in a.h5 state several units \(cm, mm\)"):
        read(path, mapping=ARRAYS)


def attributed(path, changed):
    """An HDF5 file in metres, seconds and kPa, but some arrays with other values and attributes."""
    with h5py.File(path, "w") as file:
        for name, values, unit in (("time", TIMES, "s"), ("base", BASE, "m"), ("tip", TIP, "m"), ("p", KPA, "kPa")):
            other = changed.get(name, (values, {"units": unit}))
            file.create_dataset(name, data=other[0]).attrs.update(other[1])
    return path


PLAIN = {"position": {"base": "base", "tip": "tip"}, "pressure": "p"}


@pytest.mark.parametrize("changed", [
    {"time": (1e3 * TIMES, {"units": "milliseconds since 2024-01-01"})},
    {"time": (1e3 * TIMES, {"units": "[ms]"}), "base": (1e3 * BASE, {"units": "(mm)"}),
     "tip": (1e3 * TIP, {"units": "[mm]"})},
    {"tip": (np.rint((TIP - 0.5) / 1e-9).astype("i8"), {"units": "m", "scale_factor": 1e-9, "add_offset": 0.5})},
], ids=["since", "brackets", "packed"])  # fmt: skip
def test_attributes_of_an_hdf5_file_state_units_and_packing(tmp_path, changed):
    ds = read(attributed(tmp_path / "a.h5", changed), mapping=PLAIN)
    np.testing.assert_allclose(ds["time"], TIMES, atol=1e-12)
    np.testing.assert_allclose(ds["position"].values, np.stack([BASE, TIP], axis=1), atol=1e-9)


def test_fill_values_of_an_hdf5_file_are_gaps(tmp_path):
    tip = TIP.copy()
    tip[5] = -9999.0
    ds = read(attributed(tmp_path / "a.h5", {"tip": (tip, {"units": "m", "_FillValue": -9999.0})}), mapping=PLAIN)
    assert np.flatnonzero(np.isnan(ds["position"].values[:, 1]).all(axis=1)).tolist() == [5]
    assert "tip is stored value * 1 + 0, with 3 gap(s)" in ds.attrs["history"]


@pytest.mark.parametrize(("changed", "words"), [
    ({"base": (BASE, {})}, "arrays of position in a.h5, base state no unit, others m: state length_unit"),
    ({"tip": (TIP, {"units": "furlong"})}, "the array tip of a.h5 has the unit 'furlong', which is none of m, "),
    ({"time": (TIMES, {"units": "ticks"})}, "the array time of a.h5 has the unit 'ticks', which is none of s, "),
    ({"p": (KPA, {"units": "counts"})}, "the array p of a.h5 has the unit 'counts', .* state pressure_unit"),
    ({"tip": (TIP, {"units": "m", "valid_max": 1.0})}, "the array tip of a.h5 has the attribute valid_max"),
])  # fmt: skip
def test_units_that_an_hdf5_file_does_not_state_clearly_are_refused(tmp_path, changed, words):
    path = attributed(tmp_path / "a.h5", changed)
    with pytest.raises(InputError, match=words):
        read(path, mapping=PLAIN)


def test_a_unit_in_the_mapping_takes_precedence_over_attributes(tmp_path):
    path = attributed(tmp_path / "a.h5", {"tip": (TIP, {"units": "furlong"})})
    ds = read(path, mapping={**PLAIN, "length_unit": "m"})
    np.testing.assert_allclose(ds["position"].values[:, 1], TIP, atol=1e-12)


def test_columns_of_one_table_in_an_hdf5_file(tmp_path):
    names = ["time", "p_kpa", *PLACES]
    rows = np.rec.fromarrays([TIMES, KPA, *BASE.T, *TIP.T], names=names)
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["log"] = rows
    places = {s: [f"{s}_{axis}" for axis in "xyz"] for s in ("base", "tip")}
    ds = read(tmp_path / "a.h5", mapping={"position": places})
    np.testing.assert_allclose(ds["position"].values[:, 1], TIP)
    np.testing.assert_allclose(ds["pressure"], 1e3 * KPA)


def test_poses_of_seven_numbers_and_nanoseconds_in_npz(tmp_path):
    stamps = np.round(1e9 * (1.7e9 + TIMES)).astype(np.int64)
    np.savez(tmp_path / "a.npz", stamps_ns=stamps, stamps=stamps, tip_pose=np.column_stack([TIP, TURN]), p_kpa=KPA)
    for clock in ("stamps_ns", "stamps"):
        ds = read(tmp_path / "a.npz", mapping={"time": clock, "position": {"tip": "tip_pose"}})
        np.testing.assert_allclose(np.diff(ds["time"]), np.diff(TIMES), atol=1e-6)
        np.testing.assert_allclose(ds["position"].values[:, 0], TIP)
        assert "orientations of tip in a.npz were left out" in ds.attrs["history"]
    np.savez(tmp_path / "b.npz", t=TIMES, tip_pose=np.column_stack([TURN, TIP]), p_kpa=KPA)
    with pytest.raises(InputError, match="array of station tip has 7 columns, whose last four are not quaternions"):
        read(tmp_path / "b.npz", mapping={"position": {"tip": "tip_pose"}})
    np.savez(tmp_path / "c.npz", t=TIMES[:7], tip=TIP[:7].T, p_kpa=KPA[:7])  # seven frames
    ds = read(tmp_path / "c.npz", mapping={"position": {"tip": "tip"}})
    np.testing.assert_allclose(ds["position"].values[:, 0], TIP[:7])


def element(kind, content):
    """An element of a MATLAB file of version 5."""
    return struct.pack("<II", kind, len(content)) + content + bytes(-len(content) % 8)


@pytest.mark.parametrize("kind", ["table", "timetable"])
@pytest.mark.parametrize("version", ["7", "7.3"])
def test_objects_of_matlab_are_named_with_the_way_out(tmp_path, kind, version):
    path, numbers = tmp_path / "a.mat", np.array([[0xDD000000, 2, 1, 1, 1, 1]], np.uint32)
    if version == "7":
        array = [element(6, struct.pack("<II", 13, 0)), element(5, struct.pack("<ii", 6, 1)), element(1, b""),
                 element(6, numbers.tobytes())]  # fmt: skip
        opaque = [element(6, struct.pack("<II", 17, 0)), element(1, b"T"), element(1, b"MCOS"),
                  element(1, kind.encode()), element(14, b"".join(array))]  # fmt: skip
        head = b"MATLAB 5.0 MAT-file".ljust(124) + struct.pack("<H", 0x0100) + b"IM"
        path.write_bytes(head + element(14, b"".join(opaque)))
    else:
        with h5py.File(path, "w", userblock_size=512) as file:
            stored = file.create_dataset("T", data=numbers)
            stored.attrs["MATLAB_class"], stored.attrs["MATLAB_object_decode"] = np.bytes_(kind), np.int32(3)
        with path.open("r+b") as file:
            file.write(b"MATLAB 7.3 MAT-file")
    with pytest.raises(InputError, match=rf"holds T \({kind}\) and no array of numbers: of a table T save the columns"):
        read(path)
