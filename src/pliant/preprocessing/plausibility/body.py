"""Checks of the stated length, mass and gravity of a body against its recording and against values usual for soft
bodies, and of the stiffness and torque of a fitted model.
"""

from __future__ import annotations

import numpy as np

from pliant.errors import InputError
from pliant.model.summary import bending_stiffness
from pliant.preprocessing.plausibility.contract import Case, Check
from pliant.preprocessing.plausibility.shape import LEAST_BODY, MOST_BODY
from pliant.preprocessing.side import alignment_of
from pliant.units import METRE

SHORTER, LONGER = 0.7, 5.0  # stated length relative to the reach in the recording
DENSITY = (200.0, 8000.0)  # kg/m3: foam, and steel
SILICONE = 1100.0  # kg/m3
WIDEST = 0.6  # diameter of a solid silicone body relative to its length
EARTH = (9.7, 9.9)  # m/s^2
ACROSS = 0.1  # fraction of gravity across the plane beyond which the plane or gravity is doubtful
STIFFEST = 5e3  # Pa, EI / L^4: a solid rod of 8 MPa, a third as wide as long
MODULUS = (1e3, 1e9)  # Pa: hydrogel, and a hard plastic
ROUND = np.pi / 64  # second moment of area of a solid round section, over the fourth power of its diameter
LARGEST_ARM = np.pi / 8  # area of that section times its radius, over the third power of its diameter
MOST_MOVED = 2.2  # largest displacement of a point over the length of its body
MISTAKEN = (("mm", "cm"), ("mm", "in"), ("mm", "m"), ("m", "in"), ("m", "cm"), ("m", "mm"))  # unit read, true unit
NEARLY = 1.3
USUAL_WIDTH = 0.4  # assumed diameter relative to the length where none is stated


def length(case: Case) -> str:
    """Return a sentence where the stated length of the body is implausible, such as in millimetres; else ""."""
    if case.length is None:
        return ""
    if not LEAST_BODY < case.length < MOST_BODY:
        return f"length = {case.length:g} m is implausible for a soft body: state length in metres"
    size, whole = reach(case), case.length + case.base_length
    stated = f"length = {case.length:g} m" + (f" and base_length = {case.base_length:g} m" if case.base_length else "")
    if size is None:
        wide = displacement(case)
        if wide is None or wide <= MOST_MOVED * whole:
            return ""
        return (f"{stated}, but a point of the recording moves by {wide:.3g} m: state length_unit in the mapping, such "
                'as length_unit = "cm", or correct the length')  # fmt: skip
    if SHORTER * size <= whole <= LONGER * size:
        return ""
    other = next(((read, true) for read, true in MISTAKEN
                  if 1 / NEARLY < whole / size / (METRE[true] / METRE[read]) < NEARLY), None)
    remedy = "state length in metres, and check the unit of the positions" if other is None else (
        f"if its positions are in {other[1].replace('in', 'inches')}, and not in {other[0]} as they are read, state "
        f'length_unit = "{other[1]}" in the mapping; else correct the length')
    return f"{stated}, but the recording reaches {size:.3g} m from the base: {remedy}"


def displacement(case: Case) -> float | None:
    """Return the largest displacement of a station from its first known position [m]; None without positions."""
    recording = case.recording
    if recording is None or "position" not in recording:
        return None
    position = recording["position"].values
    first = np.array([[*station[np.isfinite(station).all(axis=1)], station[0]][0]
                      for station in np.moveaxis(position, 1, 0)])  # fmt: skip
    away = np.linalg.norm(position - first, axis=-1)
    return float(np.percentile(away[np.isfinite(away)], 99.5)) if np.isfinite(away).any() else None


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
        return (
            f"mass = {case.mass:g} kg in {1e3 * case.length:.4g} mm of {1e3 * case.diameter:.3g} mm diameter is "
            f"a density of {density:.3g} kg/m3, but soft bodies have {DENSITY[0]:g} to {DENSITY[1]:g}: state "
            "mass in kg and lengths in m; fitted stiffness, damping and torque are proportional to the mass"
        )
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


def stiffness(case: Case) -> str:
    """Return a sentence where the fitted bending stiffness is implausible for the size of the body, else ""."""
    if case.model is None:
        return ""
    section, length = float(np.max(bending_stiffness(case.model))), case.model.length
    if case.diameter is not None:
        modulus = section / (ROUND * case.diameter**4)
        if MODULUS[0] <= modulus <= MODULUS[1]:
            return ""
        return (f"the fitted bending stiffness EI = {section:.3g} N m^2 needs a modulus of {modulus:.3g} Pa at "
                f"{1e3 * case.diameter:.3g} mm diameter, but soft bodies have {MODULUS[0]:.0e} to {MODULUS[1]:.0e} Pa: "
                "check mass, length and diameter")  # fmt: skip
    if section <= STIFFEST * length**4:
        return ""
    return (f"the fitted bending stiffness EI = {section:.3g} N m^2 is implausible for a soft body of "
            f"{1e3 * length:.4g} mm: check mass (kg) and length (m), which scale it")  # fmt: skip


def torque(case: Case) -> str:
    """Return a sentence where the fitted torque per pascal is larger than a pressure chamber within the body could
    produce, else an empty text.

    The torque per pascal is an area times a lever arm.
    """
    if case.model is None:
        return ""
    inputs = [c for c in case.model.chambers if c.kind == "pressure"]  # a tendon's torque is for a newton or a metre
    peak = max((float(np.max(np.abs(c.lever_at(0.0) * c.joint_gain))) for c in inputs), default=0.0)
    wide = USUAL_WIDTH * case.model.length if case.diameter is None else case.diameter
    most = LARGEST_ARM * wide**3
    if peak <= most:
        return ""
    return (f"the fitted torque of {peak:.3g} N m/Pa is an area times a lever arm of {peak:.3g} m^3, but a section of "
            f"{1e3 * wide:.3g} mm diameter has {most:.2g} at most: check mass (kg), length (m) and the "
            "unit of pressure")  # fmt: skip


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
    Check("bending stiffness", "model", "fitted EI over the fourth power of the length; the modulus where a diameter "
          "is stated", f"EI / L^4 is above {STIFFEST:g} Pa, the value of a solid rod of 8 MPa a third as wide as "
          f"long, or the modulus is outside {MODULUS[0]:.0e} to {MODULUS[1]:.0e} Pa", stiffness),
    Check("torque", "model", "fitted torque per pascal, which is a chamber's area times its lever arm",
          "the torque per pascal is above the area of the whole section times its radius; where no diameter is stated, "
          f"it is taken as {USUAL_WIDTH:g} of the length", torque),
)  # fmt: skip
