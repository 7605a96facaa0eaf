"""Bodies that lengthen, from the places of their point masses alone: what `equations.extension` is compared with."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from pliant.equations.inertia import body_constants
from pliant.equations.symbols import ExtensibleBody, ExtensibleJoints, ExtensibleWorkspace


class Extensible(NamedTuple):
    """Links 0 ... n, the first of which does not turn; each carries two halves of its mass at c +- rho along it."""

    l: np.ndarray  # (n + 1,)
    m: np.ndarray  # (n + 1,), none on the first
    c: np.ndarray  # (n + 1,)
    rho: np.ndarray  # (n + 1,) radius of gyration about the centre of mass
    share: np.ndarray  # (n + 1, S)
    m_tip: float
    gravity: np.ndarray  # (2,)
    base_angle: float
    theta0: np.ndarray  # (n,)
    K: np.ndarray  # (n + S,)
    D: np.ndarray  # (n + S,)
    K2: np.ndarray  # (n,)

    @property
    def n(self):
        return len(self.theta0)

    @property
    def size(self):
        return len(self.K)

    def body(self):
        B, h = np.zeros((self.n + 1, self.n + 1), object), np.zeros(self.n + 1, object)
        body_constants(self.l, self.m, self.c, self.m_tip, B, h)
        for k in range(self.n + 1):
            B[k, k] = B[k, k] + self.m[k] * self.rho[k] ** 2
        if np.asarray(self.l).dtype != object:
            B, h = B.astype(float), h.astype(float)
        return ExtensibleBody(B, self.l, h, self.share, *self.gravity)

    def joints(self, axial=None, rest=()):
        """With axial springs of coefficients `axial` (3, S) where given, and resting strains (S,) or none."""
        hardening = np.stack([self.K2, -0.5 * self.K2, 0 * self.K2])
        if axial is not None:
            hardening = np.concatenate([hardening, axial], axis=1)
        rest = np.zeros(0) if len(rest) == 0 else np.array(rest)
        return ExtensibleJoints(self.base_angle, self.theta0, self.K, self.D, hardening, self.theta0, rest)

    def masses(self, x, cos=np.cos, sin=np.sin):
        """(mass, x, y) of every point mass at the coordinates x (n + S,)."""
        found, px, py = [], 0.0, 0.0
        for k in range(self.n + 1):
            angle = x[k - 1] if k else self.base_angle
            stretch = 1.0 + sum(self.share[k, s] * x[self.n + s] for s in range(self.size - self.n))
            for place in (self.c[k] + self.rho[k], self.c[k] - self.rho[k]):
                at = place * stretch
                found.append((self.m[k] / 2, px - at * sin(angle), py + at * cos(angle)))
            px, py = px - self.l[k] * stretch * sin(angle), py + self.l[k] * stretch * cos(angle)
        return [*found, (self.m_tip, px, py)]


def random_extensible(rng, n, S):
    l = rng.uniform(0.02, 0.06, n + 1)
    share = rng.uniform(0.0, 1.0, (n + 1, S))
    size = n + S
    return Extensible(
        l, np.append(0.0, rng.uniform(0.005, 0.03, n)), l * rng.uniform(0.3, 0.7, n + 1), 0.3 * l, share / S,
        0.01, rng.normal(0, 7.0, 2), 0.3, rng.uniform(-0.3, 0.3, n),
        np.append(rng.uniform(0.1, 2.0, n), rng.uniform(1.0, 3.0, S)), rng.uniform(1e-3, 1e-2, size),
        rng.uniform(-0.1, 0.1, n),
    )  # fmt: skip


def random_state(rng, chain):
    """Angles and strains of a strong bend and a large stretch, in fast motion."""
    S = chain.size - chain.n
    x = np.append(np.cumsum(rng.uniform(-0.8, 0.8, chain.n)), rng.uniform(-0.3, 0.4, S))
    return x, np.append(rng.normal(0, 8.0, chain.n), rng.normal(0, 5.0, S))


def workspace(n, S, kind=float):
    N = n + S
    shapes = {"A": (N, N), "t": (N + 1,), **dict.fromkeys(("stretch", "ax", "ay", "bx", "by"), (n + 1,))}
    return ExtensibleWorkspace(*(np.zeros(shapes.get(f, (N,)), kind) for f in ExtensibleWorkspace._fields))
