"""Measure how often the 95 % intervals of a fit contain the true values, for random bodies with two chambers.

Each seed draws a chain of four links (stiffness, damping, gains and valves, each within 25 % of its middle). SciPy's
LSODA simulates three records: each chamber alone, and both. Two stations are measured with noise of 0.3 mm, white or
coloured (each frame keeps 0.8 of the previous one). The fit starts in the middle of the ranges and integrates in steps
of 1 ms. The percentage of each parameter has a 95 % interval (Clopper and Pearson). Parameters of one fit are not
independent, so the interval of the percentage over all parameters comes from the scatter between seeds.

Usage: python benchmarks/intervals.py [seeds]
"""

from __future__ import annotations

import sys
from collections.abc import Sequence

import numpy as np
from scipy.stats import binomtest

from pliant.identification import Experiment, fit
from pliant.identification.parameters import apply
from pliant.model import Chamber, Model, Station
from pliant.simulation import Pulse, Trace, simulate

LINKS, HALF = 4, np.array([1.0, 1.0, 0.0, 0.0])
BODIES = {"two segments": (HALF, 1.0 - HALF), "two sides": (np.ones(LINKS), -np.ones(LINKS))}
TIMES = np.arange(0.0, 1.2, 0.01)  # s
KNOTS = np.array([0.1, 0.2, 0.55, 0.65, 0.9])  # s, of the pressures
RECORDS = {
    "first_alone": {"first": (0.0, 9e4, 9e4, 0.0, 0.0)},
    "second_alone": {"second": (0.0, 1e5, 1e5, 0.0, 0.0)},
    "both": {"first": (0.0, 8e4, 8e4, 2e4, 0.0), "second": (0.0, 0.0, 9e4, 9e4, 0.0)},
}  # Pa
MIDDLE = {"stiffness": 1.2, "damping": 6e-3, "first.torque_1": 1.2e-6, "second.torque_1": 1.0e-6,
          "first.valve_rise_time": 0.03, "second.valve_rise_time": 0.05, "first.valve_fall_time": 0.05,
          "second.valve_fall_time": 0.02}  # fmt: skip
NOISE, KEPT, STEP = 3e-4, {"white": 0.0, "coloured": 0.8}, 1e-3  # m, share of the frame before, s


def chain(body: str) -> Model:
    """Return the body with every parameter in the middle of its range."""
    chambers = tuple(Chamber(torque=[1e-6], joint_gain=gain, name=name)
                     for name, gain in zip(("first", "second"), BODIES[body], strict=True))  # fmt: skip
    model = Model(link_length=[0.0425] * LINKS, link_mass=[0.017] * LINKS, stiffness=1.0, damping=1e-3,
                  chambers=chambers, stations=(Station("mid", 1, 0.0425), Station("tip", 3, 0.0425)))  # fmt: skip
    return apply(model, MIDDLE)


def coloured(rng: np.random.Generator, shape: tuple[int, ...], kept: float) -> np.ndarray:
    """Return first-order noise of unit standard deviation; each frame keeps a fraction of the previous one."""
    noise = rng.standard_normal(shape)
    for k in range(1, shape[0]):
        noise[k] = kept * noise[k - 1] + np.sqrt(1.0 - kept**2) * noise[k]
    return noise


def records(model: Model, kept: float, rng: np.random.Generator) -> list[Experiment]:
    """Return the three records of a body, simulated by LSODA, with noise."""
    made = []
    for name, levels in RECORDS.items():
        drives = {c: Trace(KNOTS, np.array(p)) for c, p in levels.items()}
        inputs = [drives.get(c.name, Pulse(0.0)) for c in model.chambers]
        seen = simulate(model, inputs, times=TIMES, method="LSODA", rtol=1e-9)["station_position"].values
        seen = seen + NOISE * coloured(rng, seen.shape, kept)
        made.append(Experiment(name, TIMES, seen, ("mid", "tip"), "trace", drives=drives))
    return made


def errors(body: str, kept: float, seed: int) -> np.ndarray:
    """Return errors of all parameters (P,) of one draw, in standard errors."""
    rng = np.random.default_rng([seed, 2])
    truth = {name: value * rng.uniform(0.75, 1.25) for name, value in MIDDLE.items()}
    seen = records(apply(chain(body), truth), kept, rng)
    found = fit(seen, chain(body), list(MIDDLE), time_step=STEP, starts=1)
    std = {p.name: p.std for p in found.parameters}
    return np.array([(found.values[name] - truth[name]) / std[name] for name in MIDDLE])


def share(held: np.ndarray) -> str:
    """Return a fraction with its 95 % interval."""
    low, high = binomtest(int(held.sum()), held.size).proportion_ci()
    return f"{100 * held.mean():5.1f} ({100 * low:.1f} to {100 * high:.1f})"


def print_coverage(title: str, names: Sequence[str], z: np.ndarray) -> None:
    """Print the coverage of all parameters and of each, % of the fits; z (fits, P) are errors in standard errors."""
    held = np.abs(z) < 1.96
    each = held.mean(axis=1)
    half = 1.96 * each.std(ddof=1) / np.sqrt(len(z))
    print(f"{title}: all parameters {100 * each.mean():.1f} +- {100 * half:.1f} %, z rms {np.sqrt(np.mean(z**2)):.2f}")
    for name, column, off in zip(names, held.T, z.T, strict=True):
        print(f"  {name:<18} {share(column)} %, mean z {off.mean():+.2f}", flush=True)


def main(seeds: int) -> None:
    """Print the coverage of each body under each kind of noise."""
    for body in BODIES:
        for kind, kept in KEPT.items():
            z = np.array([errors(body, kept, seed) for seed in range(seeds)])
            print_coverage(f"{body}, {kind} noise, {seeds} seeds", list(MIDDLE), z)


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 200)
