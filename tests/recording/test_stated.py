"""What a file states about its content is compared with what was read, in every format that states it."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest
from command_line import invoke
from nptdms import ChannelObject, TdmsWriter
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore
from scipy.io import savemat

from pliant.errors import InputError
from pliant.preprocessing.quality import quality
from pliant.recording import read
from pliant.recording.clock import usual_step, without_repeats
from pliant.recording.stated import Stated, judge_stated

STORE = get_typestore(Stores.ROS2_JAZZY)
NS = 1_700_000_000_000_000_000


def lvm(path, rows=60, *, samples=60, layout="One", times=None, step="0.01", begin=("10:11:12.0",) * 2, **words):
    """A LabVIEW measurement of two channels; `words` replace entries of its headers."""
    facts = {"Separator": "Tab", "Decimal_Separator": ".", "X_Columns": layout, "Time_Pref": "Relative", **words}
    about = {"Channels": "2", "Samples": f"{samples}\t{samples}", "Date": "2026/01/02\t2026/01/02",
             "Time": "\t".join(begin), "Y_Unit_Label": "kPa\tkPa", "X_Dimension": "Time\tTime", "X0": "0.0\t0.0",
             "Delta_X": f"{step}\t{step}", **{k: v for k, v in words.items() if k == "X_Dimension"}}  # fmt: skip
    end = "***End_of_Header***"
    head = ["LabVIEW Measurement\t", *(f"{k}\t{v}" for k, v in facts.items()), end, "",
            *(f"{k}\t{v}" for k, v in about.items()), end]  # fmt: skip
    multi = layout == "Multi"
    clock = [f"{0.01 * k:.6f}" for k in range(rows)] if times is None else times
    table = ["X_Value\tleft\t" + ("X_Value\t" if multi else "") + "right\tComment"]
    table += ["\t".join([t, f"{k}.5", *([t] if multi else []), f"{2 * k}.25"]) for k, t in enumerate(clock)]
    path.write_text("\n".join([*head, *table, ""]))
    return path


def test_a_log_of_fewer_samples_than_stated_is_refused_or_read_on_request(tmp_path):
    path = lvm(tmp_path / "log.lvm", 20)
    with pytest.raises(InputError, match=r"states 60 samples of left \(Samples of its header\), but only 20 of 60"):
        read(path)
    shown = invoke("inspect", path)
    assert shown.exit_code != 0
    assert "20 of 60" in str(shown.exception)
    mapping = tmp_path / "m.toml"
    mapping.write_text("incomplete = true\n")
    accepted = invoke("inspect", path, "--mapping", mapping)
    assert accepted.exit_code == 0
    assert "! log.lvm states 60 samples of left" in accepted.output
    with pytest.raises(InputError, match=r"incomplete in the mapping for log[.]lvm must be true or false"):
        read(path, mapping={"incomplete": "yes"})


def test_a_log_that_was_appended_below_one_header_holds_more_than_that_states(tmp_path):
    assert read(lvm(tmp_path / "log.lvm", 60, samples=20)).sizes["pressure_time"] == 60
    assert read(lvm(tmp_path / "no.lvm", 60, samples=20, layout="No")).sizes["pressure_time"] == 60


@pytest.mark.parametrize(("options", "said"), [
    ({"times": [""] * 60}, "no row with a time"),
    ({"layout": "No", "step": "inf"}, "does not state a start time X0 and a time step Delta_X above 0"),
    ({"layout": "No", "step": "0"}, "does not state a start time X0 and a time step Delta_X above 0"),
    ({"layout": "No", "step": "fast"}, "states Delta_X = 'fast' for channel 1, which is not a number"),
    ({"samples": "sixty"}, "states Samples = 'sixty'"),
    ({"layout": "Some"}, "states X_Columns = 'Some', which is not one of One, Multi, No"),
    ({"Decimal_Separator": ";"}, "states Decimal_Separator = ';'"),
    ({"Time_Pref": "Sidereal"}, "states Time_Pref = 'Sidereal'"),
    ({"X_Dimension": "Frequency"}, "states X_Dimension = 'Frequency'"),
])  # fmt: skip
def test_headers_that_cannot_be_understood_are_refused_in_a_sentence(tmp_path, options, said):
    with pytest.raises(InputError, match=said):
        read(lvm(tmp_path / "log.lvm", **options))


def test_another_step_than_that_of_the_times_is_a_warning(tmp_path):
    ds = read(lvm(tmp_path / "log.lvm", step="0.02"))
    assert any("states 50 Hz for samples of left (Delta_X of its header), but its times have 100 Hz" in line
               for line in quality(ds).findings)  # fmt: skip
    assert not [f for f in quality(read(lvm(tmp_path / "same.lvm"))).findings if "states" in f]


def test_channels_that_begin_at_different_times_are_not_simultaneous(tmp_path):
    path = lvm(tmp_path / "log.lvm", begin=("10:11:12.0", "10:11:17.5"))
    with pytest.raises(InputError, match="different sample times"):
        read(path)
    late = read(path, mapping={"pressure": ["right"]})
    assert float(late["pressure_time"][0]) == pytest.approx(5.5)
    assert "begin at different times" in late.attrs["history"]


def tdms(path, *, starts=(None, None), parts=3):
    """A file of two channels in several segments."""
    channels = []
    for name, start in zip(("left", "right"), starts, strict=True):
        facts = {"wf_increment": 0.01, "wf_start_offset": 0.0, "unit_string": "kPa"}
        channels.append((name, facts | ({} if start is None else {"wf_start_time": np.datetime64(start)})))
    with TdmsWriter(path) as writer:
        for _ in range(parts):
            writer.write_segment([ChannelObject("valves", n, np.arange(20.0), properties=f) for n, f in channels])
    return path


def test_a_tdms_file_cut_anywhere_but_between_two_segments_is_refused(tmp_path):
    content = tdms(tmp_path / "whole.tdms").read_bytes()
    starts = [k for k in range(len(content)) if content[k : k + 4] == b"TDSm"]
    assert len(starts) == 3
    path = tmp_path / "cut.tdms"
    for at in (starts[1] + 20, starts[2] + 1, starts[2] + 27, starts[2] + 60, len(content) - 1):
        path.write_bytes(content[:at])
        with pytest.raises(InputError, match=r"whole segments .* of [23] were read"):
            read(path)


def test_channels_of_a_tdms_file_are_shifted_by_their_start_times(tmp_path):
    path = tdms(tmp_path / "log.tdms", starts=("2026-01-02T10:00:05", "2026-01-02T10:00:00"))
    with pytest.raises(InputError, match=r"left \(60 samples from 5 s\) and right \(60 samples from 0 s\)"):
        read(path)
    late = read(path, mapping={"pressure": ["left"]})
    assert float(late["pressure_time"][0]) == pytest.approx(5.0)
    assert "left 5 s, right 0 s" in late.attrs["history"]
    half = read(tdms(tmp_path / "half.tdms", starts=("2026-01-02T10:00:05", None)))
    assert any("right of half.tdms state no start time" in line for line in quality(half).findings)
    same = read(tdms(tmp_path / "same.tdms", starts=("2026-01-02T10:00:05",) * 2))
    assert float(same["pressure_time"][0]) == 0.0


def message(kind, **fields):
    return STORE.types[kind](**fields)


def header(ns, frame):
    stamp = message("builtin_interfaces/msg/Time", sec=ns // 10**9, nanosec=ns % 10**9)
    return message("std_msgs/msg/Header", stamp=stamp, frame_id=frame)


def transform(parent, child, x, angle=0.0):
    """A message with the pose of a frame that is moved along x and turned about z."""
    move = message("geometry_msgs/msg/Vector3", x=x, y=0.0, z=0.0)
    turn = message("geometry_msgs/msg/Quaternion", x=0.0, y=0.0, z=np.sin(angle / 2), w=np.cos(angle / 2))
    pose = message("geometry_msgs/msg/Transform", translation=move, rotation=turn)
    kind = "geometry_msgs/msg/TransformStamped"
    entry = message(kind, header=header(NS, parent), child_frame_id=child, transform=pose)
    return message("tf2_msgs/msg/TFMessage", transforms=[entry])


def bag(folder: Path, *, frames=("world", "world"), stamps=(NS, NS), transforms=(), number=False):
    """A bag of two bodies over 40 frames; a stamp of None is 0 in the header."""
    with Writer(folder, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        bodies = [writer.add_connection(f"/m{k}", "geometry_msgs/msg/PoseStamped", typestore=STORE) for k in (0, 1)]
        level = writer.add_connection("/level", "std_msgs/msg/Float64", typestore=STORE)
        tf = writer.add_connection("/tf_static", "tf2_msgs/msg/TFMessage", typestore=STORE) if transforms else None
        for one in transforms:
            writer.write(tf, NS, STORE.serialize_cdr(one, tf.msgtype))
        for k in range(40):
            for body, frame, start in zip(bodies, frames, stamps, strict=True):
                place = message("geometry_msgs/msg/Point", x=0.001 * k * (body is bodies[1]), y=0.1, z=0.0)
                turn = message("geometry_msgs/msg/Quaternion", x=0.0, y=0.0, z=0.0, w=1.0)
                at = header(0 if start is None else start + 10_000_000 * k, frame)
                pose = message("geometry_msgs/msg/Pose", position=place, orientation=turn)
                raw = STORE.serialize_cdr(message(body.msgtype, header=at, pose=pose), body.msgtype)
                writer.write(body, NS + 10_000_000 * k, raw)
            if number:
                raw = STORE.serialize_cdr(message(level.msgtype, data=float(k)), level.msgtype)
                writer.write(level, NS + 10_000_000 * k, raw)
    return folder


def test_a_bag_is_read_as_its_folder_and_through_the_program(tmp_path):
    folder = bag(tmp_path / "take")
    whole = read(folder)
    assert whole.sizes["time"] == 40
    assert whole.attrs["source_sha256"]
    np.testing.assert_array_equal(whole["position"], read(folder / "take.mcap")["position"])
    shown = invoke("inspect", folder)
    assert shown.exit_code == 0, shown.output
    assert "40 frames of 2 station(s)" in shown.output
    (tmp_path / "plain").mkdir()
    with pytest.raises(InputError, match="this is a folder, not a file"):
        read(tmp_path / "plain")


def test_messages_that_a_bag_states_and_does_not_hold_are_counted(tmp_path):
    path = bag(tmp_path / "take") / "take.mcap"
    content = path.read_bytes()
    path.write_bytes(content.replace(struct.pack("<HQ", 1, 40), struct.pack("<HQ", 1, 60)))  # as its statistics count
    with pytest.raises(InputError, match=r"take.mcap states 60 messages of /m0 \(its index\), but only 40 of 60"):
        read(path)
    assert "only 40 of 60" in read(path, mapping={"incomplete": True}).attrs["history"]
    metadata = path.with_name("metadata.yaml")
    short = bag(tmp_path / "other") / "other.mcap"
    short.with_name("metadata.yaml").write_text(
        metadata.read_text().replace("take.mcap", "other.mcap").replace("message_count: 40", "message_count: 55")
    )
    with pytest.raises(InputError, match=r"states 55 messages of /m0 \(metadata.yaml\), but only 40 of 55"):
        read(short)


def test_stations_in_different_frames_need_a_transform(tmp_path):
    frames = ("world", "camera")
    with pytest.raises(InputError, match=r"m0 in world; m1 in camera.*no transform from camera to world"):
        read(bag(tmp_path / "none", frames=frames))
    chain = (transform("world", "stand", 1.0), transform("stand", "camera", 0.5, np.pi / 2))
    moved = read(bag(tmp_path / "tf", frames=frames, transforms=chain))
    np.testing.assert_allclose(moved["position"][:, 0], [[0.0, 0.1, 0.0]] * 40, atol=1e-12)
    np.testing.assert_allclose(moved["position"][20, 1], [1.5 - 0.1, 0.02, 0.0], atol=1e-12)  # turned by a quarter
    np.testing.assert_allclose(np.abs(moved["quaternion"][5, 1]), [0, 0, np.sqrt(0.5), np.sqrt(0.5)], atol=1e-12)
    assert "positions in frame world; transformed from camera" in moved.attrs["history"]
    back = read(tmp_path / "tf", mapping={"frame": "camera"})
    np.testing.assert_allclose(back["position"][20, 1], [0.02, 0.1, 0.0], atol=1e-12)
    turning = (transform("world", "camera", 1.0), transform("world", "camera", 1.1))
    with pytest.raises(InputError, match="the transform in the bag changes in time"):
        read(bag(tmp_path / "moving", frames=frames, transforms=turning))


def test_a_mapping_states_the_pose_of_a_frame_or_that_two_are_the_same(tmp_path):
    folder = bag(tmp_path / "take", frames=("m0", "m1"))
    same = read(folder, mapping={"transforms": {"m1": {}}})
    np.testing.assert_allclose(same["position"][20, 1], [0.02, 0.1, 0.0], atol=1e-12)
    up = read(folder, mapping={"transforms": {"m1": {"position": [0, 0, 300]}}, "length_unit": "mm"})
    np.testing.assert_allclose(up["position"][20, 1], [2e-5, 1e-4, 0.3], atol=1e-12)
    with pytest.raises(InputError, match="no unit quaternion"):
        read(folder, mapping={"transforms": {"m1": {"quaternion": [0, 0, 0, 0]}}})


def test_clocks_without_common_time_are_refused_and_each_clock_is_named(tmp_path):
    simulated = bag(tmp_path / "simulated", stamps=(10_000_000, 10_000_000), number=True)
    mapping = {"pressure": {"p": "/level"}, "pressure_unit": "kPa"}
    with pytest.raises(InputError, match=r'/m0 \(header, 0.010 to .* have no time in common.*clock = "reception"'):
        read(simulated, mapping=mapping)
    received = read(simulated, mapping={**mapping, "clock": "reception"})
    assert float(received["pressure"][-1]) == pytest.approx(39e3)
    assert "clock of p, m0, m1: times of reception" in received.attrs["history"]
    blank = read(bag(tmp_path / "blank", stamps=(None, None)))
    assert "times of reception (no stamp in the messages of m0, m1)" in blank.attrs["history"]
    late = read(bag(tmp_path / "late", stamps=(NS - 100_000_000, None)))
    assert "clock of m0: times of the message headers" in late.attrs["history"]
    assert any("reception is 0.1 s after the stamp" in line for line in quality(late).findings)


def motive(path, frames=48, *, stated=48, rate="120.000000", space="Global", name="tip"):
    """A Motive export whose times are rounded to 1 ms."""
    facts = f"Format Version,1.23,Export Frame Rate,{rate},Total Exported Frames,{stated},Length Units,Meters"
    head = [f"{facts},Coordinate Space,{space}", "", ",Type,Marker,Marker,Marker,Marker,Marker,Marker",
            f",Name,{name},{name},{name},Unlabeled 1001,Unlabeled 1001,Unlabeled 1001", ",ID,a,a,a,b,b,b",
            ",,Position,Position,Position,Position,Position,Position", "Frame,Time (Seconds),X,Y,Z,X,Y,Z"]  # fmt: skip
    rows = [f"{k},{k / 120:.3f}000,{0.001 * k:.4f},2.0,3.0,,," for k in range(frames)]
    path.write_text("\n".join([*head, *rows, ""]))
    return path


def test_the_rate_of_rounded_times_is_the_stated_one(tmp_path):
    ds = read(motive(tmp_path / "take.csv"))
    found = quality(ds)
    assert found.rate_hz == pytest.approx(120, rel=1e-2)
    assert not [line for line in found.findings if "Hz" in line or "irregular" in line]
    assert ds["station"].values.tolist() == ["tip"]
    assert "1 marker(s) without a label were left out: Unlabeled 1001" in ds.attrs["history"]
    assert read(motive(tmp_path / "take.csv"), mapping={"unlabelled": True}).sizes["station"] == 2
    wrong = quality(read(motive(tmp_path / "wrong.csv", rate="100.0")))
    assert any("states 100 Hz for frames (Export Frame Rate)" in line for line in wrong.findings)


@pytest.mark.parametrize(("options", "said"), [
    ({"stated": 50}, "only 48 of 50"), ({"stated": 40}, "but holds 48"), ({"space": "Local"}, "space 'Local'"),
    ({"name": "Unlabeled 1000"}, "its markers have no label"),
])  # fmt: skip
def test_an_export_that_contradicts_itself_is_refused(tmp_path, options, said):
    with pytest.raises(InputError, match=said):
        read(motive(tmp_path / "take.csv", **options))


def test_rows_of_a_mapping_that_drop_the_last_row_alone_are_a_warning(tmp_path):
    path = tmp_path / "a.txt"
    path.write_text("".join(f"{k / 10},{k},0,1\n" for k in range(10)))
    mapping = {"time": 0, "length_unit": "mm", "stations": {"tip": {"position": [1, 2, 3]}}}
    ds = read(path, mapping={**mapping, "rows": [0, 9]})
    assert any("leaves out the last row of a.txt: the second number is the first row that is not read, 10 for all" in f
               for f in quality(ds).findings)  # fmt: skip
    for rows in ([0, 10], [0, 8]):
        assert not [f for f in quality(read(path, mapping={**mapping, "rows": rows})).findings if "last row" in f]


def test_equal_rows_at_one_time_are_merged_and_others_are_refused(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text("ms,t,x,y\n0,0.0,1,2\n200,0.0,1,2\n400,0.2,2,2\n600,0.4,3,2\n")
    mapping = {"header": True, "time": "t", "length_unit": "mm", "stations": {"tip": {"position": ["x", "y"]}}}
    ds = read(path, mapping=mapping)
    assert ds.sizes["time"] == 3
    assert "1 of 4 rows of a.csv repeat the previous row with its time stamp" in ds.attrs["history"]
    path.write_text(path.read_text().replace("200,0.0,1,2", "200,0.0,1.5,2"))
    with pytest.raises(InputError, match=r"1 pair.* the first 0 s: .* or keep one run by rows = \[first, last\]"):
        read(path, mapping=mapping)
    wide = tmp_path / "w.csv"
    wide.write_text("t,x_a,y_a\n0,1,2\n0,1,2\n1,2,2\n")
    assert read(wide).sizes["time"] == 2
    with pytest.raises(InputError, match="no row with a time"):
        without_repeats(np.zeros(0), "a.csv")


def test_quoted_cells_are_read_and_lists_in_them_are_named(tmp_path):
    path = tmp_path / "note.csv"
    path.write_text('"t","p_kpa","x_tip","y_tip","note"\n0.00,0,0,0.1,"start, rest"\n0.01,1,0.001,0.1,""\n')
    ds = read(path)
    assert ds.sizes["time"] == 2
    assert "1 column(s) of note.csv have unknown names and were left out: note" in ds.attrs["history"]
    path.write_text('state,input\n"[0.0,100.0]","[0.0]"\n"[1.0,99.0]","[1.0]"\n')
    mapping = {"header": True, "rate_hz": 50, "length_unit": "m", "stations": {"tip": {"position": ["state", "input"]}}}
    with pytest.raises(InputError, match=r"line 2, cell 1 of note.csv holds a list in quotes, '\[0.0,100.0\]'"):
        read(path, mapping=mapping)


@pytest.mark.parametrize("cells", [False, True])
def test_one_of_several_structs_is_named_by_its_number(tmp_path, cells):
    t, path = np.arange(20) / 10, tmp_path / "a.mat"
    kind = np.dtype([("t", object), ("xyz", object)])
    trials = np.empty((1, 3), object if cells else kind)
    for k in range(3):
        values = (t[:, None], np.full((20, 6), float(k)))
        trials[0, k] = dict(zip(("t", "xyz"), values, strict=True)) if cells else values
    savemat(path, {"trial": trials})
    with pytest.raises(InputError, match=r"trial: 3 structs of t, xyz: name a field of one struct, such as trial\(1\)"):
        read(path, mapping={"time": "trial.t", "position": "trial.xyz"})
    mapping = {"time": "trial(2).t", "position": "trial(2).xyz", "station": ["mid", "tip"]}
    second = read(path, mapping=mapping)
    assert second["position"].shape == (20, 2, 3)
    assert float(second["position"][3, 1, 2]) == 1.0


def test_the_usual_step_is_that_without_rounding_and_gaps():
    exact = np.arange(1000) / 120
    rounded = np.delete(np.round(exact, 3), slice(300, 500))
    assert 1 / usual_step(rounded) == pytest.approx(120, rel=2e-3)
    assert np.isnan(usual_step(exact[:1]))


def test_one_rule_judges_counts_and_rates():
    exact = Stated("frames", "its header", 10, 12)
    with pytest.raises(InputError, match=r"states 10 frames .its header., but holds 12: it contradicts itself"):
        judge_stated([exact], "a.x")
    assert judge_stated([exact._replace(kind="at least"), exact._replace(kind="rate", stated=100, read=101)], "a") == []
    warned = judge_stated([exact._replace(read=7)], "a.x", incomplete=True)
    text = "a.x states 10 frames (its header), but only 7 of 10 were read, and incomplete = true accepts that"
    assert warned == [f"WARNING: {text}"]
