"""The loops of chains that remember: steps with memory, and the slow pressure that swells a chamber."""

from __future__ import annotations

import numpy as np

from pliant.equations.elastic import tangent
from pliant.equations.energy import damping_power, input_power
from pliant.equations.memory import step_with_memory
from pliant.equations.section import inflated_interval, mean_inflated_torque, mean_swollen_torque, slow_interval
from pliant.simulation.march_loops import first_order_interval, rate_limited_interval


def march_with_memory(
    phi, w, state, base_angle, h, torque, keep, body, joints, memory, held, work, phi_out, w_out, state_out, energy_out,
):
    """As `march_loops.march`, with the memory of the joints: `state` (n, branches) is advanced in place and kept.

    state_out (rows, n, branches) takes it, energy_out (rows, 3) the energy that the memory dissipated in its last
    column. Returns -1; the index k of a step that turns a link by more than a radian; or -2 - k where the branches of
    step k find no agreement.
    """
    n = len(phi)
    supplied = 0.0
    lost = 0.0
    forgone = 0.0
    for k in range(len(h)):
        taken = step_with_memory(phi, w, base_angle, h[k], torque[k], body, joints, memory, state, held, work)
        for i in range(n):
            work.c[i] = w[i] - 0.5 * work.a[i]
            if not (abs(w[i]) * h[k] <= 1.0 and tangent(i, phi, base_angle, joints) > 0.0):
                return k
        if not taken >= 0.0:
            return -2 - k
        supplied = supplied + h[k] * input_power(work.c, joints, torque[k])
        lost = lost + h[k] * damping_power(work.c, joints)
        forgone = forgone + taken
        row = keep[k]
        if row >= 0:
            for i in range(n):
                phi_out[row, i] = phi[i]
                w_out[row, i] = w[i]
                for j in range(state.shape[1]):
                    state_out[row, i, j] = state[i, j]
            energy_out[row, 0] = supplied
            energy_out[row, 1] = lost
            energy_out[row, 2] = forgone
    return -1


def held_step_with_memory(
    phi, w, state, base_angle, h, command, p, slow, rise, fall, share, time, law, body, joints, memory, held, work,
):
    """As `march_loops.held_step`, with memory and with a chamber that swells: `slow` [Pa] is its slow pressure.

    Returns the pressure and the slow pressure at the end of the step; not a number where the step failed.
    """
    start, middle, end, mean = first_order_interval(h, command, command, rise, fall, p)
    half, last = slow_interval(h, start, end, mean, slow, time)
    torque = mean_swollen_torque(start, middle, end, mean, slow, half, last, share, law)
    taken = step_with_memory(phi, w, base_angle, h, torque, body, joints, memory, state, held, work)
    for i in range(len(w)):
        if not (abs(w[i]) * h <= 1.0 and taken >= 0.0 and tangent(i, phi, base_angle, joints) > 0.0):
            return np.nan, last
    return end, last


def slow_pressure(h, behind, slow, time, out):
    """Slow pressure at the start, middle and end of each interval, out (m, 3) [Pa], from `behind` (m, 4) the valve.

    `slow` is its value at the start, `time` [s] its time constant; exact for a pressure straight in each interval.
    """
    for k in range(len(h)):
        out[k, 0] = slow
        out[k, 1], out[k, 2] = slow_interval(h[k], behind[k, 0], behind[k, 2], behind[k, 3], slow, time)
        slow = out[k, 2]


def inflation(h, behind, y, limit, time, out):
    """Fourth power of the hoop stretch at the start, middle and end of each interval, out (m, 3); see `slow_pressure`.

    `y` is its value at the start, `limit` [Pa] and `time` [s] those of `equations.section.inflated_interval`.
    """
    for k in range(len(h)):
        out[k, 0] = y
        out[k, 1], out[k, 2] = inflated_interval(h[k], behind[k, 1], behind[k, 2], behind[k, 3], y, limit, time)
        y = out[k, 2]


def held_step_of_chamber(
    phi, w, state, base_angle, h, command, chamber, valve, share, time, limit, late, law, body, joints, memory, held,
    work,
):
    """As `held_step_with_memory`, for every valve of first order and a chamber that inflates.

    `chamber` (3,) is its pressure and slow pressure [Pa] and the fourth power of its stretch, advanced in place; its
    pressure is not a number where the step failed. `valve` holds the times of rise and fall [s] and the limits of
    their rates [Pa/s]; `limit` [Pa] and `late` [s] are those of the inflation, 0 Pa for a rigid wall.
    """
    start, middle, end, mean = rate_limited_interval(
        h, command, command, valve[0], valve[1], valve[2], valve[3], chamber[0]
    )
    half, last = slow_interval(h, start, end, mean, chamber[1], time)
    if limit > 0.0:
        y1, y2 = inflated_interval(h, middle, end, mean, chamber[2], limit, late)
        torque = mean_inflated_torque(
            start, middle, end, mean, chamber[1], half, last, chamber[2], y1, y2, share, law
        )
        chamber[2] = y2
    else:
        torque = mean_swollen_torque(start, middle, end, mean, chamber[1], half, last, share, law)
    taken = step_with_memory(phi, w, base_angle, h, torque, body, joints, memory, state, held, work)
    chamber[0] = end
    chamber[1] = last
    for i in range(len(w)):
        if not (abs(w[i]) * h <= 1.0 and taken >= 0.0 and tangent(i, phi, base_angle, joints) > 0.0):
            chamber[0] = np.nan
