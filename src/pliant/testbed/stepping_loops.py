"""Compiled time loop of the virtual actuator: banded Newton steps, update of the hysteresis states, energies."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from pliant.testbed.rod_loops import (
    add_bending,
    add_contact,
    add_edges,
    add_inertia,
    add_thrust,
    curvatures,
    gap_to,
    penalty,
    section_law,
    volume,
)

BAND = 5  # a vertex meets its two neighbours on either side, two coordinates each
CONVERGED, NOT_CONVERGED, NOT_FINITE = 0, 1, 2
TOLERANCE = 1e-10  # m, largest node update of the last Newton iteration
LONGEST = 2e-3  # m, longest node update that one iteration may make
ITERATIONS = 60


def factor(band):
    """Compute the Cholesky factor of the banded matrix `band` in place; return False if the matrix is not positive
    definite.

    Row i of `band` holds the entries of row i of the matrix from the diagonal leftwards.
    """
    for i in range(band.shape[0]):
        for d in range(min(i, BAND), -1, -1):
            j = i - d
            value = band[i, d]
            for m in range(max(0, i - BAND), j):
                value -= band[i, i - m] * band[j, j - m]
            if d > 0:
                band[i, d] = value / band[j, 0]
            elif value > 0.0:
                band[i, 0] = np.sqrt(value)
            else:
                return False
    return True


def substitute(band, b):
    """Solve the linear system whose Cholesky factor `band` comes from `factor`. The solution replaces the right-hand
    side `b`.
    """
    n = b.size
    for i in range(n):
        for m in range(max(0, i - BAND), i):
            b[i] -= band[i, i - m] * b[m]
        b[i] /= band[i, 0]
    for i in range(n - 1, -1, -1):
        for m in range(i + 1, min(n, i + BAND + 1)):
            b[i] -= band[m, m - i] * b[m]
        b[i] /= band[i, 0]


def largest(values):
    """Return the largest absolute value of `values`, or NaN when one of them is NaN."""
    magnitude = 0.0
    for i in range(values.size):
        if not abs(values[i]) <= magnitude:
            magnitude = abs(values[i])
        if np.isnan(magnitude):
            break
    return magnitude


def copy(values, out):
    """Copy the array `values` into `out`."""
    for i in range(values.shape[0]):
        for j in range(values.shape[1]):
            out[i, j] = values[i, j]


def gather(x, load, body, obstacles, state, clock, geometric, work):
    """Write gradient and Hessian of the incremental potential at the node positions `x` into `work`; return False if a
    value is not finite.
    """
    for i in range(work.gradient.size):
        work.gradient[i] = 0.0
        for d in range(BAND + 1):
            work.band[i, d] = 0.0
    add_bending(x, load, body, state, clock, work.band, work.torque, work.six)
    add_edges(x, body, state, clock, work.torque, geometric, work.gradient, work.band)
    add_thrust(x, load, body, geometric, work.gradient, work.band)
    add_inertia(x, load, body, work.drift, clock, work.gradient, work.band)
    add_contact(x, obstacles, body, state, clock, work.gradient, work.band, work.force)
    for i in range(work.gradient.size):
        if not np.isfinite(work.gradient[i]):
            return False
    return True


def move(x, step, scale):
    """Move all free nodes of `x` in place by `scale` times the Newton step."""
    for v in range(1, x.shape[0]):
        x[v, 0] += scale * step[2 * v - 2]
        x[v, 1] += scale * step[2 * v - 1]


def newton(x, load, body, obstacles, state, clock, work):
    """Move the nodes `x` in place to equilibrium at the end of the time step; return status, number of iterations and
    last update [m].

    A step that overshoots is shortened by the secant rule until the slope of the potential along it is below 0.9 times
    its initial magnitude. Without this rule friction and slip can make the iteration cycle.
    """
    longest = np.inf
    scale = slope = 0.0
    for iteration in range(ITERATIONS):
        if not gather(x, load, body, obstacles, state, clock, 1.0, work):
            return NOT_FINITE, iteration, longest
        now = np.dot(work.gradient, work.step)
        if iteration > 0 and now > 0.9 * abs(slope) and scale > 1e-4:
            shorter = scale * max(0.1, slope / (slope - now))
            move(x, work.step, shorter - scale)
            scale = shorter
            continue
        if not factor(work.band):
            gather(x, load, body, obstacles, state, clock, 0.0, work)
            if not factor(work.band):
                return NOT_CONVERGED, iteration, longest
        for i in range(work.step.size):
            work.step[i] = -work.gradient[i]
        substitute(work.band, work.step)
        longest = largest(work.step)
        scale = min(1.0, LONGEST / max(longest, 1e-300))
        slope = np.dot(work.gradient, work.step)
        move(x, work.step, scale)
        if longest < TOLERANCE:
            return CONVERGED, iteration + 1, longest
    return NOT_CONVERGED, ITERATIONS, longest


def remember(x, body, state, clock, work):
    """Accept a time step: update slip and Prony states, velocities and the stored previous states in place."""
    curvatures(x, body, work.curvature)
    for k in range(work.curvature.size):
        rest = body.rest_curvature[k]
        before, bend = state.curvature[k] - rest, work.curvature[k] - rest
        for j in range(body.prony_share.size):
            inner = clock.decay[j, 0] * state.prony[k, j] + clock.decay[j, 1] * before
            state.prony[k, j] = inner + clock.decay[j, 2] * bend
        for j in range(body.slip_limit.shape[1]):
            limit = body.slip_limit[k, j]
            trial = state.slip[k, j] + body.slip_stiffness[k, j] * (bend - before)
            state.slip[k, j] = max(-limit, min(limit, trial))
    for k in range(work.curvature.size):
        state.curvature_before[k], state.curvature[k] = state.curvature[k], work.curvature[k]
    for e in range(body.rest_length.size):
        state.length_before[e] = state.length[e]
        state.length[e] = np.sqrt((x[e + 1, 0] - x[e, 0]) ** 2 + (x[e + 1, 1] - x[e, 1]) ** 2)
    for v in range(x.shape[0]):
        for a in range(2):
            speed = (x[v, a] - (4.0 * state.x[v, a] - state.x_before[v, a]) / 3.0) / clock.h
            state.v_before[v, a], state.v[v, a] = state.v[v, a], speed
            state.x_before[v, a], state.x[v, a] = state.x[v, a], x[v, a]
    for c in range(state.chamber.shape[0]):
        now = volume(c, state.curvature, state.length, body)
        state.chamber[c, 1] = (now - state.chamber[c, 0]) / clock.dt
        state.chamber[c, 0] = now


def energies(body, obstacles, state, out):
    """Write the kinetic, elastic, hysteresis, gravity and contact energies [J] of the rod to `out` (5,)."""
    for i in range(out.size):
        out[i] = 0.0
    last = state.x.shape[0] - 1
    for v in range(1, last + 1):
        out[0] += 0.5 * body.mass[v] * (state.v[v, 0] ** 2 + state.v[v, 1] ** 2)
        out[3] -= body.mass[v] * (body.gravity[0] * state.x[v, 0] + body.gravity[1] * state.x[v, 1])
        for o in range(obstacles.shape[0]):
            depth = body.half_width - gap_to(obstacles[o], state.x[v, 0], state.x[v, 1])[0]
            out[4] += obstacles[o, 4] * body.contact_share[v] * penalty(depth)[2]
    for i in range(4):
        a, b = last - 1 + i // 2, i % 2
        out[3] -= body.cap_weight[i] * state.x[a, b]
        for j in range(4):
            out[0] += 0.5 * body.cap_mass[i, j] * state.v[a, b] * state.v[last - 1 + j // 2, j % 2]
    for e in range(body.rest_length.size):
        out[1] += 0.5 * body.axial[e] / body.rest_length[e] * (state.length[e] - body.rest_length[e]) ** 2
    for k in range(body.weight.size):
        bend = state.curvature[k] - body.rest_curvature[k]
        law = section_law(bend, body.stiffness[k], body.fibre_height, body.fibre_share, body.locking)
        out[1] += body.weight[k] * law[2]
        for j in range(body.prony_share.size):
            inner = bend - state.prony[k, j]
            out[2] += 0.5 * body.weight[k] * body.prony_share[j] * body.stiffness[k] * inner * inner
        for j in range(body.slip_limit.shape[1]):
            out[2] += 0.5 * body.weight[k] * state.slip[k, j] ** 2 / body.slip_stiffness[k, j]


def march(loads, span, body, obstacles, state, clock, work, out):
    """Simulate the rod over the time steps of `span`, and write its state after every ``span.stride`` steps to `out`.

    Returns the status, the index of the failed step (or the end of the span), the last Newton update [m] and the total
    number of iterations. `loads` (S, C + 3) holds the loads of every step.
    """
    total = 0
    x, load = work.x, work.load
    for n in range(span.first, span.stop):
        for i in range(load.size):
            load[i] = loads[n, i]
        for c in range(state.chamber.shape[0]):
            load[c] -= body.tube_resistance * state.chamber[c, 1]
        for v in range(x.shape[0]):
            for a in range(2):
                slow = (4.0 * state.v[v, a] - state.v_before[v, a]) / 3.0
                back = (4.0 * state.x[v, a] - state.x_before[v, a]) / 3.0
                work.drift[v, a] = back + clock.h * slow
                x[v, a] = state.x[v, a] + clock.dt * (1.5 * state.v[v, a] - 0.5 * state.v_before[v, a])
        status, iterations, longest = newton(x, load, body, obstacles, state, clock, work)
        total += iterations
        if status != CONVERGED:
            return status, n, longest, total
        remember(x, body, state, clock, work)
        if (n + 1) % span.stride == 0:
            r = (n + 1) // span.stride
            copy(state.x, out.position[r])
            copy(state.v, out.velocity[r])
            copy(work.force, out.force[r])
            for k in range(state.curvature.size):
                out.curvature[r, k] = state.curvature[k]
            for c in range(state.chamber.shape[0]):
                out.pressure[r, c] = load[c]
                out.volume[r, c] = state.chamber[c, 0]
            energies(body, obstacles, state, out.energy[r])
    return CONVERGED, span.stop, 0.0, total


GAS_CONSTANT = 287.05  # J/(kg K), dry air
REFERENCE_DENSITY = 1.185  # kg/m3, ISO 6358 reference atmosphere (100 kPa, 293.15 K, 65 % humidity)
REFERENCE_TEMPERATURE = 293.15  # K


class ValveLaw(NamedTuple):
    """Constants of a second-order pressure regulator with slew limits."""

    natural: float  # rad/s
    damping: float
    exhaust: float  # factor by which falling pressure is slower
    slew_up: float  # Pa/s
    slew_down: float  # Pa/s
    dead_band: float  # Pa


class Spool(NamedTuple):
    """Constants of a second-order proportional spool."""

    natural: float  # rad/s
    damping: float
    band: float  # Pa, pressure error at which the spool is fully open


class Gas(NamedTuple):
    """Constants of a fixed chamber volume between supply and ambient air, with ISO 6358 restrictions on both sides."""

    source: float  # Pa, absolute
    ambient: float  # Pa, absolute
    fill: float  # m3/(s Pa), sonic conductance
    exhaust: float  # m3/(s Pa)
    critical: float  # pressure ratio
    volume: float  # m3
    polytropic: float
    temperature: float  # K


def regulate(command, dt, law, out):
    """Simulate a second-order pressure regulator with slew limits, and write its pressure [Pa] at S times to `out`
    (S,).

    The equation is ``p'' = w^2 (u - p) - 2 z w p'``, with a natural frequency that is lower by the factor `exhaust` for
    falling pressure. `command` (S,) [Pa] holds the set points at steps of `dt` [s], and `law` is a `ValveLaw`. The two
    states are integrated by the midpoint rule.
    """
    p = command[0]
    rate = 0.0
    out[0] = p
    for n in range(1, command.size):
        p, rate = regulator_step(p, rate, command[n - 1], 0.5 * (command[n - 1] + command[n]), dt, law)
        out[n] = p
    return p


def regulate_on(commands, dt, sub, law, held, out):
    """Simulate a pressure regulator over N steps, each with a constant command, and write its pressure [Pa] after each
    step to `out` (N,). It continues from one call to the next.

    The equation is that of `regulate`. Each of the `commands` (N,) [Pa] is held for a step of `dt` [s], which has `sub`
    midpoint substeps. `held` (2,) is the pressure [Pa] and its rate [Pa/s]; it is updated in place.
    """
    p = held[0]
    rate = held[1]
    for n in range(commands.size):
        for _ in range(sub):
            p, rate = regulator_step(p, rate, commands[n], commands[n], dt / sub, law)
        out[n] = p
    held[0] = p
    held[1] = rate


def regulator_step(p, rate, command, middle, h, law):
    """Return the pressure [Pa] of a regulator and its rate [Pa/s] after one midpoint step of `h` [s], from both at its
    beginning. The set point is `command` [Pa] at the beginning of the step and `middle` [Pa] in its middle.
    """
    error = command - p
    w = law.natural if error > 0.0 else law.natural / law.exhaust
    pull = w * w * np.sign(error) * max(abs(error) - law.dead_band, 0.0) - 2.0 * law.damping * w * rate
    half_rate = max(-law.slew_down, min(law.slew_up, rate + 0.5 * h * pull))
    error = middle - (p + 0.5 * h * rate)
    pull = w * w * np.sign(error) * max(abs(error) - law.dead_band, 0.0) - 2.0 * law.damping * w * half_rate
    rate = max(-law.slew_down, min(law.slew_up, rate + h * pull))
    p = p + h * half_rate
    if p < 0.0:
        return 0.0, 0.0
    return p, rate


def mass_flow(upstream, downstream, conductance, critical, temperature):
    """Return the ISO 6358 mass flow [kg/s] through a restriction between two absolute pressures [Pa].

    `conductance` is the sonic conductance in m3/(s Pa).
    """
    ratio = downstream / upstream
    if ratio >= 1.0:
        return 0.0
    flow = conductance * upstream * REFERENCE_DENSITY * np.sqrt(REFERENCE_TEMPERATURE / temperature)
    if ratio > critical:
        flow *= np.sqrt(1.0 - ((ratio - critical) / (1.0 - critical)) ** 2)
    return flow


def chamber_rate(p, opening, gas):
    """Return the rate of change [Pa/s] of a chamber's absolute pressure `p` [Pa], for a spool `opening` from -1
    (exhaust) to 1 (fill).
    """
    flow = 0.0
    if opening > 0.0:
        flow = mass_flow(gas.source, p, gas.fill * opening, gas.critical, gas.temperature)
    elif opening < 0.0:
        flow = -mass_flow(p, gas.ambient, -gas.exhaust * opening, gas.critical, gas.temperature)
    return gas.polytropic * GAS_CONSTANT * gas.temperature * flow / gas.volume


def fill_chamber(command, dt, sub, spool, gas, out):
    """Simulate the pressure of a chamber (`gas`) behind a spool valve (`spool`), and write it [Pa gauge] at S times to
    `out` (S,).

    `command` (S,) [Pa gauge] holds the set points at steps of `dt` [s]. Each step has `sub` substeps.
    """
    p = command[0] + gas.ambient
    position = speed = 0.0
    h = dt / sub
    out[0] = command[0]
    for n in range(1, command.size):
        for k in range(sub):
            u = command[n - 1] + (command[n] - command[n - 1]) * (k + 0.5) / sub
            wish = max(-1.0, min(1.0, (u + gas.ambient - p) / spool.band))
            speed += h * (spool.natural ** 2 * (wish - position) - 2.0 * spool.damping * spool.natural * speed)
            position += h * speed
            opening = max(-1.0, min(1.0, position))
            rate = chamber_rate(p, opening, gas)
            half = p + 0.5 * h * rate
            p += h * chamber_rate(half, opening, gas)
        out[n] = p - gas.ambient
    return p
