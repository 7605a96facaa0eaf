"""Measure energy and angular momentum about gravity of chains in space over a million steps, without dampers.

There are three bodies of two hanging links of 0.2 m and 0.1 kg: free swings, swings with springs of all terms, and a
first joint that turns freely about gravity, with twist on a spring behind it. The program prints the largest changes:
of the energy relative to the kinetic energy at the start, and of the angular momentum relative to itself. `--steps N`
sets another number of steps.
"""

from __future__ import annotations

import argparse

import numpy as np
from rods import Chain

from pliant.compiler.choose import twin
from pliant.equations import spatial, spatial_points, spatial_springs
from pliant.equations.elastic import ROWS
from pliant.equations.symbols import SpatialBody, SpatialJoints

Array = np.ndarray
LOOKS = 500  # times at which energy and momentum are taken


def hanging(stiffness: Array, hardening: Array) -> Chain:
    """Return two hanging links with springs (N,) and their terms (ROWS, N)."""
    length, mass, none = np.array([0.05, 0.2, 0.2]), np.full(2, 0.1), np.zeros(stiffness.size)
    body = SpatialBody(length, mass, length[1:] / 2, mass * length[1:] ** 2 / 12, mass * 1e-4,
                       np.tile(np.eye(3), (2, 1, 1)), np.eye(3), 0.0, 0.0, 9.81, np.zeros((0, none.size)),
                       *np.zeros((4, 0)), np.zeros((none.size, 0)), np.zeros((3, 0)))  # fmt: skip
    linear = np.zeros(2), np.zeros((0, 3)), np.zeros((2, 0))
    return Chain(body, SpatialJoints(0.0, none, stiffness, none, hardening, *linear))


def bodies() -> dict[str, Chain]:
    """Return the three bodies by name."""
    K = np.full(4, 0.5)
    twist = np.array([0.3, 0.3, 0.3, 0.3, 0.0, 0.05])
    return {
        "free swings": hanging(np.zeros(4), np.zeros((ROWS, 4))),
        "springs of all terms": hanging(K, np.stack([-0.3 * K, 0.4 * K, np.full(4, 0.25)])),
        "free about gravity, twist": hanging(twist, np.zeros((ROWS, 6))),
    }


def invariants(chain: Chain, x: Array, v: Array) -> Array:
    """Return energy [J] and angular momentum about gravity [N m s].

    A turn of the body about gravity turns every swing (a, b), or where the first joint twists, its swing and twist.
    """
    work, size = chain.work(), x.size
    moving = twin(spatial_points.kinetic_energy)(x, v, chain.body, work)
    weight = twin(spatial_points.gravity_energy)(x, chain.body, work)
    stored = weight + twin(spatial_springs.elastic_energy)(x, chain.joints)
    M = np.zeros((size, size))
    twin(spatial.inertia)(0.0, chain.body, work, M)
    p = (M + np.tril(M, -1).T) @ v
    swings = x[:4:2] * p[1:4:2] - x[1:4:2] * p[:4:2]
    return np.array([moving + stored, swings.sum() if size == 4 else swings[0] + p[4]])


def changes(chain: Chain, h: float, steps: int) -> Array:
    """Return the largest changes of energy and momentum over a number of steps of h [s]."""
    rng = np.random.default_rng(3)
    size = len(chain.joints.K)
    x, v, still, work = rng.uniform(-0.7, 0.7, size), rng.normal(0, 3, size), np.zeros(size), chain.work()
    before, step = invariants(chain, x, v), twin(spatial.step)
    moving = twin(spatial_points.kinetic_energy)(x, v, chain.body, work)
    largest = np.zeros(2)
    for k in range(steps):
        step(x, v, h, still, *chain, work)
        if k % max(1, steps // LOOKS) == 0:
            largest = np.maximum(largest, np.abs(invariants(chain, x, v) - before))
    return largest / [moving, abs(before[1])]


def main() -> None:
    """Print the table."""
    asked = argparse.ArgumentParser(description=__doc__)
    asked.add_argument("--steps", type=int, default=1_000_000)
    steps = asked.parse_args().steps
    print(f"largest change over {steps} steps: energy, angular momentum about gravity")
    for name, chain in bodies().items():
        for h in (1e-3, 5e-4, 2.5e-4):
            energy, momentum = changes(chain, h, steps)
            print(f"  {name:<26} h = {1e3 * h:<5} ms {energy:10.1e}{momentum:10.1e}", flush=True)


if __name__ == "__main__":
    main()
