"""A linear policy that brings the tip of an arm in space to a target, by the cross-entropy method in one environment.

Each of the environments of a batch tries another policy. The inputs are pressures of three chambers; a policy sees tip
and target.

python examples/learning/reach_in_space.py [--rounds 15] [--policies 64] [--engine pliant]
"""

from __future__ import annotations

import argparse
import time

import gymnasium
import numpy as np

from pliant.exporters.gymnasium import EpisodeTask
from pliant.model import Chamber, Space, chain_model

AZIMUTHS = np.radians([90.0, 210.0, 330.0])
ACTIONS, BEST = 25, 0.15  # actions of an episode; fraction of the policies that the next round is drawn around
SIZE = 3, 5  # of a policy: pressures, and what it sees: target and tip across the axis, and 1
EPISODES = 3  # in which each policy is tried
NEAR = 0.2  # of the length: a distance that counts as 1


def arm():
    """Return an arm of three links with three chambers around its axis, hanging in gravity."""
    chambers = [Chamber([2e-6], joint_gain=np.sin(a), cross_gain=-np.cos(a), name=f"chamber_{k + 1}")
                for k, a in enumerate(AZIMUTHS)]  # fmt: skip
    return chain_model(
        length=0.3, mass=0.1, links=3, stiffness=0.5, damping=2e-2, gravity=(0.0, 0.0, 9.81), chambers=chambers,
        space=Space(radius=0.012), name="arm_in_space",
    )


def returns(envs, policies: np.ndarray, seed: int) -> np.ndarray:
    """Return the mean reward of each policy (P, 3, 5) in the last half of one episode."""
    state, _ = envs.reset(seed=seed)
    total = np.zeros(len(policies))
    for k in range(ACTIONS):
        tip, target = state[:, -9:-7] / NEAR, state[:, -6:-4] / NEAR
        seen = np.concatenate([target, tip, np.ones((len(tip), 1))], axis=1)
        action = np.tanh(np.einsum("pci,pi->pc", policies, seen)).astype(np.float32)
        state, reward, *_ = envs.step(action)
        total += reward if k >= ACTIONS // 2 else 0.0
    return total / (ACTIONS - ACTIONS // 2)


def mean_distance(envs, policy: np.ndarray) -> float:
    """Return the mean distance of tip and target over the body's length, on targets that no round has used."""
    return -float(returns(envs, np.broadcast_to(policy, (envs.num_envs, *SIZE)), 0).mean())


def main(rounds: int, policies: int, engine: str) -> dict[str, float]:
    """Print and return the mean distance of tip and target over the body's length, before and after."""
    task = EpisodeTask(duration=ACTIONS * 0.02, engine=engine)
    envs = gymnasium.make_vec("pliant/Reach-v0", num_envs=policies, model=arm(), task=task)
    rng = np.random.default_rng(0)
    mean, spread = np.zeros(SIZE), np.ones(SIZE)
    first, start = mean_distance(envs, mean), time.perf_counter()
    for k in range(rounds):
        tried = mean + spread * rng.standard_normal((policies, *SIZE))
        score = np.mean([returns(envs, tried, EPISODES * k + j + 1) for j in range(EPISODES)], axis=0)
        best = tried[np.argsort(score)[-max(2, int(BEST * policies)) :]]
        mean, spread = best.mean(axis=0), best.std(axis=0) + 0.03
    took = time.perf_counter() - start
    steps = EPISODES * rounds * policies * ACTIONS
    found = {"distance": first, "distance_after": mean_distance(envs, mean), "steps_per_s": steps / took}
    print({name: float(f"{value:.3g}") for name, value in found.items()})
    return found


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("--rounds", type=int, default=15)
    parser.add_argument("--policies", type=int, default=64)
    parser.add_argument("--engine", choices=("pliant", "jax"), default="pliant")
    given = parser.parse_args()
    main(given.rounds, given.policies, given.engine)
