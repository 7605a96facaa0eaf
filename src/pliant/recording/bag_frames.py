"""Express the stations of a ROS 2 bag in one coordinate frame, by the transforms in the bag or in its mapping."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from pliant.errors import InputError, clipped
from pliant.recording.lost import NORM_TOLERANCE
from pliant.recording.mapping import FileMapping

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray


class FramePose(FileMapping):
    """Pose of a coordinate frame in the frame of the recording: position in the unit of length of the mapping, and unit
    quaternion x, y, z, w. Without entries the two frames are the same.
    """

    position: tuple[float, float, float] = (0.0, 0.0, 0.0)
    quaternion: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 1.0)


class Pose(NamedTuple):
    """A rigid transform: position (3,) and unit quaternion (4,) x, y, z, w of one coordinate frame in another."""

    position: NDArray[np.float64]
    quaternion: NDArray[np.float64]

    def after(self, inner: Pose) -> Pose:
        """Return the pose of a frame, of which `inner` is the pose in this frame, in the parent of this frame."""
        return Pose(self.position + rotated(self.quaternion, inner.position), times(self.quaternion, inner.quaternion))

    def inverse(self) -> Pose:
        """Return the pose of the parent frame in this frame."""
        back = self.quaternion * np.array([-1.0, -1.0, -1.0, 1.0])
        return Pose(-rotated(back, self.position), back)


def times(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the products (..., 4) of quaternions x, y, z, w: the rotation `b` followed by the rotation `a`."""
    u, v = a[..., :3], b[..., :3]
    vector = a[..., 3:] * v + b[..., 3:] * u + np.cross(u, v)
    return np.concatenate([vector, a[..., 3:] * b[..., 3:] - (u * v).sum(-1, keepdims=True)], -1)


def rotated(q: NDArray[np.float64], p: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the points (..., 3) rotated by the unit quaternion `q` (4,), x, y, z, w."""
    twice = 2.0 * np.cross(q[:3], p)
    return np.asarray(p + q[3] * twice + np.cross(q[:3], twice))


def moved(rows: NDArray[np.float64], pose: Pose) -> NDArray[np.float64]:
    """Return poses (M, R, 7), position and quaternion, in the frame in which `pose` is that of their frame."""
    return np.concatenate([pose.position + rotated(pose.quaternion, rows[..., :3]),
                           times(pose.quaternion, rows[..., 3:])], -1)  # fmt: skip


class FrameTree:
    """The transforms between the coordinate frames of a bag, those of its mapping first.

    Parameters
    ----------
    listed : sequence of dict
        The transforms in the bag: parent, child, pose (7 numbers), moving.
    scale : float, m
        Unit of length of the stations; the transforms in a bag are in metres.
    """

    def __init__(self, listed: Sequence[Mapping[str, Any]], scale: float, file: str) -> None:
        self.file = file
        self.moving = {(t["parent"], t["child"]) for t in listed if t["moving"]}
        self.edges: dict[str, dict[str, Pose]] = {}
        for t in listed:
            if not t["moving"]:
                self.add(t["parent"], t["child"], np.array(t["pose"][:3]) / scale, np.array(t["pose"][3:]))

    def add(self, parent: str, child: str, position: NDArray, quaternion: NDArray) -> None:
        """Add the pose of the frame `child` in the frame `parent`; raise InputError for a quaternion that is not of
        unit length.
        """
        norm = float(np.linalg.norm(quaternion))
        if not (abs(norm - 1.0) < NORM_TOLERANCE and np.isfinite(position).all()):
            raise InputError(f"the transform of frame {clipped(child, 60)!r} of {self.file} has no unit quaternion or "
                             "no finite position: state it by transforms in the mapping")
        pose = Pose(position, quaternion / norm)
        self.edges.setdefault(parent, {})[child] = pose
        self.edges.setdefault(child, {})[parent] = pose.inverse()

    def pose(self, frame: str, target: str) -> Pose | None:
        """Return the pose of `frame` in the frame `target`, None where no transforms lead from one to the other."""
        known, fresh = {target: Pose(np.zeros(3), np.array([0.0, 0.0, 0.0, 1.0]))}, [target]
        while fresh and frame not in known:
            parent = fresh.pop()
            for child, pose in self.edges.get(parent, {}).items():
                if child not in known:
                    known[child] = known[parent].after(pose)
                    fresh.append(child)
        return known.get(frame)


def in_one_frame(
    rows: Mapping[str, tuple[str, NDArray[np.float64]]], tree: FrameTree, target: str | None
) -> tuple[dict[str, NDArray[np.float64]], list[str]]:
    """Return the poses (M, R, 7) of each station in one coordinate frame, and lines for the history.

    Parameters
    ----------
    rows : dict
        The frame, and the poses in it, by station.
    tree : FrameTree
    target : str, optional
        Name of the frame; default that of the first station.

    Raises
    ------
    InputError
        When no constant transform leads from the frame of a station to the target.
    """
    frames = list(dict.fromkeys(frame for frame, _ in rows.values()))
    if not frames or (len(frames) == 1 and target in (None, frames[0])):
        return {name: values for name, (_, values) in rows.items()}, []
    target = frames[0] if target is None else target.removeprefix("/")
    poses = {frame: tree.pose(frame, target) for frame in frames}
    if lost := [frame for frame in frames if poses[frame] is None]:
        raise InputError(_without_transform(rows, lost[0], target, tree))
    shifted = [frame for frame in frames if frame != target]
    said = f"positions in frame {shown(target)}; transformed from {', '.join(map(shown, shifted))}"
    return {name: values if frame == target else moved(values, poses[frame])  # type: ignore[arg-type]
            for name, (frame, values) in rows.items()}, [said]  # fmt: skip


def shown(frame: str) -> str:
    """Return the name of a frame for a message."""
    return clipped(frame, 60) or "(no name)"


def _without_transform(
    rows: Mapping[str, tuple[str, NDArray[np.float64]]], frame: str, target: str, tree: FrameTree
) -> str:
    groups: dict[str, list[str]] = {}
    for name, (frame_name, _) in rows.items():
        groups.setdefault(frame_name, []).append(clipped(name, 40))
    listing = "; ".join(f"{', '.join(names[:6])} in {shown(frame_name)}" for frame_name, names in groups.items())
    moving = any(frame in edge for edge in tree.moving)
    why = "the transform in the bag changes in time" if moving else "the bag has no transform"
    table = clipped(frame, 60) or '""'
    return (f"the stations of {tree.file} are in different coordinate frames ({clipped(listing, 300)}), and {why} from "
            f"{shown(frame)} to {shown(target)}: choose topics of one frame, or state the pose of the frame by "
            f"[transforms.{table}] with position and quaternion in the mapping, empty if both "
            "frames are the same")  # fmt: skip
