"""Measure how often 95 % intervals contain the true values of a hyperelastic wall with J_m, by data and by a prior.

Usage: python benchmarks/wall_coverage.py [seeds, default 200]; odd seeds draw J_m from its prior, at levels that hardly
determine it.
"""

from __future__ import annotations

import sys
from collections import defaultdict

import numpy as np

from pliant.identification import Experiment, Parameter, fit
from pliant.model import Model, Station, Valve
from pliant.simulation import Pulse, simulate

BODY = Model(
    link_length=[0.05, 0.05], link_mass=0.02, stiffness=0.5, damping=0.004, torque=[1e-6], tip_mass=0.01,
    stations=[Station("tip", 1, 0.05)], valve=Valve(rise_time=0.03, fall_time=0.05),
)
LEVELS = {"data": (3e4, 6e4, 9e4), "prior": (2e4, 3.5e4, 4.5e4)}  # Pa; the limit is 50 kPa
ENTRY = {"data": Parameter("inflation_jm", 5.0), "prior": Parameter("inflation_jm", 20.0, prior=20.0, prior_std=4.0)}
TIME, STEP, NOISE = np.arange(0.0, 0.6, 0.01), 2e-3, 3e-4  # s, s, m


def held(seed: int) -> tuple[str, dict[str, bool]]:
    """Return which parameters' intervals contain the true value in one virtual experiment, and the source of J_m."""
    rng, kind = np.random.default_rng(seed), ("data", "prior")[seed % 2]
    bound = max(rng.normal(20.0, 4.0), 5.0) if kind == "prior" else rng.uniform(2.0, 6.0)
    true = {"inflation_limit": 5e4, "inflation_time": 0.03, "inflation_jm": bound}
    body, seen = BODY.with_(**true), []
    for level in LEVELS[kind]:
        tip = simulate(body, Pulse(level, 0.05, 0.4), times=TIME, time_step=STEP)["station_position"].values
        noisy = tip + rng.normal(0.0, NOISE, tip.shape)
        seen.append(Experiment(f"at_{level:.0f}", TIME, noisy, ("tip",), "pulse", level=level))
    edges = [Parameter(f"{e.name}.{k}", v, free=False) for e in seen for k, v in (("start", 0.05), ("stop", 0.45))]
    wall = [Parameter("inflation_limit", 6e4), Parameter("inflation_time", 0.05), ENTRY[kind]]
    result = fit(seen, BODY, ["torque_1", *wall, *edges], starts=1, time_step=STEP)
    truth = {**true, "torque_1": 1e-6}
    return kind, {p.name: bool(abs(p.value - truth[p.name]) <= 1.96 * p.std) for p in result.parameters
                  if p.free and p.value is not None and p.std is not None}  # fmt: skip


if __name__ == "__main__":
    counts: dict[tuple[str, str], list[bool]] = defaultdict(list)
    for number in range(int(sys.argv[1]) if len(sys.argv) > 1 else 200):
        rests_on, inside = held(number)
        for name, hit in inside.items():
            counts[rests_on, name].append(hit)
    for (rests_on, name), hits in sorted(counts.items()):
        print(f"{rests_on:6} {name:16} {100 * np.mean(hits):.0f} % of {len(hits)}")
