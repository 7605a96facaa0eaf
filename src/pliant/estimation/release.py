"""Detection of the time at which a hand let go of a body, from the disturbance torques of `estimate`."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import xarray as xr

from pliant.errors import InputError

Array = np.ndarray
CLEAR = 2.0  # least ratio of the pull to the torques at the end of the recording
REST = 50  # frames at the end of the recording


class Release(NamedTuple):
    """Times between which the pull of a hand on a body ended, and the joint torques while the hand held it.

    Attributes
    ----------
    begin : float
        Time of the last frame at which the pull was above nine tenths of its initial value, s.
    half, gone : float
        Times of the first frames at which the pull was below a half, and below a tenth, s.
    held : array (n,)
        Torques of the joints while held, N m; in space (2 n,), those about x first.
    after : float
        Root mean square of the torques from half a second after `half` on, over that of `held`.
    """

    begin: float
    half: float
    gone: float
    held: Array
    after: float


def release_of(found: xr.Dataset, *, start: int = 8, frames: int = 6) -> Release:
    """Return when a hand let go of a body that it held at the start. `found` is the result of `estimate` with
    disturbance torques.

    The pull is the median torque of `frames` frames after the first `start` frames, in which the filter converges.
    Later torques are projected onto it. A slow release appears as a long time from `begin` to `gone`.

    Parameters
    ----------
    found : xarray.Dataset
        Result of `estimate`, with disturbance torques.

    Raises
    ------
    InputError
        When nothing pulls at the start, or the pull does not end within the recording.

    Examples
    --------
    On recordings of your own::

        from pliant.estimation import Noise, estimate, release_of
        noise = Noise(random_walk=4.0, initial_disturbance=2.0)
        found = estimate(recording, model, pressure=pliant.Pulse(0.0), noise=noise)
        release_of(found).begin                                    # s
    """
    parts = [name for name in ("disturbance", "disturbance_x", "disturbance_y") if name in found]
    if not parts:
        raise InputError("release_of needs disturbance torques: pass a result of `estimate` with noise.random_walk > 0")
    if found.sizes["time"] < start + 2 * frames:
        raise InputError(
            f"release_of needs at least {start + 2 * frames} frames, got {found.sizes['time']}: record for longer"
        )
    time, torque = found["time"].values, np.concatenate([found[name].values for name in parts], axis=1)
    grip = np.median(torque[start : start + frames], axis=0)
    left = float(np.sqrt(np.mean(np.sum(torque[-REST:] ** 2, axis=1))))
    if np.linalg.norm(grip) <= CLEAR * left:
        raise InputError(
            f"the torque at the start, {np.linalg.norm(grip):.3g} N m, is below {CLEAR:g} times that at the end, "
            f"{left:.3g} N m: the body was not held at the start, or is still held at the end; record from before the "
            "release until the body is free"
        )
    pull = torque @ grip / float(grip @ grip)
    later = np.arange(start + frames, time.size)
    low, least = later[pull[later] < 0.5], later[pull[later] < 0.1]
    if not least.size:
        raise InputError("the pull does not end within the recording: record until the body is free")
    begin = np.flatnonzero(pull[: low[0]] > 0.9)[-1]
    rest = torque[time > time[low[0]] + 0.5]
    after = float(np.sqrt(np.sum(rest**2) / max(len(rest), 1) / float(grip @ grip)))
    return Release(float(time[begin]), float(time[low[0]]), float(time[least[0]]), grip, after)
