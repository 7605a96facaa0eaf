"""Measurement functions of a chain in space: positions of points and orientations of links."""

from __future__ import annotations

import numpy as np

from pliant.equations.observation import TURN_X, TURN_Y, TURN_Z
from pliant.equations.spatial import pose_links, stumpff
from pliant.equations.spatial_points import point_position

HALVINGS = 3  # of an angle below 180 degrees, after which the series below is exact to rounding
SERIES = 12  # terms of theta / sin(theta)
LEAST = 1e-15  # beside cos^2(theta / 2): keeps the root real at half a turn
FLIPPED = 0.0  # cosine below which, beyond 90 degrees, an orientation is taken for a flip of its markers


def angle_over_sine(cosine):
    """Return theta / sin(theta) from `cosine` = cos(theta), for 0 <= theta < pi, accurate also near 0.

    Three halvings of the angle, then theta / sin(theta) = sum_n a_n (1 - cos theta)^n, a_n / a_{n-1} = n / (2 n + 1).
    The rotation vector of a rotation matrix is this factor times the vector of the matrix' skew part.
    """
    halved = 1.0 + 0.0 * cosine
    for _ in range(HALVINGS):
        cosine = np.sqrt(0.5 * (1.0 + cosine) + LEAST)
        halved = halved * cosine
    ratio = 1.0 + 0.0 * cosine
    for n in range(SERIES, 0, -1):
        ratio = 1.0 + (1.0 - cosine) * (n / (2.0 * n + 1.0)) * ratio
    return ratio / halved


def place_links(x, base_angle, body, work):
    """Write the pose of a chain in space at coordinates x (N,) to `work`; `base_angle` is not used. The planar function
    is `observation.place_links`.
    """
    pose_links(x, body, work)


def point_at(link, along, across, aside, x, base_angle, work, p):
    """Write the position p (3,) [m] of a point of link `link` (-1: the part before the first joint), for the pose in
    `work`. The planar function is `observation.point_at`.
    """
    point_position(link, aside, across, along, work, p)


def look(r, frame, sight):
    """Write what row r of a measurement may depend on to `sight`: the position p (3,) [m] of its point, or, where an
    orientation begins, the orientation of its link as a vector turn (3,) [rad].

    It is the measured rotation vector of the link's frame in the base frame, minus the rotation vector from the
    predicted to the measured orientation. NaN where the two differ by more than 90 degrees. For a further kind, it is
    the predicted rotation vector itself, `axes` holds the axes of the link, and `angle` the angles of the link and of
    the link before it from the base's axis +z (0 for the first). The planar function is `observation.look`.
    """
    link = int(frame.rows[r, 1])
    kind = int(frame.rows[r, 0])
    if kind == TURN_X:
        rotation(frame.values[r : r + 3], sight.E)
        cosine = rotation_between(sight.E, sight.links.R[link + 1], sight.turn)
        for i in range(3):
            sight.turn[i] = frame.values[r + i] - sight.turn[i] if cosine.real > FLIPPED else np.nan
    elif kind not in (TURN_Y, TURN_Z):  # those were written with TURN_X
        point_position(link, frame.rows[r, 4], frame.rows[r, 3], frame.rows[r, 2], sight.links, sight.p)
        if kind > TURN_Z:
            for i in range(3):
                for j in range(3):
                    sight.E[i, j] = 0.0
                    sight.axes[i, j] = sight.links.R[link + 1, i, j]
                sight.E[i, i] = 1.0
            rotation_between(sight.links.R[link + 1], sight.E, sight.turn)
            sight.angle[0] = tilt(sight.links.R[link + 1, :, 2])
            sight.angle[1] = 0.0
            if link > 0:
                sight.angle[1] = tilt(sight.links.R[link, :, 2])


def tilt(z):
    """Return the angle [rad] of a unit vector z (3, ...) from the axis +z."""
    return angle_over_sine(z[2]) * np.sqrt(z[0] * z[0] + z[1] * z[1] + LEAST * LEAST)


def rotation(e, E):
    """Write the rotation matrix of a rotation vector e (3,) [rad] to E (3, 3): c0 + c1 [e] + c2 e e^T, with `stumpff`'s
    functions of its square.
    """
    y = e[0] * e[0] + e[1] * e[1] + e[2] * e[2]
    c2, c3, _, _ = stumpff(y)
    c1 = 1.0 - y * c3
    for i in range(3):
        j = (i + 1) % 3
        m = (i + 2) % 3
        E[i, i] = 1.0 - y * c2 + c2 * e[i] * e[i]
        E[j, i] = c1 * e[m] + c2 * e[j] * e[i]
        E[m, i] = c2 * e[m] * e[i] - c1 * e[j]


def rotation_between(E, R, e):
    """Write the rotation vector [rad] of the rotation E R^T, from the rotation R to the rotation E, to e (3, ...), and
    return the cosine of its angle.

    Both are (3, 3, ...), for any number of rotations at once. The vector is (theta / sin theta) v, where v is the
    vector of the skew part of E R^T: half the sum of the cross products of the columns of R and E.
    """
    cosine = -0.5 + 0.0 * R[0, 0]
    for i in range(3):
        j = (i + 1) % 3
        m = (i + 2) % 3
        skew = 0.0 * R[0, 0]
        for c in range(3):
            skew = skew + (R[j, c] * E[m, c] - R[m, c] * E[j, c])
            cosine = cosine + 0.5 * (E[i, c] * R[i, c])
        e[i] = 0.5 * skew
    ratio = angle_over_sine(cosine)
    for i in range(3):
        e[i] = ratio * e[i]
    return cosine


def turned(rest_shift, turn):
    """Write the changes [rad] of the joint angles to `turn` when the rest angles of the joints change by `rest_shift`
    [rad]. In space the two are equal.

    The planar function is `observation.turned`, for absolute link angles.
    """
    for i in range(len(rest_shift)):
        turn[i] = rest_shift[i]


def motion_of(v, joints):
    """Return the sum of squared joint rates, swing and twist, divided by the number of joints [rad^2/s^2], from the
    rates v (N,).

    The planar function is `observation.motion_of`.
    """
    power = v[0] * v[0]
    for i in range(1, joints.hardening.shape[1] - joints.tied.shape[1]):
        power = power + v[i] * v[i]
    return power / len(joints.unloaded)
