"""The arithmetic of one control step, compiled.

Records of `symbols` are taken apart by position, so that plain tuples do as well: Python hands those over faster.
"""

from __future__ import annotations

import numpy as np

from pliant.control.symbols import COMMAND, DIRECTION, ERROR, HOLD, INTEGRAL, SATURATED, SEEN, TIP, WISH


def between(grid, value):
    """Index k and share b of a value between grid[k] and grid[k + 1]; held at the ends of the grid."""
    k = 0
    while k < len(grid) - 2 and value >= grid[k + 1]:
        k = k + 1
    b = (value - grid[k]) / (grid[k + 1] - grid[k])
    return k, min(1.0, max(0.0, b))


def feedback(schedule, aim, seen, lead, memory):
    """Command of a gain-scheduled state feedback before its limits; Pa.

    Gains and rests are interpolated between the pressures of the schedule. The state is that of body and valve, the
    commands on their way and the integral of the tip's error. Where the joints' rest angles are off by a shift, another
    pressure brings the tip to where the model rests at `aim.target`: out[HOLD]; angles, valve and commands are
    deviations from the rest there, less those of a trajectory, `lead` (N,), whose last entry is added to the command.
    Where the body turns as if under `aim.scale` times the pressure, pressures are counted so often and the command is
    divided by it. out[WISH] takes the command, out[TIP:] the tip [m] at the rest and out[DIRECTION:] that of its path.
    """
    gains, grid, rest_angle, rest_tip, direction, tip_by_angle, tip_by_pressure = schedule
    target, scale, _lead_tip = aim
    angle, rate, shift, valve = seen
    waiting, held, out = memory
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
    total = total + (a * gains[k, base] + b * gains[k + 1, base]) * held[INTEGRAL]
    out[HOLD] = hold / scale
    out[WISH] = (hold + lead[len(lead) - 1] - total) / scale
    for i in range(2):
        out[TIP + i] = a * rest_tip[k, i] + b * rest_tip[k + 1, i]
        out[DIRECTION + i] = a * direction[k, i] + b * direction[k + 1, i]


def steer(law, aim, seen, lead, memory):
    """One step of the linear-quadratic regulator: feedback, limits, integral action without windup; the command, Pa."""
    schedule, geometry, rules = law
    link_length, x0, y0, sign = geometry
    highest, slew, period, band = rules
    waiting, held, out = memory
    feedback(schedule, aim, seen, lead, memory)
    tip_of(seen[0], link_length, x0, y0, out)
    error = (sign * out[SEEN] - out[TIP]) * out[DIRECTION] + (out[SEEN + 1] - out[TIP + 1]) * out[DIRECTION + 1]
    error = error - aim[2]
    wish = out[WISH]
    command = within(wish, held[COMMAND], highest, slew * period)
    if command != wish:
        held[SATURATED] = held[SATURATED] + 1.0
    if (wish - command) * error >= 0.0:  # at a limit, only what leads away from it is summed up
        share = band / max(abs(error), 1e-12)
        held[INTEGRAL] = held[INTEGRAL] + min(1.0, share * share) * error * period
    for i in range(len(waiting) - 1, 0, -1):
        waiting[i] = waiting[i - 1]
    if len(waiting) > 0:
        waiting[0] = command
    held[COMMAND] = command
    held[ERROR] = error
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
    """Tip of the last link from absolute angles (n,), m, before any mirror, into out[SEEN:]."""
    out[SEEN] = x0
    out[SEEN + 1] = y0
    for i in range(len(angle)):
        out[SEEN] = out[SEEN] - link_length[i] * np.sin(angle[i])
        out[SEEN + 1] = out[SEEN + 1] + link_length[i] * np.cos(angle[i])


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


def follow_valve(asked, seen, valve, held, command, out):
    """As `regulate` under one command [Pa], len(command) steps, then corrected by a gauge's reading [Pa] if finite.

    `valve` is a `SupplyNumbers`, `held` (2,) the pressure and its rate, `command` and `out` are workspace.
    """
    h, rise, fall, damping, gain = valve
    for k in range(len(command)):
        command[k] = asked
    regulate(command, h, rise, fall, damping, held, out)
    if np.isfinite(seen):
        off = seen - held[0]
        held[0] = held[0] + gain[0] * off
        held[1] = held[1] + gain[1] * off
