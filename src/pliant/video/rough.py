"""Compute a rough centreline of the body from a single frame, to start tracking or resume after a gap."""

from __future__ import annotations

import numpy as np

from pliant.recording.camera import opencv
from pliant.video.surroundings import Surroundings

Array = np.ndarray
LEVELS = 24  # intervals of distance from the base
LEAST_PIXELS = 40  # least number of pixels of the body in the small picture


def mask_of(small: Array, around: Surroundings) -> Array:
    """Return the mask (h, w) of the pixels of the body in a small picture (h, w, 3)."""
    cv2 = opencv("tracking a video")
    light, behind = small.astype(np.float32) @ around.weight, around.small @ around.weight
    share = (light - behind) / np.maximum(around.body - behind, 0.3)
    mask = ((share > 0.5) & around.reach).astype(np.uint8)
    mask = cv2.morphologyEx(mask, cv2.MORPH_CLOSE, np.ones((3, 3), np.uint8))
    count, label, facts, _ = cv2.connectedComponentsWithStats(mask)
    if count < 2:
        return np.zeros(mask.shape, bool)
    inside = np.bincount(label[around.always], minlength=count)
    inside[0] = 0
    best = int(inside.argmax()) if inside.any() else 1 + int(facts[1:, cv2.CC_STAT_AREA].argmax())
    return np.asarray(label == best)


def rough_line(mask: Array, start: Array | None) -> Array | None:
    """Return points (N, 2) along the middle of a mask (h, w), base first; None where the mask is too small.

    Parameters
    ----------
    start : array (2,), optional
        Position of the base. Without it the line begins at one of the two ends that are farthest apart.
    """
    place = np.argwhere(mask)[:, ::-1].astype(float)
    if len(place) < LEAST_PIXELS:
        return None
    seen = _distances(mask, place, place[0] if start is None else start)
    if start is None:
        seen = _distances(mask, place, place[int(np.where(np.isfinite(seen), seen, -1.0).argmax())])
    whole = np.isfinite(seen)
    step = seen[whole].max() / LEVELS
    level = np.minimum((seen[whole] / step).astype(int), LEVELS - 1)
    count = np.bincount(level, minlength=LEVELS)
    middle = np.stack([np.bincount(level, place[whole, k], LEVELS) / np.maximum(count, 1) for k in (0, 1)], axis=1)
    return np.asarray(middle[count > 0])


def _distances(mask: Array, place: Array, start: Array) -> Array:
    """Return the distance (N,) of each pixel of the mask from the pixel nearest to `start`, within the mask."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import dijkstra

    number = np.full((mask.shape[0] + 2, mask.shape[1] + 2), -1)
    number[1:-1, 1:-1][mask] = np.arange(len(place))
    rows, columns, lengths = [], [], []
    for dy, dx in ((0, 1), (1, 0), (1, 1), (1, -1)):
        here, there = number[1:-1, 1:-1], number[1 + dy : mask.shape[0] + 1 + dy, 1 + dx : mask.shape[1] + 1 + dx]
        both = (here >= 0) & (there >= 0)
        rows.append(here[both])
        columns.append(there[both])
        lengths.append(np.full(int(both.sum()), float(np.hypot(dy, dx))))
    graph = coo_array((np.concatenate(lengths), (np.concatenate(rows), np.concatenate(columns))),
                      shape=(len(place), len(place))).tocsr()  # fmt: skip
    nearest = int(np.linalg.norm(place - start, axis=1).argmin())
    return np.asarray(dijkstra(graph, directed=False, indices=nearest))
