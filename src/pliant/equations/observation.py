"""What sensors see of a chain: positions of points that are fixed to links, and how they move with its coordinates.

The one text for fits, filters and contact; whole arrays of a motion take `mechanics.PlanarChain.stations`.
"""

from __future__ import annotations

import numpy as np

ANGLE, ALONG_X, ALONG_Y, JOINT, ALONG_Z, TURN_X, TURN_Y, TURN_Z = range(8)  # what a row of a measurement sees


def place_links(x, base_angle, chain, links):
    """Cosine, sine, stretch and joint (x, y) [m] of the base and all links into `links` (5, n + 1).

    Coordinates x (n + S,) are absolute angles, strains behind them; `chain` is `symbols.ObservedChain`. The joint of
    the base is the origin.
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
    """Position along an axis (0: x, 1: y) of a point fixed to a link (-1: the base), m; see `place_links`.

    p = joint + stretch along e(phi) + across n(phi),  e = (-sin, cos),  n = (-cos, -sin)
    """
    k = link + 1
    reach = along * links[2, k]
    if axis == 0:
        return links[3, k] - reach * links[1, k] - across * links[0, k]
    return links[4, k] + reach * links[0, k] - across * links[1, k]


def point_slope(axis, place, chain, links, row):
    """Slopes (n + S,) by the coordinates of `position`; `place` is (link, along, across)."""
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
    """Return the position along an axis [m] that a row (kind, link, along, across) sees; slope (n + S,) by coordinates.

    `links` holds what `place_links` wrote.
    """
    link = int(row[1])
    point_slope(axis, (link, row[2], row[3]), chain, links, slope)
    return position(axis, link, row[2], row[3], links)


def observe_rows(x, frame, links, seen, H):
    """What each row of a measurement sees (m,), and its slopes H (m, N) with respect to the coordinates x (N,).

    A row is (kind, link, along, across): the angle of a link, from +y or from the link before it, or x or y of a point
    fixed to it. `links` is scratch. In space: `spatial_observation.observe_rows`.
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
            continue
        seen[r] = observe_point(kind - ALONG_X, rows[r], frame.chain, links, H[r])


def tip_outputs(angle, strain, geometry, out):
    """Outputs at absolute angles (n,) and strains (S,): tip x, tip y [m] or the last link's angle, as `which` says."""
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
    """Write what shifts of the joints' rest angles (n,) turn the links by, turn (n + S,), strains behind untouched."""
    total = 0.0
    for i in range(len(rest_shift)):
        total = total + rest_shift[i]
        turn[i] = total


def motion_of(w, joints):
    """Return the mean square of the joint rates [rad^2/s^2], of the rates w of links, and of strains behind them."""
    n = len(joints.theta0)
    power = w[0] * w[0]
    for i in range(1, n):
        power = power + (w[i] - w[i - 1]) * (w[i] - w[i - 1])
    return power / n


def observe(phi, base_angle, places, seen):
    """Position [m] and angle [rad] of the observed points, seen (S, 3), at coordinates phi (n + S,).

    Angles are less `places.reference`.
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
