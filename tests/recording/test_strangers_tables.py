"""Tables in the habits of different laboratories: what a mapping states in one line, and what needs no mapping."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from command_line import invoke
from scipy.spatial.transform import Rotation

from pliant.errors import InputError
from pliant.recording import read
from pliant.recording.apart_bag import inertial
from pliant.recording.apart_mat5 import Variables
from pliant.recording.bag import last_parts
from pliant.recording.inclination import turning_angles
from pliant.recording.mapping import joined_mappings, options_of, refuse_idle
from pliant.recording.mat import fields_of, in_round_brackets, trials_of
from pliant.study.first_reading import shape_of, with_logs

TIP = {"rate_hz": 10, "length_unit": "mm", "stations": {"tip": {"position": ["x", "y", "z"]}}}


def write(path: Path, text: str) -> Path:
    path.write_text(text, encoding="utf-8")
    return path


def history(recording) -> str:
    return recording.attrs["history"]


def test_each_file_takes_the_options_of_the_longest_name_that_fits(tmp_path):
    mapping = {"delimiter": ";", "files": {"track": {"length_unit": "mm"}, "track_3": {"rows": [0, 5]},
                                           "*.tdms": {"pressure": ["ai0"]}}}  # fmt: skip
    assert options_of(Path("track_1.csv"), mapping) == {"delimiter": ";", "length_unit": "mm"}
    assert options_of(Path("track_3.csv"), mapping) == {"delimiter": ";", "rows": [0, 5]}
    assert options_of(Path("a.tdms"), mapping) == {"delimiter": ";", "pressure": ["ai0"]}
    assert options_of(Path("other.csv"), mapping) == {"delimiter": ";"}
    joined = joined_mappings([("", {"rate_hz": 1}), ("log", {"time": 0})])
    assert options_of(Path("a_log.csv"), joined) == {"time": 0}
    assert options_of(Path("a.csv"), joined) == {"rate_hz": 1}
    for wrong in ({"files": 3}, {"files": {"a": 3}}):
        with pytest.raises(InputError, match="must hold a table for each kind"):
            options_of(Path("a.csv"), wrong)
    with pytest.raises(InputError, match=r"for files named 'lgo', but no file is: a.csv"):
        refuse_idle({"files": {"lgo": {}}}, [Path("a.csv")])
    with pytest.raises(InputError, match=r"several mappings have no name: .* --mapping track=track.toml"):
        joined_mappings([("", {}), ("", {})])


def test_the_command_line_takes_a_mapping_for_each_kind_of_file(tmp_path):
    track = write(tmp_path / "track_1.csv", "10,20,30\n11,21,31\n12,22,32\n")
    log = write(tmp_path / "log_1.csv", "0;512\n0.1;612\n")
    write(tmp_path / "track.toml", 'rate_hz = 10\nlength_unit = "mm"\nstations = { tip = { position = [0, 1, 2] } }\n')
    write(tmp_path / "log.toml", 'time = 0\npressure = { columns = [1], unit = "kPa", scale = 0.5, zero = 512 }\n')
    options = ["--mapping", f"track={tmp_path / 'track.toml'}", "--mapping", f"log={tmp_path / 'log.toml'}"]
    assert "3 frames of 1 station(s)" in invoke("inspect", track, *options).output
    done = invoke("inspect", log, *options)
    assert "pressure p: 0 to 50 kPa" in done.output
    assert "1: value = (stored value - 512.0) * 0.5 kPa" in done.output
    done = invoke("inspect", log, "--mapping", options[1], "--mapping", options[1])
    assert "two mappings are for files named 'track'" in str(done.exception)


@pytest.mark.parametrize(("log", "shapes", "expected"), [
    ("push_3_log.csv", ["push_3.csv", "push_1.csv"], "push_3.csv"),
    ("pressure_2.tdms", ["mocap_1.csv", "mocap_2.csv"], "mocap_2.csv"),
    ("daq.lvm", ["mocap.csv"], "mocap.csv"),
    ("daq.lvm", ["mocap_1.csv", "mocap_2.csv"], None),
])  # fmt: skip
def test_a_log_finds_its_recording_by_words_and_numbers(log, shapes, expected):
    found = shape_of(Path(log), [Path(name) for name in shapes])
    assert (found and found.name) == expected


def test_marks_of_missing_values_are_gaps_and_counted(tmp_path):
    path = write(tmp_path / "a.csv", "x,y,z\n1,2,3\nMISSING,MISSING,MISSING\n-9999.0,5,6\n7,8,9\n")
    with pytest.raises(InputError, match=r'cell 1 .*: \'MISSING\'; .*state na = \["MISSING"\] in the mapping'):
        read(path, mapping=TIP)
    recording = read(path, mapping=TIP | {"na": ["MISSING", -9999]})
    assert np.isnan(recording["position"].values[1:3, 0]).any(axis=1).all()
    assert "4 cell(s) of a.csv hold MISSING, -9999" in history(recording)
    wide = write(tmp_path / "b.csv", "t,x_tip,y_tip,z_tip\n0,1,2,3\n1,lost,lost,lost\n2,1,2,3\n")
    assert np.isnan(read(wide, mapping={"na": ["lost"]})["position"].values[1]).all()


def test_a_status_word_makes_a_gap_of_its_station_alone(tmp_path):
    path = write(tmp_path / "a.csv", "state,x,y,z,u,v,w\nOK,1,2,3,4,5,6\nMISSING,0,0,1,4,5,6\nOK,1,2,3,4,5,7\n")
    stations = {"base": {"position": ["u", "v", "w"]}, "tip": {"position": ["x", "y", "z"], "status": "state"}}
    recording = read(path, mapping=TIP | {"stations": stations})
    assert np.argwhere(np.isnan(recording["position"].values).any(axis=2)).tolist() == [[1, 1]]
    assert "1 frame(s) of tip are gaps by their status: MISSING" in history(recording)
    stations["tip"]["valid"] = ["good"]
    with pytest.raises(InputError, match="no row has good in the status of tip, which holds MISSING, OK: correct"):
        read(path, mapping=TIP | {"stations": stations})


def test_a_trial_is_selected_by_a_word_and_all_trials_are_found(tmp_path):
    path = write(tmp_path / "a.csv", "who,x,y,z\nslow,1,2,3\nfast,4,5,6\nslow,7,8,9\n")
    assert read(path, mapping=TIP | {"select": {"column": "who", "value": "slow"}}).sizes["time"] == 2
    open_select = TIP | {"select": {"column": "who"}}
    assert [m["select"]["value"] for m in trials_of(path, open_select).values()] == ["slow", "fast"]
    with pytest.raises(InputError, match=r"select .* has no value: .*`pliant new` makes a recording of each"):
        read(path, mapping=open_select)
    with pytest.raises(InputError, match=r"no row of a.csv has none in column 'who': .* holds fast, slow"):
        read(path, mapping=TIP | {"select": {"column": "who", "value": "none"}})


def test_euler_angles_need_their_order(tmp_path):
    path = write(tmp_path / "a.csv", "x,y,z,yaw,pitch,roll\n1,2,3,90,0,0\n1,2,4,30,20,10\n1,2,5,,,\n")
    euler = {"columns": ["yaw", "pitch", "roll"], "order": "ZYX", "unit": "deg"}
    recording = read(path, mapping=TIP | {"stations": {"tip": {"position": ["x", "y", "z"], "euler": euler}}})
    expected = Rotation.from_euler("ZYX", [30, 20, 10], degrees=True).as_quat()
    np.testing.assert_allclose(recording["quaternion"].values[1, 0], expected)
    assert np.isnan(recording["quaternion"].values[2]).all()
    assert np.isfinite(recording["position"].values[2]).all()
    for change, message in (({"order": "ZZX"}, "turns twice about one axis"), ({"order": "ZyX"}, "order"),
                            ({"unit": "turns"}, "unit"), ({"columns": ["yaw"]}, "columns")):  # fmt: skip
        stations = {"tip": {"position": ["x", "y", "z"], "euler": euler | change}}
        with pytest.raises(InputError, match=message):
            read(path, mapping=TIP | {"stations": stations})


def test_counts_have_a_zero_and_a_scale_for_each_column(tmp_path):
    path = write(tmp_path / "a.csv", "a,b\n512,100\n612,300\n")
    pressure = {"columns": ["a", "b"], "unit": "kPa", "scale": [0.5, 0.1], "zero": [512, 100]}
    values = read(path, mapping={"rate_hz": 1, "pressure": pressure})["pressure"].values
    np.testing.assert_allclose(values, [[0, 0], [50e3, 20e3]])
    steps = {"columns": ["a"], "kind": "angle", "unit": "deg", "scale": 0.1125, "zero": 512}
    turned = np.degrees(read(path, mapping={"rate_hz": 1, "inputs": steps})["actuation"].values)
    np.testing.assert_allclose(turned, [[0], [11.25]])
    for change, message in (({"scale": [1.0]}, "gives 1 numbers in scale to 2 columns"), ({"scale": 0}, "scale = 0")):
        with pytest.raises(InputError, match=message):
            read(path, mapping={"rate_hz": 1, "pressure": pressure | change})


@pytest.mark.parametrize(("header", "cells", "seconds"), [
    ("time", ["23:59:59.5", "00:00:00.0"], 0.5), ("time", ["2026-02-28 23:59:59,5", "2026-03-01 00:00:00"], 0.5),
    ("sec,usec", ["17,900000", "18,150000"], 0.25), ("secs,nsecs", ["17,999000000", "18,1000000"], 0.002),
    ("millis", ["5210", "5220"], 0.01), ("time_ns", ["1760000000000000000", "1760000000010000000"], 0.01),
])  # fmt: skip
def test_clocks_of_loggers_need_no_mapping(tmp_path, header, cells, seconds):
    delimiter = "," if "," in header else ";"
    rows = [delimiter.join(row) for row in ((header, *"xyz"), (cells[0], *"123"), (cells[1], *"124"))]
    recording = read(write(tmp_path / "a.csv", "\n".join([*rows, ""])))
    assert np.diff(recording["time"].values)[0] == pytest.approx(seconds, abs=1e-6)
    assert recording["station"].values.tolist() == ["body"]


def test_a_time_of_day_that_is_no_time_is_named(tmp_path):
    path = write(tmp_path / "a.csv", "time,x,y,z\n10:00:00,1,2,3\nlater,1,2,4\n")
    with pytest.raises(InputError, match="holds times of day, but one cell is 'later'"):
        read(path)


def test_columns_of_different_lengths_lie_side_by_side(tmp_path):
    path = write(tmp_path / "a.csv", "t,x,y,z,tp,p\n0,1,2,3,0,5\n1,1,2,4,0.5,6\n,,,,1,7\n")
    mapping = {"time": "t", "input_time": "tp", "length_unit": "mm", "stations": TIP["stations"],
               "pressure": {"columns": ["p"], "unit": "kPa"}}  # fmt: skip
    recording = read(path, mapping=mapping)
    assert (recording["time"].values.tolist(), recording["pressure_time"].values.tolist()) == ([0, 1], [0, 0.5, 1])
    assert "1 row(s) of a.csv have neither a time nor values and are left out" in history(recording)
    with pytest.raises(InputError, match="not finite"):  # a row with values and no time is lost data
        read(path, mapping={key: value for key, value in mapping.items() if key != "input_time"})


@pytest.mark.parametrize("behind", ["|", ""])
def test_a_delimiter_behind_the_last_cell_begins_no_cell(tmp_path, behind):
    text = f"t|tip_x_mm|tip_y_mm|tip_z_mm{behind}\n0|1|2|3|\n1|1|2|4|\n"
    recording = read(write(tmp_path / "a.csv", text))
    np.testing.assert_allclose(recording["position"].values[1, 0], [1e-3, 2e-3, 4e-3])
    assert "unknown names" not in history(recording)
    mapping = {"header": True, "time": "t", "length_unit": "mm",
               "stations": {"tip": {"position": ["tip_x_mm", "tip_y_mm", "tip_z_mm"]}}}  # fmt: skip
    assert read(tmp_path / "a.csv", mapping=mapping).equals(recording)


def test_names_complete_a_mapping(tmp_path):
    path = write(tmp_path / "a.csv", "ID,x1,y1,z1,x2,y2,z2,servo_1_mm\n3,1,2,3,4,5,6,7\n3,1,2,3,4,5,7,8\n")
    mapping = {"rate_hz": 10, "select": {"column": "ID", "value": 3},
               "inputs": {"columns": ["servo_1_mm"], "kind": "displacement", "unit": "mm"}}  # fmt: skip
    log = read(path, mapping=mapping)
    assert "position" not in log  # a log has a time of its own
    timed = write(tmp_path / "b.csv", "t,tip_x,tip_y,tip_z,servo_1_mm\n0,1,2,3,7\n1,1,2,4,8\n")
    both = read(timed, mapping={"length_unit": "mm", "inputs": mapping["inputs"]})
    assert (both["station"].values.tolist(), both["position"].values[1, 0, 2]) == (["tip"], 4e-3)
    del mapping["inputs"]
    assert read(path, mapping=mapping)["station"].values.tolist() == ["s1", "s2"]


def test_pressures_without_a_unit_are_named_and_take_one(tmp_path):
    path = write(tmp_path / "a.csv", "time,x,y,z,measured_pressure_left,pressure_right,desired_pressure_left\n"
                                     "0,1,2,3,0,0,0\n1,1,2,4,1,2,5\n")  # fmt: skip
    assert "2 column(s) of a.csv seem to hold pressures without a unit" in history(read(path))
    recording = read(path, mapping={"pressure_unit": "psi"})
    assert recording["chamber"].values.tolist() == ["left", "right"]
    assert recording["pressure"].values[1] == pytest.approx([6894.757, 13789.51], rel=1e-6)
    other = write(tmp_path / "b.csv", "time,x,y,z\n0,1,2,3\n1,1,2,4\n")
    with pytest.raises(InputError, match="no column whose name says pressure and no unit"):
        read(other, mapping={"pressure_unit": "psi"})


def test_a_table_without_names_is_told_by_its_indices(tmp_path):
    with pytest.raises(InputError, match=r"holds numbers and no names: .* by index, 0 to 2"):
        read(write(tmp_path / "a.csv", "0,1,2\n1,1,3\n"))
    with pytest.raises(InputError, match=r"give a mapping .*; they are 0 to 2$"):
        read(write(tmp_path / "a.txt", "0 1 2\n1 1 3\n"))


def test_structs_and_cells_of_matlab_files_by_number():
    content = Variables()
    content.walk("train", [{"t": np.arange(2.0), "xyz": np.zeros((2, 3))}, {"t": np.arange(3.0)}], 0)
    content.walk("frames", [np.zeros((2, 3)), np.ones((2, 3))], 0)
    assert {"train(1).t", "train(2).t", "frames(2)"} <= set(content.names)
    arrays = {name: content.arrays[key] for name, key in content.names.items()}
    assert fields_of("train(2)", arrays, content.structs, "a.mat")["t"].tolist() == [0, 1, 2]
    assert in_round_brackets({"time": "train{2}.t", "position": ["a[1].x"]}) == {
        "time": "train(2).t", "position": ["a(1).x"]}  # fmt: skip
    for wrong, message in (("train", r"holds 2 structs 'train': choose one by struct = \"train\(1\)\""),
                           ("test", "has no struct 'test'")):  # fmt: skip
        with pytest.raises(InputError, match=message):
            fields_of(wrong, arrays, content.structs, "a.mat")


def turning(angle: np.ndarray, aside: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """Gravity in the axes of a sensor that turns by an angle about a tilted axis, and the sensor's orientations."""
    mounted = Rotation.from_euler("xyz", [20, -35, 70], degrees=True)
    vector = np.outer(angle, [0, 0, 1.0]) + aside * np.outer(np.sin(9 * angle), [1.0, 0, 0])
    turns = Rotation.from_rotvec(vector) * mounted
    return turns.inv().apply([0.0, -9.81, 0.0]), turns.as_quat()


@pytest.mark.parametrize("kind", [0, 1])
def test_the_angle_of_an_inertial_sensor(kind):
    angle = 1.2 * np.sin(np.linspace(0, 3, 50))
    first, second = turning(angle)[kind], turning(-0.5 * angle)[kind]
    first[7] = np.nan
    found, lines = turning_angles({"a": second, "b": first}, "bag")
    known = np.arange(50) != 7
    np.testing.assert_allclose(found[known, 1], angle[known] - angle[0], atol=1e-9)
    assert np.isnan(found[7, 1])
    np.testing.assert_allclose(found[:, 0], 0.5 * angle, atol=1e-9)  # turns with the tip
    assert len(lines) == 2
    _, lines = turning_angles({"a": turning(angle, 0.5)[kind]}, "bag")
    assert any("rotation about other axes is left out (a " in line for line in lines)


def test_gravity_does_not_show_a_turn_about_the_vertical():
    flat = np.tile([0.0, 0.0, 9.81], (20, 1))
    with pytest.raises(InputError, match=r"gravity hardly turns .* horizontal plane"):
        turning_angles({"tip": flat}, "bag")
    with pytest.raises(InputError, match="no acceleration or orientation in any frame"):
        turning_angles({"tip": np.full((20, 3), np.nan)}, "bag")
    shaken = turning(np.linspace(0, 1, 40))[0] * (1 + 0.3 * np.sin(np.arange(40.0)))[:, None]
    assert any("not gravity alone" in line for line in turning_angles({"tip": shaken}, "bag")[1])


def test_accelerations_in_a_table_become_angles(tmp_path):
    angle = np.linspace(0, 0.5, 30)
    gravity = turning(angle)[0]
    rows = "\n".join(f"{0.1 * k:.1f}," + ",".join(f"{v:.6f}" for v in row) for k, row in enumerate(gravity))
    path = write(tmp_path / "imu.csv", f"t,ax,ay,az\n{rows}\n")
    recording = read(path, mapping={"time": "t", "angles": {"tip": ["ax", "ay", "az"]}})
    np.testing.assert_allclose(recording["angle"].values[:, 0], angle, atol=1e-5)
    with pytest.raises(InputError, match="angles need one column for each station, or the 3"):
        read(path, mapping={"time": "t", "angles": {"tip": ["ax", "ay"]}})


def test_what_an_inertial_message_marks_as_not_measured_is_a_gap():
    vector = SimpleNamespace(x=1.0, y=2.0, z=3.0)
    turn = SimpleNamespace(x=0.0, y=0.0, z=0.0, w=1.0)
    nine = np.zeros(9)
    message = SimpleNamespace(linear_acceleration=vector, linear_acceleration_covariance=nine, orientation=turn,
                              orientation_covariance=nine)  # fmt: skip
    assert inertial(message) == [1.0, 2.0, 3.0, 0.0, 0.0, 0.0, 1.0]
    message.orientation_covariance = np.array([-1.0, *nine[1:]])
    assert np.isnan(inertial(message)).tolist() == [False] * 3 + [True] * 4
    message.linear_acceleration_covariance = message.orientation_covariance
    assert np.isnan(inertial(message)).all()


def test_topics_with_equal_ends_are_named_by_more_of_their_names():
    assert last_parts(dict.fromkeys(("/tip/imu", "/base/imu", "/valve"))) == {
        "tip_imu": "/tip/imu", "base_imu": "/base/imu", "valve": "/valve"}  # fmt: skip


def test_a_folder_for_each_trial_names_the_recordings(tmp_path):
    for trial, level in (("trial1", 5), ("trial2", 9)):
        (tmp_path / trial).mkdir()
        write(tmp_path / trial / "mocap.csv", "t,x_tip,y_tip\n" + "".join(f"{k},{k},{k + level}\n" for k in range(5)))
        write(tmp_path / trial / "daq.csv", "t,p_kpa\n" + "".join(f"{k},{level}\n" for k in range(5)))
    pairs = with_logs([tmp_path / f"trial{k}" / name for name in ("daq.csv", "mocap.csv") for k in (1, 2)])
    assert [pair.trial for pair in pairs] == ["trial1", "trial2"]
    assert all(pair.shape.parent == pair.log.parent for pair in pairs)


def test_all_trials_of_arrays_are_found_and_a_stated_rate_is_used(tmp_path):
    np.savez(tmp_path / "a.npz", position=np.arange(48.0).reshape(2, 4, 2, 3), pressure_mbar=[10, 20], rate_hz=50.0)
    trials = trials_of(tmp_path / "a.npz", None)
    assert trials == {"0": {"trial": 0}, "1": {"trial": 1}}
    recording = read(tmp_path / "a.npz", mapping=trials["1"])
    assert (recording.attrs["nominal_pressure"], recording["time"].values[1]) == (2000.0, 0.02)


def test_stations_and_inputs_of_arrays_by_name(tmp_path):
    t = np.arange(5.0)
    np.savez(tmp_path / "a.npz", t=t, base=np.zeros((5, 3)), x=t, y=2 * t, z=3 * t, drum=90 + t)
    mapping = {"position": {"base": "base", "tip": ["x", "y", "z"]}, "length_unit": "mm", "actuation": "drum",
               "input_kind": "angle", "input_unit": "deg", "input_names": ["pull"]}  # fmt: skip
    recording = read(tmp_path / "a.npz", mapping=mapping)
    np.testing.assert_allclose(recording["position"].values[4, 1], [4e-3, 8e-3, 12e-3])
    assert recording["station"].values.tolist() == ["base", "tip"]
    assert np.degrees(recording["actuation"].values[:, 0]) == pytest.approx(90 + t)
    for change, message in (({"input_unit": None}, "needs input_kind"),
                            ({"position": {"tip": ["x", "q"]}}, "no array 'q'"),
                            ({"position": {"base": "base", "tip": ["x"]}}, "must have equal lengths")):  # fmt: skip
        with pytest.raises(InputError, match=message):
            read(tmp_path / "a.npz", mapping=mapping | change)
