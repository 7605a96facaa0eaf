"""Emulator of a motion-capture system that records markers on the actuator."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pliant.testbed.fibre import body_angle, stretched
from pliant.testbed.rod import RodParameters
from pliant.testbed.stepping import RodMotion

Array = np.ndarray
BASE = ((0.02, -0.01, 0.0), (-0.02, -0.01, 0.0), (0.0, -0.01, 0.02))  # m, markers on the clamp


@dataclass(frozen=True)
class MotionCapture:
    """A motion-capture system with markers on the convex side of the body and on the clamp (SI units)."""

    markers: int = 5
    stand_off: float = 0.014  # m, from the centreline
    noise: float = 5e-5  # m, each axis
    drop_out: float = 0.002  # probability, each marker and frame
    rate: float = 100.0  # Hz


def marker_names(mocap: MotionCapture) -> list[str]:
    """Return the names of the markers: three on the base, then those on the body from base to tip."""
    return [f"base_{k + 1}" for k in range(len(BASE))] + [f"body_{k + 1}" for k in range(mocap.markers)]


def marker_positions(motion: RodMotion, p: RodParameters, mocap: MotionCapture, at: Array) -> Array:
    """Return the true positions (T, M, 3) [m] of M markers in the actuator's frame at T times `at` (T,) [s]."""
    s, theta = body_angle(motion, p, at)
    half = 0.5 * (theta[:, 1:] + theta[:, :-1])
    step = np.diff(stretched(motion, p, at), axis=1)
    zero = np.zeros((at.size, 1))
    x = np.concatenate([zero, np.cumsum(-np.sin(half) * step, axis=1)], axis=1)
    y = np.concatenate([zero, np.cumsum(np.cos(half) * step, axis=1)], axis=1)
    on = np.round(np.arange(1, mocap.markers + 1) / mocap.markers * (s.size - 1)).astype(int)
    out = np.zeros((at.size, len(BASE) + mocap.markers, 3))
    out[:, : len(BASE)] = BASE
    out[:, len(BASE) :, 0] = x[:, on] + mocap.stand_off * np.cos(theta[:, on])
    out[:, len(BASE) :, 1] = y[:, on] + mocap.stand_off * np.sin(theta[:, on])
    return out


def observe_markers(
    motion: RodMotion, p: RodParameters, mocap: MotionCapture, at: Array, rng: np.random.Generator
) -> Array:
    """Return noisy positions (T, M, 3) [m] of M markers at T times `at` (T,) [s], in a laboratory frame of random pose.
    Lost markers are NaN.
    """
    from scipy.spatial.transform import Rotation

    turn = Rotation.from_quat(rng.standard_normal(4)).as_matrix()
    shift = rng.uniform(-0.5, 0.5, 3)
    out = marker_positions(motion, p, mocap, at) @ turn.T + shift
    out += mocap.noise * rng.standard_normal(out.shape)
    out[rng.random(out.shape[:2]) < mocap.drop_out] = np.nan
    return np.asarray(out)
