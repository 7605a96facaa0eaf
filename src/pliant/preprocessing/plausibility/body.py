"""Checks of the stated length, mass and gravity of a body against its recording and against values usual for soft
bodies.
"""

from __future__ import annotations

import numpy as np

from pliant.errors import InputError
from pliant.preprocessing.alignment import alignment_of
from pliant.preprocessing.plausibility.contract import Case, Check
from pliant.preprocessing.plausibility.shape import LEAST_BODY, MOST_BODY

SHORTER, LONGER = 0.7, 5.0  # stated length relative to the reach in the recording
DENSITY = (200.0, 8000.0)  # kg/m3: foam, and steel
SILICONE = 1100.0  # kg/m3
WIDEST = 0.6  # diameter of a solid silicone body relative to its length
EARTH = (9.7, 9.9)  # m/s^2
ACROSS = 0.1  # fraction of gravity across the plane beyond which the plane or gravity is doubtful


def length(case: Case) -> str:
    """Return a sentence where the stated length of the body is implausible, such as in millimetres; else ""."""
    if case.length is None:
        return ""
    if not LEAST_BODY < case.length < MOST_BODY:
        return f"length = {case.length:g} m is implausible for a soft body: state length in metres"
    size = reach(case)
    if size is None or SHORTER * size <= case.length <= LONGER * size:
        return ""
    return (f"length = {case.length:g} m, but the recording reaches {size:.3g} m from the base: state length in "
            "metres, and check the unit of the positions")  # fmt: skip


def reach(case: Case) -> float | None:
    """Return how far the recorded body extends [m]: the arc length of its last station or, without arc length, the
    largest distance from the base. Return None without positions.
    """
    recording = case.aligned
    if recording is None or "position" not in recording:
        return None
    if "arc_length" in recording.coords and np.isfinite(recording["arc_length"].values).all():
        return float(recording["arc_length"].values.max())
    away = np.linalg.norm(recording["position"].values, axis=-1)
    return float(np.percentile(away[np.isfinite(away)], 99.5)) if np.isfinite(away).any() else None


def mass(case: Case) -> str:
    """Return a sentence where the stated mass of the body is implausible, such as in grams; else ""."""
    if case.mass is None or case.length is None or not LEAST_BODY < case.length < MOST_BODY:
        return ""
    if case.diameter is not None:
        density = case.mass / (0.25 * np.pi * case.diameter**2 * case.length)
        if DENSITY[0] <= density <= DENSITY[1]:
            return ""
        return (f"mass = {case.mass:g} kg in {1e3 * case.length:.4g} mm of {1e3 * case.diameter:.3g} mm diameter is "
                f"a density of {density:.3g} kg/m3, but soft bodies have {DENSITY[0]:g} to {DENSITY[1]:g}: state "
                "mass in kg "
                "and lengths in m; fitted stiffness, damping and torque are proportional to the mass")  # fmt: skip
    wide = float(np.sqrt(case.mass / (0.25 * np.pi * SILICONE * case.length)))
    if wide <= WIDEST * case.length:
        return ""
    return (f"mass = {case.mass:g} kg would make a silicone body of {1e3 * case.length:.4g} mm length "
            f"{1e3 * wide:.3g} mm wide: state mass in kg; fitted stiffness, damping and torque are proportional to "
            "it")  # fmt: skip


def gravity(case: Case) -> str:
    """Return a sentence where the stated gravity is not about 9.81 m/s^2, or has a large component perpendicular to the
    plane of bending; else "".
    """
    if case.gravity is None or not any(case.gravity):
        return ""
    size = float(np.linalg.norm(case.gravity))
    if size > EARTH[1] or (len(case.gravity) == 3 and size < EARTH[0]):
        return f"gravity has a magnitude of {size:.4g} m/s^2, but the earth's is 9.81: state gravity in m/s^2"
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
    return (f"{across:.3g} of {size:.3g} m/s^2 of gravity point across the plane of bending and are ignored: is the "
            f"vertical another axis of the tracker? The body points along its {up} axis at the base")  # fmt: skip


CHECKS = (
    Check("length", "body", "stated length and the largest measured distance of a point from the base",
          f"the stated length is below {SHORTER:g} or above {LONGER:g} times the largest measured distance, or "
          f"outside {1e3 * LEAST_BODY:g} mm to {MOST_BODY:g} m", length),
    Check("mass", "body", "stated mass over length, and diameter where it is stated",
          f"the density is outside {DENSITY[0]:g} to {DENSITY[1]:g} kg/m3 (foam, steel) or, without a diameter, a "
          f"silicone body of this mass would be wider than {WIDEST:g} of its length", mass),
    Check("gravity", "body", "stated gravity and the plane of bending",
          f"more than {100 * ACROSS:g} % of gravity is across the plane (6 degrees, more than the error of a tracker's "
          f"axes), or its magnitude is not within {EARTH[0]:g} to {EARTH[1]:g} m/s^2", gravity),
)  # fmt: skip
