"""The whole model of Chen, Galloway and Godage in 150 lines of plain NumPy, to be read next to their paper.

Source: Chen, Galloway, Godage, "Efficient Reduced-Order Models for Soft Actuators", Sec. III.
Clarity comes before speed; tests compare the fast kernels of `pliant.equations`, which share no line with this page.
Index 0 is the first link, i = 1 in the paper. SI units. q (n,) [rad] are joint angles from the rest shape.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.integrate import solve_ivp

S = np.array([[0.0, -1.0], [1.0, 0.0]])  # quarter turn about +z


class Actuator(NamedTuple):
    """Constants of a soft actuator with n links: lengths, masses, stiffness, damping and bladder radius."""

    l: np.ndarray  # (n,) m, link lengths
    theta0: np.ndarray  # (n,) rad, rest angle of each joint
    m: np.ndarray  # (n,) kg, link masses
    c: np.ndarray  # (n,) m, centre of mass of each link from its joint
    I: np.ndarray  # (n,) kg m^2, rotary inertia of each link about its centre of mass
    K: np.ndarray  # (n,) N m/rad
    D: np.ndarray  # (n,) N m s/rad
    r2: float  # m, inner radius of the bladder
    m_tip: float = 0.0  # kg, cap at the last tip
    g: tuple[float, float] = (0.0, 0.0)  # m/s^2, gravity in the base frame


def paper(n=5, theta0=0.0):
    """Return the actuator of Chen et al. with n links: 17 cm, 69 g at the link tips, printed stiffness and damping."""
    ones = np.ones(n)
    return Actuator(
        l=0.17 / n * ones, theta0=theta0 * ones, m=0.069 / n * ones, c=0.17 / n * ones, I=0 * ones,
        K=1.6067 * ones, D=8e-3 * ones, r2=0.010,
    )  # fmt: skip


def section(r2):
    """Return area pi r2^2 / 2 [m^2] and lever arm 4 r2 / (3 pi) [m] of a half-disc of radius r2 [m]. Sec. III-C."""
    return np.pi * r2**2 / 2, 4 * r2 / (3 * np.pi)


def torque(pressure, actuator):
    """Return the torques (n,) [N m] of n joints at a gauge `pressure` [Pa]: pressure * area * lever arm. Sec. III-C."""
    A, d = section(actuator.r2)
    return pressure * A * d * np.ones(len(actuator.l))


def link_transform(q_i, theta0_i, l_i):
    """Return the transform R_z(q_i + theta_i0) P_y(l_i) (3, 3) from a link's frame to the previous link's. Eq. (1)."""
    c, s = np.cos(q_i + theta0_i), np.sin(q_i + theta0_i)
    Rz = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    Py = np.array([[1, 0, 0], [0, 1, l_i], [0, 0, 1]])
    return Rz @ Py


def chain(q, actuator):
    """Return the transforms T^i = T_1 ... T_i (n, 3, 3) from the frames of n links to the base frame. Eqs. (2), (3)."""
    T, T_i = [], np.eye(3)
    for link in zip(q, actuator.theta0, actuator.l, strict=True):
        T_i = T_i @ link_transform(*link)
        T.append(T_i)
    return np.array(T)


def tips(q, actuator):
    """Return the tip positions p^i of the n links in the base frame, (n, 2) [m], at joint angles q (n,) [rad]."""
    return chain(q, actuator)[:, :2, 2]


def body_velocities(q, dq, actuator):
    """Return angular velocities, skew (n, 2, 2) [rad/s], and tip velocities (n, 2) [m/s] in link frames. Eq. (4)."""
    Omega, v, Omegas, vs = np.zeros((2, 2)), np.zeros(2), [], []
    for q_i, dq_i, theta0_i, l_i in zip(q, dq, actuator.theta0, actuator.l, strict=True):
        T = link_transform(q_i, theta0_i, l_i)
        R, p = T[:2, :2], T[:2, 2]
        dR, dp = S @ R * dq_i, S @ p * dq_i
        v = R.T @ (v + Omega @ p + dp)
        Omega = R.T @ (Omega @ R + dR)
        Omegas.append(Omega)
        vs.append(v)
    return np.array(Omegas), np.array(vs)


def jacobians(q, actuator, point=None):
    """Return Jacobians J_w (n, n), J_v (n, 2, n) [m]: angular velocity of each link, velocity of a point on it, per dq.

    J_v_i[:, m] = R^iT S (x_i - p^{m-1}) for m <= i: the lever from joint m to the point x_i, turned by 90 degrees. x_i
    is `point` (n,) [m] from joint i; None: centre of mass. At the tips J_v dq is upsilon, J_w dq is omega of Eq. (4).
    """
    T = chain(q, actuator)
    R, joints = T[:, :2, :2], np.vstack([np.zeros(2), T[:-1, :2, 2]])
    points = joints + R[:, :, 1] * (actuator.c if point is None else point)[:, None]
    J_w = np.tri(len(q))
    lever = (points[:, None] - joints) * J_w[:, :, None]
    return J_w, np.einsum("iba,bc,imc->iam", R, S, lever)


def inertia(q, actuator):
    """Return the inertia matrix M (n, n) [kg m^2] of n links and cap: sum_i m_i J_v^T J_v + I_i J_w^T J_w. Eq. (5)."""
    J_w, J_v = jacobians(q, actuator)
    J_tip = jacobians(q, actuator, actuator.l)[1][-1]
    M = np.einsum("i,iab,iac->bc", actuator.m, J_v, J_v) + np.einsum("i,ib,ic->bc", actuator.I, J_w, J_w)
    return M + actuator.m_tip * J_tip.T @ J_tip


def coriolis(q, dq, actuator):
    """Return the Coriolis matrix C (n, n) [N m s] from the derivatives of the inertia matrix M by angles q. Eq. (5).

    C_ab = sum_r 1/2 (dM_ab/dq_r + dM_ar/dq_b - dM_rb/dq_a) dq_r. dM/dq_r = Im M(q + i h e_r) / h, exact to rounding.
    """
    h = 1e-30
    dM = np.stack([inertia(q + 1j * h * e, actuator).imag / h for e in np.eye(len(q))], axis=-1)
    return 0.5 * (dM @ dq + np.einsum("arb,r->ab", dM, dq) - np.einsum("rba,r->ab", dM, dq))


def gravity(q, actuator):
    """Return the joint torques (n,) [N m] due to gravity, sum_i m_i J_v^T R^iT g. The paper leaves gravity out."""
    R, g = chain(q, actuator)[:, :2, :2], np.array(actuator.g)
    J_v, J_tip = jacobians(q, actuator)[1], jacobians(q, actuator, actuator.l)[1][-1]
    return np.einsum("i,ian,iba,b->n", actuator.m, J_v, R, g) + actuator.m_tip * J_tip.T @ R[-1].T @ g


def acceleration(q, dq, tau, actuator):
    """Return joint accelerations ddq (n,) [rad/s^2]: M ddq + (C + D) dq + K q = tau + gravity. Eq. (5) and gravity."""
    rest = (coriolis(q, dq, actuator) + np.diag(actuator.D)) @ dq + actuator.K * q
    return np.linalg.solve(inertia(q, actuator), tau + gravity(q, actuator) - rest)


def pulse(actuator, pressure=119e3, start=0.12, duration=2.76, end=4.5, rtol=1e-4):
    """Simulate the paper's experiment from rest: a pulse of `pressure` [Pa] from `start` [s] for `duration` [s].

    Returns times (T,) [s] and joint angles q (T, n) [rad]. The integration restarts at each edge (paper: ode15s).
    """
    n = len(actuator.l)
    edges = [0.0, start, start + duration, end]
    times, angles, state = [], [], np.zeros(2 * n)
    for t0, t1, p in zip(edges[:-1], edges[1:], (0.0, pressure, 0.0), strict=True):
        tau = torque(p, actuator)
        run = solve_ivp(
            lambda _, x, tau=tau: np.r_[x[n:], acceleration(x[:n], x[n:], tau, actuator)],
            (t0, t1), state, method="LSODA", rtol=rtol, atol=1e-3 * rtol)  # fmt: skip
        times.append(run.t)
        angles.append(run.y[:n].T)
        state = run.y[:, -1]
    return np.concatenate(times), np.concatenate(angles)
