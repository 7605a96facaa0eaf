"""Open-loop trajectory: a pressure trace within limits that brings the tip to a point and holds it there, by gradients.

python examples/jax/trajectory.py [--rounds 150]
"""

from __future__ import annotations

import argparse
from typing import Any

import jax
import jax.numpy as jnp
from design import exported

from pliant.actuators import chen2018
from pliant.model import Memory

STEP, KNOTS, EACH = 2e-3, 20, 10  # s; pressures of the trace, and steps of each
HIGHEST, RATE = 120e3, 1.5e6  # Pa, Pa/s


def main(rounds: int) -> dict[str, float]:
    """Print and return the distance of the tip from its goal over the last fifth, before and after."""
    jax.config.update("jax_enable_x64", True)
    model = chen2018.model(memory=Memory((0.1,), (0.3,), (0.1,), (0.01,)))
    arm = exported(model)
    start = arm.rest(arm.parameters, jnp.zeros(1))
    goal = arm.observe(arm.parameters, arm.rest(arm.parameters, jnp.array([60e3])))["position"][-1]

    def trace(knots: Any) -> Any:
        level = HIGHEST * jax.nn.sigmoid(knots)
        change = RATE * STEP * EACH * jnp.tanh(jnp.diff(level, prepend=0.0) / (RATE * STEP * EACH))
        return jnp.clip(jnp.cumsum(change), 0.0, HIGHEST)

    def misses(knots: Any) -> Any:
        commands = jnp.repeat(trace(knots), EACH)[:, None]
        _, states = arm.rollout(arm.parameters, start, commands, STEP)
        tip = jax.vmap(lambda s: arm.observe(arm.parameters, s)["position"][-1])(states)
        miss = jnp.sum((tip - goal) ** 2, axis=1)
        return jnp.mean(miss[-len(miss) // 2 :]), miss

    slope = jax.jit(jax.value_and_grad(misses, has_aux=True))
    knots, mean, square = jnp.zeros(KNOTS), jnp.zeros(KNOTS), jnp.zeros(KNOTS)
    (_, before), _ = slope(knots)
    for k in range(1, rounds + 1):  # Adam
        _, g = slope(knots)
        mean, square = 0.9 * mean + 0.1 * g, 0.99 * square + 0.01 * g * g
        knots -= 0.1 * mean / (1 - 0.9**k) / (jnp.sqrt(square / (1 - 0.99**k)) + 1e-12)
    (_, after), _ = slope(knots)
    part = len(after) // 5
    found = {
        "miss_mm": 1e3 * float(jnp.sqrt(jnp.mean(before[-part:]))),
        "miss_after_mm": 1e3 * float(jnp.sqrt(jnp.mean(after[-part:]))),
        "highest_kpa": 1e-3 * float(jnp.max(trace(knots))),
        "steepest_kpa_s": 1e-3 * float(jnp.max(jnp.abs(jnp.diff(trace(knots), prepend=0.0)))) / (STEP * EACH),
    }
    print({name: float(f"{value:.3g}") for name, value in found.items()})
    return found


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("--rounds", type=int, default=150)
    main(parser.parse_args().rounds)
