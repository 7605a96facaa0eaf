"""ROS 2 bags, written here by rosbags: poses of three bodies at their own stamps, a pressure, a plain number."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from pliant.errors import InputError
from pliant.recording import apart_bag, read

STORE = get_typestore(Stores.ROS2_JAZZY)
NS = 1_700_000_000_000_000_000
T = np.arange(60) / 50


def make(name, **fields):
    return STORE.types[name](**fields)


def header(t):
    ns = NS + round(1e9 * t)
    stamp = make("builtin_interfaces/msg/Time", sec=ns // 10**9, nanosec=ns % 10**9)
    return make("std_msgs/msg/Header", stamp=stamp, frame_id="world")


def pose(t, x):
    turn = make("geometry_msgs/msg/Quaternion", x=0.0, y=0.0, z=0.0, w=1.0)
    place = make("geometry_msgs/msg/Point", x=x, y=0.1, z=0.2)
    return make("geometry_msgs/msg/PoseStamped", header=header(t),
                pose=make("geometry_msgs/msg/Pose", position=place, orientation=turn))  # fmt: skip


def swing(t):
    return 0.1 * np.sin(5 * t)


def bag(folder: Path, plugin: StoragePlugin, *, lost: int = -1) -> Path:
    """Poses 3 ms late of one another, received 1 s after their stamps; the tip's message `lost` is absent."""
    with Writer(folder, version=9, storage_plugin=plugin) as writer:
        poses = {n: writer.add_connection(f"/mocap/{n}", "geometry_msgs/msg/PoseStamped", typestore=STORE)
                 for n in ("base", "tip")}  # fmt: skip
        fluid = writer.add_connection("/valve/pressure", "sensor_msgs/msg/FluidPressure", typestore=STORE)
        level = writer.add_connection("/valve/level", "std_msgs/msg/Float64", typestore=STORE)
        for k, t in enumerate(T.tolist()):
            received = NS + round(1e9 * (t + 1.0))
            for late, (name, connection) in enumerate(poses.items()):
                if k != lost or name == "base":
                    message = pose(t + 3e-3 * late, 0.0 if name == "base" else float(swing(t)))
                    writer.write(connection, received, STORE.serialize_cdr(message, connection.msgtype))
            pressure = make(fluid.msgtype, header=header(t), fluid_pressure=101e3 + 1e3 * k, variance=0.0)
            writer.write(fluid, received, STORE.serialize_cdr(pressure, fluid.msgtype))
            writer.write(level, received, STORE.serialize_cdr(make(level.msgtype, data=0.5 * k), level.msgtype))
    return next(f for f in folder.iterdir() if f.suffix in (".mcap", ".db3"))


@pytest.mark.parametrize("plugin", [StoragePlugin.MCAP, StoragePlugin.SQLITE3])
def test_poses_and_pressure_by_header_stamp(tmp_path, plugin):
    ambient = {"linear": {"pressure": {"offset": -101.0, "unit": "kPa"}}}
    ds = read(bag(tmp_path / "bag", plugin, lost=20), mapping=ambient)
    assert ds["station"].values.tolist() == ["base", "tip"]
    np.testing.assert_allclose(ds["time"], T, atol=1e-8)
    there = np.arange(60) != 20
    np.testing.assert_allclose(ds["position"].values[there, 1, 0], swing(T)[there], atol=1e-12)
    assert np.isnan(ds["position"].values[20, 1]).all()
    assert "1 frame(s) have no message of tip and are gaps" in ds.attrs["history"]
    np.testing.assert_allclose(ds["pressure"], 1e3 * np.arange(60), atol=1e-9)
    assert "/valve/level" in ds.attrs["history"]


def test_topics_are_chosen_by_name_and_plain_numbers_by_unit(tmp_path):
    path = bag(tmp_path / "bag", StoragePlugin.MCAP)
    mapping = {"topics": {"end": "/mocap/tip"}, "pressure": {"left": "/valve/level"}}
    with pytest.raises(InputError, match="plain numbers: set pressure_unit"):
        read(path, mapping=mapping)
    ds = read(path, mapping={**mapping, "pressure_unit": "kPa"})
    assert ds["station"].values.tolist() == ["end"]
    assert float(ds["pressure"].max()) == pytest.approx(0.5e3 * 59)
    with pytest.raises(InputError, match="no topic '/mocap/nose' of a known type: "
                                         "choose in its mapping among /mocap/base"):
        read(path, mapping={"topics": {"end": "/mocap/nose"}})


def test_a_cut_bag_is_refused(tmp_path):
    path = bag(tmp_path / "bag", StoragePlugin.MCAP)
    path.write_bytes(path.read_bytes()[:3000])
    with pytest.raises(InputError, match=r"states 3000 bytes of whole records and an end \(its size\), but "):
        read(path)


def test_definitions_of_messages_in_a_bag_are_never_taken(tmp_path, monkeypatch):
    """rosbags turns definitions into Python and runs it: with a bag's own, a stranger's words would be run."""
    path = bag(tmp_path / "bag", StoragePlugin.MCAP)

    def refuse(*_, **__):
        raise AssertionError("a definition was taken")

    monkeypatch.setattr(type(STORE), "register", refuse)
    arrays, facts = apart_bag.read(str(path))
    assert {t["name"] for t in facts["topics"]} == {"/mocap/base", "/mocap/tip", "/valve/level", "/valve/pressure"}
    assert arrays


def test_another_definition_of_a_known_message_is_refused(tmp_path):
    kind = "std_msgs/msg/Float64"
    with Writer(tmp_path / "bag", version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        other = writer.add_connection("/level", kind, msgdef="float32 data\n", rihs01="RIHS01_" + 64 * "0")
        writer.write(other, NS, STORE.serialize_cdr(make(kind, data=0.5), kind))
    path = next((tmp_path / "bag").glob("*.mcap"))
    with pytest.raises(InputError, match=r"topic /level cannot be read: the bag defines std_msgs/msg/Float64 differe"):
        read(path)
    with pytest.raises(InputError, match=r"topic '/level' cannot be read: .* Choose another topic"):
        read(path, mapping={"pressure": {"left": "/level"}, "pressure_unit": "kPa"})


def test_a_topic_that_cannot_be_read_is_named_and_the_others_are_read(tmp_path):
    """As of a lidar beside a tracker: the number of its points changes."""
    with Writer(tmp_path / "bag", version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        tip = writer.add_connection("/mocap/tip", "geometry_msgs/msg/PoseStamped", typestore=STORE)
        lidar = writer.add_connection("/lidar", "sensor_msgs/msg/PointCloud2", typestore=STORE)
        for k, t in enumerate(T.tolist()):
            received = NS + round(1e9 * t)
            writer.write(tip, received, STORE.serialize_cdr(pose(t, float(swing(t))), tip.msgtype))
            points = cloud(7, "<", {"x": 0, "y": 4, "z": 8}, np.ones((2 + k // 30, 3)))
            writer.write(lidar, received, STORE.serialize_cdr(points, lidar.msgtype))
    path = next((tmp_path / "bag").glob("*.mcap"))
    ds = read(path)
    assert ds["station"].values.tolist() == ["tip"]
    np.testing.assert_allclose(ds["position"].values[:, 0, 0], swing(T), atol=1e-12)
    why = "topic /lidar cannot be read: it has a varying number of points per message; it is left out"
    assert why in ds.attrs["history"]
    with pytest.raises(InputError, match="topic '/lidar' cannot be read: it has a varying number"):
        read(path, mapping={"topics": {"body": "/lidar"}})


def fields_of(kind, places):
    """The fields of a cloud: names and offsets of numbers of one type."""
    field = STORE.types["sensor_msgs/msg/PointField"]
    return [field(name=n, offset=at, datatype=kind, count=1) for n, at in places.items()]


def cloud(kind, order, places, rows, row_step=None):
    """A PointCloud2 whose points lie in records of 40 bytes."""
    raw = np.zeros((len(rows), 40), np.uint8)
    for k, (name, at) in enumerate(places.items()):
        if name in "xyz":
            column = np.ascontiguousarray(rows[:, k], f"{order}f{8 if kind == 8 else 4}")
            raw[:, at : at + column.itemsize] = column.view(np.uint8).reshape(len(rows), -1)
    fields = fields_of(kind, places)
    return make("sensor_msgs/msg/PointCloud2", header=header(0.0), height=1, width=len(rows), fields=fields,
                is_bigendian=order == ">", point_step=40, row_step=row_step or raw.size, data=raw.ravel(),
                is_dense=False)  # fmt: skip


@pytest.mark.parametrize(("kind", "order"), [(7, "<"), (7, ">"), (8, "<"), (8, ">")])
def test_points_of_a_cloud_are_read_at_their_offsets_and_in_their_order_of_bytes(kind, order):
    rows = np.array([[0.25, -1.5, 3.0], [np.nan, 0.5, 0.125]])
    message = cloud(kind, order, {"x": 4, "y": 16, "z": 28}, rows)
    assert np.array(apart_bag.cloud(message))[:, :3] == pytest.approx(rows, nan_ok=True)


@pytest.mark.parametrize(("kind", "places", "row_step", "words"), [
    (7, {"x": 0, "y": 4}, None, "no x, y and z"),
    (5, {"x": 0, "y": 4, "z": 8}, None, "as floating-point numbers"),
    (7, {"x": 0, "y": 4, "z": 8}, 400, "fewer bytes than its points need"),
    (7, {"x": 0, "y": 4, "z": 38}, None, "fewer bytes than its points need"),
])  # fmt: skip
def test_clouds_that_cannot_be_read_are_refused(kind, places, row_step, words):
    message = cloud(kind, "<", {k: v for k, v in places.items() if v < 36}, np.ones((2, 3)), row_step)
    message.fields = fields_of(kind, places)
    with pytest.raises(apart_bag.Refused, match=words):
        apart_bag.cloud(message)


def unchunked(path: Path) -> bytes:
    """The records of an MCAP file with those of its chunks one by one, as a recorder writes them without chunks; not
    its index.
    """
    content, begin, out = path.read_bytes(), 8, b"\x89MCAP0\r\n"
    while content[begin] != 0x0F:  # the end of the data
        size = 9 + int.from_bytes(content[begin + 1 : begin + 9], "little")
        record = content[begin : begin + size]
        if record[0] == 0x06:  # a chunk: times, size, checksum, then the compression, which is none, and the size again
            assert record[9 + 28 : 9 + 32] == bytes(4)
            out += record[9 + 40 :]
        elif record[0] != 0x07:
            out += record
        begin += size
    return out


def test_a_recording_that_was_cut_is_read_up_to_its_last_whole_record_and_the_rest_counted(tmp_path):
    path = bag(tmp_path / "bag", StoragePlugin.MCAP)
    mapping = {"topics": {n: f"/mocap/{n}" for n in ("base", "tip")}, "pressure": {"a": "/valve/pressure"}}
    whole, records = read(path, mapping=mapping), unchunked(path)
    cut = tmp_path / "take.mcap"
    cut.write_bytes(records[: len(records) - 4000])
    with pytest.raises(InputError, match=r"take.mcap states \d+ bytes of whole records and an end \("):
        read(cut, mapping=mapping)
    rest = read(cut, mapping={**mapping, "incomplete": True})
    count = rest.sizes["time"]
    assert 30 < count < 60
    np.testing.assert_array_equal(rest["position"], whole["position"][:count])
    assert "bytes of whole records" in rest.attrs["history"]
    cut.write_bytes(records[:-4000] + bytes(5000))  # the file system had reserved more
    np.testing.assert_array_equal(read(cut, mapping={**mapping, "incomplete": True})["position"], rest["position"])


def test_a_recording_without_an_end_is_whole_and_named(tmp_path):
    path = bag(tmp_path / "bag", StoragePlugin.MCAP)
    (tmp_path / "take.mcap").write_bytes(unchunked(path))
    rest = read(tmp_path / "take.mcap", mapping={"pressure": {"a": "/valve/pressure"}, "incomplete": True})
    assert rest.sizes["time"] == 60
    assert "bytes of whole records and an end" in rest.attrs["history"]


@pytest.mark.parametrize("content", [b"", b"\x89MCAP0\r\n", b"\x89MCAP0\r\n\x01", b"\x89MCAP0\r\n" + bytes(400)])
def test_a_cut_recording_without_a_record_is_refused(tmp_path, content):
    (tmp_path / "take.mcap").write_bytes(content)
    with pytest.raises(InputError, match=r"take\.mcap"):
        read(tmp_path / "take.mcap", mapping={"incomplete": True})


def test_the_folder_of_a_recording_that_was_cut_names_the_file_in_it(tmp_path):
    path = bag(tmp_path / "bag", StoragePlugin.MCAP)
    path.with_name("metadata.yaml").unlink()
    with pytest.raises(InputError, match=rf"which has metadata.yaml\): give the file in it, such as {path.name}"):
        read(path.parent)
    assert read(path, mapping={"pressure": {"a": "/valve/pressure"}}).sizes["time"] == 60


@pytest.mark.parametrize("plugin", [StoragePlugin.MCAP, StoragePlugin.SQLITE3])
def test_a_bag_without_a_message_says_so(tmp_path, plugin):
    with Writer(tmp_path / "bag", version=9, storage_plugin=plugin) as writer:
        writer.add_connection("/tip", "geometry_msgs/msg/PoseStamped", typestore=STORE)
    with pytest.raises(InputError, match="bag holds no whole message: nothing was recorded"):
        read(tmp_path / "bag")


def test_arrays_of_numbers_are_pressures_of_several_chambers(tmp_path):
    kind = "std_msgs/msg/Float64MultiArray"
    with Writer(tmp_path / "bag", version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        tip = writer.add_connection("/tip", "geometry_msgs/msg/PoseStamped", typestore=STORE)
        valves = writer.add_connection("/valves", kind, typestore=STORE)
        layout = make("std_msgs/msg/MultiArrayLayout", dim=[], data_offset=0)
        for t in T.tolist():
            stamp = NS + round(1e9 * t)
            writer.write(tip, stamp, STORE.serialize_cdr(pose(t, float(swing(t))), tip.msgtype))
            writer.write(valves, stamp, STORE.serialize_cdr(
                make(kind, layout=layout, data=np.array([t, 2.0 * t])), kind))  # fmt: skip
    ds = read(tmp_path / "bag", mapping={"pressure": {"valve": "/valves"}, "pressure_unit": "kPa"})
    assert ds["chamber"].values.tolist() == ["valve_0", "valve_1"]
    np.testing.assert_allclose(ds["pressure"], 1e3 * np.column_stack([T, 2.0 * T]))
    arrays, facts = apart_bag.read(str(tmp_path / "bag"))  # one that nobody names may be of any size
    assert facts["others"] == ["/valves"]
    assert sum(array.shape[-1] == 1 for array in arrays.values()) == 0
    assert "1 topic(s) of bag were not used: /valves" in read(tmp_path / "bag").attrs["history"]
