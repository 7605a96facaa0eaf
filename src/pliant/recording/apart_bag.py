"""Read poses, points and pressures of a ROS 2 bag (.mcap, .db3) by rosbags, in a separate process.

Messages are decoded by the definitions in rosbags. The definitions in the bag are only compared with those, because
rosbags would generate and run Python code from them. A bag whose definition of a known message differs is refused.
"""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from rosbags.interfaces import MessageDefinitionFormat
from rosbags.rosbag2 import Reader
from rosbags.typesys import Stores, TypesysError, get_types_from_msg, get_typestore
from ruamel.yaml import YAML
from ruamel.yaml.error import YAMLError

from pliant.recording.apart_worker import Content, Refused

STORE = get_typestore(Stores.ROS2_JAZZY)


def point(p: Any) -> list[float]:
    """Return a ROS 2 point as a row of seven numbers: x, y, z and four NaN for the missing quaternion."""
    return [p.x, p.y, p.z, *[float("nan")] * 4]


def pose(p: Any) -> list[float]:
    """Return a ROS 2 pose as a row of seven numbers: position x, y, z and quaternion x, y, z, w."""
    q = p.orientation
    return [p.position.x, p.position.y, p.position.z, q.x, q.y, q.z, q.w]


def transform(t: Any) -> list[float]:
    """Return a ROS 2 transform as a row of seven numbers: position x, y, z and quaternion x, y, z, w."""
    p, q = t.translation, t.rotation
    return [p.x, p.y, p.z, q.x, q.y, q.z, q.w]


def inertial(m: Any) -> list[float]:
    """Return a ROS 2 Imu message as a row of seven numbers: acceleration x, y, z and quaternion x, y, z, w. What its
    covariance marks as not measured (-1) is NaN.
    """
    a, q = m.linear_acceleration, m.orientation
    acceleration = [a.x, a.y, a.z] if m.linear_acceleration_covariance[0] != -1 else [float("nan")] * 3
    turned = m.orientation_covariance[0] != -1 and any((q.x, q.y, q.z, q.w))
    return [*acceleration, *([q.x, q.y, q.z, q.w] if turned else [float("nan")] * 4)]


def cloud(m: Any) -> list[list[float]]:
    """Return the points of a ROS 2 PointCloud2 message as rows of seven numbers: x, y, z and four NaN for the missing
    quaternion.
    """
    layout = {f.name: (f.offset, FLOATS.get(f.datatype)) for f in m.fields}
    if not {"x", "y", "z"} <= set(layout) or None in {layout[a][1] for a in "xyz"}:
        raise Refused("a PointCloud2 message has no x, y and z as floating-point numbers")
    order, size = ">" if m.is_bigendian else "<", m.width * m.point_step
    beyond = any(offset + bytes_of > m.point_step for offset, bytes_of in (layout[a] for a in "xyz"))
    if m.data.size < m.height * m.row_step or m.row_step < size or beyond:
        raise Refused("a PointCloud2 message has fewer bytes than its points need")
    rows = m.data[: m.height * m.row_step].reshape(m.height, m.row_step)[:, :size].reshape(-1, m.point_step)
    columns = [np.ascontiguousarray(rows[:, offset : offset + bytes_of]).view(f"{order}f{bytes_of}")[:, 0]
               for offset, bytes_of in (layout[a] for a in "xyz")]  # fmt: skip
    return [[x, y, z, *[float("nan")] * 4] for x, y, z in zip(*(c.tolist() for c in columns), strict=True)]


FLOATS = {7: 4, 8: 8}  # PointField.datatype -> bytes, of floating-point numbers
ARRAYS = ("std_msgs/msg/Float64MultiArray", "std_msgs/msg/Float32MultiArray")
NUMBERS = ("sensor_msgs/msg/FluidPressure", "std_msgs/msg/Float64", "std_msgs/msg/Float32", *ARRAYS)
ROWS = {  # type of message -> its rows of numbers, a pose or a number each
    "geometry_msgs/msg/PoseStamped": lambda m: [pose(m.pose)],
    "geometry_msgs/msg/PoseArray": lambda m: [pose(p) for p in m.poses],
    "geometry_msgs/msg/PointStamped": lambda m: [point(m.point)],
    "geometry_msgs/msg/TransformStamped": lambda m: [transform(m.transform)],
    "nav_msgs/msg/Odometry": lambda m: [pose(m.pose.pose)],
    "geometry_msgs/msg/PoseWithCovarianceStamped": lambda m: [pose(m.pose.pose)],
    "sensor_msgs/msg/Imu": lambda m: [inertial(m)],
    "sensor_msgs/msg/PointCloud": lambda m: [point(p) for p in m.points],
    "sensor_msgs/msg/PointCloud2": cloud,
    "sensor_msgs/msg/FluidPressure": lambda m: [[m.fluid_pressure]],
    "std_msgs/msg/Float64": lambda m: [[m.data]],
    "std_msgs/msg/Float32": lambda m: [[m.data]],
    **dict.fromkeys(ARRAYS, lambda m: [[float(x)] for x in m.data]),
}


MCAP = b"\x89MCAP0\r\n"  # begin and end of an MCAP file
FOOTER = bytes([2, 20, *[0] * 27]) + MCAP  # end of an MCAP file without an index
RECORDS = range(1, 16)  # opcodes of the records of MCAP
TRANSFORMS = "tf2_msgs/msg/TFMessage"
FIXED = 1e-6  # m, and of a unit quaternion: a transform that changes by less is constant


def stamp_of(message: Any) -> int:
    """Return the time [ns] in the header of a ROS 2 message; 0 without a header, or where the header states none."""
    header = getattr(message, "header", None)
    return 0 if header is None else int(header.stamp.sec * 10**9 + header.stamp.nanosec)


def frame_of(message: Any) -> str:
    """Return the name of the coordinate frame in the header of a ROS 2 message, "" without a header."""
    return str(message.header.frame_id).removeprefix("/") if hasattr(message, "header") else ""


def defined_as_in_ros(connection: Any) -> bool:
    """Return whether the bag defines the message type of a topic as ROS 2 does, or not at all."""
    definition, name = connection.msgdef, connection.msgtype
    if definition.format == MessageDefinitionFormat.NONE:
        return True
    try:
        definitions = get_types_from_msg(definition.data, name)
    except TypesysError:
        return False
    return bool(definitions) and all(fields == STORE.fielddefs.get(kind) for kind, fields in definitions.items())


class Messages:
    """The messages of one topic that holds poses, points or numbers, as they are read."""

    def __init__(self, kind: str) -> None:
        self.kind, self.read = kind, 0
        self.stamps: list[int] = []
        self.received: list[int] = []
        self.rows: list[list[list[float]]] = []
        self.frame = ""

    def add(self, message: Any, received: int) -> None:
        """Add a message that was received at a time [ns]; raise Refused where it does not fit the others."""
        row, frame = ROWS[self.kind](message), frame_of(message)
        if self.rows and len(row) != len(self.rows[0]):
            raise Refused("it has a varying number of points per message")
        if self.rows and frame != self.frame:
            raise Refused(f"its coordinate frame changes from {self.frame[:60]!r} to {frame[:60]!r}")
        self.frame = frame
        self.stamps.append(stamp_of(message))
        self.received.append(received)
        self.rows.append(row)


class Transforms:
    """The transforms between coordinate frames in a bag: the pose of each child frame in its parent frame."""

    def __init__(self) -> None:
        self.poses: dict[tuple[str, str], list[float]] = {}
        self.moving: set[tuple[str, str]] = set()

    def add(self, message: Any) -> None:
        """Add the transforms of a message. One that differs from an earlier one is marked as moving."""
        for entry in message.transforms:
            edge = (frame_of(entry), str(entry.child_frame_id).removeprefix("/"))
            t, q = entry.transform.translation, entry.transform.rotation
            pose_of = [t.x, t.y, t.z, q.x, q.y, q.z, q.w]
            first = self.poses.setdefault(edge, pose_of)
            if max(abs(a - b) for a, b in zip(first, pose_of, strict=True)) > FIXED:
                self.moving.add(edge)

    def listed(self) -> list[dict[str, Any]]:
        """Return the transforms as a list of dicts: parent, child, pose (7 numbers), moving."""
        return [{"parent": parent, "child": child, "pose": numbers, "moving": (parent, child) in self.moving}
                for (parent, child), numbers in self.poses.items()]  # fmt: skip


def read(path: str, *named: str) -> Content:
    """Read the topics of a ROS 2 bag that hold poses, points or numbers, arrays of numbers only of the topics `named`,
    as others may be large. Return for each topic the header stamps and
    times of reception (M,) [ns] of its M messages (a stamp is 0 where there is none), and their values (M, R, 7) or
    (M, R, 1): R poses of 7 numbers, or R single numbers, per message.

    The facts hold for each topic its coordinate frame and the number of messages that the bag states; the transforms
    between frames; the names of all other topics; for each topic that cannot be read the reason; and of an MCAP file
    that was cut the number of its bytes, at least those up to an end, and of those in whole records.
    """
    size, whole = Path(path).stat().st_size, whole_records(Path(path))
    if not whole:
        return content_of(Path(path), named)
    with tempfile.TemporaryDirectory() as folder:
        mended = Path(folder) / "whole.mcap"
        with Path(path).open("rb") as file:
            mended.write_bytes(file.read(whole) + FOOTER)
        arrays, facts = content_of(mended, named)
    return arrays, {**facts, "cut": [max(size, whole + len(FOOTER)), whole]}


def whole_records(path: Path) -> int:
    """Return the number of bytes up to the end of the last whole record of an MCAP file that was cut, as by a loss of
    power; 0 for a file that ends as it should, and for other files.
    """
    if path.is_dir() or path.suffix.lower() != ".mcap":
        return 0
    with path.open("rb") as file:
        size = file.seek(0, 2)
        file.seek(max(0, size - len(MCAP)))
        ends = file.read() == MCAP
        file.seek(0)
        if ends or file.read(len(MCAP)) != MCAP:
            return 0
        end = len(MCAP)
        while len(head := file.read(9)) == 9 and head[0] in RECORDS:
            behind = end + 9 + int.from_bytes(head[1:], "little")
            if behind > size:
                break
            end = file.seek(behind)
    return end


def content_of(path: Path, named: Sequence[str]) -> Content:
    """Return the arrays and facts of an undamaged bag; see `read`."""
    with Reader(path) as bag:
        kinds = {c.topic: c.msgtype for c in bag.connections
                 if c.msgtype in ROWS and (c.msgtype not in ARRAYS or c.topic in named)}  # fmt: skip
        others = sorted({c.topic for c in bag.connections if c.msgtype != TRANSFORMS} - set(kinds))
        unread = {c.topic: f"the bag defines {c.msgtype} differently from ROS 2"
                  for c in bag.connections if c.topic in kinds and not defined_as_in_ros(c)}  # fmt: skip
        stated = {t: sum(c.msgcount for c in bag.connections if c.topic == t and c.msgtype == kinds[t]) for t in kinds}
        topics, transforms = {topic: Messages(kind) for topic, kind in kinds.items()}, Transforms()
        wanted = [c for c in bag.connections if (c.topic in kinds and c.msgtype == kinds[c.topic]
                  and c.topic not in unread) or (c.msgtype == TRANSFORMS and defined_as_in_ros(c))]  # fmt: skip
        for connection, received, raw in bag.messages(connections=wanted) if wanted else ():
            if connection.msgtype == TRANSFORMS:
                transforms.add(STORE.deserialize_cdr(raw, TRANSFORMS))
                continue
            topic = topics[connection.topic]
            topic.read += 1
            if connection.topic in unread:
                continue
            try:
                topic.add(STORE.deserialize_cdr(raw, connection.msgtype), received)
            except Refused as refused:
                unread[connection.topic] = str(refused)
                topic.rows.clear()
        arrays, listed = tabulated(topics, stated, metadata_counts(path))
        total = sum(connection.msgcount for connection in bag.connections)
    return arrays, {"topics": listed, "others": others, "unread": unread, "transforms": transforms.listed(),
                    "messages": total}  # fmt: skip


def tabulated(
    topics: dict[str, Messages], stated: dict[str, int], beside: dict[str, int]
) -> tuple[dict[str, np.ndarray], list[dict[str, Any]]]:
    """Return the arrays of the topics by key, and for each topic a dict of its facts. `stated` and `beside` are the
    numbers of messages that the bag and the file of metadata beside it state.
    """
    arrays: dict[str, np.ndarray] = {}
    listed = []
    for k, (name, topic) in enumerate(topics.items()):
        if not topic.rows and not (stated[name] and not topic.read):
            continue
        arrays[f"t{k}"], arrays[f"r{k}"] = (np.array(v, np.int64) for v in (topic.stamps, topic.received))
        width = 1 if topic.kind in NUMBERS else 7
        arrays[f"v{k}"] = np.array(topic.rows, np.float64) if topic.rows else np.zeros((0, 1, width))
        listed.append({"name": name, "type": topic.kind, "stamps": f"t{k}", "received": f"r{k}", "rows": f"v{k}",
                       "frame": topic.frame, "stated": stated[name], "beside": beside.get(name, 0),
                       "read": topic.read})  # fmt: skip
    return arrays, listed


def metadata_counts(path: Path) -> dict[str, int]:
    """Return the number of messages of each topic that `metadata.yaml` beside a bag of a single file states; empty
    where there is none, or where it describes other files.
    """
    beside = path.parent / "metadata.yaml"
    if path.is_dir() or not beside.is_file():
        return {}
    try:
        facts = YAML(typ="safe").load(beside.read_text(encoding="utf-8"))["rosbag2_bagfile_information"]
        files = [Path(name).name for name in facts["relative_file_paths"]]
        counts = {str(entry["topic_metadata"]["name"]): int(entry["message_count"])
                  for entry in facts["topics_with_message_count"]}  # fmt: skip
    except (OSError, ValueError, KeyError, TypeError, AttributeError, YAMLError):
        return {}
    return counts if files == [path.name] else {}
