"""Compiled arithmetic of one control step: the linear-quadratic regulator, the limits of its commands, a valve's
equation, and the prediction of valves and body over a horizon.
"""

from __future__ import annotations

import numpy as np

from pliant.equations.linearised import step_jacobian
from pliant.equations.observation import outputs, turned

KILO = 1e3  # Pa in a kPa, the unit of pressures in states and gains


def look(gains, row, geometry, known, rules, resting, memory):
    """Compute the deviation of the regulator's state from the reference, and from it the commands [Pa] before limits.
    Both are written to arrays in the tuple `memory`.

    `gains` are (K, slope, inverse, driven, row) of `Gains`, `row` is the row of an `LqrDesign` for this period, and
    `geometry` comes from `tip_geometry`. `memory` holds the workspace arrays (delayed commands, integrals, last
    commands, errors, shifts, pressures that compensate the shifts, deviation of the state, commands); the last five are
    written. If the joints' rest angles are shifted, the compensating pressures move the outputs back to their
    reference. If the torques are scaled by the factor `scale`, pressures are multiplied and commands divided by it.
    """
    K, slope, inverse, _driven, by_position = gains
    pressure, lead, position, beside, wanted, still = row
    angle, rate, rest_shift, strain, strain_rate, strain_shift, scale, behind = known
    weight = rules[4]
    queue, integral, _command, error, turn, more, away, wish = memory
    n = len(angle)
    size = n + len(strain)
    outputs(angle, strain, *geometry, error)
    for j in range(len(error)):
        error[j] = error[j] - still[j] - wanted[j]
    turned(rest_shift, turn)
    for i in range(n):
        away[i] = angle[i]
        away[size + i] = rate[i]
    for i in range(n, size):
        turn[i] = strain_shift[i - n]
        away[i] = strain[i - n]
        away[size + i] = strain_rate[i - n]
    for c in range(len(more)):
        more[c] = 0.0
        for j in range(len(weight)):
            moved = 0.0
            for i in range(size):
                moved = moved + by_position[j, i] * turn[i]
            more[c] = more[c] - inverse[c, j] * weight[j] * moved
    fill(away, 2 * size, scale / KILO, behind, queue, integral)
    for i in range(size):
        away[i] = away[i] - position[i] - turn[i]
        for c in range(len(more)):
            away[i] = away[i] - slope[i, c] * more[c]
    ask((K, pressure, lead, beside, resting), scale, more, away, wish)


def fill(away, first, scale, behind, queue, integral):
    """Write the valve states [kPa, kPa/s], the commands in transit [kPa] and the error integrals to the N regulator
    states `away` (N,), from index `first` on.
    """
    for i in range(len(behind)):
        away[first + i] = scale * behind[i]
    first = first + len(behind)
    for i in range(len(queue)):
        away[first + i] = scale * queue[i]
    first = first + len(queue)
    for j in range(len(integral)):
        away[first + j] = integral[j]


def ask(row, scale, more, away, wish):
    """Subtract the reference from the N regulator states `away` (N,) in place. Write the commands (C,) [Pa] for C
    chambers, before limits, to `wish`.
    """
    K, pressure, lead, beside, resting = row
    for i in range(len(away)):
        away[i] = away[i] - beside[i]
        for c in range(len(more)):
            away[i] = away[i] - resting[i, c] * (pressure[c] + more[c]) / KILO
    for c in range(len(more)):
        total = lead[c]
        for i in range(len(away)):
            total = total - K[c, i] * away[i]
        wish[c] = (pressure[c] + more[c] + KILO * total) / scale


def finish(gains, rules, memory):
    """Apply the limits of pressure and slew rate to the commands, and integrate the output errors with anti-windup.
    Return True if a limit changed a command.

    At a limit, only errors that lead away from the limit are integrated.
    """
    K, _slope, _inverse, driven, _row = gains
    highest, reach, band, period, weight, waiting = rules
    queue, integral, command, error, _turn, _more, _away, wish = memory
    m = len(weight)
    first = K.shape[1] - m
    far = 0.0
    for j in range(m):
        part = 0.0
        for i in range(m):
            part = part + driven[j, i] * weight[i] * error[i]
        far = far + part * part
    share = min(1.0, band * band / far) if far > 0.0 else 1.0
    met = False
    left = 0.0
    newest = 0
    for c in range(len(command)):
        sent = within(wish[c], command[c], highest[c], reach)
        met = met or sent != wish[c]
        for j in range(m):
            for i in range(m):
                left = left + (wish[c] - sent) * K[c, first + j] * driven[j, i] * weight[i] * error[i]
        for i in range(waiting[c] - 1, 0, -1):
            queue[newest + i] = queue[newest + i - 1]
        if waiting[c] > 0:
            queue[newest] = sent
        newest = newest + waiting[c]
        command[c] = sent
    if left >= 0.0:
        for j in range(m):
            for i in range(m):
                integral[j] = integral[j] + share * period * driven[j, i] * weight[i] * error[i]
    return met


def within(command, before, highest, reach):
    """Return the command [Pa] closest to `command` that is in the range 0 ... `highest` and at most `reach` away from
    `before`.

    NaN is returned unchanged.
    """
    if command < 0.0:
        command = 0.0
    if command < before - reach:
        command = before - reach
    if command > highest:
        command = highest
    if command > before + reach:
        command = before + reach
    return command


def regulate(command, h, rise, fall, damping, held, out):
    """Integrate the second-order equation of a valve under one command [Pa] per step, and write its pressures [Pa] to
    `out`.

    The equation is p'' = omega^2 (u - p) - 2 zeta omega p' with p >= 0, where omega is `rise` [rad/s] for u > p and
    `fall` for u < p. Each command is held for a step of `h` [s], integrated by the midpoint rule. `held` = (p, dp/dt)
    [Pa, Pa/s] is updated in place.
    """
    p = held[0]
    v = held[1]
    for k in range(len(command)):
        omega = rise if command[k] > p else fall
        pull = omega * omega * (command[k] - p) - 2.0 * damping * omega * v
        middle = p + 0.5 * h * v
        v_middle = v + 0.5 * h * pull
        omega = rise if command[k] > middle else fall
        v = v + h * (omega * omega * (command[k] - middle) - 2.0 * damping * omega * v_middle)
        p = p + h * v_middle
        if p < 0.0:
            p = 0.0
            v = 0.0
        out[k] = p
    held[0] = p
    held[1] = v


def follow_valve(asked, seen, valve, held, command, out):
    """Advance the simulated pressure of a valve under one command [Pa], and correct it with the gauge's reading `seen`
    [Pa].

    `regulate` integrates the valve's equation.

    The command is held for len(command) steps. A reading that is not finite is ignored. `valve` holds (h, rise, fall,
    damping, gain): the step [s], the natural frequencies [rad/s] for filling and emptying, the damping ratio, and the
    gain (2,) of the correction. `held` (2,) is the pressure and its rate, updated in place; `command` and `out` are
    workspace.
    """
    h, rise, fall, damping, gain = valve
    for k in range(len(command)):
        command[k] = asked
    regulate(command, h, rise, fall, damping, held, out)
    if np.isfinite(seen):
        off = seen - held[0]
        held[0] = held[0] + gain[0] * off
        held[1] = held[1] + gain[1] * off


def valve_ahead(sent, by_node, pieces, state, scratch, values, slopes):
    """Write a valve's r states at the ends of K periods to `values` (K, r), and their derivatives with respect to the
    commands at the N node times of a plan to `slopes` (K, r, N).

    Each period begins under the previous command and ends under the next one: `sent` (K + 1,) holds the commands in
    order, and `by_node` (K + 1, N) their derivatives. `pieces` are (A, B), of shapes (2, 2, r, r) and (2, 2, r): the
    exact step of each part of a period, for a command below and above the pressure. `state` (r,) is updated in place;
    `scratch` is (r, N + 1).
    """
    A, B = pieces
    r = len(state)
    N = by_node.shape[1]
    for k in range(len(values)):
        for i in range(r):
            for j in range(N):
                slopes[k, i, j] = slopes[k - 1, i, j] if k > 0 else 0.0
        for piece in range(2):
            command = sent[k + piece]
            side = 1 if command > state[0] else 0
            for i in range(r):
                for j in range(N):
                    scratch[i, j] = B[piece, side, i] * by_node[k + piece, j]
                scratch[i, N] = B[piece, side, i] * command
                for m in range(r):
                    for j in range(N):
                        scratch[i, j] = scratch[i, j] + A[piece, side, i, m] * slopes[k, m, j]
                    scratch[i, N] = scratch[i, N] + A[piece, side, i, m] * state[m]
            for i in range(r):
                for j in range(N):
                    slopes[k, i, j] = scratch[i, j]
                state[i] = scratch[i, N]
        for i in range(r):
            values[k, i] = state[i]


def body_ahead(x, v, h, torque, chain, places, rates, jacobians):
    """Integrate the motion of N coordinates over K steps of `h` [s]. Write positions to `places` (K, N), rates to
    `rates` (K, N), and to `jacobians` the derivatives of the state after each step
    with respect to the state before it and the torques.

    `x` and `v` (N,) are updated in place. `torque` (K, N + R) [N m] is held over each step, with tendon commands last.
    The Jacobians of `step_jacobian` are written to `jacobians` (K, 3 N + R, 2 N). `chain` holds (body, joints, slopes),
    where `slopes` is the result of `Mechanics.slopes`.
    """
    body, joints, slopes = chain
    J = slopes.J
    for k in range(len(torque)):
        step_jacobian(x, v, h, torque[k], body, joints, slopes)
        for a in range(J.shape[0]):
            for b in range(J.shape[1]):
                jacobians[k, a, b] = J[a, b]
        for i in range(len(x)):
            places[k, i] = x[i]
            rates[k, i] = v[i]
