"""Chains to try the kernels on: random ones of n links, and the paper's actuator in three readings of its mass."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from pliant import basic
from pliant.equations.inertia import body_constants
from pliant.equations.symbols import Body, Joints, Links, Workspace

SIZES = list(range(1, 9))
PAPER_GAIN = 6.666666666666667e-7  # N m/Pa, A d


class Chain(NamedTuple):
    """One chain in the letters of the kernels; `base_angle` turns its base away from +y."""

    l: np.ndarray
    theta0: np.ndarray
    m: np.ndarray
    c: np.ndarray
    I: np.ndarray
    K: np.ndarray
    D: np.ndarray
    gain: np.ndarray
    m_tip: float = 0.0
    gx: float = 0.0
    gy: float = 0.0
    base_angle: float = 0.0
    stiffening: float = 0.0
    cubic_stiffening: float = 0.0
    bend_scale: float = 0.0  # R of the springs' law

    @property
    def n(self):
        return len(self.l)

    def body(self):
        B, h = np.zeros((self.n, self.n)), np.zeros(self.n)
        body_constants(self.l, self.m, self.c, self.m_tip, B, h)
        return Body(B, np.array(self.I), h, self.gx, self.gy)

    def joints(self):
        own = {name: np.array(getattr(self, name)) for name in ("theta0", "K", "D")}
        bound = [np.full(self.n, self.bend_scale)] if self.bend_scale else []
        hardening = np.stack([self.K * self.stiffening, self.K * self.cubic_stiffening, *bound])
        return Joints(self.base_angle, **own, hardening=hardening, unloaded=np.array(self.theta0))

    def actuator(self):
        """The same chain for `pliant.basic`, which has no base angle: it goes into the first rest angle."""
        theta0 = np.array(self.theta0)
        theta0[0] += self.base_angle
        return basic.Actuator(
            self.l, theta0, self.m, self.c, self.I, self.K, self.D, 0.01, self.m_tip, (self.gx, self.gy)
        )

    def phi(self, q):
        return self.base_angle + np.cumsum(q + self.theta0)

    def drive(self, torque):
        """What a chamber of this torque gives each joint, (n,)."""
        return self.gain * torque

    def links(self):
        return Links(
            self.l, self.theta0, self.m, self.c, self.I, self.m_tip, self.gx, self.gy, self.base_angle
        )

    def torques(self, q, dq, torque):
        """tau - K q (1 + s q g + a q^2) - D dq, (n,); g from the energy s q^3 (2/3) / (1 + root) by R."""
        root = np.sqrt(1.0 + self.bend_scale * q * q)
        g = 2.0 / (1.0 + root) - 2.0 / 3.0 * self.bend_scale * q * q / (root * (1.0 + root) ** 2)
        bent = 1.0 + self.stiffening * q * g + self.cubic_stiffening * q * q
        return self.gain * torque - self.K * q * bent - self.D * dq


def workspace(n, kind=float):
    return Workspace(
        np.zeros((n, n), kind), np.zeros((n, n), kind),
        np.zeros(n, kind), np.zeros(n, kind), np.zeros(n + 1, kind), np.zeros(n, kind), np.zeros(n, kind),
        np.zeros(n, kind),
    )  # fmt: skip


def random_chain(rng, n, *, gravity=True):
    """Unequal links with offset rest angles, cap, gravity along both axes and a tilted base."""
    l = rng.uniform(0.02, 0.06, n)
    return Chain(
        l=l,
        theta0=rng.uniform(-0.5, 0.5, n),
        m=rng.uniform(0.005, 0.03, n),
        c=l * rng.uniform(0.2, 1.0, n),
        I=rng.uniform(1e-7, 1e-5, n),
        K=rng.uniform(0.1, 2.0, n),
        D=rng.uniform(1e-3, 1e-2, n),
        gain=rng.uniform(0.5, 1.5, n),
        m_tip=rng.uniform(0.0, 0.02),
        gx=rng.normal(0, 7.0) if gravity else 0.0,
        gy=rng.normal(0, 7.0) if gravity else 0.0,
        base_angle=rng.uniform(-1.0, 1.0),
    )


def random_state(rng, n):
    """Joint angles and rates of a strong bend in fast motion."""
    return rng.uniform(-1.2, 1.2, n), rng.normal(0, 8.0, n)


def paper_chain(mass="tip", n=5, m_tip=0.0, **changes):
    """The paper's actuator: 17 cm, 69 g, K_b = 1.6067 N m/rad, D = 8e-3 N m s/rad, straight, no gravity.

    mass="tip" lumps each link at its tip, "rod" spreads it evenly, "middle" lumps it half-way.
    """
    one = np.ones(n)
    l, m = 0.17 / n * one, 0.069 / n * one
    c = l if mass == "tip" else l / 2
    inertia = m * l**2 / 12 if mass == "rod" else 0 * one
    chain = Chain(l, 0 * one, m, c, inertia, 1.6067 * one, 8e-3 * one, one, m_tip)
    return chain._replace(**changes)


def station(phi, l, first, base_angle, point, p):
    """Write the position p (2,) [m] of a point (link, along, across) of a chain with absolute link angles phi (n,)."""
    link, along, across = point
    joint = np.array(first) if link >= 0 else np.zeros(2)
    for i in range(link):
        joint = joint + l[i] * np.array([-np.sin(phi[i]), np.cos(phi[i])])
    s, c = (f(phi[link] if link >= 0 else base_angle) for f in (np.sin, np.cos))
    p[:] = joint + along * np.array([-s, c]) - across * np.array([c, s])
