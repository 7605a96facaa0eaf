"""The soft bending actuator of the paper (Chen, Galloway and Godage), with the numbers printed there.

Source: Y. Chen, K. C. Galloway, I. S. Godage, "Efficient Reduced-Order Models for Soft Actuators", Secs. II and III.
"""

from __future__ import annotations

from typing import Any

from pliant.equations.chamber import bladder_area, lever_arm
from pliant.model import Model, chain_model

LENGTH = 0.17  # m, bending portion
MASS = 0.069  # kg; more than the walls alone weigh: base, tube and cap may be in it
LINKS = 5
OUTER_RADIUS = 0.014  # m, r1
INNER_RADIUS = 0.010  # m, r2
STIFFNESS = 1.6067  # N m/rad at each joint; the print gives no unit  # D5
DAMPING = 8e-3  # N m s/rad at each joint  # D5
SPACING = 0.8e-3  # m between the points of the fibre
POINTS = 212
FRAME_RATE = 75.0  # Hz
PULSE_PRESSURE = 119e3  # Pa, from 0.12 s for 2.76 s
PULSE_START = 0.12
PULSE_WIDTH = 2.76


SOURCE = "Chen, Galloway, Godage, Secs. II and III"
BODY: dict[str, Any] = {
    "length": LENGTH, "mass": MASS, "links": LINKS, "stiffness": STIFFNESS, "damping": DAMPING,
    "torque": bladder_area(INNER_RADIUS) * lever_arm(INNER_RADIUS), "mass_at": "tip", "name": "chen2018",
    "source": dict.fromkeys(("link_length", "link_mass", "stiffness", "damping", "torque"), SOURCE),
}


def model(**changes: Any) -> Model:
    """Return the paper's five-link model of its soft bending actuator, with stiffness and damping as printed, masses at
    the link tips.

    `changes` replaces any argument of `chain_model`, for example ``links=7``. The paper does not say where on a link
    its mass is. With the mass at the link tips, where the paper puts its frames, the first mode is at 5.006 Hz ("about
    5 Hz" in the paper). With uniform rods it is at 5.916 Hz.  # D11
    """
    changed = {*changes, *(f"link_{name}" for name in changes)}
    source = {name: where for name, where in BODY["source"].items() if name not in changed}
    return chain_model(**{**BODY, "source": source, **changes})
