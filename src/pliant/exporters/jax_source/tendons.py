"""Tendons of a chain in space: mean tension over a step, slack, friction at the entry and along the path (capstan).

A tendon of signed force s has the tension max(0, s). Its mean over a step is that of the work it stores; friction is
that at the rates in the middle of the step.
"""

from __future__ import annotations

import jax
import jax.numpy as jnp
from jax import lax

from pliant.exporters.jax_source.numerics import rooted
from pliant.exporters.jax_source.space import SIZE, TINY, from_joint_matrix, from_joints, inertial_forces
from pliant.exporters.jax_source.structure import LINKS, RUBS

NEWTON_MOVES = 50  # moves of Newton's method in a step, at most


def signed_forces(c, x, torque):
    """Return the signed forces (R,) [N] of the tendons at coordinates x (N,), under inputs `torque` (N + R,)."""
    return c["pretension"] + torque[SIZE:] - c["tendon_stiffness"] * (c["lever"] @ x + c["chord"] @ (x * x))


def arms(c, x):
    """Return the lever arms (R, N) [m] of the tendons at coordinates x (N,); those between guides run along chords."""
    return c["lever"] + 2.0 * c["chord"] * x


def mean_tension(s0, s1):
    """Return the mean tension [N] while the signed force goes from s0 to s1 at a constant rate."""
    first, last = s0 >= 0.0, s1 >= 0.0
    change = jnp.where(first == last, 1.0, s1 - s0)
    mixed = 0.5 * jnp.where(last, s1, s0) ** 2 / jnp.where(last, change, -change)
    return jnp.where(first & last, 0.5 * (s0 + s1), jnp.where(first | last, mixed, 0.0))


def felt(c, tension, x, v):
    """Return the fraction (R, N) of each tendon's tension (R,) that acts on each coordinate, at coordinates x and rates
    v.

    At the entry the tension falls by `entry_friction` run, at most by tension times run, with run from -1 to 1. Over a
    joint that swings by theta it changes by the factor exp(-mu theta run).
    """
    a, b = x[0 : 2 * LINKS : 2], x[1 : 2 * LINKS : 2]
    theta = jnp.sqrt(a * a + b * b + TINY)
    speed = (arms(c, x) * v) @ c["beyond"]  # (R, n + 1) shortening of the path beyond the entry and each joint
    run = speed / jnp.sqrt(speed * speed + (c["slip_rate"] ** 2)[:, None])
    over = tension > c["entry_friction"]
    grip = jnp.where(over, c["entry_friction"] / jnp.where(over, tension, 1.0), 1.0 * (c["entry_friction"] > 0.0))
    entered = 1.0 - grip[:, None] * run[:, :1]
    behind = jnp.exp(-jnp.cumsum(c["friction"][:, None] * theta * run[:, 1:], axis=1))
    kept = entered * jnp.concatenate([jnp.ones_like(entered), behind], axis=1)
    lost = jnp.concatenate([jnp.ones_like(entered), kept[:, :-1]], axis=1) - kept
    return 1.0 - lost @ c["beyond"].T


def pulls(c, tension, x, v):
    """Return the generalised forces (N,) of tensions (R,) at coordinates x, with friction at rates v (N,)."""
    part = felt(c, tension, x, v) if RUBS else 1.0
    return jnp.sum(arms(c, x) * part * tension[:, None], axis=0)


def rest_pull(c, x, torque):
    """Return the generalised forces (N,) of the tendons at rest at x (N,), where nothing has moved that could rub."""
    s = signed_forces(c, x, torque)
    return jnp.where(s >= 0.0, s, 0.0) @ arms(c, x)


def changed(c, begun, K, net):
    """Return the change of the rates (N,) over a step with stiffness K and net torques of the joints.

    The second value tells whether Newton's method found it.
    """
    A, push, h, v = begun.A + from_joint_matrix(c, K), from_joints(c, net), begun.h, begun.v
    start = signed_forces(c, begun.x, begun.torque)

    def pull(change):
        return h * step_pull(c, start, begun.middle, v + 0.5 * change, h)

    change, found = taut_step(A, h * (push - begun.first), pull, jnp.zeros_like(v))
    second = h * (push - inertial_forces(c, begun.posed, v + 0.5 * change))
    change, again = taut_step(A, second, pull, change)
    return change, found & again


def step_pull(c, start, middle, rate, h):
    """Return the mean generalised forces (N,) of the tendons over a step with the rates `rate` (N,) in its middle."""
    end = start - h * c["tendon_stiffness"] * (arms(c, middle) @ rate)
    return pulls(c, mean_tension(start, end), middle, rate)


def taut_step(A, push, pull, guess):
    """Return the change of the rates (N,) that solves A change = push + pull(change), and whether it was found.

    Newton's method; a move is halved while the slope along it has changed its sign and is more than half as large.
    """

    def residual(change):
        return push + pull(change) - A @ change

    def search(residual, change):
        def newton(now):
            change, move, fall, agreed, count, _ = now
            r = residual(change)
            size = jnp.max(jnp.abs(A @ change)) + jnp.max(jnp.abs(push)) + jnp.max(jnp.abs(r))
            near = jnp.max(jnp.abs(r)) <= close(r.dtype) * size
            back = (count > 0) & ~near & ~agreed & (r @ move < -0.5 * fall)
            full = jnp.linalg.solve(-jax.jacfwd(residual)(change), r)
            move = jnp.where(back, 0.5 * move, full)
            change = jnp.where(back, change - move, change + move)
            fall = jnp.where(back, 0.5 * fall, jnp.abs(r @ full))
            return change, move, fall, near, count + 1, near & agreed

        def open_yet(now):
            return (now[4] < NEWTON_MOVES) & ~now[5] & jnp.all(jnp.isfinite(now[0]))

        no = jnp.zeros((), bool)
        still = (change, 0.0 * change, jnp.zeros((), change.dtype), no, 0, no)
        return lax.while_loop(open_yet, newton, still)[0]

    change = rooted(residual, guess, search)
    size = jnp.max(jnp.abs(A @ change)) + jnp.max(jnp.abs(push))
    return change, jnp.max(jnp.abs(residual(change))) <= 1e4 * close(change.dtype) * size


def close(dtype):
    """Return the tolerance of the forces of a step, over the largest one."""
    return 1e-10 if dtype == jnp.float64 else 1e-5
