"""The double pendulum in closed form, from a textbook's page: two masses on two rods, absolute angles.

For masses m1, m2 at the ends of l1, l2, torques Q on the absolute angles and gravity g along -y (upright rods):
(m1 + m2) l1^2 a1 + m2 l1 l2 cos(D) a2 + m2 l1 l2 sin(D) w2^2 = (m1 + m2) g l1 sin(phi1) + Q1, D = phi1 - phi2
m2 l2^2 a2 + m2 l1 l2 cos(D) a1 - m2 l1 l2 sin(D) w1^2 = m2 g l2 sin(phi2) + Q2
"""

from __future__ import annotations

import numpy as np


def accelerations(phi, w, l, m, g, Q):
    """Absolute angular accelerations (2,) by Cramer's rule."""
    D = phi[0] - phi[1]
    a11, a22 = (m[0] + m[1]) * l[0] ** 2, m[1] * l[1] ** 2
    a12 = m[1] * l[0] * l[1] * np.cos(D)
    sine = m[1] * l[0] * l[1] * np.sin(D)
    b1 = (m[0] + m[1]) * g * l[0] * np.sin(phi[0]) + Q[0] - sine * w[1] ** 2
    b2 = m[1] * g * l[1] * np.sin(phi[1]) + Q[1] + sine * w[0] ** 2
    determinant = a11 * a22 - a12**2
    return np.array([b1 * a22 - b2 * a12, a11 * b2 - a12 * b1]) / determinant
