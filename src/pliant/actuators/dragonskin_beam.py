"""Constants of a beam of Dragon Skin 10 silicone, 3 x 3 x 10 cm, without actuation.

Source: the recordings of srl-ethz/diffPD_sim2real (size and density as in its simulation). Stiffness and damping are
only starting values for a fit, from a Young's modulus near 0.26 MPa.
"""

from __future__ import annotations

from typing import Any

LENGTH = 0.100  # m
WIDTH = 0.030  # m, square section
DENSITY = 1070.0  # kg/m^3
YOUNG = 0.26e6  # Pa, start value
LINKS = 5
BODY: dict[str, Any] = {
    "length": LENGTH, "mass": DENSITY * WIDTH**2 * LENGTH, "links": LINKS, "joint_placement": "midsegment",
    "stiffness": YOUNG * WIDTH**4 / 12 / (LENGTH / LINKS), "damping": 4e-3, "torque": [0.0], "name": "dragonskin_beam",
    "source": {
        "link_length": "size of the beam", "link_mass": "size times 1070 kg/m3",
        "stiffness": "start value, E = 0.26 MPa", "damping": "start value",
    },
}
