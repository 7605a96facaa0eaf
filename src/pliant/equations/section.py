"""The cross-section: bladder area, lever arm, and the torque that pressure makes. Sec. III-C; `chamber` goes on."""

from __future__ import annotations

import numpy as np


def bladder_area(r2):
    """Area of the half-round chamber of inner radius r2 [m], m^2.

    A = pi r2^2 / 2

    The paper calls it the cross-section area of the actuator; the formula is that of the chamber.  # D6
    Paper: Sec. III-C
    """
    return 0.5 * np.pi * r2 * r2


def lever_arm(r2):
    """Distance of the chamber's centroid from its flat face, m.

    d = 4 r2 / (3 pi)

    Paper: Sec. III-C
    """
    return 4.0 * r2 / (3.0 * np.pi)


def torque(p, a):
    """Torque on every joint at gauge pressure p [Pa], N m.

    tau = a_1 p + a_2 p^2 + ... with a = (a_1, a_2, ...) in N m/Pa^k. The paper's law tau = p A d is a = (A d,).
    Every joint feels the same torque: the flat face does not stretch, so V(q) = A L + A d sum(q) and p dV/dq_i = p A d.

    Paper: Sec. III-C
    """
    value = 0.0 * p
    for k in range(len(a) - 1, -1, -1):
        value = (value + a[k]) * p
    return value
