"""The arithmetic of one control step, compiled."""

from __future__ import annotations

import numpy as np


def between(grid, value):
    """Index k and share b of a value between grid[k] and grid[k + 1]; held at the ends of the grid."""
    k = 0
    while k < len(grid) - 2 and value >= grid[k + 1]:
        k = k + 1
    b = (value - grid[k]) / (grid[k + 1] - grid[k])
    return k, min(1.0, max(0.0, b))


def feedback(
    gains, grid, rest_angle, rest_tip, direction, tip_by_angle, tip_by_pressure,
    target, angle, rate, shift, valve, waiting, integral, scale, lead, out,
):
    """Command of a gain-scheduled state feedback before its limits; Pa.

    Gains (G, N) and rests are interpolated between the pressures of `grid` (G,). The state is angle (n,), rate (n,),
    valve (v,), the commands on their way `waiting` (D,) and `integral` [m s]. Where the joints' rest angles are off by
    `shift` (n,), another pressure brings the tip to where the model rests at `target` [Pa]: out[0]; angles, valve and
    commands are deviations from the rest there, less those of a reference, `lead` (N,), whose last entry is added to
    the command. Where the body turns as if under `scale` times the pressure, pressures are counted so often and the
    command is divided by it. out[1] takes the command, out[2:4] the tip [m] at the rest and out[4:6] the direction of
    its path.
    """
    k, b = between(grid, target)
    a = 1.0 - b
    n = len(angle)
    moved = 0.0
    turn = 0.0
    for i in range(n):
        turn = turn + shift[i]
        moved = moved + (a * tip_by_angle[k, i] + b * tip_by_angle[k + 1, i]) * turn
    hold = target - moved / (a * tip_by_pressure[k] + b * tip_by_pressure[k + 1])
    j, d = between(grid, hold)
    c = 1.0 - d
    total = 0.0
    turn = 0.0
    for i in range(n):
        turn = turn + shift[i]
        rest = c * rest_angle[j, i] + d * rest_angle[j + 1, i] + turn
        total = total + (a * gains[k, i] + b * gains[k + 1, i]) * (angle[i] - rest - lead[i])
        total = total + (a * gains[k, n + i] + b * gains[k + 1, n + i]) * (rate[i] - lead[n + i])
    base = 2 * n
    offset = hold
    for i in range(len(valve)):
        off = scale * valve[i] - offset - lead[base + i]
        total = total + (a * gains[k, base + i] + b * gains[k + 1, base + i]) * off
        offset = 0.0
    base = base + len(valve)
    for i in range(len(waiting)):
        off = scale * waiting[i] - hold - lead[base + i]
        total = total + (a * gains[k, base + i] + b * gains[k + 1, base + i]) * off
    base = base + len(waiting)
    total = total + (a * gains[k, base] + b * gains[k + 1, base]) * integral
    out[0] = hold / scale
    out[1] = (hold + lead[len(lead) - 1] - total) / scale
    for i in range(2):
        out[2 + i] = a * rest_tip[k, i] + b * rest_tip[k + 1, i]
        out[4 + i] = a * direction[k, i] + b * direction[k + 1, i]


def steer(table, place, rules, aim, angle, rate, shift, valve, lead, waiting, held, out):
    """One step of the linear-quadratic regulator: feedback, limits, integral action without windup; the command, Pa.

    `table` holds the first seven arguments of `feedback`, `place` (link_length, x0, y0, sign of the bend), `rules`
    (highest [Pa], slew [Pa/s], period [s], integral_band [m]) and `aim` (target [Pa], scale, lead_tip [m]). Changed in
    place: `waiting` (D,), and held (4,), the command [Pa], the integral [m s], the tip's error [m] and the count of
    commands that met a limit. `out` (8,) is scratch.
    """
    gains, grid, rest_angle, rest_tip, direction, tip_by_angle, tip_by_pressure = table
    link_length, x0, y0, sign = place
    highest, slew, period, band = rules
    target, scale, lead_tip = aim
    feedback(
        gains, grid, rest_angle, rest_tip, direction, tip_by_angle, tip_by_pressure,
        target, angle, rate, shift, valve, waiting, held[1], scale, lead, out,
    )
    tip_of(angle, link_length, x0, y0, out[6:])
    error = (sign * out[6] - out[2]) * out[4] + (out[7] - out[3]) * out[5] - lead_tip
    wish = out[1]
    command = within(wish, held[0], highest, slew * period)
    if command != wish:
        held[3] = held[3] + 1.0
    if (wish - command) * error >= 0.0:  # at a limit, only what leads away from it is summed up
        share = band / max(abs(error), 1e-12)
        held[1] = held[1] + min(1.0, share * share) * error * period
    for i in range(len(waiting) - 1, 0, -1):
        waiting[i] = waiting[i - 1]
    if len(waiting) > 0:
        waiting[0] = command
    held[0] = command
    held[2] = error
    return command


def within(command, before, highest, reach):
    """The command [Pa] nearest to `command` that lies in 0 ... highest and no farther than `reach` from `before`.

    What is not a number stays so.
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


def tip_of(angle, link_length, x0, y0, out):
    """Tip (2,) of the last link from absolute angles (n,), m, before any mirror."""
    out[0] = x0
    out[1] = y0
    for i in range(len(angle)):
        out[0] = out[0] - link_length[i] * np.sin(angle[i])
        out[1] = out[1] + link_length[i] * np.cos(angle[i])


def regulate(command, h, rise, fall, damping, held, out):
    """Pressures at the ends of steps of `h` [s] under commands held over them, from `held` = (p, dp/dt) [Pa, Pa/s].

    p'' = omega^2 (u - p) - 2 zeta omega p', with omega = rise [rad/s] where u > p and fall where u < p; p >= 0. By the
    midpoint rule; `held` is carried on in place.
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


def follow_valve(asked, seen, h, rise, fall, damping, gain, held, command, out):
    """As `regulate` under one command [Pa], len(command) steps, then corrected by a gauge's reading [Pa] if finite.

    `gain` (2,) is that of the correction, `command` and `out` are scratch.
    """
    for k in range(len(command)):
        command[k] = asked
    regulate(command, h, rise, fall, damping, held, out)
    if np.isfinite(seen):
        off = seen - held[0]
        held[0] = held[0] + gain[0] * off
        held[1] = held[1] + gain[1] * off
