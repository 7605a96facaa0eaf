"""How hard a run was: when the tip settled, and how much the command moved."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

Array = np.ndarray
BAND = 0.02  # of a step: within it the tip has settled
STAYS = 0.2  # of the time that a set-point holds: a tip that is inside for less of its end has not settled
STILL_S = 0.5  # after the wanted place last changed, the command is at rest


def settling_time(time: Array, tip: Array, wanted: float, step: float) -> float | None:
    """Seconds from time[0] after which the tip stays within 2 % of the step; None where it does not settle.

    Parameters
    ----------
    time : array (T,)
        s, from the set-point's beginning to its end.
    tip : array (T,)
        m, displacement along the path.
    wanted, step : float
        m, where the tip shall come to rest, and how far that is from where it was.

    Returns
    -------
    float or None
        None as well where the tip is inside for less than the last fifth of the time: that may be a passage.
    """
    outside = np.flatnonzero(~(np.abs(tip - wanted) <= BAND * abs(step)))
    if not outside.size:
        return 0.0
    if outside[-1] + 1 >= time.size:
        return None
    since = float(time[outside[-1] + 1] - time[0])
    return since if float(time[-1] - time[0]) - since >= STAYS * float(time[-1] - time[0]) else None


def settling_times(time: Array, tip: Array, points: Sequence[tuple[float, float]]) -> list[float | None]:
    """Settling of every set-point (s, m) of a run, each up to the next one; the first step begins at rest, 0 m."""
    found, before = [], 0.0
    ends = [*(t for t, _ in points[1:]), np.inf]
    for (begin, wanted), end in zip(points, ends[: len(points)], strict=True):
        during = (time >= begin) & (time < end)
        if wanted != before and during.sum() > 1:
            found.append(settling_time(time[during], tip[during], wanted, wanted - before))
        before = wanted
    return found


def command_activity(time: Array, wanted: Array, command: Array) -> dict[str, float]:
    """Return the activity of a command, Pa: a measure of a valve's wear and noise.

    Parameters
    ----------
    time, wanted, command : arrays (T,)
        s; m, where the tip is wanted, whose last change `STILL_S` ago makes a period one at rest; Pa.

    Returns
    -------
    dict
        ``command_change_rest``, ``command_change_motion``: root mean square of the change from one period to the next;
        ``command_sd_rest``: standard deviation at rest, about its mean over each rest. Not a number where a run has no
        such part.
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
    """Root mean square; not a number of nothing."""
    return float(np.sqrt(np.mean(x**2))) if x.size else float("nan")
