"""Read poses, points and pressures of a ROS 2 bag (.mcap, .db3) by rosbags, in a separate process.

Messages are decoded by the definitions in rosbags. The definitions in the bag are only compared with those, because
rosbags would generate and run Python code from them. A bag whose definition of a known message differs is refused.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from rosbags.interfaces import MessageDefinitionFormat
from rosbags.rosbag2 import Reader
from rosbags.typesys import Stores, TypesysError, get_types_from_msg, get_typestore

from pliant.recording.apart_worker import Content, Refused

STORE = get_typestore(Stores.ROS2_JAZZY)


def point(p: Any) -> list[float]:
    """Return a ROS 2 point as a row of seven numbers: x, y, z and four NaN for the missing quaternion."""
    return [p.x, p.y, p.z, *[float("nan")] * 4]


def pose(p: Any) -> list[float]:
    """Return a ROS 2 pose as a row of seven numbers: position x, y, z and quaternion x, y, z, w."""
    q = p.orientation
    return [p.position.x, p.position.y, p.position.z, q.x, q.y, q.z, q.w]


def cloud(m: Any) -> list[list[float]]:
    """Return the points of a ROS 2 PointCloud2 message as rows of seven numbers: x, y, z and four NaN for the missing
    quaternion.
    """
    places = {f.name: (f.offset, FLOATS.get(f.datatype)) for f in m.fields}
    if not {"x", "y", "z"} <= set(places) or None in {places[a][1] for a in "xyz"}:
        raise Refused("a PointCloud2 message has no x, y and z as floating-point numbers")
    order, size = ">" if m.is_bigendian else "<", m.width * m.point_step
    beyond = any(at + bytes_of > m.point_step for at, bytes_of in (places[a] for a in "xyz"))
    if m.data.size < m.height * m.row_step or m.row_step < size or beyond:
        raise Refused("a PointCloud2 message has fewer bytes than its points need")
    rows = m.data[: m.height * m.row_step].reshape(m.height, m.row_step)[:, :size].reshape(-1, m.point_step)
    columns = [np.ascontiguousarray(rows[:, at : at + bytes_of]).view(f"{order}f{bytes_of}")[:, 0]
               for at, bytes_of in (places[a] for a in "xyz")]  # fmt: skip
    return [[x, y, z, *[float("nan")] * 4] for x, y, z in zip(*(c.tolist() for c in columns), strict=True)]


FLOATS = {7: 4, 8: 8}  # PointField.datatype -> bytes, of floating-point numbers
ROWS = {  # type of message -> its rows of numbers, a pose or a number each
    "geometry_msgs/msg/PoseStamped": lambda m: [pose(m.pose)],
    "geometry_msgs/msg/PoseArray": lambda m: [pose(p) for p in m.poses],
    "geometry_msgs/msg/PointStamped": lambda m: [point(m.point)],
    "sensor_msgs/msg/PointCloud": lambda m: [point(p) for p in m.points],
    "sensor_msgs/msg/PointCloud2": cloud,
    "sensor_msgs/msg/FluidPressure": lambda m: [[m.fluid_pressure]],
    "std_msgs/msg/Float64": lambda m: [[m.data]],
    "std_msgs/msg/Float32": lambda m: [[m.data]],
}


def stamp_of(message: Any, received: int) -> int:
    """Return the time [ns] in the header of a ROS 2 message; without a header, the time of reception."""
    header = getattr(message, "header", None)
    stamp = 0 if header is None else header.stamp.sec * 10**9 + header.stamp.nanosec
    return int(stamp or received)


def defined_as_in_ros(connection: Any) -> bool:
    """Return whether the bag defines the message type of a topic as ROS 2 does, or not at all."""
    definition, name = connection.msgdef, connection.msgtype
    if definition.format == MessageDefinitionFormat.NONE:
        return True
    try:
        found = get_types_from_msg(definition.data, name)
    except TypesysError:
        return False
    return bool(found) and all(fields == STORE.fielddefs.get(kind) for kind, fields in found.items())


def read(path: str) -> Content:
    """Read the topics of a ROS 2 bag that hold poses, points or numbers. Return for each topic the times (M,) [ns] of
    its M messages and their values (M, R, 7) or (M, R, 1): R poses of 7 numbers, or R single numbers, per message. Also
    return the names of all other topics, and for each topic that cannot be read the reason.
    """
    with Reader(Path(path)) as bag:
        known = {c.topic: c for c in bag.connections if c.msgtype in ROWS}
        others = sorted({c.topic for c in bag.connections} - set(known))
        unread = {c.topic: f"the bag defines {c.msgtype} differently from ROS 2"
                  for c in bag.connections if c.topic in known and not defined_as_in_ros(c)}  # fmt: skip
        stamps: dict[str, list[int]] = {topic: [] for topic in known}
        rows: dict[str, list[list[list[float]]]] = {topic: [] for topic in known}
        wanted = [c for c in bag.connections if c.topic in known and c.topic not in unread]
        for connection, received, raw in bag.messages(connections=wanted) if wanted else ():
            topic = connection.topic
            if topic in unread:
                continue
            message = STORE.deserialize_cdr(raw, connection.msgtype)
            try:
                row = ROWS[connection.msgtype](message)
            except Refused as refused:
                unread[topic] = str(refused)
            else:
                if rows[topic] and len(row) != len(rows[topic][0]):
                    unread[topic] = "it has a varying number of points per message"
                stamps[topic].append(stamp_of(message, received))
                rows[topic].append(row)
            if topic in unread:
                rows[topic].clear()
    arrays: dict[str, np.ndarray] = {}
    topics = []
    for k, topic in enumerate(rows):
        if rows[topic]:
            arrays[f"t{k}"], arrays[f"v{k}"] = np.array(stamps[topic], np.int64), np.array(rows[topic], np.float64)
            topics.append({"name": topic, "type": known[topic].msgtype, "times": f"t{k}", "rows": f"v{k}"})
    return arrays, {"topics": topics, "others": others, "unread": unread}
