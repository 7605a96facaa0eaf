"""Order of the components of recorded quaternions, judged by the positions beside them: of a body that bends, a
neighbour moves less in the axes of a station than in fixed axes.
"""

from __future__ import annotations

import numpy as np

Array = np.ndarray
MUCH_BETTER = 0.5  # spread of the neighbours in one order over that in another, from which the order is known
TURNS = 0.02  # least spread of the direction to a neighbour in fixed axes: below it, no orientation shows
ORDERS = {"x, y, z, w": [0, 1, 2, 3], "w, x, y, z": [1, 2, 3, 0]}  # where x, y, z and w are in each
INVERSE = "the inverse of x, y, z, w"


def shown_order(position: Array, quaternion: Array) -> str:
    """Return the order of the components of quaternions that the positions show: a key of `ORDERS`, or `INVERSE` if
    the quaternions turn the fixed axes to those of the stations; "" if the motion does not show it.

    Parameters
    ----------
    position : (T, S, 3) array
        Positions of S stations from base to tip, in any unit; NaN for gaps.
    quaternion : (T, S, 4) array
        Unit quaternions in the order in which they were recorded.
    """
    spreads: dict[str, float] = {}
    for name, components in ORDERS.items():
        spreads[name] = spread(position, quaternion[..., components])
    spreads[INVERSE] = spread(position, quaternion * np.array([-1.0, -1.0, -1.0, 1.0]))
    best, second = sorted(spreads.values())[:2]
    if not best < MUCH_BETTER * min(second, 1.0):
        return ""
    return min(spreads, key=lambda name: spreads[name])


def spread(position: Array, quaternion: Array) -> float:
    """Return by how much neighbours move in the axes of the stations that turn, relative to fixed axes; infinite if
    the directions to them hardly turn.
    """
    from scipy.spatial.transform import Rotation

    own, fixed = 0.0, 0.0
    for s in range(position.shape[1]):
        known = np.isfinite(quaternion[:, s]).all(axis=1) & (np.linalg.norm(quaternion[:, s], axis=1) > 0)
        if not turns(quaternion[known, s]):
            continue
        for other in {s - 1, s + 1} & set(range(position.shape[1])):
            rows = known & np.isfinite(position[:, [s, other]]).all(axis=(1, 2))
            if rows.sum() < 3:
                continue
            way = position[rows, other] - position[rows, s]
            if np.sqrt(way.var(axis=0).sum()) < TURNS * np.linalg.norm(way.mean(axis=0)):
                continue
            own += float(Rotation.from_quat(quaternion[rows, s]).inv().apply(way).var(axis=0).sum())
            fixed += float(way.var(axis=0).sum())
    return float(np.sqrt(own / fixed)) if fixed else float("inf")


def turns(quaternion: Array) -> bool:
    """Return whether quaternions (T, 4) turn by more than noise; q and -q are the same rotation."""
    if not len(quaternion):
        return False
    unit = quaternion / np.linalg.norm(quaternion, axis=1, keepdims=True)
    return bool((np.abs(unit @ unit[0]) < np.cos(TURNS / 2)).any())
