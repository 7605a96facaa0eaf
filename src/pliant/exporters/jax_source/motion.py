"""What a time step knows before it is solved, and functions for users: rest, step, rollout and observe."""

from __future__ import annotations

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax import lax

from pliant.exporters.jax_source.forgetful import relaxed, solved_step
from pliant.exporters.jax_source.inputs import behind_valves, chamber_torques, rest_torques
from pliant.exporters.jax_source.numerics import rooted
from pliant.exporters.jax_source.plane import (
    SIZE,
    constants,
    coordinates,
    from_joints,
    holds,
    inertia,
    inertial_forces,
    joint_coordinates,
    observed,
    pose,
    spring_slopes,
    spring_torques,
    to_joints,
)
from pliant.exporters.jax_source.structure import COLUMNS, REMEMBERING, START
from pliant.exporters.jax_source.untied import rest_pull


class Beginning(NamedTuple):
    """State at the start of a step of h [s], and matrices and forces in the middle of it."""

    x: jnp.ndarray  # (N,)
    v: jnp.ndarray  # (N,)
    h: jnp.ndarray  # s
    torque: jnp.ndarray  # (N + R,) mean inputs
    middle: jnp.ndarray  # (N,) coordinates in the middle
    posed: Any  # pose there
    first: jnp.ndarray  # (N,) inertial forces at the rates v
    A: jnp.ndarray  # (N, N) inertia and stiffness by gravity
    K: jnp.ndarray  # (N, N) implicit terms of springs and dampers, in joint coordinates
    net: jnp.ndarray  # (N,) torques of inputs, springs and dampers there


def begin(c, x, v, torque, h):
    """Return the `Beginning` of a step from coordinates x and rates v (N,) under mean inputs (N + R,)."""
    middle = x + 0.5 * h * v
    q, posed, quarter = joint_coordinates(c, middle), pose(c, middle), 0.25 * h * h
    K = 0.5 * h * jnp.diag(c["D"]) + quarter * spring_slopes(c, q)
    net = torque[:SIZE] - spring_torques(c, q) - c["D"] * to_joints(c, v)
    first = inertial_forces(c, posed, v)
    return Beginning(x, v, h, torque, middle, posed, first, inertia(c, posed, quarter), K, net)


PARTS, MOVES = 8, 40  # parts in which the inputs of `rest` grow, and moves of Newton's method in each


class BodyState(NamedTuple):
    """Coordinates, rates and inner states of the actuator, in arrays of the precision of the parameters."""

    position: jnp.ndarray  # (N,) coordinates: rad, strains 1
    velocity: jnp.ndarray  # (N,) their rates, 1/s
    memory: jnp.ndarray  # hysteresis states, a row for each coordinate that has them
    pressure: jnp.ndarray  # (C,) inputs behind the valves
    slow: jnp.ndarray  # (C, 2) lagged pressure [Pa], fourth power of the hoop stretch
    failed: jnp.ndarray  # () number of invalid steps: where it is above 0, the state is invalid


def arrays(parameters):
    """Return the parameters as JAX arrays of one precision, that of the first one."""
    kind = jnp.result_type(*jax.tree_util.tree_leaves(parameters))
    return {name: jnp.asarray(value, kind) for name, value in parameters.items()}


def rest(parameters, inputs):
    """Return the `BodyState` in equilibrium under constant `inputs` (C,).

    Newton's method from the equilibrium of the exported model without inputs, while the inputs grow to their values.
    `failed` is 1 where no stable equilibrium is found. Derivatives are those of the implicit function theorem.
    """
    c = constants(arrays(parameters))
    inputs = jnp.asarray(inputs, c["K"].dtype)

    def net(q, part=1.0):
        torque = rest_torques(c, part * inputs)[0] @ c["joint_gain"]
        x = coordinates(c, q)
        push = from_joints(c, torque[:SIZE] - spring_torques(c, q)) - inertial_forces(c, pose(c, x), 0.0 * x)
        return push + rest_pull(c, x, torque)

    def search(_, q):
        def grown(k, q):
            return settled(lambda q: net(q, (k + 1.0) / PARTS), q)

        return lax.fori_loop(0, PARTS, grown, q)

    q = rooted(net, jnp.asarray(START, inputs.dtype), search)
    x, tolerance = coordinates(c, q), 1e-9 if q.dtype == jnp.float64 else 1e-3
    K = -from_joint_slope(c, jax.jacfwd(net)(lax.stop_gradient(q)))
    good = jnp.max(jnp.abs(net(q))) <= tolerance * jnp.max(jnp.abs(c["K"]))
    good &= jnp.linalg.eigvalsh(0.5 * (K + K.T))[0] > 0.0
    _, slow = rest_torques(c, inputs)
    memory = relaxed(c, q, jnp.zeros((REMEMBERING, COLUMNS), x.dtype))
    return BodyState(x, 0.0 * x, memory, inputs, slow, jnp.where(good, 0.0, 1.0).astype(x.dtype))


def from_joint_slope(c, slope):
    """Return a derivative (N, N) of generalised forces by joint coordinates as one in these coordinates alone."""
    turned = jax.vmap(lambda v: to_joints(c, v))(jnp.eye(SIZE, dtype=slope.dtype))
    return slope @ turned.T


def settled(net, q):
    """Return the coordinates q (N,) at which the net force vanishes, by Newton's method with moves of at most 0.5."""

    def moved(now):
        q, count, _ = now
        move = jnp.linalg.solve(-jax.jacfwd(net)(q), net(q))
        far = jnp.max(jnp.abs(move))
        return q + move * jnp.minimum(1.0, 0.5 / jnp.maximum(far, 1e-30)), count + 1, far

    def open_yet(now):
        return (now[1] < MOVES) & (now[2] > (1e-13 if q.dtype == jnp.float64 else 1e-6))

    return lax.while_loop(open_yet, moved, (q, 0, jnp.full((), jnp.inf, q.dtype)))[0]


def step(parameters, state, inputs, dt):
    """Return the `BodyState` after one time step of `dt` [s] under constant commands `inputs` (C,).

    The linearly implicit midpoint rule of pliant. A step in which a rate is too high for `dt`, a spring loses its
    stiffness or an iteration does not converge adds 1 to `failed`.
    """
    return advance(constants(arrays(parameters)), state, inputs, dt)


def rollout(parameters, state, inputs, dt):
    """Return the last `BodyState`, and the states after each of T steps of `dt` [s] under commands `inputs` (T, C)."""
    c = constants(arrays(parameters))

    def one(state, command):
        after = advance(c, state, command, dt)
        return after, after

    first = BodyState(*(jnp.asarray(part, c["K"].dtype) for part in state))
    return lax.scan(one, first, jnp.asarray(inputs, c["K"].dtype))


def observe(parameters, state):
    """Return a dict of the positions and orientations of the observed points, see `observed`."""
    c = constants(arrays(parameters))
    return observed(c, jnp.asarray(state.position, c["K"].dtype))


def advance(c, state, command, dt):
    """Return the state after one step, for the `constants` c of the model."""
    x, v, memory, pressure, slow, failed = (jnp.asarray(part, c["K"].dtype) for part in state)
    h, command = jnp.asarray(dt, x.dtype), jnp.asarray(command, x.dtype)
    interval = behind_valves(c, h, command, pressure)
    torque, slow = chamber_torques(c, h, interval, slow)
    change, memory, solved_it = solved_step(c, begin(c, x, v, torque @ c["joint_gain"], h), memory)
    x, v = x + h * (v + 0.5 * change), v + change
    good = solved_it & holds(c, x, v, h)
    return BodyState(x, v, memory, interval[2], slow, failed + jnp.where(good, 0.0, 1.0).astype(x.dtype))
