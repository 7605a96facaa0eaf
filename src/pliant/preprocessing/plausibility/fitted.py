"""Checks of a fitted model: whether stiffness and torque are plausible for a soft body of its size."""

from __future__ import annotations

import numpy as np

from pliant.model.section import bending_stiffness
from pliant.preprocessing.plausibility.contract import Case, Check

STIFFEST = 5e3  # Pa, EI / L^4: a solid rod of 8 MPa, a third as wide as long
MODULUS = (1e3, 1e9)  # Pa: hydrogel, and a hard plastic
ROUND = np.pi / 64  # second moment of area of a solid round section, over the fourth power of its diameter
LARGEST_ARM = np.pi / 8  # area of that section times its radius, over the third power of its diameter
USUAL_WIDTH = 0.4  # assumed diameter relative to the length where none is stated


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
    made = max((float(np.max(np.abs(c.lever_at(0.0) * c.joint_gain))) for c in inputs), default=0.0)
    wide = USUAL_WIDTH * case.model.length if case.diameter is None else case.diameter
    most = LARGEST_ARM * wide**3
    if made <= most:
        return ""
    return (f"the fitted torque of {made:.3g} N m/Pa is an area times a lever arm of {made:.3g} m^3, but a section of "
            f"{1e3 * wide:.3g} mm diameter has {most:.2g} at most: check mass (kg), length (m) and the "
            "unit of pressure")  # fmt: skip


CHECKS = (
    Check("bending stiffness", "model", "fitted EI over the fourth power of the length; the modulus where a diameter "
          "is stated", f"EI / L^4 is above {STIFFEST:g} Pa, the value of a solid rod of 8 MPa a third as wide as "
          f"long, or the modulus is outside {MODULUS[0]:.0e} to {MODULUS[1]:.0e} Pa", stiffness),
    Check("torque", "model", "fitted torque per pascal, which is a chamber's area times its lever arm",
          "the torque per pascal is above the area of the whole section times its radius; where no diameter is stated, "
          f"it is taken as {USUAL_WIDTH:g} of the length", torque),
)  # fmt: skip
