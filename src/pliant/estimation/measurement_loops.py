"""What a frame of the shape sees of the links, and its slopes: compiled for filters and observers."""

from __future__ import annotations

from pliant.equations.observation import observe_point, place_links

ANGLE, ALONG_X, ALONG_Y, JOINT, ALONG_Z = 0, 1, 2, 3, 4  # what a row of a measurement sees


def observe(x, frame, links, seen, H):
    """What each row of a measurement sees (m,), and its slopes H (m, N) with respect to the coordinates x (N,).

    A row is (kind, link, along, across): the angle of a link, from +y or from the link before it, or x or y of a point
    fixed to it. Of a chain in space it is (kind, link, along, across, aside), and sees x, y or z of a point. `links` is
    scratch.
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
        axis = 2 if kind == ALONG_Z else kind - ALONG_X
        seen[r] = observe_point(axis, rows[r], frame.chain, links, H[r])
