"""Time a batch of arms in space in SIMD vectors beside the same batch one by one, on one core.

The arm has five links (10 coordinates) and three chambers; a rollout lasts 2 s in steps of 1 ms, with 201 output times.
Samples differ in their pulses of pressure, in their stiffness, or in both. The first line is the time of a step alone,
in both loops, and the second that of a batch that is held for 20 steps at a time, as environments are. Processor times
of the fastest of several runs, taken in turn.

python benchmarks/space_batch.py [--samples 200] [--runs 3]
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from time import process_time
from typing import Any
from unittest.mock import patch

import numpy as np
from harness import parser_of
from speed.timing import in_turn, machine

import pliant.batch.batch as batches
from pliant.batch.space_lanes import lanes_last, scratch_of, shared_steps, stacked
from pliant.batch.space_loops import LaneRows, march_in_space
from pliant.batch.stepper import OneByOne, OnSpaceLanes
from pliant.compiler import WIDTH
from pliant.compiler.choose import free_twin, lane_twin
from pliant.compiler.simd import aligned
from pliant.mechanics import mechanics_of
from pliant.model import Chamber, Model, Space
from pliant.simulation import Pulse, march_loops
from pliant.simulation.drive import drive

AZIMUTHS = np.radians([90.0, 210.0, 330.0])
TIMES, STEP, HELD = np.linspace(0.0, 2.0, 201), 1e-3, 20  # s, s, steps


def arm() -> Model:
    """Return five links in space with three chambers."""
    chambers = [Chamber([2e-6], joint_gain=np.sin(a), cross_gain=-np.cos(a), name=f"chamber_{k}")
                for k, a in enumerate(AZIMUTHS)]  # fmt: skip
    return Model(
        link_length=[0.04] * 5, link_mass=0.02, stiffness=0.5, damping=5e-3, rest_angle=0.0, gravity=[0.0, 0.0, -9.81],
        chambers=chambers, space=Space(radius=0.012), name="in_space",
    )


def steps_alone(model: Model, runs: int) -> tuple[float, float]:
    """Return the time [ns] of a step and body in a vector, and of one body alone."""
    plans = [drive(model, [Pulse(1e4 * k, 0.1, 1.0)] * 2 + [Pulse(2e4)], TIMES, STEP) for k in range(WIDTH)]
    chain, count = mechanics_of(model), plans[0].h.size
    march, alone = lane_twin(march_in_space, *chain.sizes), free_twin(march_loops.march, *chain.sizes)
    body, joints, work = lanes_last([chain.body] * WIDTH), lanes_last([chain.joints] * WIDTH), scratch_of(chain)
    shape, steps = (TIMES.size, model.size, WIDTH), shared_steps(plans, TIMES.size)
    best = [np.inf, np.inf]
    for k in range(10 * runs):
        state = stacked([np.zeros((2, model.size))] * WIDTH)
        out = LaneRows(aligned(shape), aligned(shape), np.full(WIDTH, -1))
        rows, (x, v) = march_loops.rows_for(TIMES.size, model.size, (model.n, 0), 3), np.zeros((2, model.size))
        start = process_time()
        march(state, steps, body, joints, work, out)
        middle = process_time()
        alone(x, v, plans[k % WIDTH].steps, chain.body, chain.joints, chain.workspace(), rows)
        times = (middle - start) / WIDTH, process_time() - middle
        best = [min(a, b) for a, b in zip(best, times, strict=True)]
    return 1e9 * best[0] / count, 1e9 * best[1] / count


def held_steps(model: Model, size: int, runs: int) -> list[float]:
    """Return the times [ns] of a step and body in a batch of `size` bodies that keep their states, in vectors and one
    by one.
    """
    pressure = np.random.default_rng(0).uniform(0.0, 5e4, (size, 3))
    jobs = [partial(kind([model], size, STEP).hold, pressure, HELD) for kind in (OnSpaceLanes, OneByOne)]
    return [1e9 * float(spent) / size / HELD for spent in in_turn(jobs, 3 * runs).min(axis=1)]


def rollouts(in_vectors: Callable[..., bool], **given: Any) -> None:
    """Compute the rollouts of a batch on one thread; `in_vectors` says which bodies are simulated in SIMD vectors."""
    with patch.object(batches, "fits_lanes", in_vectors):
        batches.simulate_batch(arm(), times=TIMES, time_step=STEP, threads=1, **given)


def main(samples: int, runs: int) -> None:
    """Print the times of steps and rollouts."""
    print(machine())
    vector, alone = steps_alone(arm(), runs)
    print(f"step, output rows included: {vector:.0f} ns in a vector, {alone:.0f} ns alone, ratio {alone / vector:.1f}")
    held, single = held_steps(arm(), 256, runs)
    print(f"held step: {held:.0f} ns in vectors, {single:.0f} ns one by one, ratio {single / held:.1f}")
    rng = np.random.default_rng(0)
    pulses = [[Pulse(p, 0.1, 1.0) for p in row] for row in rng.uniform(0.0, 5e4, (samples, 3))]
    stiffness = {"stiffness": rng.uniform(0.45, 0.55, samples)}
    cases = {"pulses": {"pressures": pulses}, "stiffness": {"pressures": pulses[0], "parameters": stiffness},
             "both": {"pressures": pulses, "parameters": stiffness}}  # fmt: skip
    for name, given in cases.items():
        jobs = [partial(rollouts, choice, **given) for choice in (batches.fits_lanes, lambda _: False)]
        vectors, single = 1e3 * in_turn(jobs, runs + 1).min(axis=1) / samples
        print(f"rollouts that differ in {name}: {vectors:.2f} ms in vectors, {single:.2f} ms one by one, ratio "
              f"{single / vectors:.1f}")  # fmt: skip


if __name__ == "__main__":
    main(**vars(parser_of(__doc__, samples=200, runs=3).parse_args()))
