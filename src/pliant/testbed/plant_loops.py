"""Compiled simulation of the pressure regulator that continues from one command to the next."""

from __future__ import annotations

import numpy as np


def regulate_on(commands, dt, sub, law, held, out):
    """Simulate a pressure regulator over N steps, each with a constant command, and write its pressure [Pa] after each
    step to `out` (N,).

    The equation is that of `valve_loops.regulate`. Each of the `commands` (N,) [Pa] is held for a step of `dt` [s],
    which has `sub` midpoint substeps. `held` (2,) is the pressure [Pa] and its rate [Pa/s]; it is updated in place.
    """
    p = held[0]
    rate = held[1]
    h = dt / sub
    for n in range(commands.size):
        for _ in range(sub):
            error = commands[n] - p
            w = law.natural if error > 0.0 else law.natural / law.exhaust
            pull = w * w * np.sign(error) * max(abs(error) - law.dead_band, 0.0) - 2.0 * law.damping * w * rate
            half_rate = max(-law.slew_down, min(law.slew_up, rate + 0.5 * h * pull))
            error = commands[n] - (p + 0.5 * h * rate)
            pull = w * w * np.sign(error) * max(abs(error) - law.dead_band, 0.0) - 2.0 * law.damping * w * half_rate
            rate = max(-law.slew_down, min(law.slew_up, rate + h * pull))
            p += h * half_rate
            if p < 0.0:
                p, rate = 0.0, 0.0
        out[n] = p
    held[0] = p
    held[1] = rate
