"""Measurement functions of a planar chain: positions of points on links, link angles, and their derivatives by the
chain's coordinates.

Fits, filters and contact detection use these kernels. `mechanics.PlanarChain.stations` is the vectorised form for a
whole motion.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

ANGLE, ALONG_X, ALONG_Y, JOINT, ALONG_Z, TURN_X, TURN_Y, TURN_Z = range(8)  # kinds of rows of a measurement


class RowKind(NamedTuple):
    """What a kind of row measures, its unit, and in which dimensions of space `observe_rows` computes it."""

    meaning: str
    unit: str
    dimensions: tuple[int, ...]


KINDS = {  # of every kind, in the order of its number
    ANGLE: RowKind("angle of a link from the base", "rad", (2,)),
    ALONG_X: RowKind("x of a point", "m", (2, 3)),
    ALONG_Y: RowKind("y of a point", "m", (2, 3)),
    JOINT: RowKind("angle of a link from the link before it", "rad", (2,)),
    ALONG_Z: RowKind("z of a point", "m", (3,)),
    TURN_X: RowKind("x of the rotation vector of a link", "rad", (3,)),
    TURN_Y: RowKind("y of the rotation vector of a link", "rad", (3,)),
    TURN_Z: RowKind("z of the rotation vector of a link", "rad", (3,)),
}


def place_links(x, base_angle, chain, links):
    """Write cosine, sine, stretch and joint position (x, y) [m] of the base and all n links to `links` (5, n + 1), at
    coordinates x.

    The coordinates x (n + S,) are absolute angles [rad], then strains. `chain` is a `symbols.ObservedChain`. Column 0
    is the base, whose joint is the origin.
    """
    n = len(chain.length)
    px = 0.0 * x[0]
    py = 0.0 * x[0]
    for k in range(n + 1):
        angle = base_angle
        reach = chain.base_length
        if k > 0:
            angle = x[k - 1]
            reach = chain.length[k - 1]
        c = np.cos(angle)
        s = np.sin(angle)
        stretch = 1.0 + 0.0 * x[0]
        for i in range(n, len(x)):
            stretch = stretch + chain.share[k, i - n] * x[i]
        links[0, k] = c
        links[1, k] = s
        links[2, k] = stretch
        links[3, k] = px
        links[4, k] = py
        px = px - reach * stretch * s
        py = py + reach * stretch * c


def position(axis, link, along, across, links):
    """Return one coordinate [m] (`axis` 0: x, 1: y) of the point at `along`, `across` [m] on link `link` (-1: the
    base).

    `along` and `across` [m] locate the point on the link, `links` is the array written by `place_links`.

    p = joint + stretch along e(phi) + across n(phi),  e = (-sin, cos),  n = (-cos, -sin)
    """
    k = link + 1
    reach = along * links[2, k]
    if axis == 0:
        return links[3, k] - reach * links[1, k] - across * links[0, k]
    return links[4, k] + reach * links[0, k] - across * links[1, k]


def point_slope(axis, place, chain, links, row):
    """Write the derivatives of a point's x or y position [m] with respect to n link angles and S strains to `row` (n +
    S,). `place` holds the index of the point's link and the distances [m] along and across this link.

    The position is that of `position`.
    """
    link, along, across = place
    n = len(chain.length)
    for i in range(len(row)):
        row[i] = 0.0 * along
    for k in range(link + 2):
        c = links[0, k]
        s = links[1, k]
        reach = chain.base_length
        aside = 0.0 * across
        if k > 0:
            reach = chain.length[k - 1]
        if k == link + 1:
            reach = along
            aside = across
        for i in range(n, len(row)):
            part = chain.share[k, i - n] * reach
            if axis == 0:
                row[i] = row[i] - part * s
            else:
                row[i] = row[i] + part * c
        if k > 0:
            whole = reach * links[2, k]
            if axis == 0:
                row[k - 1] = -whole * c + aside * s
            else:
                row[k - 1] = -whole * s - aside * c


def observe_point(axis, row, chain, links, slope):
    """Return the x or y position [m] of a measured point on a link, and write its derivatives by the coordinates to
    `slope` (n + S,).

    `axis` is 0 for x, 1 for y. The row is (kind, link, along, across). `links` is the array written by `place_links`.
    """
    link = int(row[1])
    point_slope(axis, (link, row[2], row[3]), chain, links, slope)
    return position(axis, link, row[2], row[3], links)


def observe_rows(x, frame, links, seen, H):
    """Write the m predicted measurements at coordinates x (N,) to `seen` (m,), and their derivatives by x to H (m, N).

    A row of `frame.rows` is (kind, link, along, across). It measures the angle of a link [rad], from +y or from the
    link before it, or the x or y position [m] of a point fixed to the link; other kinds are NaN. `links` is scratch.
    Chains in space use `spatial_observation.observe_rows`.
    """
    rows = frame.rows
    place_links(x, frame.base_angle, frame.chain, links)
    for r in range(rows.shape[0]):
        kind = int(rows[r, 0])
        link = int(rows[r, 1])
        if kind in (ANGLE, JOINT):
            for k in range(len(x)):
                H[r, k] = 0.0
            seen[r] = x[link]
            H[r, link] = 1.0
            if kind == JOINT and link > 0:
                seen[r] -= x[link - 1]
                H[r, link - 1] = -1.0
        elif kind in (ALONG_X, ALONG_Y):
            seen[r] = observe_point(kind - ALONG_X, rows[r], frame.chain, links, H[r])
        else:
            seen[r] = np.nan


def tip_outputs(angle, strain, geometry, out):
    """Write the selected outputs to `out`: tip x or y [m], or the last link's angle [rad], from absolute link angles
    and segment strains.

    `geometry` is (length, share, x0, y0, which). which[j] selects output j: 0 is x, 1 is y, 2 is the angle.
    """
    length, share, x0, y0, which = geometry
    x = 0.0
    y = 0.0
    for i in range(len(length)):
        stretch = 1.0
        for s in range(len(strain)):
            stretch = stretch + share[i, s] * strain[s]
        if i == 0:
            x = x0 * stretch
            y = y0 * stretch
        else:
            x = x - length[i] * stretch * np.sin(angle[i - 1])
            y = y + length[i] * stretch * np.cos(angle[i - 1])
    for j in range(len(out)):
        if which[j] == 0:
            out[j] = x
        elif which[j] == 1:
            out[j] = y
        else:
            out[j] = angle[len(angle) - 1]


def turned(rest_shift, turn):
    """Write the changes [rad] of the n absolute link angles to turn (n + S,) when the rest angles of the joints change
    by `rest_shift` (n,) [rad]. The S entries of the strains are left unchanged.
    """
    total = 0.0
    for i in range(len(rest_shift)):
        total = total + rest_shift[i]
        turn[i] = total


def motion_of(w, joints):
    """Return the mean over the joints of the squared joint rates [rad^2/s^2], from the rates w of the absolute link
    angles.

    w may hold rates of strains behind those of the links.
    """
    n = len(joints.theta0)
    power = w[0] * w[0]
    for i in range(1, n):
        power = power + (w[i] - w[i - 1]) * (w[i] - w[i - 1])
    return power / n


def observe(phi, base_angle, places, seen):
    """Write position x, y [m] and angle [rad] of the S observed points to seen (S, 3), from link angles and strains
    `phi`.

    The angles are measured from `places.reference`.
    """
    place_links(phi, base_angle, places.chain, places.links)
    for j in range(len(places.carrier)):
        link = places.carrier[j]
        x = position(0, link, places.along[j], places.across[j], places.links)
        y = position(1, link, places.along[j], places.across[j], places.links)
        angle = base_angle
        if link >= 0:
            angle = phi[link]
        seen[j, 0] = x + places.shift_x
        seen[j, 1] = y + places.shift_y
        seen[j, 2] = angle - places.reference
