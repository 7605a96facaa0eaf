"""A linear policy that brings the tip of an arm in space to a target, by the cross-entropy method in one environment.

Each of the environments of a batch tries another policy on the same sequence of targets. The inputs are pressures of
three chambers; a policy sees tip and target.

python examples/learning/reach_in_space.py [--rounds 25] [--policies 64] [--engine pliant]
"""

from __future__ import annotations

import argparse
import time

import gymnasium
import numpy as np

from pliant.exporters.gymnasium import EpisodeTask
from pliant.model import Chamber, Space, chain_model

AZIMUTHS = np.radians([90.0, 210.0, 330.0])
ACTIONS, BEST = 25, 0.2  # actions of an episode; fraction of the policies that the next round is drawn around


def arm():
    """Return an arm of three links with three chambers around its axis, hanging in gravity."""
    chambers = [Chamber([2e-6], joint_gain=np.sin(a), cross_gain=-np.cos(a), name=f"chamber_{k + 1}")
                for k, a in enumerate(AZIMUTHS)]  # fmt: skip
    return chain_model(
        length=0.3, mass=0.1, links=3, stiffness=0.5, damping=2e-2, gravity=(0.0, 0.0, 9.81), chambers=chambers,
        space=Space(radius=0.012), name="arm_in_space",
    )


def returns(envs, policies: np.ndarray, seed: int) -> np.ndarray:
    """Return the mean reward of each policy (P, C, 7) in the last half of one episode."""
    state, _ = envs.reset(seed=[seed] * len(policies))
    total = np.zeros(len(policies))
    for k in range(ACTIONS):
        place = state[:, -9:-3]  # tip and target, over the length
        seen = np.concatenate([place, np.ones((len(place), 1))], axis=1)
        action = np.tanh(np.einsum("pci,pi->pc", policies, seen)).astype(np.float32)
        state, reward, *_ = envs.step(action)
        total += reward if k >= ACTIONS // 2 else 0.0
    return total / (ACTIONS - ACTIONS // 2)


def main(rounds: int, policies: int, engine: str) -> dict[str, float]:
    """Print and return the mean distance of tip and target over the body's length, before and after."""
    task = EpisodeTask(duration=ACTIONS * 0.02, engine=engine)
    envs = gymnasium.make_vec("pliant/Reach-v0", num_envs=policies, model=arm(), task=task)
    rng = np.random.default_rng(0)
    mean, spread = np.zeros((3, 7)), np.full((3, 7), 3.0)
    first = returns(envs, np.broadcast_to(mean, (policies, 3, 7)), 1).mean()
    start = time.perf_counter()
    for k in range(rounds):
        tried = mean + spread * rng.standard_normal((policies, 3, 7))
        score = np.mean([returns(envs, tried, seed) for seed in (2 * k + 2, 2 * k + 3)], axis=0)
        best = tried[np.argsort(score)[-max(2, int(BEST * policies)) :]]
        mean, spread = best.mean(axis=0), best.std(axis=0) + 0.05
    took = time.perf_counter() - start
    last = returns(envs, np.broadcast_to(mean, (policies, 3, 7)), 1).mean()
    found = {"distance": -first, "distance_after": -last, "steps_per_s": 2 * rounds * policies * ACTIONS / took}
    print({name: float(f"{value:.3g}") for name, value in found.items()})
    return found


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("--rounds", type=int, default=25)
    parser.add_argument("--policies", type=int, default=64)
    parser.add_argument("--engine", choices=("pliant", "jax"), default="pliant")
    given = parser.parse_args()
    main(given.rounds, given.policies, given.engine)
