"""A body that lengthens as point masses, by d'Alembert: no inertia of links, no sweep, no line of `equations`."""

from __future__ import annotations

import numpy as np
from scipy.integrate import solve_ivp

SPREAD = 0.5 + np.array([-0.5, 0.5]) / np.sqrt(3.0)  # where two halves of a rod's mass have its inertia


class Stretching:
    """Uniform rods and linear springs, clamped: every place is W u with u_k = st_k e_k, link 0 before the first joint.

    `joints` (C, n) and `segments` (C, S) are 1 where a chamber of `area` and `offset` (C,) lies along them.
    """

    def __init__(self, body, area, offset, joints, segments):
        self.body, self.n = body, body.n
        self.length, self.part = np.append(body.base_length, body.link_length), body.stretch_share
        places = [self.place(k, share * self.length[k]) for k in range(1, self.n + 1) for share in SPREAD]
        self.W = np.array([*places, self.length])
        self.mass = np.append(np.repeat(0.5 * body.link_mass, 2), body.tip_mass)
        L, axial = self.length @ self.part, np.array([(e.stiffness, e.damping) for e in body.extensions])
        self.K, self.D = (np.append(a, b * L) for a, b in zip((body.stiffness, body.damping), axial.T, strict=True))
        push = np.asarray(area)[:, None]
        self.gain = np.hstack([push * np.asarray(offset)[:, None] * joints, push * segments * L])

    def place(self, link, along):
        """The row of W of a point of a link, 0 the part before the first joint."""
        rows = np.arange(self.length.size)
        return np.where(rows < link, self.length, along * (rows == link))

    def directions(self, x):
        """Along the links and to their left (n + 1, 2), and their stretch (n + 1,)."""
        phi = np.append(self.body.base_angle, x[: self.n])
        c, s = np.cos(phi), np.sin(phi)
        return np.stack([-s, c], 1), np.stack([-c, -s], 1), 1.0 + self.part @ x[self.n :]

    def points(self, x, rows):
        """Where places are (..., 2)."""
        e, _, stretch = self.directions(x)
        return rows @ (stretch[:, None] * e)

    def acceleration(self, x, v, pressure, force=(0.0, 0.0), row=None):
        """Of angles and strains (n + S,) at rates v, under pressures (C,) and a force (2,) at a place."""
        n, (e, left, stretch) = self.n, self.directions(x)
        w, growth = np.append(0.0, v[:n]), self.part @ v[n:]
        by_x = np.zeros((n + 1, 2, x.size))  # of each u_k
        by_x[np.arange(1, n + 1), :, np.arange(n)] = (stretch[:, None] * left)[1:]
        by_x[:, :, n:] = e[:, :, None] * self.part[:, None]
        turned = (2.0 * growth * w)[:, None] * left - (stretch * w**2)[:, None] * e
        J = (self.W @ by_x.reshape(n + 1, -1)).reshape(-1, x.size)  # x and y of every mass
        heavy = np.repeat(self.mass, 2)[:, None] * J
        q, rate = np.append(x[0] - self.body.base_angle, x[1:n] - x[: n - 1]) - self.body.rest_angle, w[1:] - w[:-1]
        push = pressure @ self.gain - self.K * np.append(q, x[n:]) - self.D * np.append(rate, v[n:])
        push[: n - 1] -= push[1:n]
        push += heavy.T @ (self.body.gravity - self.W @ turned).ravel()
        if row is not None:
            push += np.asarray(force) @ np.tensordot(row, by_x, 1)
        return np.linalg.solve(J.T @ heavy, push)

    def motion(self, time, start, pressure, force=lambda t: (0.0, 0.0), row=None):
        """States (T, 2 (n + S)) at times, from a start, under functions of time."""

        def rates(t, y):
            x, v = np.split(y, 2)
            return np.append(v, self.acceleration(x, v, pressure(t), force(t), row))

        found = solve_ivp(
            rates, (time[0], time[-1]), start, method="LSODA", t_eval=time, rtol=1e-6, atol=1e-8, max_step=0.02
        )
        assert found.success
        return found.y.T
