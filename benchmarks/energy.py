"""Count motions of random models whose error `simulate` does not report, by time step.

Chains of one to five links, of fixed length and lengthening, are released from small and large bends or driven by a
pulse of pressure for half a second; many have no damping. `simulate` reports a motion by a warning (`AccuracyWarning`,
`EnergyWarning`). A motion is wrong if its tip is off by more than 1 % of the length. The reference is
`method="accurate"`. Every twentieth reference is compared with LSODA, which shares only the equation of motion.

Usage: python benchmarks/energy.py [N] [STEPS...] [--seed S]; a step is `default` or a number of milliseconds.
"""

from __future__ import annotations

import argparse
import warnings
from collections import Counter
from itertools import pairwise
from typing import NamedTuple

import numpy as np

import pliant
from pliant.errors import PliantError
from pliant.model import Extension, Model
from pliant.simulation import state
from pliant.simulation.balance import EnergyWarning
from pliant.simulation.inputs import Input
from pliant.simulation.state import typical_pressure
from pliant.simulation.time_step import AccuracyWarning

DURATION, EVERY, WRONG = 0.5, 1e-3, 0.01  # s, s, of the length
BENT = {"small": 0.15, "large": 0.7}  # rad, of each joint at the start
KINDS, STARTS = ("fixed", "lengthening"), ("small", "large", "pulse")


class Motion(NamedTuple):
    """A random motion."""

    model: Model
    pressure: Input
    start: np.ndarray | None  # joint coordinates, rad; none: at rest
    kind: str
    how: str


def random_model(rng: np.random.Generator, kind: str) -> Model:
    """Return a chain whose masses and stiffnesses range over two decades and more."""
    n = int(rng.integers(1, 6))
    length = rng.uniform(0.01, 0.08, n)
    springs = ()
    if kind == "lengthening":
        edges = np.linspace(0.0, length.sum(), int(rng.integers(2, 4)))
        damping = float(rng.choice([0.0, 0.0, 0.1, 1.0]))
        springs = tuple(
            Extension(float(10 ** rng.uniform(1.5, 3.5)), damping, float(a), float(b), f"s{k}")
            for k, (a, b) in enumerate(pairwise(edges))
        )
    return Model(
        link_length=length, link_mass=10 ** rng.uniform(-3, 0, n), stiffness=10 ** rng.uniform(-1, 1, n),
        damping=float(rng.choice([0.0, 0.0, 1e-4, 1e-2])), torque=[1e-6], tip_mass=float(10 ** rng.uniform(-3, 0.3)),
        gravity=[0.0, float(rng.choice([0.0, 9.81]))], extensions=springs,
    )


def random_motion(rng: np.random.Generator, number: int) -> Motion | None:
    """Return the random motion with a given number; None if the chain has no equilibrium."""
    kind, how = KINDS[number % 2], STARTS[number // 2 % 3]
    try:
        model = random_model(rng, kind)
        q = state.equilibrium(model)
        if how == "pulse":
            level = typical_pressure(model) * float(rng.uniform(0.2, 2.0))
            return Motion(model, pliant.Pulse(level, 0.05, 0.2), None, kind, how) if level else None
        bend = np.append(rng.uniform(-BENT[how], BENT[how], model.n), np.zeros(model.size - model.n))
        return Motion(model, pliant.Step(0.0), q + bend, kind, how)
    except PliantError:
        return None


def tips(motion: Motion, **how) -> tuple[np.ndarray, np.ndarray]:
    """Return times (T,) [s] and tip positions (T, 2) relative to the length."""
    made = pliant.simulate(motion.model, motion.pressure, initial_angle=motion.start, **how)
    return made.time.values, made.tip_position.values[:, -1] / motion.model.length


def reference(motion: Motion) -> np.ndarray | None:
    """Return tips (T, 2) every millisecond, accurate to a thousandth of the length; None if not computable."""
    try:
        return tips(motion, duration=DURATION, method="accurate", tolerance=1e-3)[1]
    except PliantError:
        return None


def judged(motion: Motion, truth: np.ndarray, step: float | None) -> tuple[str, float]:
    """Return the outcome of the motion at a step [s], and its error relative to the length."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            time, tip = tips(motion, duration=DURATION, time_step=step)
        except PliantError:
            return "refused", np.nan
    rows = np.flatnonzero(np.abs(time / EVERY - np.round(time / EVERY)) < 1e-6)
    same = np.round(time[rows] / EVERY).astype(int)
    error = float(np.linalg.norm(tip[rows] - truth[same], axis=1).max())
    by = {w.category for w in caught} & {AccuracyWarning, EnergyWarning}
    told = "not reported" if not by else "reported, accuracy" if AccuracyWarning in by else "reported, energy alone"
    return f"{'wrong' if error > WRONG else 'right'}, {told}", error


def independent(motion: Motion, truth: np.ndarray) -> float:
    """Return the largest difference of a reference from LSODA over the first tenth, relative to the length."""
    times = np.arange(101) * EVERY
    return float(np.linalg.norm(tips(motion, times=times, method="LSODA", rtol=1e-9)[1] - truth[:101], axis=1).max())


def main() -> None:
    """Print the table of each step."""
    asked = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    asked.add_argument("number", nargs="?", type=int, default=200)
    asked.add_argument("steps", nargs="*", default=["default", "1"])
    asked.add_argument("--seed", type=int, default=1)
    given = asked.parse_args()
    rng = np.random.default_rng(given.seed)
    counts: dict[str, Counter] = {name: Counter() for name in given.steps}
    missed: dict[str, list[tuple[float, int, str]]] = {name: [] for name in given.steps}
    motions = unknown = 0
    apart = [0.0]
    for number in range(given.number):
        motion = random_motion(rng, number)
        if motion is None:
            continue
        motions += 1
        truth = reference(motion)
        if truth is None:
            unknown += 1
            continue
        if number % 20 == 0:
            apart.append(independent(motion, truth))
        for name in given.steps:
            outcome, error = judged(motion, truth, None if name == "default" else 1e-3 * float(name))
            counts[name][outcome] += 1
            if outcome == "wrong, not reported":
                missed[name].append((error, number, f"{motion.kind}, {motion.how}"))
    print(f"seed {given.seed}: {motions} motions, {unknown} without a reference; references and LSODA differ by at "
          f"most {100 * max(apart):.2g} % of the length in {len(apart) - 1} motions")  # fmt: skip
    for name, outcomes in counts.items():
        print(f"step {name}{'' if name == 'default' else ' ms'}")
        for outcome in sorted(outcomes):
            print(f"  {outcome:<32} {outcomes[outcome]}")
        for error, number, what in sorted(missed[name], reverse=True)[:5]:
            print(f"    missed: {100 * error:.3g} % of the length, motion {number} ({what})")


if __name__ == "__main__":
    main()
