"""Measures of a control run: the settling time of the tip, and how much the command changes."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

Array = np.ndarray
BAND = 0.02  # fraction of a step within which the tip has settled
STAYS = 0.2  # fraction of a set-point's duration for which the tip must stay settled at its end
STILL_S = 0.5  # s after the last change of the target, from which the command is taken as at rest


def settling_time(time: Array, tip: Array, wanted: float, step: float) -> float | None:
    """Return the settling time [s] of the tip after a step of its target, or None if the tip does not settle. From this
    time on the tip deviates from the target by at most 2 % of the step.

    Parameters
    ----------
    time : array (T,)
        Times [s], from the set-point's beginning to its end.
    tip : array (T,)
        Displacement of the tip along its path [m].
    wanted, step : float
        Target displacement, and its difference from the previous one [m].

    Returns
    -------
    float or None
        None also when the tip is within 2 % for less than the last fifth of the time: it may only pass the target then.
    """
    outside = np.flatnonzero(~(np.abs(tip - wanted) <= BAND * abs(step)))
    if not outside.size:
        return 0.0
    if outside[-1] + 1 >= time.size:
        return None
    since = float(time[outside[-1] + 1] - time[0])
    return since if float(time[-1] - time[0]) - since >= STAYS * float(time[-1] - time[0]) else None


def settling_times(time: Array, tip: Array, points: Sequence[tuple[float, float]]) -> list[float | None]:
    """Return the settling time [s] of the tip after each change of the set-point in a run. It is None where the tip
    does not settle. A set-point is a pair (time [s], displacement [m]).

    The first step begins at 0 m.

    Each set-point lasts up to the next one.
    """
    found, before = [], 0.0
    ends = [*(t for t, _ in points[1:]), np.inf]
    for (begin, wanted), end in zip(points, ends[: len(points)], strict=True):
        during = (time >= begin) & (time < end)
        if wanted != before and during.sum() > 1:
            found.append(settling_time(time[during], tip[during], wanted, wanted - before))
        before = wanted
    return found


def command_activity(time: Array, wanted: Array, command: Array) -> dict[str, float]:
    """Return three measures [Pa] of how much a command changes: its root-mean-square change per control period while
    the target is at rest, the same while the target moves, and its standard deviation while the target is at rest.

    Parameters
    ----------
    time, wanted, command : arrays (T,)
        Times [s], target displacement [m] and command [Pa]. A period counts as at rest from `STILL_S` after the last
        change of the target.

    Returns
    -------
    dict
        ``command_change_rest``, ``command_change_motion``: root mean square [Pa] of the change from one period to the
        next; ``command_sd_rest``: standard deviation [Pa] at rest, about the mean of each interval of rest. NaN where
        a run has no such interval.
    """
    changed = np.append(True, np.diff(wanted) != 0.0)
    last = np.maximum.accumulate(np.where(changed, time, -np.inf))
    rest = time - last >= STILL_S
    step = np.diff(command)
    still = rest[1:] & rest[:-1]
    part = np.cumsum(np.append(False, np.diff(rest.astype(int)) > 0))  # which rest
    about = [command[rest & (part == k)] for k in np.unique(part[rest])]
    return {
        "command_change_rest": rms(step[still]), "command_change_motion": rms(step[~still]),
        "command_sd_rest": rms(np.concatenate([c - c.mean() for c in about])) if about else float("nan"),
    }


def rms(x: Array) -> float:
    """Return the root mean square of the array `x`, or NaN if it is empty."""
    return float(np.sqrt(np.mean(x**2))) if x.size else float("nan")
