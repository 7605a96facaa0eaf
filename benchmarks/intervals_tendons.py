"""Measure how often intervals contain the true values of an arm with tendons and friction, simulated by MuJoCo.

The body is that of intervals_in_space.py: three rods on ball joints in MuJoCo. The friction is computed here from the
equation of a rope on a bent path, dT/ds = -mu kappa T w / sqrt(w^2 + w_0^2). The tension is integrated along the arc of
each joint in several parts; w is the rate at which the rope passes the middle of each part, and a joint feels the mean
tension over its arc. pliant has one rate for each joint, and the mean of the tensions before and behind the joint. With
1 part, only this mean differs, by a fraction (mu swing)^2 / 12. With more parts, a rope can also slip in opposite
directions on the two sides of a joint. Each seed draws friction, gain and azimuth of both tendons and the body's
stiffness and damping. Two records have known tensions that rise and fall, with noise of 1 mm. Percentages are as in
intervals_in_space.py.

Usage: python benchmarks/intervals_tendons.py [seeds] [first seed] [parts of an arc]
"""

from __future__ import annotations

import sys

import mujoco
import numpy as np
from intervals_in_space import LINKS, STEP, chain, count, moved, record

from pliant.identification import FitResult, Parameter, fit
from pliant.model import Model, Tendon

LEVER, EDGE, TICK = 0.012, 5e-3, 2.5e-4  # m, m/s, s of a step of MuJoCo
AZIMUTHS = {"red": 0.4, "green": 2.3}
FRICTION = 0.4
RECORDS = {
    "first": {"red": (0.0, 11.0, 11.0, 3.0, 0.0, 5.0), "green": (0.0, 0.0, 5.0, 11.0, 4.0, 0.0)},
    "second": {"red": (0.0, 5.0, 11.0, 6.0, 8.0, 0.0), "green": (0.0, 9.0, 2.0, 0.0, 6.0, 3.0)},
}  # N


def tendon_arm() -> Model:
    """Return the chain in the middle of all ranges."""
    cord = {"driven_by": "tension", "lever": LEVER, "friction": FRICTION, "slip_rate": EDGE}
    return chain().with_(
        chambers=[Tendon.at_azimuth(a, np.ones(LINKS), name=name, **cord) for name, a in AZIMUTHS.items()]
    )


def drawn(rng: np.random.Generator | None = None) -> dict[str, float]:
    """Return random values of all parameters of one body; values in the middle without `rng`."""

    def near(value: float, part: float = 0.25) -> float:
        return value * (1.0 if rng is None else rng.uniform(1.0 - part, 1.0 + part))

    values = {"stiffness": near(0.6), "damping": near(4e-3)}
    for name, middle in AZIMUTHS.items():
        size, azimuth = near(1.0), middle + 0.15 * (near(1.0, 1.0) - 1.0)
        values |= {f"{name}.gain_x": -size * np.sin(azimuth), f"{name}.gain_y": size * np.cos(azimuth),
                   f"{name}.friction": near(FRICTION, 0.5)}  # fmt: skip
    return values


def swings(data: mujoco.MjData) -> tuple[np.ndarray, np.ndarray]:
    """Return swings of the joints [rad] and their rates [rad/s], each (n, 2), of rods that do not twist."""
    q, w = data.qpos.reshape(-1, 4), data.qvel.reshape(-1, 3)
    half = np.arctan2(np.linalg.norm(q[:, 1:], axis=1), q[:, 0])
    axis = q[:, 1:] / np.maximum(np.linalg.norm(q[:, 1:], axis=1, keepdims=True), 1e-300)
    v = 2.0 * half[:, None] * axis
    rates = []
    for vector, omega in zip(v, w, strict=True):  # the rate of a rotation vector from the angular velocity of the body
        y = vector @ vector
        c = 1.0 / 12.0 + y / 720.0 if y < 1e-4 else (1.0 - 0.5 * np.sqrt(y) / np.tan(0.5 * np.sqrt(y))) / y
        rates.append(omega + 0.5 * np.cross(vector, omega) + c * np.cross(vector, np.cross(vector, omega)))
    return v[:, :2], np.array(rates)[:, :2]


def felt(
    T: float, lever: np.ndarray, mu: float, bent: np.ndarray, moving: np.ndarray, parts: int = 1,
) -> np.ndarray:
    """Return generalised forces (n, 2) [N m] of a rope with tension T [N] and the lever (2,) [m] at every joint.

    bent, moving : swings of the joints and their rates (n, 2)
    """
    running = moving @ lever  # m/s, rate at which each arc draws in
    out = np.empty_like(bent)
    inside = (np.arange(parts) + 0.5) / parts
    for k, (turned, own) in enumerate(zip(np.hypot(*bent.T), running, strict=True)):
        w = running[k + 1 :].sum() + (1.0 - inside) * own
        steps = -mu * turned / parts * w / np.hypot(w, EDGE)  # of log T
        log = np.cumsum(steps)
        within = np.sinh(0.5 * steps) / np.where(steps == 0.0, 1.0, 0.5 * steps) + (steps == 0.0)
        out[k] = T * (np.exp(log - 0.5 * steps) * within).mean() * lever  # the integral of an exponential in each part
        T = T * np.exp(log[-1])
    return out


def seen(truth: dict[str, float], levels: dict[str, tuple[float, ...]], parts: int = 1) -> np.ndarray:
    """Return positions (T, S, 3) of the stations under tensions, m."""
    cords = [(LEVER * np.array([truth[f"{n}.gain_x"], truth[f"{n}.gain_y"]]), truth[f"{n}.friction"]) for n in levels]

    def forces(tensions: np.ndarray, data: mujoco.MjData) -> np.ndarray:
        bent, moving = swings(data)
        return sum(felt(T, lever, mu, bent, moving, parts) for T, (lever, mu) in zip(tensions, cords, strict=True))

    return moved(truth, levels, forces, TICK)


def main(seeds: int, first: int, parts: int) -> None:
    """Count the intervals of bodies with tendons."""
    start = [Parameter(name, value) for name, value in drawn().items()]

    def fitted(seed: int) -> tuple[dict[str, float], FitResult]:
        rng = np.random.default_rng([seed, 4])
        truth = drawn(rng)
        records = [record(name, seen(truth, levels, parts), levels, rng) for name, levels in RECORDS.items()]
        return truth, fit(records, tendon_arm(), start, time_step=STEP, starts=1)

    count(range(first, first + seeds), list(drawn()), fitted)


if __name__ == "__main__":
    main(*(int(word) for word in (sys.argv[1:] + ["20", "0", "1"][len(sys.argv) - 1 :])))
