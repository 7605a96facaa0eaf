"""Measure how often 95 % intervals contain the true values of the laws of regulators, lags, springs and segments.

Each seed draws the parameters of one case from their ranges, and simulates pulses at three levels with a quarter of the
step of the fit. Tip and middle are measured with white noise of 0.3 mm. A fit that starts in the middle of the ranges
estimates these parameters and the edges of the pulses. SciPy's solvers do not support most of these laws, so that
pliant simulates too: the percentages judge the intervals, not the laws. They count the parameters whose standard error
the fit states, and have 95 % intervals (Clopper and Pearson).

Usage: python benchmarks/intervals_laws.py [seeds, default 100] [cases, default all]
"""

from __future__ import annotations

import sys
from dataclasses import dataclass, field

import numpy as np
from intervals import share

from pliant.errors import PliantError
from pliant.identification import Experiment, FitResult, Parameter, fit
from pliant.identification.parameters import apply
from pliant.model import Extension, Model, Station
from pliant.simulation import Pulse, simulate

Ranges = dict[str, tuple[float, float]]
BODY = Model(link_length=[0.05, 0.05], link_mass=0.02, stiffness=0.5, damping=0.004, torque=[1e-6], tip_mass=0.01,
             stations=[Station("mid", 0, 0.05), Station("tip", 1, 0.05)])  # fmt: skip
LONGER = BODY.with_(extensions=(Extension(stiffness=200.0, damping=2.0),))
NOISE, STEP, BEGIN = 3e-4, 2e-3, 0.05  # m, s, s
FREE: Ranges = {"stiffness": (0.4, 0.6), "damping": (3e-3, 5e-3), "torque_1": (0.8e-6, 1.2e-6)}
LAG: Ranges = {"valve_rise_time": (0.02, 0.04), "valve_fall_time": (0.03, 0.06)}
AXIAL: Ranges = {**FREE, "axial_gain": (80.0, 120.0), "axial_damping": (1.5, 2.5)}


@dataclass(frozen=True)
class Case:
    """The laws of one virtual experiment: the ranges of its parameters, the body and the pulses."""

    ranges: Ranges
    body: Model = field(default_factory=lambda: BODY)
    levels: tuple[float, ...] = (3e4, 6e4, 9e4)  # Pa
    width: float = 0.4  # s
    every: float = 0.01  # s, between frames


CASES = {
    "dead_band": Case({**FREE, "valve_dead_band": (1e3, 3e3), "valve_rise_rate": (2e5, 4e5),
                       "valve_fall_rate": (2e5, 4e5)}, levels=(1e4, 2e4, 4e4)),
    "opening": Case({**FREE, "valve_opening_time": (0.05, 0.15)}),
    "settling": Case({**FREE, **LAG, "valve_settle_share": (0.1, 0.3), "valve_settle_time": (0.3, 0.9)},
                     width=2.0, every=0.02),
    "lag": Case({**FREE, "torque_2": (0.8e-11, 1.2e-11), "swell_share": (0.2, 0.6), "swell_time": (0.3, 0.9)},
                width=2.0, every=0.02),
    "softening": Case({**FREE, "stiffening": (-2.0, -1.2), "stiffening_bound": (0.5, 0.8)}, levels=(5e4, 1e5, 1.5e5)),
    "axial_softening": Case({**AXIAL, "axial_stiffening": (-2.5, -1.2)}, LONGER),
    "axial_creep": Case({**AXIAL, "axial_creep_share_1": (0.2, 0.6), "axial_creep_time_1": (0.3, 0.9)}, LONGER,
                        width=2.0, every=0.02),
    "axial_slip": Case({**AXIAL, "axial_slip_share_1": (0.2, 0.6), "axial_slip_strain_1": (3e-3, 1e-2)}, LONGER),
}  # fmt: skip


def recorded(case: Case, truth: dict[str, float], rng: np.random.Generator) -> list[Experiment]:
    """Return the noisy records of a body under one pulse at each level."""
    body, records = apply(case.body, truth), []
    times = np.arange(0.0, 1.6 * case.width, case.every)
    for level in case.levels:
        motion = simulate(body, Pulse(level, BEGIN, case.width), times=times, time_step=STEP / 4)
        position = motion["station_position"].values
        noisy = position + rng.normal(0.0, NOISE, position.shape)
        records.append(Experiment(f"at_{level:.0f}", times, noisy, ("mid", "tip"), "pulse", level=level))
    return records


def fitted(case: Case, records: list[Experiment]) -> FitResult:
    """Return the fit of all parameters of a case and of the edges of its pulses."""
    parameters = [Parameter(name, (low + high) / 2) for name, (low, high) in case.ranges.items()]
    edges = (("start", BEGIN), ("stop", BEGIN + case.width))
    parameters += [Parameter(f"{r.name}.{edge}", value) for r in records for edge, value in edges]
    middle = {p.name: p.value for p in parameters if p.value is not None}
    return fit(records, apply(case.body, middle), parameters, starts=1, time_step=STEP)


def errors(case: Case, seed: int) -> dict[str, float]:
    """Return the error of every parameter whose standard error the fit states, in standard errors; {} without a fit."""
    rng = np.random.default_rng([seed, 5])
    truth = {name: rng.uniform(low, high) for name, (low, high) in case.ranges.items()}
    try:
        result = fitted(case, recorded(case, truth, rng))
    except PliantError as error:
        print(f"  seed {seed}: {error}", flush=True)
        return {}
    return {p.name: (p.value - truth[p.name]) / p.std for p in result.parameters
            if p.name in truth and p.value is not None and p.std}  # fmt: skip


def main(seeds: int, names: list[str]) -> None:
    """Print the coverage of each parameter of each case."""
    for name in names or CASES:
        found = [errors(CASES[name], seed) for seed in range(seeds)]
        print(f"{name}: {sum(map(bool, found))} fits of {seeds}")
        for parameter in CASES[name].ranges:
            z = np.array([one[parameter] for one in found if parameter in one])
            if z.size:
                print(f"  {parameter:<20} {share(np.abs(z) < 1.96)} % of {z.size}, mean z {z.mean():+.2f}", flush=True)


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 100, sys.argv[2:])
