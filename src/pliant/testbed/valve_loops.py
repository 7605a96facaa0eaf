"""Compiled loops of the pneumatic supply."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

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
