"""A policy of 10^4 parameters, trained by gradients through 64 arms that are drawn from the uncertainty of a fit.

The tip follows a target that moves sideways. The arms differ in stiffness and damping as the recordings of a fit leave
them uncertain: here a stated covariance takes the place of a fit's.

The predictive controller of pliant (extra mpc), designed for the mean arm, follows the same target with the same arms
that the policy has not seen. Both know the true state and act every 10 ms.

python examples/jax/policy.py [--rounds 60] [--arms 64]
"""

from __future__ import annotations

import argparse
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from design import exported

from pliant.actuators import chen2018
from pliant.control.design import design_outputs
from pliant.control.mpc import Mpc
from pliant.control.tuning import Limits
from pliant.estimation import State
from pliant.exporters.provenance import Uncertainty
from pliant.model import Model
from pliant.simulation import Stepper

STEP, EACH, ACTS = 5e-3, 2, 50  # s; steps between two actions, and actions
HIGHEST = 120e3  # Pa
SKIPPED = 5  # actions at the start, in which no arm can be near the target
WIDE = 96  # units of each of the two hidden layers


def layers(key: Any, sizes: list[int]) -> list[tuple[Any, Any]]:
    """Return random weights and zero offsets of a network with layers of the given sizes."""
    keys = jax.random.split(key, len(sizes) - 1)
    pairs = zip(keys, sizes[:-1], sizes[1:], strict=True)
    return [(jax.random.normal(k, (n, m)) / jnp.sqrt(n), jnp.zeros(m)) for k, n, m in pairs]


def pressure(policy: list[tuple[Any, Any]], seen: Any) -> Any:
    """Return the command (1,) [Pa] of the policy for what it sees."""
    for weight, offset in policy[:-1]:
        seen = jnp.tanh(seen @ weight + offset)
    return HIGHEST * jax.nn.sigmoid(seen @ policy[-1][0] + policy[-1][1])


def predictive(model: Model, bodies: dict[str, np.ndarray], path: np.ndarray) -> float:
    """Return the mean square distance [m^2] of the tips of drawn arms from `path` (K, 2) [m] by predictive control."""
    limits, period = Limits(HIGHEST, np.inf), STEP * EACH
    rest = Stepper(model, STEP).tips()[-1]
    rows = np.concatenate([path[:1], path]) - rest  # the goal of an action is where the tip is at its end
    controller = Mpc(design_outputs(model, ("tip_x", "tip_y"), rows, limits, period, path=True), limits)
    square, none = [], np.zeros(model.n)
    for stiffness, damping in zip(bodies["stiffness"], bodies["damping"], strict=True):
        body = Stepper(model.with_(stiffness=stiffness, damping=damping), STEP)
        controller.reset()
        for k, goal in enumerate(path):
            state = State(body.time, body.angle, body.rate, none, none, np.zeros((2 * model.n, 2 * model.n)), 1.0, "")
            body.step(controller.step(k * period, state, body.pressure), EACH)
            if k >= SKIPPED:
                square.append(np.sum((body.tips()[-1] - goal) ** 2))
    return float(np.mean(square))


def main(rounds: int, arms: int) -> dict[str, float]:
    """Print and return the rms distance of the tips from the target on arms that were not trained on."""
    jax.config.update("jax_enable_x64", True)
    model = chen2018.model()
    fitted = {"stiffness": float(model.stiffness[0]), "damping": float(model.damping[0])}
    value = np.array([*fitted.values()])
    known = Uncertainty(tuple(fitted), value, np.diag((0.05 * value) ** 2))
    arm = exported(model, uncertainty=known)
    start = arm.rest(arm.parameters, jnp.zeros(1))
    phases = jnp.linspace(0.0, 1.0, ACTS)

    def target(part: Any) -> Any:
        held = arm.rest(arm.parameters, 1e3 * (50.0 - 30.0 * jnp.cos(2 * jnp.pi * part))[None])
        return arm.observe(arm.parameters, held)["position"][-1]

    path = jax.jit(jax.vmap(target))(phases)

    def miss(policy: Any, parameters: Any) -> Any:
        def act(state: Any, now: Any) -> Any:
            goal, ahead = now
            tip = arm.observe(parameters, state)["position"][-1]
            seen = jnp.concatenate([20 * tip, 20 * goal, 20 * ahead, state.position, 0.1 * state.velocity])
            after, _ = arm.rollout(parameters, state, jnp.repeat(pressure(policy, seen)[None], EACH, axis=0), STEP)
            return after, jnp.sum((arm.observe(parameters, after)["position"][-1] - goal) ** 2)

        _, square = jax.lax.scan(act, start, (path, jnp.roll(path, -5, axis=0)))
        return jnp.mean(square[SKIPPED:])

    def mean_miss(policy: Any, many: Any) -> Any:
        return jnp.mean(jax.vmap(miss, in_axes=(None, 0))(policy, many))

    train, test = arm.draws(arms, jax.random.key(0)), arm.draws(arms, jax.random.key(1))
    policy = layers(jax.random.key(2), [6 + 2 * model.n, WIDE, WIDE, 1])
    count = sum(a.size for pair in policy for a in pair)
    error, slope = jax.jit(mean_miss), jax.jit(jax.grad(mean_miss))
    before = float(error(policy, test))
    still = jax.tree_util.tree_map(jnp.zeros_like, policy)
    mean, square = still, still
    for k in range(1, rounds + 1):  # Adam
        g = slope(policy, train)
        mean = jax.tree_util.tree_map(lambda m, g: 0.9 * m + 0.1 * g, mean, g)
        square = jax.tree_util.tree_map(lambda s, g: 0.99 * s + 0.01 * g * g, square, g)
        scale = 0.01 * np.sqrt(1 - 0.99**k) / (1 - 0.9**k)
        policy = jax.tree_util.tree_map(lambda p, m, s: p - scale * m / (jnp.sqrt(s) + 1e-12), policy, mean, square)  # noqa: B023
    drawn, goals = jax.tree_util.tree_map(np.asarray, test), np.asarray(path)
    found = {"parameters": float(count), "rms_mm": 1e3 * before**0.5,
             "rms_after_mm": 1e3 * float(error(policy, test)) ** 0.5,
             "rms_mpc_mm": 1e3 * predictive(model, drawn, goals) ** 0.5}  # fmt: skip
    print({name: float(f"{value:.3g}") for name, value in found.items()})
    return found


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("--rounds", type=int, default=60)
    parser.add_argument("--arms", type=int, default=64)
    given = parser.parse_args()
    main(given.rounds, given.arms)
