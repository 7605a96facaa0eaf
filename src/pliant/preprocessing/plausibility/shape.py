"""Checks of the measured shape: its size, rotation, labels, base, plane and base tangent."""

from __future__ import annotations

import numpy as np

from pliant.errors import InputError
from pliant.preprocessing import detectors
from pliant.preprocessing.base import BASE_SHARE, STILL_SHARE
from pliant.preprocessing.plausibility.contract import Case, Check
from pliant.preprocessing.side import Alignment, alignment_of

LEAST_BODY, MOST_BODY = 5e-3, 10.0  # m
MOST_TURN = 420.0  # degrees: a body that curls up once and a little more
LEAST_TURN = 180.0 / 57.3  # degrees: pi, the largest value in rad of an angle below half a turn
MOST_TILT = 60.0  # degrees: tilt of the chord of a body that is bent by twice this angle at rest
FOUND, MOST_OUT = ("motion", "body"), 0.3  # planes determined from the recording itself; fraction of the motion
DENSE = 8  # stations: from here on the direction near the base is measured
Array = np.ndarray
MUCH_BETTER = 0.5  # spread of the neighbours in one order over that in another, from which the order is known
TURNS = 0.02  # least spread of the direction to a neighbour in fixed axes: below it, no orientation shows
ORDERS = {"x, y, z, w": [0, 1, 2, 3], "w, x, y, z": [1, 2, 3, 0]}  # where x, y, z and w are in each
INVERSE = "the inverse of x, y, z, w"


def length_unit(case: Case) -> str:
    """Return a sentence where the extent of the recorded positions is implausible, which suggests a wrong unit of
    length; else "".
    """
    recording = case.recording
    if (
        recording is None
        or "position" not in recording
        or recording.sizes["station"] < 2
        or not np.isfinite(recording["position"].values).any()
    ):
        return ""
    size = extent(recording["position"].values)
    if LEAST_BODY < size < MOST_BODY:
        return ""
    return (f"all positions are within {size:.3g} m, implausible for a soft body: state the unit, such as "
            'length_unit = "mm", in the mapping, or correct the positions')


def extent(position: np.ndarray) -> float:
    """Return the diagonal [m] of the smallest box, parallel to the axes, that contains every recorded position."""
    parts = [p for p in detectors.seen_points(position, np.zeros(position.shape[-1])) if p.size]
    low, high = (np.array([f(p, axis=0) for p in parts]) for f in (np.min, np.max))
    return float(np.linalg.norm(high.max(axis=0) - low.min(axis=0))) if parts else 0.0


def angle_unit(case: Case) -> str:
    """Return a sentence where the range of the recorded angles suggests degrees read as radians, or the reverse; else
    "".
    """
    recording = case.recording
    if recording is None or "angle" not in recording:
        return ""
    angle = np.degrees(recording["angle"].values)
    turn = {str(n): float(np.ptp(a[np.isfinite(a)])) for n, a in zip(recording["station"].values, angle.T, strict=True)
            if np.isfinite(a).any()}  # fmt: skip
    if not turn:
        return ""
    name = max(turn, key=lambda n: turn[n])
    if turn[name] > MOST_TURN:
        return (f"the angle of {name} turns by {turn[name]:.4g} degrees: were degrees read as rad? Set "
                'angle_unit = "deg" in the mapping, and correct the header where it states rad')  # fmt: skip
    if "position" not in recording and 0 < turn[name] < LEAST_TURN and np.nanmax(np.abs(angle)) < LEAST_TURN:
        return (f"no angle turns by more than {turn[name]:.2g} degrees: were radians read as degrees? Then set "
                'angle_unit = "rad" in the mapping')  # fmt: skip
    return ""


def quaternions(case: Case) -> str:
    """Return a sentence where the recorded orientations fit the positions much better in another order of their
    components, or inverted; else "".
    """
    recording = case.recording
    if recording is None or not {"position", "quaternion"} <= set(recording) or recording["position"].shape[-1] < 3:
        return ""
    order = shown_order(recording["position"].values, recording["quaternion"].values)
    if not order or order == "x, y, z, w":
        return ""
    remedy = "export the orientation of the body in the tracker's axes" if order == INVERSE else \
        "list their columns in the order x, y, z, w in the mapping, whatever their names say"
    return f"the orientations fit the positions only if they are read as {order}: {remedy}"


def swapped(case: Case) -> str:
    """Return a sentence where the tracker exchanged the labels of stations in some frames; else ""."""
    if not case.swapped:
        return ""
    listed = ", ".join(f"{names} in {count} frames" for names, count in case.swapped.items())
    return (f'stations exchange their labels: {listed}. Set swaps = "undo" or swaps = "exclude" in [alignment]; '
            "otherwise these frames count as motion of the body")  # fmt: skip


def tangent(case: Case) -> str:
    """Return a sentence where the base tangent of the alignment differs much from the direction of the body at rest;
    else "".
    """
    angle = tilt(case)
    if angle is None or angle < MOST_TILT:
        return ""
    return (f"the base tangent points {angle:.0f} degrees away from the body at rest: check tangent in "
            '[alignment.options], or set tangent = "chord"')  # fmt: skip


def moving_base(case: Case) -> str:
    """Return a sentence where the base station moves more than another station, as if the stations were in reverse
    order; else "".
    """
    report = report_of(case)
    if case.recording is None or report is None or "position" not in case.recording:
        return ""
    base, names = report.base, [str(n) for n in case.recording["station"].values]
    if base not in names or len(names) < 2:
        return ""
    travel = np.nan_to_num(detectors.travel(detectors.without_spikes(case.recording["position"].values)))
    still, base_travel = int(np.argmin(travel)), travel[names.index(base)]
    if base_travel > BASE_SHARE * travel.max() and travel[still] < STILL_SHARE * base_travel:
        return (f"the base station {base} moves by {1e3 * base_travel:.3g} mm, but {names[still]} by only "
                f"{1e3 * travel[still]:.2g} mm: are the stations in reverse order? Set base in [alignment.options] "
                "to the station that does not move, and list the stations from there to the tip")  # fmt: skip
    return ""


def plane(case: Case) -> str:
    """Return a sentence where much of the motion is out of the plane of bending, when that plane was stated or taken
    from the first recording; else "".
    """
    report = report_of(case)
    if report is None or report.frame != "planar" or report.plane in FOUND or not report.out_of_plane_share > MOST_OUT:
        return ""
    return (f"{100 * report.out_of_plane_share:.0f} % of the motion is out of the plane of bending, which was "
            "stated or taken from the first recording: was the tracker moved since then? If so, set alignment = { "
            'options = { plane = "motion", bend = "positive" } } for this recording (bend = "negative" if the '
            "highest pressure bends the body to the other side than in the other recordings)")  # fmt: skip


def report_of(case: Case) -> Alignment | None:
    """Return the report of the alignment (base frame, flatness, options) of the aligned recording under examination;
    None where there is none.
    """
    try:
        return None if case.aligned is None else alignment_of(case.aligned)
    except InputError:
        return None


def tilt(case: Case) -> float | None:
    """Return the angle [degrees] between the base tangent and the direction of the body at rest; None where it is
    unknown.

    The direction of the body is that of the last station or, for a dense shape, of the station at a third of its
    length.
    """
    report = report_of(case)
    if case.recording is None or report is None or "position" not in case.recording:
        return None
    names = [str(n) for n in case.recording["station"].values]
    time, position = case.recording["time"].values, case.recording["position"].values
    pose = detectors.mean_place(position[(time >= report.rest_s[0]) & (time <= report.rest_s[1])])
    if report.base not in names or position.shape[-1] != len(report.origin):
        return None
    base = names.index(report.base)
    beyond = len(names) - 1 - base
    which = base + (max(1, beyond // 3) if len(names) >= DENSE else beyond)
    way = pose[which] - pose[base]
    if which == base or not np.linalg.norm(way) > 0:
        return None
    cosine = float(way @ np.array(report.base_tangent) / np.linalg.norm(way))
    return float(np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0))))


def shown_order(position: Array, quaternion: Array) -> str:
    """Return the order of the components of quaternions that the positions show: a key of `ORDERS`, or `INVERSE` if
    the quaternions turn the fixed axes to those of the stations; "" if the motion does not show it.

    Parameters
    ----------
    position : (T, S, 3) array
        Positions of S stations from base to tip, in any unit; NaN for gaps.
    quaternion : (T, S, 4) array
        Unit quaternions in the order in which they were recorded.
    """
    spreads: dict[str, float] = {}
    for name, components in ORDERS.items():
        spreads[name] = spread(position, quaternion[..., components])
    spreads[INVERSE] = spread(position, quaternion * np.array([-1.0, -1.0, -1.0, 1.0]))
    best, second = sorted(spreads.values())[:2]
    if not best < MUCH_BETTER * min(second, 1.0):
        return ""
    return min(spreads, key=lambda name: spreads[name])


def spread(position: Array, quaternion: Array) -> float:
    """Return by how much neighbours move in the axes of the stations that turn, relative to fixed axes; infinite if
    the directions to them hardly turn.
    """
    from scipy.spatial.transform import Rotation

    own, fixed = 0.0, 0.0
    for s in range(position.shape[1]):
        known = np.isfinite(quaternion[:, s]).all(axis=1) & (np.linalg.norm(quaternion[:, s], axis=1) > 0)
        if not turns(quaternion[known, s]):
            continue
        for other in {s - 1, s + 1} & set(range(position.shape[1])):
            rows = known & np.isfinite(position[:, [s, other]]).all(axis=(1, 2))
            if rows.sum() < 3:
                continue
            way = position[rows, other] - position[rows, s]
            if np.sqrt(way.var(axis=0).sum()) < TURNS * np.linalg.norm(way.mean(axis=0)):
                continue
            own += float(Rotation.from_quat(quaternion[rows, s]).inv().apply(way).var(axis=0).sum())
            fixed += float(way.var(axis=0).sum())
    return float(np.sqrt(own / fixed)) if fixed else float("inf")


def turns(quaternion: Array) -> bool:
    """Return whether quaternions (T, 4) turn by more than noise; q and -q are the same rotation."""
    if not len(quaternion):
        return False
    unit = quaternion / np.linalg.norm(quaternion, axis=1, keepdims=True)
    return bool((np.abs(unit @ unit[0]) < np.cos(TURNS / 2)).any())


CHECKS = (
    Check("unit of length", "recording", "the box that holds all points",
          f"the diagonal of the box that holds all points is outside {1e3 * LEAST_BODY:g} mm to {MOST_BODY:g} m",
          length_unit),
    Check("unit of angle", "recording", "the range of each measured angle",
          f"the range of an angle is above {MOST_TURN:g} degrees, more than for a body that curls up once; in a "
          f"recording without positions, also if all angles and ranges are below {LEAST_TURN:.3g} degrees, since half "
          f"a turn is {LEAST_TURN:.3g} rad", angle_unit),
    Check("order of quaternions", "recording", "how much neighbours move in the axes of the stations",
          f"they move less than {MUCH_BETTER:g} times as much if the components are read as w, x, y, z, or if the "
          "rotations are inverted", quaternions),
    Check("exchanged labels", "recording", "which point continues which from frame to frame",
          "exchanging the labels of two or more points shortens their steps to a quarter, beyond the noise", swapped),
    Check("moving base", "body", "peak displacement of the base station and of the others",
          f"the base moves by more than {BASE_SHARE:g} of the largest peak displacement, and another station by less "
          f"than {STILL_SHARE:g} of the base's", moving_base),
    Check("plane", "body", "fraction of the motion out of a stated plane or the plane of the first recording",
          f"the fraction out of the plane is above {MOST_OUT:g}; a body that bends in one plane reaches up to 0.12",
          plane),
    Check("base tangent", "body", "angle between the base tangent and the direction to the last station at rest "
          "(with eight stations or more: to the station at a third of the body)",
          f"the angle to the tangent is above {MOST_TILT:g} degrees, which a body reaches only if it is bent by "
          f"{2 * MOST_TILT:g} degrees at rest", tangent),
)  # fmt: skip
