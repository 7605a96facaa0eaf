"""Checks of what was stated of the body, against its recording and against what soft bodies weigh."""

from __future__ import annotations

import numpy as np

from pliant.errors import InputError
from pliant.preprocessing.alignment import alignment_of
from pliant.preprocessing.plausibility.contract import Case, Check
from pliant.preprocessing.plausibility.shape import LEAST_BODY, MOST_BODY

SHORTER, LONGER = 0.7, 5.0  # stated length in parts of what the recording shows
DENSITY = (200.0, 8000.0)  # kg/m3: foam, and steel
SILICONE = 1100.0  # kg/m3
WIDEST = 0.6  # diameter of a solid silicone body in parts of its length
EARTH = (9.7, 9.9)  # m/s^2
ACROSS = 0.1  # of gravity: the share across the plane beyond which the plane or gravity is in doubt


def length(case: Case) -> str:
    """A length in another unit than metres."""
    if case.length is None:
        return ""
    if not LEAST_BODY < case.length < MOST_BODY:
        return f"length = {case.length:g} m is no length of a soft body: state it in metres"
    size = reach(case)
    if size is None or SHORTER * size <= case.length <= LONGER * size:
        return ""
    return (f"length = {case.length:g} m, but the recording reaches {size:.3g} m from the base: state the length in "
            "metres, and check the unit of the positions")  # fmt: skip


def reach(case: Case) -> float | None:
    """Farthest that a point was seen from the base, or the arc length of a dense shape, m."""
    recording = case.aligned
    if recording is None or "position" not in recording:
        return None
    if "arc_length" in recording.coords and np.isfinite(recording["arc_length"].values).all():
        return float(recording["arc_length"].values.max())
    away = np.linalg.norm(recording["position"].values, axis=-1)
    return float(np.percentile(away[np.isfinite(away)], 99.5)) if np.isfinite(away).any() else None


def mass(case: Case) -> str:
    """A mass in grams, or of another body."""
    if case.mass is None or case.length is None or not LEAST_BODY < case.length < MOST_BODY:
        return ""
    if case.diameter is not None:
        density = case.mass / (0.25 * np.pi * case.diameter**2 * case.length)
        if DENSITY[0] <= density <= DENSITY[1]:
            return ""
        return (f"mass = {case.mass:g} kg in {1e3 * case.length:.4g} mm of {1e3 * case.diameter:.3g} mm diameter is "
                f"{density:.3g} kg/m3, and soft bodies have {DENSITY[0]:g} to {DENSITY[1]:g}: state kg and m; "
                "stiffness, damping and torque share the scale of the mass")  # fmt: skip
    wide = float(np.sqrt(case.mass / (0.25 * np.pi * SILICONE * case.length)))
    if wide <= WIDEST * case.length:
        return ""
    return (f"mass = {case.mass:g} kg would make a silicone body of {1e3 * case.length:.4g} mm length "
            f"{1e3 * wide:.3g} mm wide: state it in kg; stiffness, damping and torque share its scale")  # fmt: skip


def gravity(case: Case) -> str:
    """Gravity that the plane of bending cannot hold, or that is not the earth's."""
    if case.gravity is None or not any(case.gravity):
        return ""
    size = float(np.linalg.norm(case.gravity))
    if size > EARTH[1] or (len(case.gravity) == 3 and size < EARTH[0]):
        return f"gravity has {size:.4g} m/s^2, the earth's is 9.81: state m/s^2"
    if len(case.gravity) != 3 or case.aligned is None:
        return ""
    try:
        report = alignment_of(case.aligned)
    except InputError:
        return ""
    across = float(abs(np.array(report.normal) @ np.array(case.gravity)))
    if report.frame == "spatial" or across <= ACROSS * size:
        return ""
    up = max(zip(np.abs(report.base_tangent), "xyz", strict=True))[1]
    return (f"{across:.3g} of {size:.3g} m/s^2 of gravity point across the plane of bending and are dropped: is the "
            f"vertical another axis of the tracker? The body lies along its {up} axis at the base")  # fmt: skip


CHECKS = (
    Check("length", "body", "stated length and the farthest that a point was seen from the base",
          f"below {SHORTER:g} or above {LONGER:g} times that, or outside {1e3 * LEAST_BODY:g} mm to {MOST_BODY:g} m",
          length),
    Check("mass", "body", "stated mass over length, and diameter where it is stated",
          f"density outside {DENSITY[0]:g} to {DENSITY[1]:g} kg/m3 (foam, steel); without a diameter, a silicone body "
          f"wider than {WIDEST:g} of its length", mass),
    Check("gravity", "body", "stated gravity and the plane of bending",
          f"more than {100 * ACROSS:g} % of it across the plane (6 degrees, beyond what a tracker's axes are off), "
          f"or a size other than {EARTH[0]:g} to {EARTH[1]:g} m/s^2", gravity),
)  # fmt: skip
