"""Compiled loops of the pneumatic supply."""

from __future__ import annotations

import numpy as np

GAS_CONSTANT = 287.05  # J/(kg K), dry air
REFERENCE_DENSITY = 1.185  # kg/m3, ISO 6358 reference atmosphere (100 kPa, 293.15 K, 65 % humidity)
REFERENCE_TEMPERATURE = 293.15  # K


def regulate(command, dt, natural, damping, exhaust, slew, dead_band, out):
    """Second-order regulator with slew limits: ``p'' = w^2 (u - p) - 2 z w p'``, slower by `exhaust` downwards.

    `slew` (2,): fastest rise and fall, Pa/s. The midpoint rule carries the two states.
    """
    p = command[0]
    rate = 0.0
    out[0] = p
    for n in range(1, command.size):
        middle = 0.5 * (command[n - 1] + command[n])
        error = command[n - 1] - p
        w = natural if error > 0.0 else natural / exhaust
        pull = w * w * np.sign(error) * max(abs(error) - dead_band, 0.0) - 2.0 * damping * w * rate
        half_rate = max(-slew[1], min(slew[0], rate + 0.5 * dt * pull))
        half_p = p + 0.5 * dt * rate
        error = middle - half_p
        pull = w * w * np.sign(error) * max(abs(error) - dead_band, 0.0) - 2.0 * damping * w * half_rate
        rate = max(-slew[1], min(slew[0], rate + dt * pull))
        p += dt * half_rate
        if p < 0.0:
            p, rate = 0.0, 0.0
        out[n] = p
    return p


def mass_flow(upstream, downstream, conductance, critical, temperature):
    """ISO 6358 flow through a restriction, kg/s; absolute pressures, Pa; `conductance` in m3/(s Pa)."""
    ratio = downstream / upstream
    if ratio >= 1.0:
        return 0.0
    flow = conductance * upstream * REFERENCE_DENSITY * np.sqrt(REFERENCE_TEMPERATURE / temperature)
    if ratio > critical:
        flow *= np.sqrt(1.0 - ((ratio - critical) / (1.0 - critical)) ** 2)
    return flow


def chamber_rate(p, opening, source, ambient, fill, exhaust, critical, volume, polytropic, temperature):
    """Rate of an absolute chamber pressure, Pa/s, for a spool `opening` in -1 (exhaust) .. 1 (fill)."""
    flow = 0.0
    if opening > 0.0:
        flow = mass_flow(source, p, fill * opening, critical, temperature)
    elif opening < 0.0:
        flow = -mass_flow(p, ambient, -exhaust * opening, critical, temperature)
    return polytropic * GAS_CONSTANT * temperature * flow / volume


def fill_chamber(command, dt, sub, spool, band, source, ambient, fill, exhaust, critical, gas, out):
    """Chamber of fixed volume behind a proportional spool of second order; gauge `command` and `out`, Pa.

    `spool` = (natural frequency rad/s, damping ratio); `gas` = (volume m3, polytropic exponent, temperature K).
    """
    p = command[0] + ambient
    place = speed = 0.0
    h = dt / sub
    out[0] = command[0]
    for n in range(1, command.size):
        for k in range(sub):
            u = command[n - 1] + (command[n] - command[n - 1]) * (k + 0.5) / sub
            wish = max(-1.0, min(1.0, (u + ambient - p) / band))
            speed += h * (spool[0] ** 2 * (wish - place) - 2.0 * spool[1] * spool[0] * speed)
            place += h * speed
            opening = max(-1.0, min(1.0, place))
            rate = chamber_rate(p, opening, source, ambient, fill, exhaust, critical, gas[0], gas[1], gas[2])
            half = p + 0.5 * h * rate
            p += h * chamber_rate(half, opening, source, ambient, fill, exhaust, critical, gas[0], gas[1], gas[2])
        out[n] = p - ambient
    return p
