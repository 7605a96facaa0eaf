"""Measure how often the truth of unknown bodies lies where fits state it: parameters within two standard errors of
their fitted values, and recordings within their 95 % bands where inputs differ from those of training.

    python benchmarks/strangers.py parameters --first 100 --seeds 20 --kind three
    python benchmarks/strangers.py bands --first 300 --seeds 12

Each seed draws a rod of the virtual laboratory: another discretisation and another solver than the chain that is
fitted to it. The rod has what the chain lacks: friction, a lever that grows with the bend, a base that is turned and
moved, a pressure that arrives later than it is measured, and coloured noise. Even seeds have one chamber, odd seeds one
in each half of the body, of which the second is late. Training recordings (`--kind`): "three" of pulses, 2.5 s each;
"single", the last of these alone; "random", one of random steps of 12 s. A parameter is determined if its standard
error is at most half of its value. Rows of bands state the fractions of the working pressure in the recording that is
predicted; `CASES` has those of training.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from harness import parser_of

from pliant.errors import PliantError
from pliant.identification import Experiment, Parameter, fit, predict_held_out
from pliant.identification.prediction_bands import TrainingResiduals
from pliant.model import Chamber, Model, Station, chain_model
from pliant.selection.criterion import DETERMINED
from pliant.simulation import Trace
from pliant.testbed.rod import ChamberParameters, RodParameters
from pliant.testbed.stepping import simulate

LINKS, ELEMENTS = 6, 24
RATE, STEP = 40.0, 5e-4  # Hz, s of the rod
DURATION = {"three": 2.5, "single": 2.5, "random": 12.0}  # s, by kind
EDGES = np.array([[0.2, 1.0], [1.4, -1.0]])  # s and change of the pressure over its level: a pulse
PLACES = (0.45, 0.75, 1.0)  # of the length: stations
ONE = {"low": (0.5,), "middle": (0.75,), "high": (1.0,)}  # of the working pressure, for each recording and chamber
TWO = {"first": (1.0, 0.0), "second": (0.0, 1.0), "both": (0.7, 0.8)}
NAMES = ("near", "far")
Levels = tuple[float, ...]


class Case(NamedTuple):
    """Levels of one or two chambers in recordings of training, and in those that are predicted."""

    train: tuple[Levels, ...]
    held_out: tuple[Levels, ...]


CASES = {
    "one chamber": Case(((0.33,), (1.0,)), ((0.15,), (0.66,), (1.3,), (2.0,))),
    "one at a time": Case(((1.0, 0.0), (0.0, 1.0)), ((0.7, 0.8), (1.4, 0.0), (1.4, 1.2))),
    "two levels of each": Case(((0.5, 0.0), (1.0, 0.0), (0.0, 0.5), (0.0, 1.0)), ((0.7, 0.8), (1.4, 0.0), (1.0, 1.0))),
    "smaller motions": Case(((1.0, 0.0), (0.0, 1.0), (0.7, 0.8)), ((0.2, 0.0), (0.0, 0.3), (0.2, 0.1))),
    "one hardly moves": Case(((1.0, 0.0), (0.7, 0.1)), ((0.0, 0.6), (0.7, 0.8))),
}


def drawn(seed: int) -> tuple[RodParameters, dict[str, Any]]:
    """Return the rod of a seed, and what else differs: working pressure, lag and delay of the pressure, base, noise."""
    rng = np.random.default_rng([seed, 51])
    length, mass = rng.uniform(0.12, 0.25), rng.uniform(0.04, 0.12)
    frequency, bend, damping = rng.uniform(2.5, 6.0), rng.uniform(0.9, 1.6), rng.uniform(0.05, 0.2)
    stiffness = mass / length * (2.0 * np.pi * frequency * length**2 / 1.875**2) ** 2  # of a clamped beam
    two = bool(seed % 2)
    chambers = tuple(ChamberParameters(n, 0.5 * k, 0.5 * k + 0.5) for k, n in enumerate(NAMES)) if two else (
        ChamberParameters(),)  # fmt: skip
    rod = RodParameters(elements=ELEMENTS, seed=seed).uniform(
        length=length, mass=mass, bending_stiffness=stiffness, chambers=chambers, gain=rng.uniform(1.0, 2.0),
        loss_time=2.0 * damping / (2.0 * np.pi * frequency), gain_slope=rng.uniform(0.0, 0.05) * length / bend,
        slip_share=rng.uniform(0.0, 0.1), slip_elements=15, slip_scale=rng.uniform(0.05, 0.3) * bend / length,
    )  # fmt: skip
    lever = rod.gain * rod.chamber_area * rod.chamber_height
    more = {"pressure": bend * stiffness / (length * lever), "lag": rng.uniform(0.02, 0.08),
            "late": rng.uniform(0.0, 0.03) + np.array([0.0, rng.uniform(0.02, 0.06)]),
            "turn": rng.normal() * 0.02, "shift": rng.normal(size=2) * 0.005 * length,
            "noise": rng.uniform(2e-4, 1e-3) * length}  # fmt: skip
    return rod, more


def truth(rod: RodParameters) -> dict[str, float]:
    """Return the parameters of a chain with the rod's stiffness, damping and gain. A body with one chamber, recorded at
    three pressures, is fitted with a curvature of the torque law too, which the rod does not have: 0.
    """
    stiffness = LINKS * rod.bending_stiffness / rod.length
    lever = rod.gain * rod.chamber_area * rod.chamber_height
    owners = [f"{c.name}." for c in rod.chambers] if len(rod.chambers) > 1 else [""]
    curved = {} if len(rod.chambers) > 1 else {"torque_2": 0.0}
    return {"stiffness": stiffness, "damping": rod.loss_time * stiffness, **{f"{o}torque_1": lever for o in owners},
            **curved}  # fmt: skip


def course(edges: np.ndarray, lag: float, late: float, time: np.ndarray) -> np.ndarray:
    """Return the pressure behind a first-order lag, from its steps `edges` (E, 2) [s, Pa]."""
    late_by = np.clip(time[:, None] - edges[:, 0] - late, 0.0, None)
    return np.asarray(-np.expm1(-late_by / lag) @ edges[:, 1])


def random_edges(rng: np.random.Generator) -> np.ndarray:
    """Return random steps (13, 2) [s, fraction of the working pressure], of which each fourth ends at 0."""
    level = np.append(rng.uniform(0.0, 1.0, 12), 0.0)
    level[::4] = 0.0
    return np.stack([0.2 + np.cumsum(rng.uniform(0.5, 1.3, 13)), np.diff(level, prepend=0.0)], axis=1)


def commands(seed: int, kind: str, chambers: int) -> dict[str, list[np.ndarray]]:
    """Return the steps (E, 2) of the pressure of each chamber by recording, in fractions of the working pressure."""
    if kind == "random":
        rng = np.random.default_rng([seed, 53])
        return {"random": [random_edges(rng) for _ in range(chambers)]}
    three = pulses(TWO if chambers > 1 else ONE)
    return three if kind == "three" else dict(list(three.items())[-1:])


def pulses(levels: Mapping[str, Levels]) -> dict[str, list[np.ndarray]]:
    """Return the steps of pulses, as `commands` does, from the levels of the chambers by recording."""
    return {name: [EDGES * [1.0, level] for level in row] for name, row in levels.items()}


def chain(rod: RodParameters) -> Model:
    """Return the chain of a rod before it is fitted: its length and mass, and values of the right size."""
    segment, count = rod.length / LINKS, len(rod.chambers)
    places = [s * rod.length - 0.5 * segment for s in PLACES]
    links = [min(int(s / segment), LINKS - 1) for s in places]
    stations = tuple(Station(f"at_{100 * p:.0f}", k, s - k * segment)
                     for p, k, s in zip(PLACES, links, places, strict=True))  # fmt: skip
    half = np.arange(LINKS) < LINKS // 2
    chambers = tuple(Chamber(torque=[1e-6], joint_gain=np.where(half == (k == 0), 1.0, 0.0), name=n)
                     for k, n in enumerate(NAMES)) if count > 1 else ()  # fmt: skip
    laws: dict[str, Any] = {"chambers": chambers} if chambers else {"torque": [1e-6]}
    return chain_model(length=rod.length, mass=rod.mass, links=LINKS, joint_placement="midsegment", stiffness=1.0,
                       damping=0.02, stations=stations, **laws)  # fmt: skip


def recorded(
    seed: int, inputs: Mapping[str, Sequence[np.ndarray]], duration: float,
) -> tuple[RodParameters, list[Experiment]]:
    """Return the rod of a seed and its recordings [`duration` s], from the steps (E, 2) of each chamber by recording,
    in fractions of the working pressure.
    """
    rod, more = drawn(seed)
    rng = np.random.default_rng([seed, 52])
    names = tuple(s.name for s in chain(rod).stations)
    nodes = [round(p * rod.elements) for p in PLACES]
    fine = np.arange(1, round(duration / STEP) + 1) * STEP
    c, s = np.cos(more["turn"]), np.sin(more["turn"])
    experiments = []
    for name, steps in inputs.items():
        edges = [e * [1.0, more["pressure"]] for e in steps]
        loads = np.zeros((fine.size, len(rod.chambers) + 3))
        for k, e in enumerate(edges):
            loads[:, k] = course(e, more["lag"], more["late"][k], fine)
        motion = simulate(rod, loads, STEP, stride=round(1.0 / (RATE * STEP)))
        position = motion.position[:, nodes] @ np.array([[c, s], [-s, c]]) + more["shift"]
        noise = rng.standard_normal(position.shape)
        for k in range(1, len(noise)):
            noise[k] = 0.6 * noise[k - 1] + 0.8 * noise[k]
        seen = [Trace(motion.time, course(e, more["lag"], 0.0, motion.time)) for e in edges]
        drives = dict(zip(NAMES, seen, strict=True)) if len(seen) > 1 else {}
        experiments.append(Experiment(name, motion.time, position + more["noise"] * noise, names, "trace",
                                      max(seen, key=lambda t: t.peak), drives=drives))  # fmt: skip
    return rod, experiments


def errors_of(seed: int, kind: str) -> dict[str, Any]:
    """Return the errors of the parameters of one seed in standard errors and relative to the truth, and the standard
    errors relative to the values (P,).
    """
    rod, train = recorded(seed, commands(seed, kind, len(drawn(seed)[0].chambers)), DURATION[kind])
    true = {n: v for n, v in truth(rod).items() if n != "torque_2" or kind == "three"}  # one level, no curvature
    result = fit(train, chain(rod), [Parameter(n) for n in true], starts=1)
    assert result.covariance is not None
    scatter = dict(zip(result.covariance.names, result.covariance.std, strict=True))
    free = [p for p in result.parameters if p.free]
    off = np.array([float(p.value or 0.0) - true[p.name] for p in free])
    std, scattered = (np.array([s or np.nan for s in some]) for some in (
        [p.std for p in free], [scatter[p.name] for p in free]))  # fmt: skip
    value, truths = np.array([float(p.value or 0.0) for p in free]), np.array([true[p.name] for p in free])
    return {"off": off / std, "scattered": off / scattered, "size": std / np.abs(value),
            "relative": off / np.where(truths, truths, np.nan)}  # fmt: skip


def summary(kept: list[dict[str, Any]], bodies: int) -> str:
    """Return the fraction of determined parameters whose truth lies within two standard errors, and their errors, of
    those of `bodies` that were not refused.
    """
    off, size, relative, scattered = (np.concatenate([body[name] for body in kept])
                                      for name in ("off", "size", "relative", "scattered"))  # fmt: skip
    determined = np.isfinite(off) & (size <= DETERMINED)
    z, relative = np.abs(off[determined]), relative[determined]
    within, scattered = np.mean(z <= 2.0), np.mean(np.abs(scattered[determined]) <= 2.0)
    return (f"{bodies} bodies, {bodies - len(kept)} refused; {z.size} of {np.isfinite(off).sum()} "
            f"parameters determined; truth within 2 standard errors of {100 * within:.0f} % of these "
            f"({100 * scattered:.0f} % without errors of the model's form); distance median {np.median(z):.2g}, nine "
            f"in ten below {np.quantile(z, 0.9):.2g}, worst {z.max():.3g} standard errors; median error "
            f"{100 * np.nanmedian(np.abs(relative)):.1f} %, median standard error "
            f"{100 * np.median(size[determined]):.1f} %")  # fmt: skip


def coverage(seed: int, case: Case) -> list[float]:
    """Return the part [%] of each predicted recording within its band."""
    levels = (*case.train, *case.held_out)
    rod, experiments = recorded(seed, pulses({f"r{k}": row for k, row in enumerate(levels)}), DURATION["three"])
    assert len(rod.chambers) == len(case.train[0])
    recordings = dict(zip(levels, experiments, strict=True))
    train = [recordings[row] for row in case.train]
    result = fit(train, chain(rod), [Parameter(n) for n in truth(rod)], starts=1)
    left, parts = TrainingResiduals.of(train, result), []
    for row in case.held_out:
        exp = recordings[row]
        predicted, refit = predict_held_out(exp, result)
        band = left.band(exp, result, predicted["compared"], refit)
        parts.append(100.0 * band.holds(exp.compared))
    return parts


def computed(seeds: Sequence[int], of_seed: Callable[[int], Any]) -> Iterator[Any]:
    """Yield what a function computes for each seed whose fit is not refused."""
    for seed in seeds:
        try:
            yield of_seed(seed)
        except PliantError as error:
            print(f"seed {seed}: {error}")


def bands(first: int, bodies: int, names: Sequence[str]) -> None:
    """Print the coverage of each case."""
    for name in names:
        even = first + first % 2  # seeds of bodies with one chamber
        odd = name != "one chamber"
        seeds = range(even + odd, even + 2 * bodies, 2)
        every = np.array([*computed(seeds, partial(coverage, case=CASES[name]))])
        for row, parts in zip(CASES[name].held_out, every.T, strict=True):
            print(f"{name:<20} {row}: {len(parts)} bodies, median {np.median(parts):.0f} %, 92 % and more in "
                  f"{100 * np.mean(parts >= 92):.0f} %, 85 % and more in {100 * np.mean(parts >= 85):.0f} %, least "
                  f"{parts.min():.0f} %", flush=True)  # fmt: skip


def main() -> None:
    """Compute the seeds and print a summary of the parameters, or the coverage of bands."""
    parser = parser_of(__doc__, first=0, seeds=12)
    parser.add_argument("what", choices=("parameters", "bands"))
    parser.add_argument("--kind", choices=list(DURATION), default="three", help="training recordings of parameters")
    parser.add_argument("--case", choices=list(CASES), action="append", help="of bands; default: all")
    args = parser.parse_args()
    if args.what == "bands":
        bands(args.first, args.seeds, args.case or list(CASES))
    else:
        seeds = range(args.first, args.first + args.seeds)
        print(summary([*computed(seeds, partial(errors_of, kind=args.kind))], args.seeds))


if __name__ == "__main__":
    main()
