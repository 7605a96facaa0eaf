"""Cross-section of the chamber, Sec. III-C: area, lever arm, and the torque as a polynomial of the pressure.

`chamber` adds the dynamics of soft walls.
"""

from __future__ import annotations

import numpy as np


def bladder_area(r2):
    """Return the area A = pi r2^2 / 2 [m^2] of the half-round chamber of inner radius r2 [m].

    A = pi r2^2 / 2

    The paper calls it the cross-section area of the actuator; the formula is that of the chamber.  # D6
    Paper: Sec. III-C
    """
    return 0.5 * np.pi * r2 * r2


def lever_arm(r2):
    """Return the lever arm d = 4 r2 / (3 pi) [m] of a half-round chamber: the distance of its centroid from the flat
    face, for inner radius r2 [m].

    d = 4 r2 / (3 pi)

    Paper: Sec. III-C
    """
    return 4.0 * r2 / (3.0 * np.pi)


def torque(p, a):
    """Return the torque [N m] which a chamber at the gauge pressure p [Pa] exerts on every joint, for polynomial
    coefficients `a`.

    tau = a_1 p + a_2 p^2 + ... with a = (a_1, a_2, ...) in N m/Pa^k. The paper's law tau = p A d is a = (A d,).
    The torque is the same on every joint: the flat face does not stretch, so V(q) = A L + A d sum(q), p dV/dq_i = p A
    d.

    Paper: Sec. III-C
    """
    value = 0.0 * p
    for k in range(len(a) - 1, -1, -1):
        value = (value + a[k]) * p
    return value
