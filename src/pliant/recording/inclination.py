"""Compute the angle by which a sensor turns in a plane, from the directions of gravity or the orientations that it
measures.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from pliant.errors import InputError, clipped
from pliant.recording.stated import WARNING

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

LEAST_TURN = 0.01  # rad: below this an axis of rotation cannot be found
MOST_ASIDE = 0.15  # fraction of the rotation about other axes above which the history warns
SHAKEN = 0.1  # relative change of the measured gravity above which the history warns


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
    columns, history = [], []
    for name, values in sensors.items():
        by_gravity = values.shape[1] == 3
        angle, aside = _from_gravity(values, name, file) if by_gravity else _from_orientation(values, name, file)
        columns.append(angle)
        source = "direction of gravity" if by_gravity else "orientation"
        history.append(f"angle of {clipped(name, 40)} in the plane of its motion, from its {source}, 0 in its first "
                       "frame")  # fmt: skip
        if aside > MOST_ASIDE:
            history.append(f"{WARNING}{100 * aside:.0f} % of the rotation of {clipped(name, 40)} is about other axes "
                           "and is left out: the body leaves a plane")  # fmt: skip
        size = np.linalg.norm(values, axis=1)
        if by_gravity and (shaken := float(np.nanstd(size) / np.nanmean(size))) > SHAKEN:
            history.append(f"{WARNING}the acceleration of {clipped(name, 40)} varies by {100 * shaken:.0f} %, so it is "
                           "not gravity alone: its angle is wrong while the body moves fast")  # fmt: skip
    angles = np.column_stack(columns)
    for s in range(angles.shape[1] - 1):
        both = np.isfinite(angles[:, s]) & np.isfinite(angles[:, -1])
        if angles[both, s] @ angles[both, -1] < 0:
            angles[:, s] *= -1
    return angles, history


def _from_gravity(values: NDArray, name: str, file: str) -> tuple[NDArray, float]:
    """Return the angle (T,) [rad] of a sensor from the gravity (T, 3) in its axes, and the fraction of the turning of
    gravity that is out of its plane.
    """
    known = np.isfinite(values).all(axis=1) & (np.linalg.norm(values, axis=1) > 0)
    _need_values(known, name, file)
    unit = values[known] / np.linalg.norm(values[known], axis=1)[:, None]
    middle = unit.mean(axis=0)
    middle /= np.linalg.norm(middle)
    across = unit - (unit @ middle)[:, None] * middle
    _, size, axes = np.linalg.svd(across - across.mean(axis=0), full_matrices=False)
    turned = np.unwrap(np.arctan2(unit @ axes[0], unit @ middle))
    if np.ptp(turned) < LEAST_TURN:
        raise InputError(f"{file}: gravity hardly turns in the axes of {clipped(name, 40)} (by {np.ptp(turned):.2g} "
                         "rad), as when a body moves in a horizontal plane: its accelerations do not show its angle")
    return _upwards(turned, known), float(size[1] / size[0])


def _from_orientation(values: NDArray, name: str, file: str) -> tuple[NDArray, float]:
    """Return the angle (T,) [rad] of a sensor from its orientations (T, 4), and the fraction of its rotation about
    other axes.
    """
    from scipy.spatial.transform import Rotation

    known = np.isfinite(values).all(axis=1) & (np.linalg.norm(values, axis=1) > 0)
    _need_values(known, name, file)
    turns = Rotation.from_quat(values[known])
    vector = (turns * turns[0].inv()).as_rotvec()
    _, size, axes = np.linalg.svd(vector, full_matrices=False)
    if not size[0]:
        return _upwards(np.zeros(len(vector)), known), 0.0
    quaternion = (turns * turns[0].inv()).as_quat()
    turned = np.unwrap(2.0 * np.arctan2(quaternion[:, :3] @ axes[0], quaternion[:, 3]))
    return _upwards(turned, known), float(size[1] / size[0])


def _need_values(known: NDArray, name: str, file: str) -> None:
    if not known.any():
        raise InputError(f"{file}: {clipped(name, 40)} has no acceleration or orientation in any frame: leave it out")


def _upwards(turned: NDArray, known: NDArray) -> NDArray:
    """Return angles from the first, positive where they are largest, for all T frames; NaN where none is known."""
    turned = turned - turned[0]
    angle = np.full(len(known), np.nan)
    angle[known] = turned * (np.sign(turned[np.argmax(np.abs(turned))]) or 1.0)
    return angle
