"""Measurement functions of a chain in space: positions of points and orientations of links, with their derivatives,
and the tip outputs that controllers use.
"""

from __future__ import annotations

import numpy as np

from pliant.equations.observation import ALONG_X, ALONG_Y, ALONG_Z, TURN_X, TURN_Y, TURN_Z
from pliant.equations.spatial import pose_links, stumpff
from pliant.equations.spatial_points import axis_slope, point_position

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


def observe_rows(x, frame, links, seen, H):
    """Write the m predicted measurements at coordinates x (N,) of a chain in space to `seen` (m,), and their
    derivatives by x to H (m, N).

    A row of `frame.rows` is (kind, link, along, across, aside). It measures x, y or z [m] of a point fixed to a link.
    Three consecutive rows measure the orientation of a link; other kinds are NaN. `links` is scratch. The planar
    function is `observation.observe_rows`.
    """
    rows = frame.rows
    pose_links(x, frame.chain, links)
    for r in range(rows.shape[0]):
        kind = int(rows[r, 0])
        link = int(rows[r, 1])
        if kind in (ALONG_X, ALONG_Y, ALONG_Z):
            axis = 2 if kind == ALONG_Z else kind - ALONG_X
            point_position(link, rows[r, 4], rows[r, 3], rows[r, 2], links, links.turn)
            axis_slope(axis, link, rows[r, 2], links.turn, frame.chain, links, H[r])
            seen[r] = links.turn[axis]
        elif kind == TURN_X:
            observe_turn(link, frame.values[r : r + 3], links, seen[r : r + 3], H[r : r + 3])
        elif kind not in (TURN_Y, TURN_Z):  # those are written with TURN_X
            seen[r] = np.nan


def observe_turn(link, value, work, seen, H):
    """Write the predicted orientation of a link to seen (3,) [rad]: the measured rotation vector `value` (3,) minus the
    rotation vector from the predicted to the measured orientation. Write its derivatives by the N coordinates to H
    (3, N).

    Both are in the base frame. e = value - seen is a rotation vector in fixed axes: exp(e) = E R^T, with the link's R
    and the measured frame E. A turn dw of the link changes e by -J_r^{-1}(e) dw with J_r^{-1} = 1 + [e] / 2 -
    c2'/c2 [e]^2. `seen` is NaN where e exceeds 90 degrees.
    """
    y = value[0] * value[0] + value[1] * value[1] + value[2] * value[2]
    c2, c3, _, _ = stumpff(y)
    c1 = 1.0 - y * c3
    cosine = -0.5
    for i in range(3):
        seen[i] = 0.0
    for i in range(3):
        j = (i + 1) % 3
        m = (i + 2) % 3
        own = 1.0 - y * c2 + c2 * value[i] * value[i]  # column i of E
        left = c1 * value[m] + c2 * value[j] * value[i]
        right = c2 * value[m] * value[i] - c1 * value[j]
        a = work.R[link + 1, i, i]
        b = work.R[link + 1, j, i]
        c = work.R[link + 1, m, i]
        cosine += 0.5 * (a * own + b * left + c * right)
        seen[i] += 0.5 * (b * right - c * left)  # sum of R_i x E_i: twice the skew part of E R^T
        seen[j] += 0.5 * (c * own - a * right)
        seen[m] += 0.5 * (a * left - b * own)
    ratio = angle_over_sine(cosine) if cosine > FLIPPED else np.nan
    for i in range(3):
        seen[i] *= ratio
    turn_slopes(link, seen, work, H)
    for i in range(3):
        seen[i] = value[i] - seen[i]


def turn_slopes(link, e, work, H):
    """Write the derivatives of a link's predicted orientation by the N coordinates to H (3, N). `e` (3,) [rad] is the
    rotation vector from the predicted to the measured orientation.

    They are J_r^{-1}(e) times the axes of the joints before the link, as derived in `observe_turn`.
    """
    y = e[0] * e[0] + e[1] * e[1] + e[2] * e[2]
    c2, _, d2, _ = stumpff(y)
    n = work.P.shape[0]
    for i in range(3):
        for k in range(H.shape[1]):
            H[i, k] = 0.0
    for s in range(len(work.S)):
        k = s // 2 if s < 2 * n else s - 2 * n
        if k > link:
            continue
        along = e[0] * work.S[s, 0] + e[1] * work.S[s, 1] + e[2] * work.S[s, 2]
        for i in range(3):
            j = (i + 1) % 3
            m = (i + 2) % 3
            H[i, s] = work.S[s, i] + 0.5 * (e[j] * work.S[s, m] - e[m] * work.S[s, j])
            H[i, s] -= d2 / c2 * (e[i] * along - y * work.S[s, i])


def tip_outputs(x, strain, geometry, out):
    """Write the selected tip coordinates (x, y or z) [m] of a chain in space to `out`, from its joint angles `x` and
    segment strains.

    Output j is x, y or z as which[j] says. x has T angles, the strains have the shape (S,).

    `geometry` is (body, work, which), with which[j] = 0, 1, 2 for x, y, z. The planar function is
    `observation.tip_outputs`.
    """
    body, work, which = geometry
    n = len(body.mass)
    for i in range(len(x)):
        work.q[i] = x[i]
    for i in range(len(strain)):
        work.q[len(x) + i] = strain[i]
    pose_links(work.q, body, work)
    for j in range(len(out)):
        axis = which[j]
        out[j] = work.r[n, axis] + work.length[n] * work.R[n, axis, 2]


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
