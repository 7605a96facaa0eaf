"""Checks of the parts of an `Experiment` against each other."""

from __future__ import annotations

from typing import Any

import numpy as np

from pliant.equations.observation import FURTHER, KINDS, kinds_of
from pliant.errors import InputError

Array = np.ndarray  # an experiment, which imports this module, is of type Any here
UNIT = 1e-3  # largest difference of a quaternion's length from 1


def check_experiment(exp: Any) -> None:
    """Raise InputError if parts of an experiment do not fit together; `check_excitation` checks its inputs."""
    check_extras(exp)
    check_orientation(exp)
    check_further(exp)
    check_poses(exp)
    check_warm_up(exp)
    check_base_motion(exp)
    if exp.drives:
        check_drives(exp)


def check_extras(exp: Any) -> None:
    """Raise InputError if the angles, noise, held pose or arc lengths of an experiment do not match its positions."""
    if exp.dimension == 3 and exp.angle is not None:
        raise InputError(
            f"experiment {exp.name}: a recording in space has no angles: give orientation in place of angle"
        )
    if exp.angle is not None and exp.angle.shape != exp.position.shape[:2]:
        raise InputError(
            f"experiment {exp.name}: angles must be (time, station) = {exp.position.shape[:2]}, got {exp.angle.shape}"
        )
    if exp.angle is not None and exp.angle_reference not in ("rest", "base", "joint"):
        raise InputError(
            f"experiment {exp.name}: state the reference of the angles: angle_reference rest, base or joint"
        )
    if exp.angles_alone and exp.angle is None:
        raise InputError(f"experiment {exp.name} compares angles alone, but has none: leave out angles_alone")
    if strange := [s for s in exp.noise if s not in exp.stations]:
        raise InputError(
            f"experiment {exp.name} has a noise level for {strange[0]!r}, which is not one of its stations: use one of "
            f"{', '.join(exp.stations)}"
        )
    known = (exp.angle_noise, exp.orientation_noise, *(rows.noise for rows in exp.further.values()))
    levels = [*exp.noise.values(), *(v for v in known if v is not None)]
    if bad := [v for v in levels if not (np.isfinite(v) and v > 0)]:
        raise InputError(f"experiment {exp.name}: noise levels must be positive, in m and rad, got {bad[0]}")
    if exp.own_places and (exp.excitation == "release" or exp.angles_alone or exp.alone):
        raise InputError(
            f"experiment {exp.name}: own_places needs positions of a body at rest, not a release or angles: leave it "
            "out"
        )
    if exp.held is not None:
        check_held(exp, exp.held)
    if exp.arc_length is not None and not (
        exp.arc_length.shape == (len(exp.stations),) and np.all(np.diff(exp.arc_length) > 0)
    ):
        raise InputError(f"experiment {exp.name}: arc_length must hold one length [m] for each of the "
                         f"{len(exp.stations)} stations, increasing from base to tip")


def check_excitation(exp: Any) -> None:
    """Raise InputError if the excitation of an experiment does not fit its pressure, or lacks its level [Pa]."""
    if (exp.excitation == "trace") != (exp.pressure is not None):
        inputs = "no measured pressure" if exp.pressure is None else "a measured pressure"
        raise InputError(
            f"experiment {exp.name} has {inputs}, and excitation {exp.excitation!r}: set excitation to 'trace' if, and "
            "only if, you give a measured pressure"
        )
    if exp.nominal and not exp.level > 0:
        raise InputError(f"experiment {exp.name}: a {exp.excitation} needs its nominal level in Pa, got {exp.level}")


def check_held(exp: Any, held: Array) -> None:
    """Raise InputError if the positions (S, 2 or 3) [m] of S stations before a release do not fit an experiment."""
    if exp.excitation != "release":
        raise InputError(f"experiment {exp.name}: held is for a release only, not for a {exp.excitation}: leave it out")
    if held.shape != exp.position.shape[1:]:
        raise InputError(
            f"experiment {exp.name}: held must be (station, axis) = {exp.position.shape[1:]}, got {held.shape}"
        )


def check_poses(exp: Any) -> None:
    """Raise InputError if an experiment of settled poses is planar, lacks a measured input, has known forces, or takes
    the stations' positions on their links from its first frames (``own_places``).
    """
    if exp.poses and (exp.excitation != "trace" or exp.dimension == 2 or exp.forces or exp.own_places):
        raise InputError(
            f"experiment {exp.name}: poses need a body in space under measured inputs (excitation 'trace'), without "
            "forces and own_places: change what differs, or leave out poses"
        )


def check_base_motion(exp: Any) -> None:
    """Raise InputError if the motion of the base of an experiment has another dimension than its positions, does not
    cover its frames, or belongs to a release or settled poses.
    """
    base = exp.base
    if base is None:
        return
    if base.dimension != exp.dimension:
        raise InputError(f"experiment {exp.name}: the motion of the base has {base.dimension} coordinates, but the "
                         f"positions have {exp.dimension}: give both in the same frame")
    if exp.excitation == "release" or exp.poses:
        raise InputError(f"experiment {exp.name}: the base moves, which is for a motion under inputs, not for a "
                         "release or poses: leave out the motion of the base, or align with remove_base_motion")
    if exp.time[0] < base.time[0] or exp.time[-1] > base.time[-1]:
        raise InputError(f"experiment {exp.name}: the pose of the base is known from {base.time[0]:.6g} to "
                         f"{base.time[-1]:.6g} s only, but the frames run from {exp.time[0]:.6g} to {exp.time[-1]:.6g} "
                         "s: cut the recording to this time by window")


def check_warm_up(exp: Any) -> None:
    """Raise InputError if the warm-up of an experiment is not a part of a recording under measured inputs."""
    if not exp.warm_up:
        return
    length = float(exp.time[-1] - exp.time[0])
    if not 0 < exp.warm_up < length:
        raise InputError(
            f"experiment {exp.name}: warm_up must be shorter than the recording of {length:.4g} s and not negative, "
            f"got {exp.warm_up:.4g} s"
        )
    if exp.excitation != "trace" or exp.poses:
        raise InputError(
            f"experiment {exp.name}: warm_up is for a motion under measured inputs, not for a {exp.excitation} or "
            "poses: leave it out, or cut the recording by window"
        )


def check_orientation(exp: Any) -> None:
    """Raise InputError if an experiment has orientations and is planar, or if these are not unit quaternions (T, S, 4)
    for T frames and S stations.
    """
    orientation = exp.orientation
    if orientation is None:
        return
    if exp.dimension == 2:
        raise InputError(f"experiment {exp.name}: orientations need a recording in space; for a planar one give angles")
    if orientation.shape != (*exp.position.shape[:2], 4):
        raise InputError(
            f"experiment {exp.name}: orientations must be (time, station, 4) = {(*exp.position.shape[:2], 4)}, got "
            f"{orientation.shape}"
        )
    if (np.abs(np.linalg.norm(orientation, axis=2) - 1.0) > UNIT).any():
        raise InputError(f"experiment {exp.name}: orientations must be unit quaternions x, y, z, w")


def check_further(exp: Any) -> None:
    """Raise InputError if the values of a further variable do not have an entry for each station and frame and each of
    its kinds of rows, or no such kind exists, or the base moves, whose axes the constants of a kind are in.
    """
    for name, rows in exp.further.items():
        counts = KINDS[FURTHER[name]].constants if name in FURTHER else {}
        if exp.dimension not in counts:
            raise InputError(f"experiment {exp.name}: {name!r} is not a further kind of measurement in {exp.dimension} "
                             f"dimensions ({', '.join(FURTHER) or 'there is none'}): leave it out")
        width = len(kinds_of(name, exp.dimension))
        shape = exp.position.shape[:2] if width == 1 else (*exp.position.shape[:2], width)
        wanted = shape, (len(exp.stations), counts[exp.dimension])
        if (rows.values.shape, rows.constants.shape) != wanted:
            raise InputError(f"experiment {exp.name}: {name} must have values and constants of the shapes {wanted}, "
                             f"got {rows.values.shape} and {rows.constants.shape}")
        if rows.reference not in ("rest", "base"):
            raise InputError(f"experiment {exp.name}: the reference of {name} must be rest or base, not "
                             f"{rows.reference!r}")
        if exp.poses and rows.reference == "rest":
            raise InputError(f"experiment {exp.name}: {name} is compared from the first frames on, but a settled pose "
                             'has none before it: state reference = "base" where the recording is read')
        if exp.base is not None and counts[exp.dimension]:
            raise InputError(f"experiment {exp.name}: {name} refers to fixed axes, but the base moves: leave out the "
                             f"motion of the base, or {name}")


def check_drives(exp: Any) -> None:
    """Raise InputError if the pressures of an experiment's chambers have different sample times, or if its excitation
    is not a measured one ('trace').
    """
    if exp.excitation != "trace":
        raise InputError(
            f"experiment {exp.name}: pressures of chambers need excitation 'trace', got {exp.excitation!r}: set it to "
            "'trace'"
        )
    first = next(iter(exp.drives.values()))
    if not all(np.array_equal(first.time, t.time) for t in exp.drives.values()):
        raise InputError(f"experiment {exp.name}: the pressures of its chambers must share their times: resample them")
