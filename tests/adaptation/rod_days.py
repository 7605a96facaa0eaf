"""Days of elastic rods of the virtual laboratory, whose solver shares no code with the model, and the verdicts on them.

Each rod has two chambers, varying stiffness and gains, creep and friction; the model is a chain of three links. On each
day springs and losses differ by 2 %. But for "same", base, rest shape, cap and a common gain differ as well.
``python tests/adaptation/rod_days.py 200 6`` prints the table of docs/another_day.md, for 6 rods from seed 200 on.
"""

from __future__ import annotations

import sys
from collections import Counter
from dataclasses import replace

import numpy as np
from virtual_days import NAMES, NOISE, RATE, STEP

from pliant.adaptation import Adaptation, adapt_model, parts_of_day, posterior_of
from pliant.identification import Experiment, FitResult, Parameter, fit
from pliant.model import Chamber, Model, Station, chain_model
from pliant.simulation import Trace
from pliant.testbed.rod import ChamberParameters, RodParameters
from pliant.testbed.stepping import simulate

TOP, LEVER, LINKS, ROD_STEP = 1.5e5, 1.5708e-4 * 4.2441e-3, 3, 1e-3  # Pa, m3, -, s
PLACES = (0.4, 0.7, 1.0)  # of the stations, as fractions of the length
CASES = ("same", "re-mounted", "leak", "springs", "longer", "other")
STREAMS = (0, 1, 4, 2, 5, 6)  # of random numbers, by case
SIDES = ("left", "right")


def rod(seed: int) -> RodParameters:
    """A rod that each chamber bends by 0.7 to 1.1 rad at the highest pressure."""
    r = np.random.default_rng([seed, 4242])
    length, mass, stiffness = r.uniform(0.15, 0.22), r.uniform(0.05, 0.1), r.uniform(0.025, 0.05)
    gain = r.uniform(0.7, 1.1) / length * stiffness / (TOP * LEVER)
    drawn = {"stiffness_variation": r.uniform(0.05, 0.15), "rest_curvature": r.uniform(-0.5, 0.5),
             "rest_variation": r.uniform(0.2, 1.0), "gain_variation": r.uniform(0.05, 0.13),
             "locking": r.uniform(0.0, 0.3), "loss_time": r.uniform(0.004, 0.012), "slip_share": r.uniform(0.0, 0.08),
             "cap_mass": r.uniform(0.003, 0.01), "end_stiffening": r.uniform(0.0, 0.35)}  # fmt: skip
    chambers = (ChamberParameters(SIDES[0]), ChamberParameters(SIDES[1], gain=-r.uniform(0.8, 1.2)))
    return RodParameters(seed=seed, length=length, mass=mass, bending_stiffness=stiffness, gain=gain, elements=40,
                         correlation_length=0.2 * length, gain_slope=0.0, two_sided=True, tube_resistance=5e6,
                         prony_share=(0.04, 0.04, 0.05), prony_time=(0.05, 0.6, 8.0), cap_curvature=60.0,
                         gravity=(0.0, -9.81), chambers=chambers, **drawn)  # fmt: skip


def changed(body: RodParameters, case: str, seed: int) -> RodParameters:
    """The rod of the other day: one chamber leaks, all springs are 20 % stiffer or softer, the rod is 15 % longer or
    shorter, or it is another one.
    """
    more = (seed // 3) % 2 == 0
    if case == "springs":
        return replace(body, bending_stiffness=body.bending_stiffness * (1.2 if more else 1 / 1.2))
    if case == "leak":
        return replace(body, chambers=tuple(replace(c, gain=c.gain * (0.75 if k == seed % 2 else 1.0))
                                            for k, c in enumerate(body.chambers)))  # fmt: skip
    if case == "longer":
        factor = 1.15 if more else 1 / 1.15
        return replace(body, **{n: getattr(body, n) * factor for n in ("length", "mass", "correlation_length")})
    return rod(seed + 5000) if case == "other" else body


def recorded(name: str, body: RodParameters, rng: np.random.Generator, seconds: float, gain: float = 1.0,
             turn: float = 0.0, move: np.ndarray | None = None) -> Experiment:  # fmt: skip
    """A recording of three stations under random steps of both chambers, in a frame that is turned and moved."""
    edges, levels, now = [0.0], [np.zeros(2)], 0.2
    while now < seconds:
        edges += [now, now + 0.1]
        levels += [levels[-1], np.where(rng.random(2) < 0.25, 0.0, rng.uniform(0.2, 1.0, 2)) * TOP]
        now += rng.uniform(0.6, 1.6)
    times, inputs = np.array(edges), np.array(levels)
    loads = np.zeros((round(seconds / ROD_STEP), 5))
    for k in range(2):
        loads[:, k] = gain * np.interp(np.arange(len(loads)) * ROD_STEP, times, inputs[:, k])
    motion = simulate(body, loads, ROD_STEP, stride=10)
    frames = np.arange(0.0, seconds - 0.05, 1 / RATE)
    shape = motion.position[:, [round(f * body.elements) for f in PLACES]]
    rows = [[np.interp(frames, motion.time, shape[:, s, a]) for a in range(2)] for s in range(3)]
    position = np.array(rows).transpose(2, 0, 1)
    if move is not None:
        cos, sin = np.cos(turn), np.sin(turn)
        position = position @ np.array([[cos, -sin], [sin, cos]]).T + move
    position = position + NOISE * rng.standard_normal(position.shape)
    drives = {n: Trace(times, inputs[:, k]) for k, n in enumerate(SIDES)}
    return Experiment(name, frames, position, NAMES, "trace", drives=drives)


def start_of(body: RodParameters) -> Model:
    """The chain from which the fit starts."""
    link = body.length / LINKS
    stiffness, stations = body.bending_stiffness / link, []
    for name, fraction in zip(NAMES, PLACES, strict=True):
        k = int(np.floor(fraction * LINKS - 0.5))
        stations.append(Station(name, k, fraction * body.length - (k + 0.5) * link))
    inputs = tuple(Chamber(name=c.name, torque=[c.gain * LEVER * body.gain]) for c in body.chambers)
    return chain_model(length=body.length, mass=body.mass, links=LINKS, stiffness=stiffness, chambers=inputs,
                       damping=3 * stiffness * body.loss_time, gravity=[0.0, -9.81], stations=tuple(stations),
                       tip_mass=body.cap_mass, joint_placement="midsegment")  # fmt: skip


def identified(seed: int) -> tuple[FitResult, list[Experiment]]:
    """The model of the first day, from three recordings of 8 s."""
    body, rng = rod(seed), np.random.default_rng([seed, 1])
    exps = [recorded(f"r{k}", body, rng, 8.0) for k in range(3)]
    start = start_of(body)
    values = {"stiffness": float(start.stiffness.mean()), "damping": float(start.damping.mean()), "stiffening": 0.05,
              **{f"{c.name}.torque_1": float(c.torque[0]) for c in start.chambers}}  # fmt: skip
    order = ("stiffness", "damping", *(f"{n}.torque_1" for n in SIDES), "stiffening")
    rest = [Parameter(f"rest_angle_{k + 1}", 0.0, prior=0.0, prior_std=0.3) for k in range(LINKS)]
    listed = [*(Parameter(n, values[n]) for n in order), *rest]
    return fit(exps, start, listed, time_step=STEP, starts=1, max_evaluations=80, tolerance=1e-5), exps


def other_day(case: str, seed: int) -> Experiment:
    """A recording of 14 s of the other day."""
    rng = np.random.default_rng([seed, STREAMS[CASES.index(case)], 3])
    body = changed(rod(seed), case, seed)
    if case != "other":
        body = replace(body, bending_stiffness=body.bending_stiffness * (1 + 0.015 * rng.standard_normal()),
                       loss_time=body.loss_time * (1 + 0.02 * rng.standard_normal()))  # fmt: skip
    if case == "same":
        return recorded("day", body, rng, 14.0)
    turn, move = 0.06 * rng.standard_normal(), 0.005 * rng.standard_normal(2)
    gain = float(np.exp(0.04 * rng.standard_normal()))
    body = replace(body, rest_curvature=body.rest_curvature + 0.1 / body.length * rng.standard_normal(),
                   cap_mass=body.cap_mass * float(np.exp(0.2 * rng.standard_normal())))  # fmt: skip
    return recorded("day", body, rng, 14.0, gain, turn, move)


def verdicts(seed: int, cases: tuple[str, ...] = CASES) -> dict[str, Adaptation]:
    """The verdicts on days of one rod, by case."""
    old, exps = identified(seed)
    posterior = posterior_of(old, {e.name for e in exps})
    return {case: adapt_model(old, posterior, parts_of_day([other_day(case, seed)], 10.0), earlier=lambda: exps)
            for case in cases}  # fmt: skip


if __name__ == "__main__":
    table: Counter[tuple[str, str]] = Counter()
    for number in range(int(sys.argv[1]), int(sys.argv[1]) + int(sys.argv[2])):
        for kind, day in verdicts(number).items():
            table[kind, day.verdict] += 1
            print(number, kind, "->", day.sentence, flush=True)
    for (kind, verdict), count in sorted(table.items()):
        print(f"{kind:12} {verdict:14} {count}")
