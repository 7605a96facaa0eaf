"""Where a fit begins: stiffness and damping from the ring-down, torque from the plateaus."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

import numpy as np

from pliant.equations.chamber import lever_growth
from pliant.errors import FitError, InputError, SimulationError
from pliant.identification.chamber_parameters import owners, prefixes
from pliant.identification.drives import alone, check_driven
from pliant.identification.edges import displacement, edges
from pliant.identification.experiment import Experiment
from pliant.identification.forces import loads_at
from pliant.identification.memory_parameters import chamber_guess
from pliant.identification.parameters import Parameter, apply, check_names, each_joint, kind_of, shared_name
from pliant.identification.springpot_band import band_of_springpot
from pliant.model import Chamber, Model, Station
from pliant.numerics.ringdown import RingDown, ring_down
from pliant.simulation import equilibrium, modes, state

Array = np.ndarray
MOST_INFLATED = 10.0  # fourth power of the stretch that a start value reckons with: one near the limit says nothing
DEFAULTS = {
    "tip_mass": 0.0, "valve_rise": 0.02, "valve_fall": 0.02, "valve_dead_time": 0.005, "base_angle": 0.0,
    "base_x": 0.0, "base_y": 0.0, "base_turn": 0.0, "hold_force": 0.0, "release_time": 0.04,
    "start": 0.0, "latency": 0.0,
}


def free_decay(exp: Experiment) -> RingDown | None:
    """The ring-down after the last edge or the release, along the main direction of the last station's motion."""
    after = last_edge(exp)
    keep = (exp.time > after + 0.03) & np.isfinite(exp.last_station).all(axis=1)
    if keep.sum() < 16:
        return None
    p = exp.last_station[keep]
    direction = np.linalg.svd(p - p.mean(axis=0), full_matrices=False)[2][0]
    return ring_down(exp.time[keep], p @ direction)


def last_edge(exp: Experiment) -> float:
    """When the pressure last changed, or the body was let go, s."""
    found = edges(exp)
    return max(found.values()) if found else last_jump(exp)


def last_jump(exp: Experiment) -> float:
    """When the measured pressure last left its final value by 5 % of its range, s; the sensor's noise stays below."""
    if exp.pressure is None:
        return float(exp.time[0])
    p = exp.pressure.pressure
    away = np.abs(p - np.median(p[-max(1, p.size // 20) :])) > 0.05 * np.ptp(p)
    return float(exp.pressure.time[np.flatnonzero(away)[-1]]) if away.any() else float(exp.time[0])


def registered(model: Model, experiments: Sequence[Experiment], values: dict[str, float]) -> Model:
    """The model with a point for every station that it does not know yet, placed where the recording shows it first.

    The names link_1 ... link_n mean the link tips. Any other point is fixed to the link that it lies beside, the last
    station of an experiment to the last link. Its place is read off the first experiment that shows it: off its first
    frames, with the chain at rest or held in its unloaded shape as the model has it there, or off the last frames of a
    body that was pulled aside and let go, with the chain at rest.
    """
    known = {p.name: p for p in model.points}
    points = {p.name: p for p in model.stations}
    for exp in experiments:
        m = apply(model, {**values, **exp.known})
        straight = exp.excitation == "release" and exp.held is None
        pulled = [f for f in exp.forces if not isinstance(f.at, str) or f.at in {p.name for p in m.points}]
        load = loads_at(m, pulled, float(exp.time[0])) if pulled and not straight else None
        phi = state.absolute(m, np.zeros(m.n) if straight else equilibrium(m, link_load=load))
        for k, name in enumerate(exp.stations):
            if name in known:
                points[name] = known[name]
            elif name not in points:
                seen = exp.position[np.isfinite(exp.position[:, k]).all(axis=1), k]
                link = m.n - 1 if name == exp.stations[-1] else None
                still = seen[:5] if exp.held is None else seen[-5:]
                points[name] = placed(m, phi, name, np.median(still, axis=0), link)
    return model.with_(stations=tuple(points.values()))


def placed(model: Model, phi: Array, name: str, point: Array, link: int | None) -> Station:
    """The station at `point` (2,) of the base frame; on the link that it lies beside when `link` is None."""
    mirror = [model.bend_sign, 1]
    tips = state.tips(model, phi) * mirror
    joints = np.concatenate([[[0.0, 0.0]], [model.first_joint], tips[:-1]])  # the base first
    length = np.concatenate([[model.base_length], model.link_length])
    angle = np.concatenate([[model.base_angle], phi])
    d = point * mirror - joints
    along = -np.sin(angle) * d[:, 0] + np.cos(angle) * d[:, 1]
    across = -np.cos(angle) * d[:, 0] - np.sin(angle) * d[:, 1]
    apart = np.hypot(along - np.clip(along, 0.0, length), across)
    i = int(np.argmin(apart)) if link is None else link + 1
    return Station(name, i - 1, float(along[i]), float(across[i]))


def stiffness_for_frequency(model: Model, exp: Experiment, frequency: float) -> float:
    """The joint stiffness at which the first mode, with this experiment's load, rings at `frequency` [Hz]."""

    def gap(log_k: float) -> float:
        m = apply(model, {**exp.known, "stiffness": float(np.exp(log_k))})
        try:
            return float(modes(m)[0][0]) / frequency - 1.0
        except SimulationError:  # too soft to carry its load: slower than any frequency
            return -1.0

    from scipy.optimize import brentq

    middle = np.log(model.stiffness.mean())
    try:
        return float(np.exp(brentq(gap, middle - 16, middle + 16, xtol=1e-6)))
    except ValueError:
        raise FitError(f"no stiffness makes the model ring at {frequency:.3g} Hz: check masses and lengths") from None


def torque_for_plateau(model: Model, exp: Experiment, target: float, chamber: Chamber) -> float:
    """The torque [N m] of a chamber that moves the last station by `target` [m] from rest, statically."""
    joints = model.joints()
    rest = state.stations(model, state.absolute(model, equilibrium(model)))[0]
    names = [p.name for p in model.points]
    k = names.index(exp.stations[-1])

    def gap(torque: float) -> float:
        q = equilibrium(model) + chamber.joint_gain * torque / joints.K
        moved = state.stations(model, state.absolute(model, q))[0]
        return float(np.linalg.norm(moved[k] - rest[k])) - target

    from scipy.optimize import brentq

    high = float(joints.K.mean() * 0.01)
    while gap(high) < 0 and high < joints.K.mean() * 2:
        high *= 2
    return float(brentq(gap, 0.0, high)) if gap(high) > 0 else high


def plateau(exp: Experiment) -> tuple[float, float]:
    """Pressure [Pa] and displacement of the last station [m] where the pressure was highest for long."""
    u = displacement(exp)
    if exp.pressure is None:
        stop = edges(exp).get("stop", float(exp.time[-1]))
        level = exp.level
        window = (exp.time > stop - 0.2) & (exp.time < stop)
    else:
        p = exp.pressure(exp.time)
        level = float(p.max())
        window = p > 0.95 * level
    return level, float(np.median(u[window])) if window.any() else float(u.max())


def estimate(
    model: Model, experiments: Sequence[Experiment], parameters: Sequence[Parameter],
) -> tuple[Model, list[Parameter]]:
    """Fill every missing start value, and give the model a point for each station.

    Returns the model with its stations and the parameters with values.
    """
    values = {p.name: p.value for p in parameters if p.value is not None}
    wanted = {shared_name(p.name) for p in parameters if p.value is None}
    base, experiments = apply(model, values), [e.synchronised(values) for e in experiments]
    found = DEFAULTS | {
        "mass": float(model.link_mass.sum()),
        "gravity_angle": float(np.arctan2(-model.gravity[0], model.gravity[1])),
        "rest_angle": float(model.rest_angle.mean()),
        **{f"rest_angle_{i + 1}": float(a) for i, a in enumerate(model.rest_angle)},
        **chambers_start(model, experiments),
    }
    for exp in experiments:
        found |= {f"{exp.name}.{k}": v for k, v in edges(exp).items()}
    found |= ring_start(base, experiments, wanted)
    limits = {p.name for p in parameters if p.value is None and shared_name(p.name) in chamber_guess(1.0)}
    base = apply(base, {k: found[k] for k in ("stiffness", *limits) if k in found and (k in wanted or "." in k)})
    base = registered(base, experiments, values)
    found |= torque_starts(base, experiments, {p.name for p in parameters if p.value is None}, values)
    for point in base.points:
        found |= {f"{point.name}.along": point.along, f"{point.name}.across": point.across}
    typical = typical_sizes(base, experiments)
    filled = []
    for p in parameters:
        value = p.value if p.value is not None else found.get(p.name, found.get(shared_name(p.name)))
        if value is None:
            raise FitError(f"parameter {p.name} needs a start value: it cannot be read off the recordings")
        scale = p.scale or kind_of(p.name).scale or abs(value) or typical.get(shared_name(p.name), 1.0)
        source = p.source or ("estimated" if p.value is None else "given")
        filled.append(p.with_(value=float(np.clip(value, p.lower, p.upper)), scale=scale, source=source))
    return base, filled


def prepare(
    experiments: Sequence[Experiment], model: Model, parameters: Sequence[Parameter | str],
) -> tuple[Model, list[Parameter]]:
    """Parameters with start values, edge times added; the model with a point for every station."""
    listed = each_joint((Parameter(p) if isinstance(p, str) else p for p in parameters), model.n)
    records = [e.name for e in experiments]
    if not records or len(set(records)) < len(records):
        raise InputError(f"a fit needs experiments whose names differ, got {', '.join(records) or 'none'}")
    names = {p.name for p in listed}
    for exp in experiments:
        span = float(np.ptp(exp.time))
        listed += [
            Parameter(n, lower=float(exp.time[0]) - span, upper=float(exp.time[-1]) + span)
            for n in exp.own_parameters if n not in names
        ]
    listed += band_of_springpot(listed, experiments)
    stations = {s for e in experiments for s in e.stations} | {s.name for s in model.points}
    others = {p.name.partition(".")[0] for p in listed if "." in p.name and not p.free}  # of an earlier fit
    others -= stations | set(owners(model))
    check_driven(model, experiments)
    check_names(listed, model, {*records, *others}, stations)
    return estimate(model, experiments, listed)


def typical_sizes(model: Model, experiments: Sequence[Experiment]) -> dict[str, float]:
    """Sizes of parameters whose start is 0: of a torque that bends a joint by 0.1 rad, of damping that lasts 1 ms."""
    K = float(model.stiffness.mean())
    level = highest_level(experiments)
    torque = {f"torque_{k}": 0.1 * K / level**k for k in range(1, 10)} if level > 0 else {}
    return {"damping": 1e-3 * K, **torque}


def highest_level(experiments: Sequence[Experiment]) -> float:
    """Highest plateau of the pressure, Pa; 0 without one."""
    return max([plateau(exp)[0] for exp in experiments if exp.excitation != "release"], default=0.0)


def ring_start(model: Model, experiments: Sequence[Experiment], wanted: set[str]) -> dict[str, float]:
    """Stiffness and damping from the free decays, else the model's own."""
    found = {"stiffness": float(model.stiffness.mean()), "damping": float(model.damping.mean())}
    if not wanted & {"stiffness", "damping"}:
        return found
    rings = [(exp, ring) for exp in experiments if (ring := free_decay(exp)) is not None]
    if rings and "stiffness" in wanted:
        found["stiffness"] = float(np.median([stiffness_for_frequency(model, e, ring.frequency) for e, ring in rings]))
    if rings and "damping" in wanted:
        omega = 2 * np.pi * np.median([ring.frequency for _, ring in rings])
        zeta = float(np.median([ring.damping_ratio for _, ring in rings]))
        found["damping"] = float(2 * zeta * found["stiffness"] / omega)
    return found


def chambers_start(model: Model, experiments: Sequence[Experiment]) -> dict[str, float]:
    """Gains as each chamber has them, and twice the highest pressure for the limit of a wall that gives way."""
    found = chamber_guess(highest_level(experiments))
    for start, chamber in zip(prefixes(model), model.chambers, strict=True):
        driven = [t for e in experiments for name, t in e.drives.items() if name == chamber.name]
        highest = max([float(t.pressure.max()) for t in driven], default=highest_level(experiments))
        found |= {f"{start}{k}": v for k, v in chamber_guess(highest).items()}
        found[f"{start}gain"] = float(chamber.joint_gain.mean())
        found |= {f"{start}joint_gain_{i + 1}": float(a) for i, a in enumerate(chamber.joint_gain)}
    return found


def torque_starts(
    model: Model, experiments: Sequence[Experiment], wanted: set[str], values: Mapping[str, float],
) -> dict[str, float]:
    """Coefficients of each chamber's law from the records in which it alone is driven, by their names.

    A chamber of several that is never driven alone begins with a torque that bends a joint by 0.1 rad.
    """
    found: dict[str, float] = {}
    several, sizes, mine = len(model.chambers) > 1, typical_sizes(model, experiments), owners(model)
    shared = {shared_name(n) for n in wanted if n.partition(".")[0] not in mine}
    for start, chamber in zip(prefixes(model), model.chambers, strict=True):
        pushed = [e for e in experiments if alone(e, chamber.name) or (not several and e.excitation != "release")]
        own = {n.removeprefix(start) for n in wanted if n.startswith(start)}
        law = {n for n in own | shared if n.startswith("torque_")}
        given = {**values, **{k.removeprefix(start): v for k, v in values.items() if k.startswith(start)}}
        begun = torque_start(model, pushed, law, given, chamber)
        if several and not pushed:
            begun = {n: sizes.get(n, 0.0) if n == "torque_1" else 0.0 for n in law}
        for n, v in begun.items():
            if pushed or (start + n if n in own else n) not in found:
                found[start + n if n in own else n] = v
    return found


def torque_start(
    model: Model, pushed: Sequence[Experiment], wanted: set[str], values: Mapping[str, float], chamber: Chamber,
) -> dict[str, float]:
    """Coefficients of a chamber's law from the plateaus, by least squares weighted to equal relative error.

    Those in `values` stay as they are.
    """
    if not wanted or not pushed:
        return {}
    levels = np.array([plateau(exp) for exp in pushed])
    torques = np.array([torque_for_plateau(model, e, u, chamber) for e, (_, u) in zip(pushed, levels, strict=True)])
    torques /= lever_growth(np.minimum(chamber.growth_at(levels[:, 0]), MOST_INFLATED))
    weight = 1.0 / np.maximum(torques, 1e-12)
    given = sum(v * levels[:, 0] ** int(n[-1]) for n, v in values.items() if re.fullmatch(r"torque_\d", n))
    powers = np.array(sorted(int(n[-1]) for n in wanted))
    basis = levels[:, :1] ** powers
    solution = np.linalg.lstsq(basis * weight[:, None], (torques - given) * weight, rcond=None)[0]
    return {f"torque_{k}": float(v) for k, v in zip(powers, solution, strict=True)}
