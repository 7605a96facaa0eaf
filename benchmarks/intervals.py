"""Measure how often 95 % intervals of a fit contain the true values: chambers, laws, and arms in space.

Bodies in a plane: each seed draws a chain of four links with two chambers, within 25 % of the middle; SciPy's LSODA
simulates three records, and two stations have noise of 0.3 mm, white or coloured (each frame keeps 0.8 of the previous
one). Laws: each seed draws the parameters of one law and of a body of two links; pliant simulates pulses at three
levels with a quarter of the step of the fit, because SciPy's solvers do not support most laws. Arms in space:
`intervals_in_space.py`. Every fit starts in the middle of the ranges.

The parameters of one fit are not independent, so the interval of the percentage over all parameters comes from the
scatter between seeds.

    python benchmarks/intervals.py --seeds 200 "two segments, white" "in space"
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial

import numpy as np
from harness import Case, in_standard_errors, measured

from pliant.errors import PliantError
from pliant.identification import Experiment, FitResult, Parameter, fit
from pliant.identification.parameters import apply
from pliant.model import Chamber, Extension, Model, Station
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


def errors(body: str, kept: float, seed: int) -> dict[str, float]:
    """Return errors of all parameters of one draw, in standard errors."""
    rng = np.random.default_rng([seed, 2])
    truth = {name: value * rng.uniform(0.75, 1.25) for name, value in MIDDLE.items()}
    seen = records(apply(chain(body), truth), kept, rng)
    return in_standard_errors(fit(seen, chain(body), list(MIDDLE), time_step=STEP, starts=1), truth)


Ranges = dict[str, tuple[float, float]]
BODY = Model(link_length=[0.05, 0.05], link_mass=0.02, stiffness=0.5, damping=0.004, torque=[1e-6], tip_mass=0.01,
             stations=[Station("mid", 0, 0.05), Station("tip", 1, 0.05)])  # fmt: skip
LONGER = BODY.with_(extensions=(Extension(stiffness=200.0, damping=2.0),))
FIT_STEP, BEGIN = 2e-3, 0.05  # s
FREE: Ranges = {"stiffness": (0.4, 0.6), "damping": (3e-3, 5e-3), "torque_1": (0.8e-6, 1.2e-6)}
LAG: Ranges = {"valve_rise_time": (0.02, 0.04), "valve_fall_time": (0.03, 0.06)}
AXIAL: Ranges = {**FREE, "axial_gain": (80.0, 120.0), "axial_damping": (1.5, 2.5)}


@dataclass(frozen=True)
class Law:
    """The laws of one virtual experiment: the ranges of its parameters, the body and the pulses."""

    ranges: Ranges
    body: Model = field(default_factory=lambda: BODY)
    levels: tuple[float, ...] = (3e4, 6e4, 9e4)  # Pa
    width: float = 0.4  # s
    every: float = 0.01  # s, between frames


LAWS = {
    "dead_band": Law({**FREE, "valve_dead_band": (1e3, 3e3), "valve_rise_rate": (2e5, 4e5),
                       "valve_fall_rate": (2e5, 4e5)}, levels=(1e4, 2e4, 4e4)),
    "opening": Law({**FREE, "valve_opening_time": (0.05, 0.15)}),
    "settling": Law({**FREE, **LAG, "valve_settle_share": (0.1, 0.3), "valve_settle_time": (0.3, 0.9)},
                     width=2.0, every=0.02),
    "lag": Law({**FREE, "torque_2": (0.8e-11, 1.2e-11), "swell_share": (0.2, 0.6), "swell_time": (0.3, 0.9)},
                width=2.0, every=0.02),
    "softening": Law({**FREE, "stiffening": (-2.0, -1.2), "stiffening_bound": (0.5, 0.8)}, levels=(5e4, 1e5, 1.5e5)),
    "wall": Law({**FREE, "inflation_limit": (4e4, 6e4), "inflation_time": (0.02, 0.04), "inflation_jm": (2.0, 6.0)}),
    "axial_softening": Law({**AXIAL, "axial_stiffening": (-2.5, -1.2)}, LONGER),
    "axial_creep": Law({**AXIAL, "axial_creep_share_1": (0.2, 0.6), "axial_creep_time_1": (0.3, 0.9)}, LONGER,
                        width=2.0, every=0.02),
    "axial_slip": Law({**AXIAL, "axial_slip_share_1": (0.2, 0.6), "axial_slip_strain_1": (3e-3, 1e-2)}, LONGER),
}  # fmt: skip


def pulsed(law: Law, truth: dict[str, float], rng: np.random.Generator) -> list[Experiment]:
    """Return the noisy records of a body under one pulse at each level."""
    body, records = apply(law.body, truth), []
    times = np.arange(0.0, 1.6 * law.width, law.every)
    for level in law.levels:
        motion = simulate(body, Pulse(level, BEGIN, law.width), times=times, time_step=FIT_STEP / 4)
        position = motion["station_position"].values
        noisy = position + rng.normal(0.0, NOISE, position.shape)
        records.append(Experiment(f"at_{level:.0f}", times, noisy, ("mid", "tip"), "pulse", level=level))
    return records


def fitted(law: Law, records: list[Experiment]) -> FitResult:
    """Return the fit of all parameters of a law and of the edges of its pulses."""
    parameters = [Parameter(name, (low + high) / 2) for name, (low, high) in law.ranges.items()]
    edges = (("start", BEGIN), ("stop", BEGIN + law.width))
    parameters += [Parameter(f"{r.name}.{edge}", value) for r in records for edge, value in edges]
    middle = {p.name: p.value for p in parameters if p.value is not None}
    return fit(records, apply(law.body, middle), parameters, starts=1, time_step=FIT_STEP)


def law_errors(law: Law, seed: int) -> dict[str, float]:
    """Return the error of every parameter whose standard error the fit states, in standard errors; {} without a fit."""
    rng = np.random.default_rng([seed, 5])
    truth = {name: rng.uniform(low, high) for name, (low, high) in law.ranges.items()}
    try:
        result = fitted(law, pulsed(law, truth, rng))
    except PliantError as error:
        print(f"  seed {seed}: {error}", flush=True)
        return {}
    return in_standard_errors(result, truth)


def in_space(seed: int, **how: bool) -> dict[str, float]:
    """Return the errors of an arm in space; MuJoCo is needed here alone."""
    import intervals_in_space

    return intervals_in_space.errors(seed, **how)


def coverage(errors_of: Callable[[int], dict[str, float]], seeds: int) -> dict[str, object]:
    """Return the percentages of intervals that contain the true value: of all parameters, and of the worst one."""
    rows = [row for seed in range(seeds) if (row := errors_of(seed))]
    each = np.array([np.mean([abs(z) < 1.96 for z in row.values()]) for row in rows])
    half = 1.96 * each.std(ddof=1) / np.sqrt(each.size) if each.size > 1 else np.nan
    inside = {name: np.mean([abs(row[name]) < 1.96 for row in rows if name in row]) for name in rows[0]}
    worst = min(inside, key=lambda name: inside[name])
    return {"fits": f"{len(rows)} of {seeds}", "all parameters, %": f"{100 * each.mean():.1f} ± {100 * half:.1f}",
            "lowest parameter, %": f"{100 * inside[worst]:.0f} ({worst})",
            "z, rms": float(np.sqrt(np.mean([z**2 for row in rows for z in row.values()])))}  # fmt: skip


SOURCES: dict[str, Callable[[int], dict[str, float]]] = {
    **{f"{body}, {kind}": partial(errors, body, kept) for body in BODIES for kind, kept in KEPT.items()},
    **{name: partial(law_errors, law) for name, law in LAWS.items()},
    "in space": in_space, "in space, twist": partial(in_space, twist=True),
    "in space, unstated": partial(in_space, stated=False),
}
if __name__ == "__main__":
    cases = [Case(name, partial(coverage, source)) for name, source in SOURCES.items()]
    measured(__doc__, {"intervals": cases}, seeds=100)
