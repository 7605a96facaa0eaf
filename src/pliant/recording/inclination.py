"""Compute what inertial sensors show of a body from the accelerations or orientations that they measure: the angle by
which each turns in a plane, or the direction of gravity in the axes of its link.
"""

from __future__ import annotations

import json
from contextlib import suppress
from typing import TYPE_CHECKING, Any, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from pliant.errors import InputError, clipped
from pliant.recording.mapping import FileMapping
from pliant.recording.stated import WARNING

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

LEAST_TURN = 0.01  # rad: below this an axis of rotation cannot be found
MOST_ASIDE = 0.15  # fraction of the rotation about other axes above which the history warns
FIRST = 20  # frames in which a body is taken to be at rest
STILL = 0.1  # of the largest rotation of a sensor: one that turns less, such as at the base, shows no plane
SHAKEN = 0.1  # relative change of the measured gravity above which the history warns
ONE_TURN = 2.1 * np.pi  # rad: a sensor that wraps after one turn reads no more; one that reads more does not wrap
UP = np.array([0.0, 0.0, 1.0])  # of the fixed axes in which sensors state their orientation


class InclinationMapping(FileMapping):
    """Options of inertial sensors whose direction of gravity is compared with a body in space, or in the plane of the
    base frame.

    Attributes
    ----------
    down : list of 3 floats, or of 2 in the plane
        Direction of gravity in the axes of the base frame, of any length: in space z, in the plane y is along the body
        from its base, such as [0, 0, 1] for a body that hangs.
    axes : list of str, or dict of such lists by sensor
        Axes of the sensor that point along x, y (and z) of its link, such as ["x", "-z", "y"]. In space z, in the plane
        y is along the body towards its tip. Default: the sensor's own x, y, z.
    reference : {"rest", "base"}
        Whether a fit compares the changes since the first frames, which a constant offset of the sensor and a slight
        tilt of it on the body do not disturb, or the values.
    measures : {"acceleration", "gravity"}
        What three columns hold: what an accelerometer shows at rest, which points up, or the direction of gravity.
    """

    down: list[float] = Field(min_length=2, max_length=3)
    axes: list[str] | dict[str, list[str]] = Field(default=["x", "y", "z"])
    reference: Literal["rest", "base"] = "rest"
    measures: Literal["acceleration", "gravity"] = "acceleration"

    @model_validator(mode="after")
    def _is_complete(self) -> Self:
        if not 0 < np.linalg.norm(self.down) < np.inf:
            raise ValueError("down is the direction of gravity in the base frame, such as [0, 0, 1], not zero")
        for axes in self.axes.values() if isinstance(self.axes, dict) else [self.axes]:
            letters = [axis.removeprefix("-").removeprefix("+") for axis in axes]
            if not set(letters) <= set("xyz") or len(set(letters)) < len(letters) or not 2 <= len(axes) <= 3:
                raise ValueError('axes are the sensor\'s axes along x, y (and z) of its link, such as ["x", "-z", "y"]')
            if len(axes) == 3 and np.linalg.det(np.array([axis_of_sensor(axis) for axis in axes])) < 0:
                raise ValueError("axes must be right-handed: change the sign of one, or exchange two")
        return self


def axis_of_sensor(name: str) -> NDArray:
    """Return the unit vector (3,) of an axis of a sensor by its name, such as "-y"."""
    return (-1.0 if name.startswith("-") else 1.0) * np.eye(3)["xyz".index(name[-1])]


def gravity_rows(
    sensors: Mapping[str, NDArray], options: InclinationMapping, file: str
) -> tuple[dict[str, Any], list[str]]:
    """Return the arguments of `make_recording` for the direction of gravity (T, S, d) in the axes of the links of S
    sensors, in d = 2 or 3 dimensions, and sentences for the history.

    Parameters
    ----------
    sensors : dict of (T, 3) or (T, 4) arrays
        As in `turning_angles`; quaternions turn the sensor's axes to fixed ones whose z points up.
    options : InclinationMapping
    file : str
        File name, for messages.

    Raises
    ------
    InputError
        When a sensor has no value, or its axes are not stated.
    """
    size, directions, history = len(options.down), [], []
    for name, values in sensors.items():
        listed = options.axes.get(name) if isinstance(options.axes, dict) else options.axes
        if listed is None or len(listed) < size:
            raise InputError(f"{file}: state in inclination.axes which {size} axes of {clipped(name, 40)} point along "
                             f"{'x and y' if size == 2 else 'x, y and z'} of its link")
        down, lines = _down(values, options.measures, name, file)
        part = down @ np.array([axis_of_sensor(axis) for axis in listed[:size]]).T
        length = np.linalg.norm(part, axis=1, keepdims=True)
        if size == 2 and (aside := float(np.sqrt(1.0 - np.nanmin(length) ** 2))) > MOST_ASIDE:
            lines.append(f"{WARNING}up to {100 * aside:.0f} % of gravity is across the plane in the axes of "
                         f"{clipped(name, 40)}, and is left out: the body leaves the plane, or axes are wrong")
        directions.append(part / np.where(length > 0, length, np.nan))
        history += lines
    gravity, vector = np.stack(directions, axis=1), np.array(options.down) / np.linalg.norm(options.down)
    constants = np.tile(vector, (len(sensors), 1))
    return {"further": {"gravity": gravity, "gravity_constants": constants}, "angle_reference": options.reference,
            "station": list(sensors), "frame": "planar" if size == 2 else "spatial"}, history  # fmt: skip


def _down(values: NDArray, measures: str, name: str, file: str) -> tuple[NDArray, list[str]]:
    """Return the direction of gravity (T, 3) in the axes of a sensor, NaN for gaps, and sentences for the history."""
    from scipy.spatial.transform import Rotation

    known = _known(values)
    _need_values(known, name, file)
    down = np.full((len(values), 3), np.nan)
    if values.shape[1] == 4:
        down[known] = Rotation.from_quat(values[known]).inv().apply(-UP)
        source = "its orientation, whose fixed axes have z up"
    else:
        sign = -1.0 if measures == "acceleration" else 1.0
        down[known] = sign * values[known] / np.linalg.norm(values[known], axis=1, keepdims=True)
        source = "its acceleration, with the opposite sign" if sign < 0 else "the direction of gravity that it states"
    history = [f"gravity in the axes of {clipped(name, 40)} from {source}"]
    lost = int((np.isfinite(values).all(axis=1) & ~known).sum())
    history += [f"{lost} frame(s) of {clipped(name, 40)} are gaps: all numbers are 0"] if lost else []
    return down, history + (_shaken(values, name) if values.shape[1] == 3 else [])


def _shaken(acceleration: NDArray, name: str) -> list[str]:
    """Return a warning if the magnitude of an acceleration (T, 3) varies, which is then not gravity alone."""
    size = np.linalg.norm(acceleration, axis=1)
    size = size[np.isfinite(size) & (size > 0)]
    shaken = float(size.std() / size.mean())
    text = (f"{WARNING}the acceleration of {clipped(name, 40)} varies by {100 * shaken:.0f} %, so it is not gravity "
            "alone: its angle is wrong while the body moves fast")  # fmt: skip
    return [text] if shaken > SHAKEN else []


def hanging(sensors: Mapping[str, NDArray], file: str) -> dict[str, Any]:
    """Return the entries `down` and `axes` of `InclinationMapping` for sensors (T, 3) or (T, 4) on a body that leaves a
    plane, as if it hung in the first frames; empty if it stays in a plane, or a sensor has no value. The axis of a
    sensor nearest to gravity then points along its link, and its other axes keep their order.
    """
    turns = {}  # of each sensor that turns: the range of its angle, and the fraction about other axes
    for name, values in sensors.items():
        if not _known(values).any():
            return {}
        with suppress(InputError):
            angle, aside = _turn(values, name, file)
            turns[name] = float(np.nanmax(angle) - np.nanmin(angle)), aside
    largest = max((turned for turned, _ in turns.values()), default=0.0)
    if not any(aside > MOST_ASIDE for turned, aside in turns.values() if turned > STILL * largest):
        return {}
    axes = {}
    for name, values in sensors.items():
        down, _ = _down(values, "acceleration", name, file)
        first = np.nanmedian(down[np.isfinite(down).all(axis=1)][:FIRST], axis=0)
        along = int(np.argmax(np.abs(first)))
        x, y = (("y", "z"), ("z", "x"), ("x", "y"))[along]
        sign = "-" if first[along] < 0 else ""
        axes[name] = [x, f"{sign}{y}", f"{sign}{'xyz'[along]}"]
    return {"down": [0.0, 0.0, 1.0], "axes": axes}


def turning_angles(sensors: Mapping[str, NDArray], file: str) -> tuple[NDArray, list[str]]:
    """Return the angles (T, S) [rad] by which S sensors turn in a plane from their first orientation, and sentences for
    the history.

    The plane of each sensor is that of its motion. The angle of the last sensor is positive where it is largest; the
    angles of the others are positive where they turn with it.

    Parameters
    ----------
    sensors : dict of (T, 3) or (T, 4) arrays
        Acceleration of each sensor in its own axes [m/s^2], which is gravity as long as the sensor moves slowly, or its
        orientation as a quaternion x, y, z, w; NaN for gaps.
    file : str
        File name, for messages.

    Raises
    ------
    InputError
        When a sensor has no value, or measures gravity and turns about the vertical.
    """
    history, motions = [], {name: _turn(values, name, file) for name, values in sensors.items()}
    angles = np.column_stack([angle for angle, _ in motions.values()])
    turned = np.nanmax(angles, axis=0) - np.nanmin(angles, axis=0)
    for name in motions:
        by_gravity = sensors[name].shape[1] == 3
        source = "direction of gravity" if by_gravity else "orientation"
        history.append(f"angle of {clipped(name, 40)} in the plane of its motion, from its {source}, 0 in its first "
                       "frame")  # fmt: skip
        history += _shaken(sensors[name], name) if by_gravity else []
    shares = {name: aside for s, (name, (_, aside)) in enumerate(motions.items())
              if aside > MOST_ASIDE and turned[s] > STILL * turned.max()}  # fmt: skip
    history += _out_of_plane(shares, sensors, file) if shares else []
    for s in range(angles.shape[1] - 1):
        both = np.isfinite(angles[:, s]) & np.isfinite(angles[:, -1])
        if angles[both, s] @ angles[both, -1] < 0:
            angles[:, s] *= -1
    return angles, history


def _out_of_plane(shares: Mapping[str, float], sensors: Mapping[str, NDArray], file: str) -> list[str]:
    """Return a warning on the fraction of the rotation of sensors that is about other axes than that of their angle,
    with the entry of a mapping for a body in space, as if it hung in the first frames.
    """
    listed = ", ".join(f"{clipped(name, 40)} {100 * aside:.0f} %" for name, aside in shares.items())
    mounted = hanging(sensors, file)
    axes = ", ".join(f"{json.dumps(name)} = {json.dumps(one)}" for name, one in mounted.get("axes", {}).items())
    said = (f"{WARNING}the body leaves a plane, and rotation about other axes is left out ({listed}): for a body in "
            "space that hangs in the first frames, state in its mapping inclination = { down = [0.0, 0.0, 1.0], ")
    return [f"{said}axes = {{ {axes} }} }}"]


def _turn(values: NDArray, name: str, file: str) -> tuple[NDArray, float]:
    """Return the angle (T,) [rad] of a sensor (T, 3) or (T, 4), and the fraction of its rotation about other axes."""
    return (_from_gravity if values.shape[1] == 3 else _from_orientation)(values, name, file)


def _from_gravity(values: NDArray, name: str, file: str) -> tuple[NDArray, float]:
    """Return the angle (T,) [rad] of a sensor from the gravity (T, 3) in its axes, and the fraction of the turning of
    gravity that is out of its plane.
    """
    known = _known(values)
    _need_values(known, name, file)
    unit = values[known] / np.linalg.norm(values[known], axis=1)[:, None]
    middle = unit.mean(axis=0)
    middle /= np.linalg.norm(middle)
    across = unit - (unit @ middle)[:, None] * middle
    _, size, axes = np.linalg.svd(across - across.mean(axis=0), full_matrices=False)
    turned = np.unwrap(np.arctan2(unit @ axes[0], unit @ middle))
    if np.ptp(turned) < LEAST_TURN:
        raise InputError(f"{file}: gravity hardly turns in the axes of {clipped(name, 40)} (by {np.ptp(turned):.2g} "
                         "rad), as when a body moves in a horizontal plane: its accelerations do not show its angle; "
                         "use the sensor's orientation")
    return _upwards(turned, known), float(size[1] / size[0])


def _from_orientation(values: NDArray, name: str, file: str) -> tuple[NDArray, float]:
    """Return the angle (T,) [rad] of a sensor from its orientations (T, 4), and the fraction of its rotation about
    other axes.
    """
    from scipy.spatial.transform import Rotation

    known = _known(values)
    _need_values(known, name, file)
    turns = Rotation.from_quat(values[known])
    vector = (turns * turns[0].inv()).as_rotvec()
    _, size, axes = np.linalg.svd(vector, full_matrices=False)
    if not size[0]:
        return _upwards(np.zeros(len(vector)), known), 0.0
    quaternion = (turns * turns[0].inv()).as_quat()
    turned = np.unwrap(2.0 * np.arctan2(quaternion[:, :3] @ axes[0], quaternion[:, 3]))
    return _upwards(turned, known), float(size[1] / size[0])


def _known(values: NDArray) -> NDArray:
    """Return a mask (T,) of the frames in which a sensor (T, 3) or (T, 4) states a direction."""
    return np.isfinite(values).all(axis=1) & (np.linalg.norm(values, axis=1) > 0)


def _need_values(known: NDArray, name: str, file: str) -> None:
    if not known.any():
        raise InputError(f"{file}: {clipped(name, 40)} has no acceleration or orientation in any frame: leave it out")


def _upwards(turned: NDArray, known: NDArray) -> NDArray:
    """Return angles from the first, positive where they are largest, for all T frames; NaN where none is known."""
    turned = turned - turned[0]
    angle = np.full(len(known), np.nan)
    angle[known] = turned * (np.sign(turned[np.argmax(np.abs(turned))]) or 1.0)
    return angle


def whole_turns(angle: NDArray) -> tuple[NDArray, list[str]]:
    """Remove the jumps of 360 degrees from the angles (T, S) [rad] of S sensors over T frames, and return them with a
    history line that counts the jumps.
    """
    finite = np.isfinite(angle)
    result, jumps = angle.copy(), 0
    for s in range(angle.shape[1]):
        read = angle[finite[:, s], s]
        if read.size and np.ptp(read) > ONE_TURN:
            continue
        steady = np.unwrap(read)
        jumps += int((np.abs(np.diff(steady) - np.diff(angle[finite[:, s], s])) > 1.0).sum())
        result[finite[:, s], s] = steady
    return result, [f"{jumps} jump(s) of an angle by a full turn were removed"] if jumps else []
