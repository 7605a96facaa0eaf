"""Reader of ROS 2 bags and MCAP files (.mcap, .db3), by rosbags (extra ``ros``) in a separate process.

Poses and points become stations, pressures become the pressure of chambers. Times are those of the message headers, or
the times of reception where a message has no header. Known types: PoseStamped, PoseArray, PointStamped, PointCloud,
PointCloud2, FluidPressure, Float64 and Float32. A FluidPressure is absolute: subtract the ambient pressure by
``linear.pressure``.
"""

from __future__ import annotations

from importlib.util import find_spec
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from pliant.errors import InputError, clipped, inside
from pliant.recording.apart import read_apart
from pliant.recording.clock import without_repeats
from pliant.recording.mapping import FileMapping, shorten
from pliant.recording.registry import ENDINGS, Reader, begins_with
from pliant.recording.schema import make_recording
from pliant.units import metre_per, pascal_per

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    import xarray as xr
    from numpy.typing import NDArray

FLUID, NUMBERS = "sensor_msgs/msg/FluidPressure", ("std_msgs/msg/Float64", "std_msgs/msg/Float32")
TOGETHER = 0.5  # of the frame interval: messages of two topics that are closer in time belong to one frame


class BagMapping(FileMapping):
    """Options of the reader of ROS 2 bags: the topics that hold stations and pressures, and their units.

    Attributes
    ----------
    topics : dict of str, optional
        Topic of each station, from base to tip. The points of an array or a cloud become numbered stations:
        ``name_000``. Default: all topics of poses and points, named by the last part of the topic.
    pressure : dict of str, optional
        Topic of each chamber. Default: all topics of FluidPressure.
    pressure_unit : str, optional
        Unit of topics with plain numbers; a FluidPressure is in Pa.
    length_unit : str
        Unit of the positions; the ROS convention is metres.
    """

    topics: dict[str, str] | None = None
    pressure: dict[str, str] | None = None
    pressure_unit: str | None = None
    length_unit: str = "m"


class Topic(NamedTuple):
    """Messages of one ROS 2 topic: its type, the times (M,) [ns] of M messages, and their values (M, R, 7) or (M, R,
    1), which are R poses of 7 numbers, or R single numbers, per message.
    """

    kind: str
    stamps: NDArray[np.int64]
    rows: NDArray[np.float64]


def read_bag(path: Path, mapping: Mapping[str, Any] | None = None) -> xr.Dataset:
    """Read the stations and pressures of a ROS 2 bag or MCAP file and return them as a recording."""
    options = BagMapping.load(mapping, path.name)
    if find_spec("rosbags") is None:
        raise InputError(f"{path.name}: ROS 2 bags need rosbags, which is not installed: pip install 'pliant[ros]'")
    arrays, facts = read_apart("bag", path, "ROS 2 bag")
    held = {t["name"]: Topic(t["type"], arrays[t["times"]], arrays[t["rows"]]) for t in facts["topics"]}
    unread = [f"topic {topic[:60]} cannot be read: {reason}" for topic, reason in facts["unread"].items()]
    stations = chosen(held, options.topics, {n.rpartition("/")[2] or n: n for n, t in held.items()
                                             if t.rows.shape[2] == 7}, facts["unread"], path.name)  # fmt: skip
    pressures = chosen(held, options.pressure, {n.rpartition("/")[2] or n: n for n, t in held.items()
                                                if t.kind == FLUID}, facts["unread"], path.name)  # fmt: skip
    if not stations and not pressures:
        raise InputError(f"{path.name} has no topic of poses, points or FluidPressure: name the topics in its mapping; "
                         f"it has {'; '.join([shorten([*held, *facts['others']]) or 'none', *unread])}")  # fmt: skip
    origin = min(t.stamps.min() for t in (*stations.values(), *pressures.values()))
    history = [f"times are those of the message headers; 0 s is {origin / 1e9:.3f} s of the ROS clock"]
    left = [*(n for n, t in held.items() if not any(t is u for u in (*stations.values(), *pressures.values()))),
            *facts["others"]]  # fmt: skip
    history += [f"{len(left)} topic(s) of {path.name} were not used: {shorten(left)}"] if left else []
    arrays_of, findings = frames_of(stations, origin, metre_per(options.length_unit), path.name)
    with inside(path.name):
        return make_recording(
            **arrays_of, **pressures_of(pressures, origin, options.pressure_unit, path.name),
            history=[*history, *(f"{text}; it is left out" for text in unread), *findings],
        )  # fmt: skip


def chosen(
    held: Mapping[str, Topic], named: Mapping[str, str] | None, default: Mapping[str, str], unread: Mapping[str, str],
    file: str,
) -> dict[str, Topic]:
    """Return a dict from the name of each station or chamber to the messages of its topic. `named` is a dict from these
    names to topics. If it is None or empty, the dict `default` is used. `unread` holds for each topic that cannot be
    read the reason.
    """
    for topic in (named or {}).values():
        if topic in unread:
            raise InputError(f"{file}: topic {clipped(topic)!r} cannot be read: {unread[topic]}. Choose another topic "
                             "in its mapping")
        if topic not in held:
            raise InputError(f"{file} has no topic {clipped(topic)!r} of a known type: choose in its mapping among "
                             f"{shorten(list(held))}")
    return {name: held[topic] for name, topic in (named or default).items()}


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
        own = 1e-9 * (topic.stamps - origin)
        order = np.argsort(own, kind="stable")
        nearest = order[nearest_in(own[order], time)]
        near = np.abs(own[nearest] - time) <= reach
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
    clock, values = None, []
    for name, topic in pressures.items():
        if topic.kind not in (FLUID, *NUMBERS):
            raise InputError(f"topic of chamber {clipped(name)} of {file} holds no numbers: choose a topic of "
                             "pressures or plain numbers")
        if topic.kind != FLUID and unit is None:
            raise InputError(f"topic of chamber {clipped(name)} of {file} holds plain numbers: set pressure_unit in "
                             "its mapping")
        own = 1e-9 * (topic.stamps - origin)
        keep, _ = without_repeats(own, file)
        clock = own[keep] if clock is None else clock
        scale = 1.0 if topic.kind == FLUID else pascal_per(str(unit))
        values.append(np.interp(clock, own[keep], scale * topic.rows[keep, 0, 0]))
    chamber = list(pressures) if len(pressures) > 1 else None
    return {"pressure_time": clock, "pressure": np.stack(values, axis=1), "chamber": chamber}


READER = Reader("bag", ENDINGS["bag"], read_bag, begins_with(b"\x89MCAP0\r\n", b"SQLite format 3\0"))
