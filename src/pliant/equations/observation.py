"""Measurement functions: the kinds of rows of a measurement with their derivatives by a chain's coordinates, and the
positions and angles of a planar chain on which they depend.

Fits, filters and contact detection use these kernels. `mechanics.PlanarChain.stations` is the vectorised form for a
whole motion.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from pliant.equations.linearised import carriers, derivative, derivatives_carried, seeded

# kinds of rows of a measurement
ANGLE, ALONG_X, ALONG_Y, JOINT, ALONG_Z, TURN_X, TURN_Y, TURN_Z, GRAVITY_X, GRAVITY_Y, GRAVITY_Z = range(11)


class RowKind(NamedTuple):
    """A kind of row of a measurement."""

    name: str
    meaning: str
    unit: str
    constants: dict[int, int]  # number of constants in such a row, by the dimensions of space that have the kind
    variable: str  # of a recording, which may have a row for each axis; empty: none
    noise: float  # default standard deviation of a measured value, including the deviation of the body from its model


FREE, FLAT, SOLID = {2: 0, 3: 0}, {2: 0}, {3: 0}
DOWN = {2: 2, 3: 3}  # the direction of gravity in fixed axes, a unit vector
KINDS = {  # of every kind, in the order of its number
    ANGLE: RowKind("angle", "angle of a link from the base", "rad", FLAT, "angle", 1e-3),
    ALONG_X: RowKind("x", "x of a point", "m", FREE, "position", 5e-4),
    ALONG_Y: RowKind("y", "y of a point", "m", FREE, "position", 5e-4),
    JOINT: RowKind("joint angle", "angle of a link from the link before it", "rad", FLAT, "", 1e-3),
    ALONG_Z: RowKind("z", "z of a point", "m", SOLID, "position", 5e-4),
    TURN_X: RowKind("turn x", "x of the rotation vector of a link", "rad", SOLID, "quaternion", 1e-3),
    TURN_Y: RowKind("turn y", "y of the rotation vector of a link", "rad", SOLID, "quaternion", 1e-3),
    TURN_Z: RowKind("turn z", "z of the rotation vector of a link", "rad", SOLID, "quaternion", 1e-3),
    GRAVITY_X: RowKind("gravity x", "direction of gravity along x of a link", "1", DOWN, "gravity", 5e-3),
    GRAVITY_Y: RowKind("gravity y", "direction of gravity along y of a link", "1", DOWN, "gravity", 5e-3),
    GRAVITY_Z: RowKind("gravity z", "direction of gravity along z of a link", "1", {3: 3}, "gravity", 5e-3),
}
# of kinds beside positions, angles and orientations, by variable of a recording: the number of its first kind
FURTHER = {row.variable: k for k, row in reversed(KINDS.items())
           if row.variable not in ("", "position", "angle", "quaternion")}  # fmt: skip


def kinds_of(variable, dimension):
    """Return the numbers of the kinds of rows that measure a variable of a recording in 2 or 3 dimensions; an empty
    list if none does.
    """
    return [kind for kind, row in KINDS.items() if row.variable == variable and dimension in row.constants]


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


def point_at(link, along, across, aside, x, base_angle, links, p):
    """Write the position x, y [m] of a point of link `link` (-1: the base), and the angle [rad] of the link, to p (3,).

    `along` and `across` [m] locate the point on the link; `aside` is 0 in the plane. In space, `p` receives x, y, z:
    `spatial_observation.point_at`.
    """
    p[0] = position(0, link, along, across, links)
    p[1] = position(1, link, along, across, links)
    p[2] = base_angle
    if link >= 0:
        p[2] = x[link]


def look(r, frame, sight):
    """Write what row r of a measurement may depend on to `sight`: the position p (x, y) [m] of its point, and the
    angles [rad] of its link and of the link before it (0 for the first), and the axes of the link.

    `sight` is a `symbols.Sight` at whose coordinates `place_links` has placed the links. In space:
    `spatial_observation.look`.
    """
    link = int(frame.rows[r, 1])
    point_at(link, frame.rows[r, 2], frame.rows[r, 3], 0.0, sight.x, frame.base_angle, sight.links, sight.p)
    sight.angle[0] = sight.p[2]
    sight.p[2] = np.nan
    sight.axes[0, 0] = sight.links[0, link + 1]
    sight.axes[1, 0] = sight.links[1, link + 1]
    sight.axes[0, 1] = -sight.links[1, link + 1]
    sight.axes[1, 1] = sight.links[0, link + 1]
    sight.axes[2, 0] = 0.0
    sight.axes[2, 1] = 0.0
    sight.angle[1] = 0.0
    if link > 0:
        sight.angle[1] = sight.x[link - 1]


def row_value(kind, sight, constants):
    """Return the value of a row of a measurement, of one of `KINDS`, from the `symbols.Sight` of its point and link and
    the constants (k,) of the row.

    It is NaN for an unknown kind, and for one that the body does not have. Filters compile this text; fits run it on
    arrays whose axes follow those of the components, such as p (3, T, S).
    """
    if kind == ANGLE:
        return sight.angle[0]
    if kind == JOINT:
        return sight.angle[0] - sight.angle[1]
    if kind in (ALONG_X, ALONG_Y, ALONG_Z):
        return sight.p[min(kind - ALONG_X, 2)]
    if kind in (TURN_X, TURN_Y, TURN_Z):
        return sight.turn[kind - TURN_X]
    if kind in (GRAVITY_X, GRAVITY_Y, GRAVITY_Z):
        return along_axis(kind - GRAVITY_X, sight.axes, constants)
    return np.nan * sight.p[0]


def along_axis(axis, axes, vector):
    """Return the component along one axis of a link, column `axis` of `axes` (3, 3), of a vector in fixed axes, the
    first two or three entries of `vector`.
    """
    value = axes[0, axis] * vector[0]
    for i in range(1, min(3, len(vector))):
        value = value + axes[i, axis] * vector[i]
    return value


def observe_rows(x, frame, sight, seen, H):
    """Write the m predicted measurements at coordinates x (N,) to `seen` (m,), and their derivatives by x to H (m, N).

    A row of `frame.rows` is (kind, link, along, across), in space (kind, link, along, across, aside), and then the
    constants of its kind. It measures one of `KINDS` at a point fixed to a link; three consecutive rows measure the
    orientation of a link in space. `sight` is a `symbols.Sight` of numbers that carry derivatives, see
    `Mechanics.sight`. For bodies in space, `place_links` and `look` are replaced by those of `spatial_observation`.
    """
    moved = carriers(sight)
    together = derivatives_carried()
    for first in range(0, len(x), together):
        for i in range(len(x)):
            moved.x[i] = seeded(x[i], i - first)
        place_links(moved.x, frame.base_angle, frame.chain, moved.links)
        for r in range(frame.rows.shape[0]):
            look(r, frame, moved)
            value = row_value(int(frame.rows[r, 0]), moved, frame.rows[r, frame.wide :])
            seen[r] = value.real
            for k in range(first, min(first + together, len(x))):
                H[r, k] = derivative(value, k - first)


def outputs(angle, strain, frame, sight, out):
    """Write the values of the m rows of `frame` to `out` (m,), at the coordinates of a chain: its angles and its S
    strains (S,).

    `observe_rows` also computes the derivatives. `sight` is a `symbols.Sight` of floats.
    """
    for i in range(len(angle)):
        sight.x[i] = angle[i]
    for i in range(len(strain)):
        sight.x[len(angle) + i] = strain[i]
    place_links(sight.x, frame.base_angle, frame.chain, sight.links)
    for r in range(len(out)):
        look(r, frame, sight)
        out[r] = row_value(int(frame.rows[r, 0]), sight, frame.rows[r, frame.wide :])


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

    The first joint turns against the base, whose mean rate in a time step is `joints.spin`. w may hold rates of strains
    behind those of the links.
    """
    n = len(joints.theta0)
    power = (w[0] - joints.spin[0]) * (w[0] - joints.spin[0])
    for i in range(1, n):
        power = power + (w[i] - w[i - 1]) * (w[i] - w[i - 1])
    return power / n


def observe(x, base_angle, places, seen):
    """Write the coordinates of the S observed points of `places` to seen (S, 3) at the coordinates x (N,) of a chain:
    position x, y [m] and angle [rad] in the plane, position x, y, z [m] in space.

    `places` is a `follow_loops.Places`. In space `place_links` and `point_at` are those of `spatial_observation`.
    """
    place_links(x, base_angle, places.chain, places.links)
    for j in range(len(places.carrier)):
        link = places.carrier[j]
        point_at(link, places.along[j], places.across[j], places.aside[j], x, base_angle, places.links, seen[j])
        for i in range(3):
            seen[j, i] = seen[j, i] + places.shift[i]
