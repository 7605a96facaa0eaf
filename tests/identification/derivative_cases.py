"""Every free parameter beside every option of an experiment and of a model: the cases that derivatives are held to."""

from __future__ import annotations

import re
import zlib
from collections.abc import Callable, Collection
from dataclasses import replace
from functools import cache
from typing import Any, get_args

import numpy as np

from pliant.equations.laws import LAWS
from pliant.equations.spring_terms import SPRING_TERMS
from pliant.errors import InputError, PliantError
from pliant.identification import Experiment, Parameter
from pliant.identification.chamber_parameters import of_chamber, owners
from pliant.identification.experiment import AngleReference, Excitation
from pliant.identification.following import observed_rows
from pliant.identification.forward_model import forward_problem
from pliant.identification.initial_guess import bands_of_layouts
from pliant.identification.parameters import check_names
from pliant.identification.part_parameters import LAYOUTS, segments
from pliant.identification.part_parameters import OWN as OF_A_SEGMENT
from pliant.identification.problem import Problem
from pliant.model import Chamber, Extension, Memory, Model, Station, Valve
from pliant.simulation import Trace
from pliant.simulation.forces import PointForce

Array = np.ndarray
STEP = 2e-3
CLOSE = 1e-5  # of the length of a column
LEAST = 1e-6  # of the longest column: what counts as the length of a shorter one
SIZES = (1e-4, 1e-3, 1e-5, 1e-6)  # of the differences, in scales of the parameter
TIMES = np.arange(0.0, 0.6, 0.01)
EDGES = {"pulse": {"e.start": 0.1234, "e.stop": 0.3367}, "step": {"e.start": 0.1234}, "release": {"e.release": 0.1471},
         "trace": {}}  # fmt: skip

LEVELS = np.linspace(1e4, 1.2e5, 8)  # Pa, and torques that rise less and less: laws with kernels begin there
TORQUES = 6e-7 * LEVELS / (1.0 + LEVELS / 2e5)

# a value for each kind of parameter, away from its bounds; every family of `names.families` must be met by one
VALUES: dict[str, float] = {
    "stiffness": 0.9, "damping": 6e-3, "stiffness_2": 0.8, "damping_3": 5e-3, "rest_angle": 0.11, "rest_angle_3": 0.07,
    "joint_share": 0.3, "gravity_angle": 2.7, "gain": 1.1, "joint_gain_1": 1.2, "joint_gain_2": 0.7,
    "torque_1": 6e-7, "torque_2": 1e-12, "mass": 0.05, "tip_mass": 0.01, "tip_inertia": 5e-6,
    "valve_rise_time": 0.03, "valve_fall_time": 0.05, "valve_dead_time": 0.0033, "valve_rise_rate": 1.5e6,
    "valve_fall_rate": 9e5,
    "valve_dead_band": 2.3e3, "valve_opening_time": 0.11, "valve_settle_share": 0.2, "valve_settle_time": 0.3,
    "base_angle": 0.06, "base_x": 1e-3, "base_y": -2e-3, "base_turn": -0.03,
    "tip.along": 0.03, "tip.across": -0.005, "mid.along": 0.02,
    "start": 0.0113, "stop": 0.35, "release": 0.15, "release_time": 0.043, "hold_force": 0.3,
    "latency": 4.2e-3, "sensor_lag": 0.021, "tip.sensor_lag": 0.017,
    "creep_share_1": 0.2, "creep_time_1": 0.15, "creep_share_2": 0.1, "creep_time_2": 1.3,
    "slip_share_1": 0.2, "slip_angle_1": 0.013,
    "fractional_share": 0.05, "fractional_order": 0.25, "fractional_low": 0.3, "fractional_high": 30.0,
    "payne_share": 2.0, "payne_angle": 0.02, "payne_exponent": 0.4, "payne_low": 2e-3, "payne_high": 0.2,
    "boucwen_share": 0.2, "boucwen_beta": 20.0, "boucwen_gamma": 9.0, "boucwen_exponent": 1.5,
    **{name: 0.7 * term.fit[2] for name, term in SPRING_TERMS.items()},
    "stiffening": -0.9, "cubic_stiffening": 0.7, "stiffening_bound": 0.6, "stiffening_2": -0.7,
    "cubic_stiffening_1": 0.5, "stiffening_bound_3": 0.5,
    "swell_share": 0.3, "swell_time": 0.2, "inflation_limit": 4e5, "inflation_time": 0.04, "inflation_jm": 3.0,
    "body_stiffness": 0.85, "axial_stiffness": 210.0, "axial_damping": 0.8, "axial_gain": 25.0,
    "axial_creep_share_1": 0.3, "axial_creep_time_1": 0.2, "axial_slip_share_1": 0.4, "axial_slip_strain_1": 0.003,
    **{f"axial_{name}": 0.7 * term.axial[2] for name, term in SPRING_TERMS.items()},
    "axial_stiffening": -15.0, "axial_cubic_stiffening": 800.0, "axial_stiffening_bound": 0.1,
    "elastic_wall_lever": 5e-7, "elastic_wall_compliance": 1.1e-6,
    **{f"{law.name}_{name}": value for law in LAWS for name, value in law.start(LEVELS, TORQUES).items()},
}  # fmt: skip

SCALES = dict.fromkeys(("start", "stop", "release"), 0.01)
BANDS = tuple(f"{law}_{end}" for law in LAYOUTS for end in ("low", "high"))  # chosen, never fitted

PLAIN: dict[str, Any] = {
    "link_length": [0.04, 0.04, 0.03], "link_mass": [0.02, 0.018, 0.015], "stiffness": 0.9, "damping": 6e-3,
    "torque": [6e-7], "rest_angle": [0.1, 0.15, 0.05], "gravity": [3.0, -6.0], "base_length": 0.01, "tip_mass": 0.004,
    "tip_inertia": 4e-6,
    "valve": Valve(rise_time=0.03, fall_time=0.05),
    "stations": (Station("mid", 1, 0.03, 0.008), Station("tip", 2, 0.025, -0.005)),
}
NEAR = Chamber(torque=[6e-7, 1e-12], joint_gain=[1.0, 0.5, 0.0], valve=Valve(rise_time=0.02, dead_time=2e-3),
               axial_gain=[20.0, 4.0], name="near")  # fmt: skip
FAR = Chamber(torque=[4e-7], joint_gain=[0.0, -0.5, -1.0], axial_gain=[0.0, 20.0], name="far", swell_share=0.2,
              swell_time=0.1)  # fmt: skip
LONGER = (Extension(200.0, 1.0, 0.005, 0.05, "inner"), Extension(250.0, 1.5, 0.05, None, "outer"))
REMEMBERS = Memory((0.1,), (0.2,), (0.1, 0.05), (0.01, 0.03), 0.1, 20.0, 10.0, 1.5)
SEGMENTS_REMEMBER = Memory((0.1,), (0.2,), axial_creep_share=(0.2,), axial_creep_time=(0.3,), axial_slip_share=(0.3,),
                           axial_slip_strain=(0.004,))
MODELS: dict[str, Model] = {
    "plain": Model(**PLAIN),
    "hardening": Model(**{**PLAIN, "mass_at": "tip", "base_angle": 0.2, "stiffening": 0.2, "cubic_stiffening": 0.6,
                          "name": "hardening", "source": {"stiffness": "stated"}}),
    "second order": Model(**{**PLAIN, "law": LAWS[0].name, "torque": LAWS[0].numbers(LAWS[0].start(LEVELS, TORQUES)),
                             "valve": Valve(dead_time=4e-3, natural_frequency=6.0, damping_ratio=0.4)}),
    "rubber": Model(**{**PLAIN, "torque": [4e-7, 2e-12], "swell_share": 0.3, "swell_time": 0.2, "inflation_limit": 4e5,
                       "inflation_time": 0.04, "inflation_jm": 2.0,
                       "valve": Valve(rise_time=0.03, fall_time=0.05, rise_rate=1.5e6, fall_rate=9e5, settle_share=0.2,
                                      settle_time=0.3, dead_band=1.5e3, opening_time=0.05)}),
    "memory": Model(**{**PLAIN, "memory": REMEMBERS, "stiffening": -0.9, "stiffening_bound": 0.75}),
    "lengthens": Model(**{**PLAIN, "extensions": LONGER, "axial_gain": [20.0, 25.0]}),
    "lengthens and remembers": Model(**{
        **PLAIN, "axial_gain": [20.0, 25.0], "tip_mass": 0.05, "memory": SEGMENTS_REMEMBER,
        "extensions": (replace(LONGER[0], stiffening=-12.0, cubic_stiffening=600.0, stiffening_bound=0.4), LONGER[1]),
    }),
    "chambers": Model(**{k: v for k, v in PLAIN.items() if k not in ("torque", "valve")},
                      chambers=(replace(NEAR, axial_gain=[0.0]), replace(FAR, axial_gain=[0.0]))),
    "all": Model(**{k: v for k, v in PLAIN.items() if k not in ("torque", "valve")}, chambers=(NEAR, FAR),
                 extensions=LONGER, memory=REMEMBERS),
}  # fmt: skip

EXCITATIONS: tuple[str, ...] = get_args(Excitation)
RAMPS = Trace([0.1, 0.13, 0.3031, 0.3212], [0.0, 1e5, 0.9e5, 0.0])
JUMPS = Trace([0.0, 0.1111, 0.1111, 0.3, 0.3057, 0.3057], [2e4, 2e4, 1e5, 0.8e5, 0.8e5, 0.0])
STARTS_LOADED = Trace([0.0, 0.2017, 0.25], [6e4, 6e4, 0.0])
PULL = PointForce([0.0, 0.2, 0.4], [[0.1, 0.2], [0.3, 0.0], [0.0, 0.0]], "tip")
THROW = PointForce([0.05, 0.2113, 0.2113], [[0.0, 0.1], [0.0, 0.1], [-0.3, 0.0]], Station("thread", 1, 0.02, 0.01))


def angles_of(exp: Experiment) -> Array:
    """Angles (T, S) of any motion, rad."""
    return 0.3 * np.arange(1, len(exp.stations) + 1) * np.sin(7.0 * exp.time)[:, None] + 0.1


def gapped(exp: Experiment) -> Array:
    """The positions with gaps, the first frames of one station among them."""
    position = exp.position.copy()
    position[:3, 0], position[20:24, -1, 0] = np.nan, np.nan
    return position


def at_reach(exp: Experiment, part: float) -> Array:
    """Positions (S, 2) of the stations on a line from the first joint, at a `part` of the reach of each."""
    places = {s.name: s for s in PLAIN["stations"]}
    reach = [sum(PLAIN["link_length"][: s.link]) + np.hypot(s.along, s.across) for s in map(places.get, exp.stations)]
    return np.array([0.0, PLAIN["base_length"]]) + part * np.outer(reach, [-np.sin(0.3), np.cos(0.3)])


def with_angles(exp: Experiment, reference: str, **more: Any) -> dict[str, Any]:
    return {"angle": angles_of(exp), "angle_reference": reference, **more}


def traced(exp: Experiment, trace: Trace) -> dict[str, Any]:
    """The experiment with another measured pressure; of several chambers, shared out."""
    if not exp.drives:
        return {"pressure": trace}
    half = Trace(trace.time, 0.5 * trace.pressure)
    return {"drives": dict(zip(exp.drives, (trace, half), strict=False))}


# what each entry of an Experiment can be beside what it is in `experiment_of`; each must be here
Changed = Callable[[Experiment], dict[str, Any]]
OPTIONS: dict[str, dict[str, Changed]] = {
    "name": {},  # the names of parameters have it
    "time": {"irregular": lambda e: {"time": e.time + 2e-3 * np.sin(40.0 * e.time)},
             "late": lambda e: {"time": e.time + 0.05}},
    "position": {"gaps": lambda e: {"position": gapped(e)},
                 "no places": lambda e: with_angles(e, "base", position=np.full_like(e.position, np.nan),
                                                    angles_alone=True)},
    "stations": {"tip alone": lambda e: {"stations": ("tip",), "position": e.position[:, 1:]},
                 "another order": lambda e: {"stations": ("tip", "mid"), "position": e.position[:, ::-1]}},
    "excitation": {},  # every case goes through all of them
    "pressure": {"jumps": lambda e: traced(e, JUMPS), "loaded at first": lambda e: traced(e, STARTS_LOADED)},
    "level": {"low": lambda _: {"level": 3e4}},
    "known": {"load": lambda _: {"known": {"tip_mass": 0.02, "base_x": 3e-3}},
              "clock": lambda _: {"known": {"start": 0.0213, "latency": 0.0117}}},
    "angle": {"seen too": lambda e: with_angles(e, "base")},
    "angle_reference": {r: lambda e, r=r: with_angles(e, r) for r in get_args(AngleReference) if r},
    "noise": {"known": lambda _: {"noise": {"tip": 1e-4}}},
    "angle_noise": {"known": lambda e: with_angles(e, "rest", angle_noise=1e-3)},
    "arc_length": {"dense": lambda e: {"arc_length": np.linspace(0.05, 0.12, len(e.stations))}},
    "held": {"measured": lambda e: {"held": e.position[:5].mean(axis=0) + np.array([0.02, -0.004])},
             **{f"{part:g} of its reach": lambda e, part=part: {"held": at_reach(e, part)}
                for part in (0.97, 1.0, 1.04)}},
    "forces": {"thread": lambda _: {"forces": (PULL,)}, "two": lambda _: {"forces": (PULL, THROW)}},
    "angles_alone": {"only": lambda e: with_angles(e, "joint", angles_alone=True)},
    "own_places": {"own": lambda _: {"own_places": True},
                   "own, pulled": lambda _: {"own_places": True, "forces": (PULL,)},
                   "own, loaded at first": lambda e: {"own_places": True, **traced(e, STARTS_LOADED)}},
    "drives": {"one alone": lambda e: {"drives": {"near": e.drives["near"]}}},
}  # fmt: skip


def experiment_of(model: Model, excitation: str) -> Experiment:
    """An experiment with no option chosen; its data are any motion near the body."""
    base = np.array([[0.005, 0.06], [-0.01, 0.115]])
    wave = np.stack([np.sin(9.0 * TIMES), np.cos(9.0 * TIMES) - 1.0], axis=1)
    position = base + 0.02 * wave[:, None] * np.array([[0.4], [1.0]])
    several = len(model.chambers) > 1 and excitation == "trace"
    drives = {c.name: Trace(RAMPS.time, s * RAMPS.pressure) for c, s in zip(model.chambers, (1.0, 0.6), strict=False)}
    return Experiment(
        "e", TIMES, position, ("mid", "tip"), excitation, RAMPS if excitation == "trace" else None,
        0.0 if excitation in ("trace", "release") else 9e4, drives=drives if several else {},
    )


def excitations_of(model: str) -> list[str]:
    """Excitations that a model of `MODELS` can have: several chambers need measured pressures, or none."""
    return [e for e in EXCITATIONS if e in ("trace", "release") or len(MODELS[model].chambers) == 1]


def case(model: str, excitation: str, field: str, what: str) -> Experiment | None:
    """The experiment with one option chosen; None where an Experiment refuses it, or has nothing to apply it to."""
    plain = experiment_of(MODELS[model], excitation)
    if (field == "drives" and not plain.drives) or (field == "pressure" and excitation != "trace"):
        return None
    try:
        return replace(plain, **OPTIONS[field][what](plain))
    except InputError:
        return None


def candidates(model: Model, owned: str) -> dict[str, dict[str, float]]:
    """Values by name in families of names that begin alike: shared by all, of one record, of a chamber or a segment."""
    found: dict[str, dict[str, float]] = {}
    for name, value in VALUES.items():
        family = re.match(r"(?:tip\.|mid\.)?[a-z]+", name)[0]
        if owned != "part":
            found.setdefault(family, {})[("e." if owned == "record" else "") + name] = value
            continue
        mine = owners(model) if of_chamber(name) else ()
        mine += segments(model) if name in OF_A_SEGMENT else ()
        for k, owner in enumerate(mine):
            found.setdefault(f"{owner}.{family}", {})[f"{owner}.{name}"] = (1.0 - 0.1 * k) * value
    return found


def groups(model: Model, exp: Experiment, owned: str) -> list[dict[str, float]]:
    """Sets of values that go together: each family in the first that takes it; what the model has not is left out."""
    made: list[dict[str, float]] = []
    for values in candidates(model, owned).values():
        new = {k: v for k, v in values.items() if k not in EDGES[exp.excitation]}
        for group in [*made, {}]:
            if simulable(model, exp, {**group, **new}):
                if not group:
                    made.append(group)
                group.update(new)
                break
    return made


def simulable(model: Model, exp: Experiment, values: dict[str, float]) -> bool:
    """Whether the values go together and with the model."""
    try:
        problem = problem_of(model, exp, values)
    except PliantError:
        return False
    return bool(np.isfinite(problem.data_residual(problem.start)).all()) and not problem.broken


def problem_of(model: Model, exp: Experiment, values: dict[str, float], free: Collection[str] = ()) -> Problem:
    """The problem of an experiment beside another one without options, with which it shares plans.

    All values are `free`, or those and the moments of edges.
    """
    free = {*(free or values), *EDGES[exp.excitation]}
    values = {**EDGES[exp.excitation], **values}
    other = replace(experiment_of(model, exp.excitation), name="o")
    values |= {n.replace("e.", "o."): v + 0.0107 for n, v in EDGES[exp.excitation].items()}
    listed = [Parameter(n, v, free=n in free and not n.endswith(BANDS), scale=SCALES.get(n.rpartition(".")[2], abs(v)))
              for n, v in values.items()]  # fmt: skip
    check_names(listed, model, {"e", "o"}, {s.name for s in model.points})
    listed += bands_of_layouts(listed, [exp], model)
    return Problem([other, exp], model, listed, STEP, "metre")


CHOICES = [(field, what) for field, changes in OPTIONS.items() for what in changes]
PLACES = [(model, excitation) for model in MODELS for excitation in excitations_of(model)]


def mismatch(problem: Problem, k: int, column: np.ndarray, longest: float) -> float:
    """Distance of a column from differences of the forward model, relative to its length.

    Differences of two sizes, extrapolated; where the first are not close, those that agree best among themselves.
    """
    o, nearest, spread = problem.observed[1], np.inf, np.inf

    def residual(move: float) -> np.ndarray:
        x = problem.start + move * (np.arange(problem.start.size) == k)
        made = forward_problem(problem.model, o.exp, problem.values(x), problem.time_step)
        return o.residual(observed_rows(made, made.numbers, o.exp.time.size))

    for size in SIZES:
        try:
            coarse, fine = ((residual(d) - residual(-d)) / (2.0 * d) for d in (size, 0.5 * size))
        except PliantError:
            continue
        expected = (4.0 * fine - coarse) / 3.0
        length = max(float(np.linalg.norm(expected)), LEAST * longest) or 1.0  # nothing drawn may move anything
        if (off := float(np.linalg.norm(column - expected)) / length) < 0.1 * CLOSE:
            return off
        if (apart := float(np.linalg.norm(coarse - fine)) / length) < spread:
            nearest, spread = off, apart
    assert spread < 1e-2, f"{problem.free[k].name}: no difference to hold the derivative to"
    return nearest


@cache
def groups_of(model: str, excitation: str, owned: str) -> list[dict[str, float]]:
    return groups(MODELS[model], experiment_of(MODELS[model], excitation), owned)


def column_errors(model: str, exp: Experiment, owned: tuple[str, ...], sample: int = 0) -> dict[str, float]:
    """Relative distance of each column from differences, by parameter; of a `sample` of each group where given."""
    errors = {}
    for values in (g for kind in owned for g in groups_of(model, exp.excitation, kind)):
        problem = problem_of(MODELS[model], exp, values, drawn(exp, values, sample))
        assert np.isfinite(problem.data_residual(problem.start)).all()
        assert not problem.broken
        J = problem.data_jacobian(problem.start)[problem.ends[0] :]
        longest = float(np.linalg.norm(J, axis=0).max())
        errors |= {p.name: mismatch(problem, k, J[:, k], longest) for k, p in enumerate(problem.free)}
    return errors


def wrong_columns(model: str, exp: Experiment, owned: tuple[str, ...], sample: int = 0) -> dict[str, float]:
    """Columns that are off by more than `CLOSE`, with their distance."""
    return {name: e for name, e in column_errors(model, exp, owned, sample).items() if not e < CLOSE}


def drawn(exp: Experiment, values: dict[str, float], sample: int) -> set[str]:
    """Names of a random sample, the same in every run and another in each case; all of them for a sample of 0."""
    names = [n for n in values if not n.endswith(BANDS)]
    if not sample or len(names) <= sample:
        return set(names)
    seed = zlib.crc32(f"{exp.excitation} {exp.stations} {exp.position.sum()} {len(values)} {names[0]}".encode())
    return set(np.random.default_rng(seed).choice(names, sample, replace=False))
