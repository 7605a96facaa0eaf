"""Writer of an MCAP file of ROS 2 messages: measured stations, the model's stations and body, and inputs over time.

Foxglove and Rerun open such files. The messages are written with rosbags (extra ``ros``). Points are float32, in m.
"""

from __future__ import annotations

import json
import re
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from pliant.errors import InputError
from pliant.files import whole
from pliant.validation.sides import Side, Sides
from pliant.version import __version__

Array = np.ndarray
FRAME, WORLD = "base", "world"
PAUSE = 1.0  # s, pause between two recordings in a file
WIDTH, COLOUR = 0.003, (0.1, 0.25, 0.6)  # of the line through the model's body: m; red, green, blue
CLOUD, MARKER = "sensor_msgs/msg/PointCloud2", "visualization_msgs/msg/Marker"
NUMBER, TEXT, FRAMES = "std_msgs/msg/Float64", "std_msgs/msg/String", "tf2_msgs/msg/TFMessage"
FLOAT32, LINE_STRIP = 7, 4  # values of PointField.datatype and of Marker.type


class RosFile:
    """A writer of ROS 2 messages to topics of one MCAP file.

    Parameters
    ----------
    folder : Path
        Folder that rosbags creates for the file; it must not exist.
    """

    def __init__(self, folder: Path) -> None:
        from rosbags.rosbag2 import StoragePlugin, Writer
        from rosbags.typesys import Stores, get_typestore

        self.store = get_typestore(Stores.ROS2_JAZZY)
        self.writer = Writer(folder, version=9, storage_plugin=StoragePlugin.MCAP)
        self.topics: dict[str, Any] = {}

    def message(self, kind: str, **fields: Any) -> Any:
        """Return a ROS message of type `kind` with the given fields."""
        return self.store.types[kind](**fields)

    def header(self, nanoseconds: int) -> Any:
        """Return the header of a ROS message in the base frame at a time [ns]."""
        stamp = self.message("builtin_interfaces/msg/Time", sec=nanoseconds // 10**9, nanosec=nanoseconds % 10**9)
        return self.message("std_msgs/msg/Header", stamp=stamp, frame_id=FRAME)

    def write(self, topic: str, nanoseconds: int, kind: str, **fields: Any) -> None:
        """Write a message to a topic, which is created with its first message."""
        if topic not in self.topics:
            self.topics[topic] = self.writer.add_connection(topic, kind, typestore=self.store)
        raw = self.store.serialize_cdr(self.message(kind, **fields), kind)
        self.writer.write(self.topics[topic], nanoseconds, raw)

    def cloud(self, topic: str, nanoseconds: int, points: Array) -> None:
        """Write S points (S, 2) or (S, 3) [m] as a point cloud; NaN marks a point that was not measured."""
        row = in_three(points).astype("<f4")
        fields = [self.message("sensor_msgs/msg/PointField", name=axis, offset=4 * k, datatype=FLOAT32, count=1)
                  for k, axis in enumerate("xyz")]  # fmt: skip
        self.write(
            topic, nanoseconds, CLOUD, header=self.header(nanoseconds), height=1, width=len(row), fields=fields,
            is_bigendian=False, point_step=12, row_step=12 * len(row), data=np.frombuffer(row.tobytes(), np.uint8),
            is_dense=bool(np.isfinite(row).all()),
        )  # fmt: skip

    def line(self, topic: str, nanoseconds: int, points: Array) -> None:
        """Write a line through P points (P, 2) or (P, 3) [m] as a marker."""
        zero = {"x": 0.0, "y": 0.0, "z": 0.0}
        pose = self.message("geometry_msgs/msg/Pose", position=self.message("geometry_msgs/msg/Point", **zero),
                            orientation=self.message("geometry_msgs/msg/Quaternion", **zero, w=1.0))  # fmt: skip
        r, g, b = COLOUR
        corners = [self.message("geometry_msgs/msg/Point", x=x, y=y, z=z) for x, y, z in in_three(points).tolist()]
        self.write(
            topic, nanoseconds, MARKER, header=self.header(nanoseconds), ns="model", id=0, type=LINE_STRIP, action=0,
            pose=pose, scale=self.message("geometry_msgs/msg/Vector3", x=WIDTH, y=0.0, z=0.0),
            color=self.message("std_msgs/msg/ColorRGBA", r=r, g=g, b=b, a=1.0),
            lifetime=self.message("builtin_interfaces/msg/Duration", sec=0, nanosec=0), frame_locked=False,
            points=corners, colors=[], texture_resource="", uv_coordinates=[], text="", mesh_resource="",
            mesh_file=self.message("visualization_msgs/msg/MeshFile", filename="", data=np.zeros(0, np.uint8)),
            mesh_use_embedded_materials=False,
            texture=self.message("sensor_msgs/msg/CompressedImage", header=self.header(nanoseconds), format="",
                                 data=np.zeros(0, np.uint8)),
        )  # fmt: skip

    def frame(self, nanoseconds: int) -> None:
        """Write a transform by which the base frame equals the world frame, so that viewers have a frame to display."""
        turn = self.message("geometry_msgs/msg/Quaternion", x=0.0, y=0.0, z=0.0, w=1.0)
        move = self.message("geometry_msgs/msg/Vector3", x=0.0, y=0.0, z=0.0)
        header = self.message("std_msgs/msg/Header", stamp=self.header(nanoseconds).stamp, frame_id=WORLD)
        link = self.message("geometry_msgs/msg/TransformStamped", header=header, child_frame_id=FRAME,
                            transform=self.message("geometry_msgs/msg/Transform", translation=move, rotation=turn))
        self.write("/tf_static", nanoseconds, FRAMES, transforms=[link])


def write_mcap(sides: Sides, path: Path) -> tuple[str, ...]:
    """Write recordings, and the motion that the model predicts for them, one after another into one MCAP file,
    atomically.

    The topics are ``/measured/points`` and ``/model/points`` (clouds of the stations, base first), ``/model/joints``
    and ``/model/body`` (the chain of links), ``/input/NAME_UNIT`` (a number; gauge pressure in Pa), ``/record`` (name
    and role of the recording that begins) and ``/about`` (study, stations and units as JSON).

    Parameters
    ----------
    sides : Sides
    path : Path
        File to write, ending in ``.mcap``.

    Returns
    -------
    tuple of str
        Sentences with the start time of each recording [s].

    Raises
    ------
    InputError
        When the recordings hold angles and no positions, or the file cannot be written.
    """
    if path.suffix != ".mcap":
        raise InputError(f"the name of an MCAP file must end in .mcap, got {path.name!r}")
    if sides.turns:
        raise InputError("the recordings hold angles and no positions, which MCAP viewers cannot show: export to "
                         "lerobot instead")
    notes = []
    with whole(path) as draft, tempfile.TemporaryDirectory(dir=path.parent, prefix=".pliant-mcap-") as temporary:
        folder = Path(temporary) / "bag"
        file = RosFile(folder)
        with file.writer:
            begin = 1.0  # s; to ROS a time stamp of 0 means that there is none
            file.frame(nanoseconds_of(begin))
            about = {"study": sides.study, "title": sides.title, "fit": sides.fit, "pliant": __version__,
                     "stations": sides.stations, "frame": "base frame of the recording", "length_unit": "m",
                     "inputs": dict(zip(sides.inputs, sides.units, strict=True))}  # fmt: skip
            file.write("/about", nanoseconds_of(begin), TEXT, data=json.dumps(about))
            for side in sides.sides:
                write_side(file, side, dict(topics_of_inputs(sides)), begin)
                notes.append(f"{side.name} begins at {begin:.3f} s")
                begin += float(side.time[-1] - side.time[0]) + PAUSE
        next(folder.glob("*.mcap")).replace(draft)
    return tuple(notes)


def write_side(file: RosFile, side: Side, inputs: dict[str, int], begin: float) -> None:
    """Write the motion of one recording into the file, from the time `begin` [s] on. `inputs` maps each ROS topic to a
    column of the inputs.
    """
    file.write("/record", nanoseconds_of(begin), TEXT, data=f"{side.name} ({side.role.replace('_', ' ')})")
    for k, time in enumerate(side.time - side.time[0] + begin):
        stamps = nanoseconds_of(time)
        file.cloud("/measured/points", stamps, side.measured[k])
        file.cloud("/model/points", stamps, side.modelled[k])
        if side.body is not None:
            file.cloud("/model/joints", stamps, side.body[k])
            file.line("/model/body", stamps, side.body[k])
        for topic, column in inputs.items():
            file.write(topic, stamps, NUMBER, data=float(side.inputs[k, column]))


def topics_of_inputs(sides: Sides) -> Iterator[tuple[str, int]]:
    """Yield (ROS topic, column) for each input. The name of the topic is made from the name and the unit of the
    input.
    """
    taken: set[str] = set()
    for k, (name, unit) in enumerate(zip(sides.inputs, sides.units, strict=True)):
        plain = re.sub(r"[^A-Za-z0-9]+", "_", name).strip("_") or "pressure"
        plain = f"in_{plain}" if plain[0].isdigit() else plain
        topic = f"/input/{plain}_{unit.lower()}"
        yield (topic if topic not in taken else f"{topic}_{k}"), k
        taken.add(topic)


def in_three(points: Array) -> Array:
    """Return S points in a plane (S, 2) as (S, 3) [m] with z = 0; return points in space unchanged."""
    return points if points.shape[1] == 3 else np.column_stack([points, np.zeros(len(points))])


def nanoseconds_of(time: float) -> int:
    """Return a time [s] as an integer number of nanoseconds."""
    return round(1e9 * float(time))
