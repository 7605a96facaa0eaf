"""The arithmetic of one control step, compiled: the regulator in two parts, and the valve of a rig."""

from __future__ import annotations

import numpy as np

from pliant.equations.observation import tip_outputs, turned

KILO = 1e3  # pressures of the state and commands of the gains are in kPa


def look(gains, row, geometry, known, rules, resting, memory):
    """Compare the state with what is wanted, and find the regulator's commands before their limits.

    `gains` are (K, slope, inverse, driven, row) of `Gains`, `row` those of an `LqrDesign` for this period, `geometry`
    of `tip_geometry`. `memory` (commands on their way, integrals, last commands, errors, shifts, pressures that make up
    for the shifts, deviations of the state, commands) takes the last five. Where the joints' rest angles are off by a
    shift, other pressures bring the outputs to their places; where the body turns as if under `scale` times the
    pressure, pressures are counted so often and the commands are divided by it.
    """
    K, slope, inverse, _driven, by_position = gains
    pressure, lead, position, beside, wanted, still = row
    angle, rate, rest_shift, strain, strain_rate, strain_shift, scale, behind = known
    weight = rules[4]
    queue, integral, _command, error, turn, more, away, wish = memory
    n = len(angle)
    size = n + len(strain)
    tip_outputs(angle, strain, geometry, error)
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
    """Put the states of the valves, commands on their way and integrals into the state (N,), from `first` on."""
    for i in range(len(behind)):
        away[first + i] = scale * behind[i]
    first = first + len(behind)
    for i in range(len(queue)):
        away[first + i] = scale * queue[i]
    first = first + len(queue)
    for j in range(len(integral)):
        away[first + j] = integral[j]


def ask(row, scale, more, away, wish):
    """Take what is wanted from the state (N,), and find the commands (C,) [Pa] of the regulator."""
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
    """Bring the commands within their limits, sum up the errors without windup, and put the commands on their way.

    Returns whether a limit changed a command. At a limit, only what leads away from it is summed up.
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
    place = 0
    for c in range(len(command)):
        sent = within(wish[c], command[c], highest[c], reach)
        met = met or sent != wish[c]
        for j in range(m):
            for i in range(m):
                left = left + (wish[c] - sent) * K[c, first + j] * driven[j, i] * weight[i] * error[i]
        for i in range(waiting[c] - 1, 0, -1):
            queue[place + i] = queue[place + i - 1]
        if waiting[c] > 0:
            queue[place] = sent
        place = place + waiting[c]
        command[c] = sent
    if left >= 0.0:
        for j in range(m):
            for i in range(m):
                integral[j] = integral[j] + share * period * driven[j, i] * weight[i] * error[i]
    return met


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

    `valve` are (h, rise, fall, damping, gain): step [s], rad/s while it fills and empties, damping ratio, and gain (2,)
    of the gauge; `held` (2,) the pressure and its rate, `command` and `out` are workspace.
    """
    h, rise, fall, damping, gain = valve
    for k in range(len(command)):
        command[k] = asked
    regulate(command, h, rise, fall, damping, held, out)
    if np.isfinite(seen):
        off = seen - held[0]
        held[0] = held[0] + gain[0] * off
        held[1] = held[1] + gain[1] * off
