"""Reader of ROS 2 bags (a folder, .mcap, .db3) and MCAP files, by rosbags (extra ``ros``) in a separate process.

Poses and points become stations, pressures become the pressure of chambers. Times are those of the message headers, or
the times of reception where the messages of a topic have no header or no stamp in it. Stations in other coordinate
frames are transformed into that of the first station by the constant transforms of the bag (tf). Known types:
PoseStamped, PoseWithCovarianceStamped, PoseArray, TransformStamped, Odometry, PointStamped, PointCloud, PointCloud2,
Imu, FluidPressure, Float64, Float32 and, where `pressure` names them, arrays of these. A FluidPressure is absolute:
subtract the ambient pressure by ``linear.pressure``.
"""

from __future__ import annotations

from importlib.util import find_spec
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

import numpy as np
from pydantic import Field

from pliant.errors import InputError, clipped, inside
from pliant.recording.apart import read_apart
from pliant.recording.bag_frames import FramePose, FrameTree, in_one_frame
from pliant.recording.clock import usual_step, without_repeats
from pliant.recording.inclination import InclinationMapping, gravity_rows, turning_angles
from pliant.recording.mapping import FileMapping, shorten
from pliant.recording.registry import ENDINGS, Reader, begins_with
from pliant.recording.schema import make_recording
from pliant.recording.stated import WARNING, Reading, Stated, judge_stated
from pliant.units import metre_per, pascal_per

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from numpy.typing import NDArray

IMU, FLUID = "sensor_msgs/msg/Imu", "sensor_msgs/msg/FluidPressure"
TOGETHER = 0.5  # of the frame interval: messages of two topics that are closer in time belong to one frame


class BagMapping(FileMapping):
    """Options of the reader of ROS 2 bags: topics of stations and pressures, units, clock and coordinate frames.

    Attributes
    ----------
    topics : dict of str, optional
        Topic of each station, from base to tip. The points of an array or a cloud become numbered stations:
        ``name_000``. Default: all topics of poses and points, named by the last part of the topic.
    pressure : dict of str, optional
        Topic of each chamber. Default: all topics of FluidPressure.
    angles : dict of str, optional
        Topic of Imu messages of each sensor, from base to tip, for a body that bends in a plane. Default: all topics of
        Imu, where the bag has no poses or points.
    inclination : InclinationMapping, optional
        For Imu sensors on a body in space: takes the direction of gravity in the axes of the links in place of angles
        in a plane.
    arc_length : list of float, m, optional
        Arc length of each of these sensors.
    pressure_unit : str, optional
        Unit of topics with plain numbers; a FluidPressure is in Pa.
    length_unit : str
        Unit of the positions; the ROS convention is metres.
    clock : {"header", "reception"}
        Times that are used. Default: those of the headers, for each topic that has them.
    frame : str, optional
        Coordinate frame of the positions. Default: that of the first station.
    transforms : dict of FramePose, optional
        Pose of other coordinate frames in that frame, where the bag holds no transform.
    """

    topics: dict[str, str] | None = None
    angles: dict[str, str] | None = None
    inclination: InclinationMapping | None = None
    arc_length: list[float] | None = None
    pressure: dict[str, str] | None = None
    pressure_unit: str | None = None
    length_unit: str = "m"
    clock: Literal["header", "reception"] = "header"
    frame: str | None = None
    transforms: dict[str, FramePose] = Field(default={})


class Topic(NamedTuple):
    """Messages of one ROS 2 topic: its name and type, the times (M,) [ns] of M messages, and their values (M, R, 7) or
    (M, R, 1), which are R poses of 7 numbers, or R single numbers, per message.

    `clock` says what the times are, `delay` is the median time [s] from the stamp of a header to the reception of its
    message (NaN without stamps), `unstamped` the number of messages without a stamp.
    """

    name: str
    kind: str
    stamps: NDArray[np.int64]
    rows: NDArray[np.float64]
    frame: str = ""
    clock: Literal["header", "reception"] = "header"
    delay: float = float("nan")
    unstamped: int = 0


def topic_of(facts: Mapping[str, Any], arrays: Mapping[str, NDArray], clock: str) -> Topic:
    """Return a topic with the times of the headers or, where `clock` says so or no header has a stamp, of reception."""
    stamps, received = arrays[facts["stamps"]], arrays[facts["received"]]
    stamped = stamps != 0
    delay = 1e-9 * float(np.median(received[stamped] - stamps[stamped])) if stamped.any() else float("nan")
    by_header = clock == "header" and bool(stamped.any())
    return Topic(facts["name"], facts["type"], stamps if by_header else received, arrays[facts["rows"]],
                 facts["frame"], "header" if by_header else "reception", delay, int((~stamped).sum()))  # fmt: skip


def read_bag(path: Path, mapping: Mapping[str, Any] | None = None) -> Reading:
    """Read the stations and pressures of a ROS 2 bag or MCAP file and return them as a recording."""
    options = BagMapping.load(mapping, path.name)
    if find_spec("rosbags") is None:
        raise InputError(f"{path.name}: ROS 2 bags need rosbags, which is not installed: pip install 'pliant[ros]'")
    arrays, facts = read_apart("bag", path, "ROS 2 bag", [*(options.pressure or {}).values()])
    cut = cut_short(facts, path.name)
    topics = {t["name"]: topic_of(t, arrays, options.clock) for t in facts["topics"]}
    unread = [f"topic {topic[:60]} cannot be read: {reason}" for topic, reason in facts["unread"].items()]
    stations = {} if options.angles or options.inclination else chosen(topics, options.topics, last_parts(
        {n: t for n, t in topics.items() if t.rows.shape[2] == 7 and t.kind != IMU}), facts["unread"], path.name)
    turning = bool(options.angles or options.inclination) or not stations
    if turning:
        sensors = last_parts({n: t for n, t in topics.items() if t.kind == IMU})
        stations = chosen(topics, options.angles, sensors, facts["unread"], path.name)
    fluids = last_parts({n: t for n, t in topics.items() if t.kind == FLUID})
    pressures = chosen(topics, options.pressure, fluids, facts["unread"], path.name)
    if not stations and not pressures:
        listed = "; ".join([shorten([*topics, *facts["others"]]) or "none", *unread])
        raise InputError(f"{path.name} has no topic of poses, points, Imu or FluidPressure: name the topics in its "
                         f"mapping; it has {listed}")
    stated = cut + [Stated(f"messages of {t['name'][:60]}", where, t[key], t["read"]) for t in facts["topics"]
              for key, where in (("stated", "its index"), ("beside", "metadata.yaml")) if t[key]]  # fmt: skip
    if empty := [t.name for t in (*stations.values(), *pressures.values()) if not len(t.stamps)]:
        raise InputError(f"{path.name} states messages of topic {clipped(empty[0])!r}, but none can be read: the bag "
                         "is damaged, so copy or record it again")
    history = compared_clocks(stations, pressures, path.name)
    origin = min(t.stamps.min() for t in (*stations.values(), *pressures.values()))
    history = [f"0 s is {origin / 1e9:.3f} s of the ROS clock", *history]
    left = [*(n for n, t in topics.items() if not any(t is u for u in (*stations.values(), *pressures.values()))),
            *facts["others"]]  # fmt: skip
    history += [f"{len(left)} topic(s) of {path.name} were not used: {shorten(left)}"] if left else []
    stations, transformed = (stations, []) if turning else placed(stations, options, facts["transforms"], path.name)
    arrays_of, findings = frames_of(stations, origin, metre_per(options.length_unit), path.name)
    if turning and stations:
        arrays_of, more = turned(arrays_of, stations, options, path.name)
        findings += more
    with inside(path.name):
        return Reading(make_recording(
            **arrays_of, **pressures_of(pressures, origin, options.pressure_unit, path.name),
            history=[*history, *transformed, *(f"{text}; it is left out" for text in unread), *findings],
        ), tuple(stated))  # fmt: skip


def cut_short(facts: Mapping[str, Any], file: str) -> list[Stated]:
    """Return the comparison of the size of a bag that was cut with its whole records; [] for another bag. Raise
    InputError where these hold no topic.
    """
    cut = [Stated("bytes of whole records and an end", "its size", *facts["cut"])] if "cut" in facts else []
    if not facts["topics"]:
        judge_stated(cut, file)
    if not facts["messages"]:
        raise InputError(f"{file} holds no whole message: nothing was recorded, or the file was cut before the first; "
                         "record it again")
    return cut


def last_parts(topics: Mapping[str, Topic]) -> dict[str, str]:
    """Return the names of topics by the last part of each name or, where these are equal, the last two or more."""
    names: dict[str, str] = {}
    for name in topics:
        parts = name.strip("/").split("/")
        count = next((k for k in range(1, len(parts)) if sum(other.strip("/").split("/")[-k:] == parts[-k:]
                                                             for other in topics) == 1), len(parts))  # fmt: skip
        names["_".join(parts[-count:])] = name
    return names


def turned(
    arrays: Mapping[str, Any], sensors: Mapping[str, Topic], options: BagMapping, file: str
) -> tuple[dict[str, Any], list[str]]:
    """Return the arguments of `make_recording` for Imu sensors, and sentences for the history: the angles of a body
    that bends in a plane or, if the mapping describes the sensors, the direction of gravity in the axes of the links.
    The orientation of a sensor is used where its messages hold one, otherwise its acceleration.
    """
    if strange := [topic.name for topic in sensors.values() if topic.kind != IMU]:
        raise InputError(f"topic {clipped(strange[0])!r} of {file} holds no Imu messages: correct angles in its "
                         "mapping")
    measured = {}
    for s, name in enumerate(sensors):
        quaternion = arrays["quaternion"][:, s] if "quaternion" in arrays else np.full((1, 4), np.nan)
        measured[name] = quaternion if np.isfinite(quaternion).any() else arrays["position"][:, s]
    if options.inclination is not None:
        by_link, history = gravity_rows(measured, options.inclination, file)
        return {"time": arrays["time"], "arc_length": options.arc_length, **by_link}, history
    angle, history = turning_angles(measured, file)
    return {"time": arrays["time"], "angle": angle, "station": list(sensors), "frame": "planar",
            "arc_length": options.arc_length}, history  # fmt: skip


def placed(
    stations: Mapping[str, Topic], options: BagMapping, transforms: list[dict[str, Any]], file: str
) -> tuple[dict[str, Topic], list[str]]:
    """Return the topics of the stations with their poses in one coordinate frame, and lines for the history."""
    posed = {name: topic for name, topic in stations.items() if topic.rows.shape[2] == 7}
    tree = FrameTree(transforms, metre_per(options.length_unit), file)
    target = options.frame if options.frame is not None or not posed else next(iter(posed.values())).frame
    for frame, pose in options.transforms.items():
        tree.add(str(target), frame.removeprefix("/"), np.array(pose.position), np.array(pose.quaternion))
    rows, history = in_one_frame({name: (t.frame, t.rows) for name, t in posed.items()}, tree, options.frame)
    return {name: t._replace(rows=rows.get(name, t.rows)) for name, t in stations.items()}, history


def compared_clocks(stations: Mapping[str, Topic], pressures: Mapping[str, Topic], file: str) -> list[str]:
    """Return lines for the history that name the clock of each channel.

    Raises
    ------
    InputError
        When only some messages of a topic have a stamp, or the times of two topics have nothing in common.
    """
    topics = {**pressures, **stations}
    remedy = 'set clock = "reception" in its mapping to use the times of reception of all topics'
    for topic in topics.values():
        if topic.clock == "header" and topic.unstamped:
            raise InputError(f"{topic.unstamped} of {len(topic.stamps)} messages of topic {clipped(topic.name)} of "
                             f"{file} have no stamp in their header (it is 0): {remedy}")
    first = next(iter((stations or pressures).values()))
    for topic in topics.values():
        if topic.stamps.max() < first.stamps.min() or topic.stamps.min() > first.stamps.max():
            raise InputError(f"topics {_span(first)} and {_span(topic)} of {file} have no time in common, so their "
                             f"clocks are different: {remedy}, or choose other topics")
    said = []
    for clock, words in (("header", "the message headers"), ("reception", "reception")):
        names = [clipped(name, 40) for name, topic in topics.items() if topic.clock == clock]
        blank = [clipped(n, 40) for n, t in topics.items() if t.clock == clock == "reception" and np.isnan(t.delay)]
        why = f" (no stamp in the messages of {shorten(blank, 6)})" if blank else ""
        said += [f"clock of {shorten(names, 6)}: times of {words}{why}"] if names else []
    delays = [t.delay for t in topics.values() if t.clock == "header"]
    step = usual_step(1e-9 * np.sort(first.stamps - first.stamps.min()))
    if len(said) > 1 and abs(float(np.median(delays))) > (step if np.isfinite(step) else 0.0):
        said.append(f"{WARNING}two clocks are joined: where both are known, reception is {np.median(delays):.4g} s "
                    "after the stamp in the header; estimate the offset by `pliant sync`")
    return said


def _span(topic: Topic) -> str:
    low, high = 1e-9 * topic.stamps.min(), 1e-9 * topic.stamps.max()
    return f"{clipped(topic.name, 60)} ({topic.clock}, {low:.3f} to {high:.3f} s)"


def chosen(
    topics: Mapping[str, Topic], named: Mapping[str, str] | None, default: Mapping[str, str],
    unread: Mapping[str, str], file: str,
) -> dict[str, Topic]:
    """Return a dict from the name of each station or chamber to the messages of its topic. `named` is a dict from these
    names to topics. If it is None or empty, the dict `default` is used. `unread` holds for each topic that cannot be
    read the reason.
    """
    for topic in (named or {}).values():
        if topic in unread:
            raise InputError(f"{file}: topic {clipped(topic)!r} cannot be read: {unread[topic]}. Choose another topic "
                             "in its mapping")
        if topic not in topics:
            raise InputError(f"{file} has no topic {clipped(topic)!r} of a known type: choose in its mapping among "
                             f"{shorten(list(topics))}")
    return {name: topics[topic] for name, topic in (named or default).items()}


def frames_of(
    stations: Mapping[str, Topic], origin: int, scale: float, file: str
) -> tuple[dict[str, Any], list[str]]:
    """Return a dict of time [s], position [m] and quaternion of all stations at the message times of the first station,
    and sentences for the history.
    """
    if not stations:
        return {}, []
    first = next(iter(stations.values()))
    keep, findings = without_repeats(1e-9 * (first.stamps - origin), file)
    time = (1e-9 * (first.stamps - origin))[keep]
    reach = TOGETHER * float(np.median(np.diff(time))) if time.size > 1 else np.inf
    columns, names = [], []
    for name, topic in stations.items():
        if topic.rows.shape[2] != 7:
            raise InputError(f"topic of station {clipped(name)} of {file} holds numbers, not positions: choose a "
                             "topic of poses or points")
        stamp_s = 1e-9 * (topic.stamps - origin)
        order = np.argsort(stamp_s, kind="stable")
        nearest = order[nearest_in(stamp_s[order], time)]
        near = np.abs(stamp_s[nearest] - time) <= reach
        columns.append(np.where(near[:, None, None], topic.rows[nearest], np.nan))
        findings += [f"{int((~near).sum())} frame(s) have no message of {name} and are gaps"] if not near.all() else []
        count = topic.rows.shape[1]
        names += [name] if count == 1 else [f"{name}_{k:03d}" for k in range(count)]
    rows = np.concatenate(columns, axis=1)
    arrays: dict[str, Any] = {"time": time, "position": scale * rows[..., :3], "station": names}
    if not np.isnan(rows[..., 3:]).all():
        arrays["quaternion"] = rows[..., 3:]
    return arrays, findings


def nearest_in(ordered: NDArray, wanted: NDArray) -> NDArray:
    """Return, for each time in `wanted`, the index of the nearest time in `ordered`, whose times ascend."""
    after = np.clip(np.searchsorted(ordered, wanted), 1, max(len(ordered) - 1, 1))
    before = after - 1
    after = np.minimum(after, len(ordered) - 1)
    return np.where(wanted - ordered[before] <= ordered[after] - wanted, before, after)


def pressures_of(
    pressures: Mapping[str, Topic], origin: int, unit: str | None, file: str
) -> dict[str, Any]:
    """Return the pressures [Pa] of all chambers at the message times of the first chamber. The pressures of the other
    chambers are interpolated to these times.
    """
    if not pressures:
        return {}
    clock, values, names = None, [], list[str]()
    for name, topic in pressures.items():
        if topic.rows.shape[2] != 1:
            raise InputError(f"topic of chamber {clipped(name)} of {file} holds no numbers: choose a topic of "
                             "pressures or plain numbers")
        if topic.kind != FLUID and unit is None:
            raise InputError(f"topic of chamber {clipped(name)} of {file} holds plain numbers: set pressure_unit in "
                             "its mapping")
        stamp_s = 1e-9 * (topic.stamps - origin)
        keep, _ = without_repeats(stamp_s, file)
        clock = stamp_s[keep] if clock is None else clock
        scale = 1.0 if topic.kind == FLUID else pascal_per(str(unit))
        numbers = scale * topic.rows[keep, :, 0]
        values += [np.interp(clock, stamp_s[keep], column) for column in numbers.T]
        names += [name] if numbers.shape[1] == 1 else [f"{name}_{k}" for k in range(numbers.shape[1])]
    chamber = names if len(names) > 1 else None
    return {"pressure_time": clock, "pressure": np.stack(values, axis=1), "chamber": chamber}


READER = Reader("bag", ENDINGS["bag"], read_bag, begins_with(b"\x89MCAP0\r\n", b"SQLite format 3\0"))
