"""Checks of what was seen of the body: its size, its turn, the names of its points, its direction at the base."""

from __future__ import annotations

import numpy as np

from pliant.errors import InputError
from pliant.preprocessing import detectors
from pliant.preprocessing.alignment import Alignment, alignment_of
from pliant.preprocessing.plausibility.contract import Case, Check

LEAST_BODY, MOST_BODY = 5e-3, 10.0  # m
MOST_TURN = 420.0  # degrees: a body that curls up once and a little more
LEAST_TURN = 180.0 / 57.3  # degrees: pi, the largest that an angle in rad reads where it is below half a turn
MOST_TILT = 60.0  # degrees: the chord of a body that rests bent by twice as much
BASE_SHARE, STILL_SHARE = 0.1, 0.2  # of the largest travel, which a base moves less, and of its own
FOUND, MOST_OUT = ("motion", "body"), 0.3  # planes that follow the recording itself; share of the motion
DENSE = 8  # stations from which on the direction near the base is seen


def length_unit(case: Case) -> str:
    """Positions in millimetres that were read as metres, and the like."""
    recording = case.recording
    if (
        recording is None
        or "position" not in recording
        or recording.sizes["station"] < 2
        or not np.isfinite(recording["position"].values).any()
    ):
        return ""
    size = extent(recording["position"].values)
    return "" if LEAST_BODY < size < MOST_BODY else f"the stations lie within {size:.3g} m: check the unit of length"


def extent(position: np.ndarray) -> float:
    """Diagonal of the box that holds every point that was seen, m."""
    parts = [p for p in detectors.seen_points(position, np.zeros(position.shape[-1])) if p.size]
    low, high = (np.array([f(p, axis=0) for p in parts]) for f in (np.min, np.max))
    return float(np.linalg.norm(high.max(axis=0) - low.min(axis=0))) if parts else 0.0


def angle_unit(case: Case) -> str:
    """Degrees that were read as radians, or the other way round."""
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
        return (f"the angle of {name} turns by {turn[name]:.4g} degrees: are its values degrees, read as rad? State "
                'angle_unit = "deg", and correct the header where it says otherwise')  # fmt: skip
    if "position" not in recording and 0 < turn[name] < LEAST_TURN and np.nanmax(np.abs(angle)) < LEAST_TURN:
        return (f"no angle turns by more than {turn[name]:.2g} degrees: are the values radians, read as degrees? State "
                'angle_unit = "rad" if they are')  # fmt: skip
    return ""


def swapped(case: Case) -> str:
    """Stations that exchange their labels for some frames."""
    if not case.swapped:
        return ""
    listed = ", ".join(f"{names} in {count} frames" for names, count in case.swapped.items())
    return (f'labels are exchanged: {listed}. Say swaps = "undo" or swaps = "exclude" in [alignment]: as they are, the '
            "frames count as the body's motion")  # fmt: skip


def tangent(case: Case) -> str:
    """A base tangent that points beside the body."""
    angle = tilt(case)
    if angle is None or angle < MOST_TILT:
        return ""
    return (f"the base tangent points {angle:.0f} degrees away from the body at rest: check tangent in "
            '[alignment.options], or take tangent = "chord"')  # fmt: skip


def moving_base(case: Case) -> str:
    """A station taken for the base that moves more than the others: the stations in reverse order."""
    report = report_of(case)
    if case.recording is None or report is None or "position" not in case.recording:
        return ""
    base, names = report.base, [str(n) for n in case.recording["station"].values]
    if base not in names or len(names) < 2:
        return ""
    travel = np.nan_to_num(detectors.travel(detectors.without_spikes(case.recording["position"].values)))
    still, own = int(np.argmin(travel)), travel[names.index(base)]
    if own > BASE_SHARE * travel.max() and travel[still] < STILL_SHARE * own:
        return (f"{base}, taken for the base, moves by {1e3 * own:.3g} mm, and {names[still]} by only "
                f"{1e3 * travel[still]:.2g} mm: are the stations in reverse order? State the one that stands still as "
                "base in [alignment.options], and list the stations from there to the tip")  # fmt: skip
    return ""


def plane(case: Case) -> str:
    """A recording in the plane of another one, or in a stated plane, that moves out of it."""
    report = report_of(case)
    if report is None or report.frame != "planar" or report.plane in FOUND or not report.out_of_plane_share > MOST_OUT:
        return ""
    return (f"{100 * report.out_of_plane_share:.0f} % of the motion is out of the plane that was stated, or of that of "
            "the first recording: was the tracker moved between them? Then state alignment = { options = { plane = "
            '"motion", bend = "positive" } } for this recording, or "negative" for one that bends back')  # fmt: skip


def report_of(case: Case) -> Alignment | None:
    """How the recording was aligned; None where it was not."""
    try:
        return None if case.aligned is None else alignment_of(case.aligned)
    except InputError:
        return None


def tilt(case: Case) -> float | None:
    """Angle between base tangent and body at rest, degrees: to the last station, of a dense shape to a third of it."""
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


CHECKS = (
    Check("unit of length", "recording", "the box that holds all points",
          f"outside {1e3 * LEAST_BODY:g} mm to {MOST_BODY:g} m", length_unit),
    Check("unit of angle", "recording", "the range of each measured angle",
          f"above {MOST_TURN:g} degrees, more than a body that curls up once; of angles alone also below "
          f"{LEAST_TURN:.3g} degrees, where half a turn in rad would lie", angle_unit),
    Check("exchanged labels", "recording", "from frame to frame, which point continues which",
          "exchanging the labels of two or more points shortens their steps to a quarter, clear of the noise", swapped),
    Check("moving base", "body", "travel of the station that was taken for the base, and of the others",
          f"above {BASE_SHARE:g} of the largest travel, where another station moves by less than {STILL_SHARE:g} of it",
          moving_base),
    Check("plane", "body", "share of the motion out of a stated plane, or that of the first recording",
          f"above {MOST_OUT:g}: a body that bends in one plane shows up to 0.12", plane),
    Check("base tangent", "body", "angle between the base tangent and the way to the last station at rest (of eight "
          "stations or more: a third of the way)", f"above {MOST_TILT:g} degrees, which a body at rest that is bent by "
          f"{2 * MOST_TILT:g} degrees has", tangent),
)  # fmt: skip
