"""Measurement functions: the kinds of rows of a measurement with their derivatives by a chain's coordinates, and the
positions and angles of a planar chain on which they depend.

Fits, filters and contact detection use these kernels. `mechanics.PlanarChain.stations` is the vectorised form for a
whole motion.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from pliant.equations.linearised import carriers, derivative, derivatives_carried, seeded

ANGLE, ALONG_X, ALONG_Y, JOINT, ALONG_Z, TURN_X, TURN_Y, TURN_Z = range(8)  # kinds of rows of a measurement


class RowKind(NamedTuple):
    """What a kind of row measures, its unit, and the dimensions of space that have it."""

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


def look(r, frame, sight):
    """Write what row r of a measurement may depend on to `sight`: the position p (x, y) [m] of its point, and the
    angles [rad] of its link and of the link before it (0 for the first).

    `sight` is a `symbols.Sight` at whose coordinates `place_links` has placed the links. In space:
    `spatial_observation.look`.
    """
    link = int(frame.rows[r, 1])
    for axis in range(2):
        sight.p[axis] = position(axis, link, frame.rows[r, 2], frame.rows[r, 3], sight.links)
    sight.angle[0] = sight.x[link]
    sight.angle[1] = 0.0
    if link > 0:
        sight.angle[1] = sight.x[link - 1]


def row_value(kind, sight):
    """Return the value of a row of a measurement, of one of `KINDS`, from the `symbols.Sight` of its point and link.

    It is NaN for an unknown kind, and for one that the body does not have.
    """
    if kind == ANGLE:
        return sight.angle[0]
    if kind == JOINT:
        return sight.angle[0] - sight.angle[1]
    if kind in (ALONG_X, ALONG_Y):
        return sight.p[kind - ALONG_X]
    if kind == ALONG_Z:
        return sight.p[2]
    if kind in (TURN_X, TURN_Y, TURN_Z):
        return sight.turn[kind - TURN_X]
    return np.nan * sight.p[0]


def observe_rows(x, frame, sight, seen, H):
    """Write the m predicted measurements at coordinates x (N,) to `seen` (m,), and their derivatives by x to H (m, N).

    A row of `frame.rows` is (kind, link, along, across), in space (kind, link, along, across, aside). It measures one
    of `KINDS` at a point fixed to a link; three consecutive rows measure the orientation of a link in space. `sight` is
    a `symbols.Sight` of numbers that carry derivatives, see `Mechanics.sight`. For bodies in space, `place_links` and
    `look` are replaced by those of `spatial_observation`.
    """
    moved = carriers(sight)
    together = derivatives_carried()
    for first in range(0, len(x), together):
        for i in range(len(x)):
            moved.x[i] = seeded(x[i], i - first)
        place_links(moved.x, frame.base_angle, frame.chain, moved.links)
        for r in range(frame.rows.shape[0]):
            look(r, frame, moved)
            value = row_value(int(frame.rows[r, 0]), moved)
            seen[r] = value.real
            for k in range(first, min(first + together, len(x))):
                H[r, k] = derivative(value, k - first)


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
