"""Start values of a fit: stiffness and damping from free decays, torque laws from constant pressures, others from the
model.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from pliant.errors import FitError, InputError, SimulationError
from pliant.identification.chamber_parameters import owners, prefixes
from pliant.identification.drives import check_driven
from pliant.identification.edges import edges
from pliant.identification.experiment import Experiment
from pliant.identification.names import declarations
from pliant.identification.parameters import (
    Parameter,
    apply,
    check_names,
    each_joint,
    kind_of,
    shared_name,
    values_of,
)
from pliant.identification.part_parameters import LAYOUTS, chamber_guess, segments, space_start
from pliant.identification.torque_start import extension_starts, highest_level, torque_starts, typical_sizes
from pliant.mechanics import mechanics_of
from pliant.model import Model, Station
from pliant.model.parts import TENDON, fitted
from pliant.model.torque_law import unfinished_law
from pliant.numerics.ringdown import LEAST_SWING, RingDown, ring_down
from pliant.simulation import equilibrium, modes
from pliant.simulation.forces import loads_at

Array = np.ndarray
DEFAULTS = {name: row.quantity.guess for name, row in declarations().items() if row.quantity.guess is not None}
MOST_BAND = 1e6  # high over low


def free_decay(exp: Experiment) -> RingDown | None:
    """Return frequency and damping of the free decay after the last step of an input or the release of the body, or
    None if the decay was recorded for too short a time.
    """
    after = last_edge(exp)
    keep = (exp.time > after + 0.03) & np.isfinite(exp.last_station).all(axis=1)
    if keep.sum() < 16:
        return None
    p = exp.last_station[keep]
    direction = np.linalg.svd(p - p.mean(axis=0), full_matrices=False)[2][0]
    return ring_down(exp.time[keep], p @ direction)


def last_edge(exp: Experiment) -> float:
    """Return the last time [s] at which the measured pressure changed or a held body was let go."""
    edge_times = edges(exp)
    return max(edge_times.values()) if edge_times else last_jump(exp)


def last_jump(exp: Experiment) -> float:
    """Return the last time [s] at which a measured input differs from its final value by over 5 % of the range of the
    input that varies most.

    The 5 % lie above the noise of a sensor.
    """
    traces = [*exp.drives.values()] or [trace for trace in [exp.pressure] if trace is not None]
    widest = max((float(np.ptp(trace.pressure)) for trace in traces), default=0.0)
    edges_s = [float(exp.time[0])]
    for trace in traces:
        p = trace.pressure
        away = np.flatnonzero(np.abs(p - np.median(p[-max(1, p.size // 20) :])) > 0.05 * widest)
        edges_s += [float(trace.time[away[-1]])] if away.size else []
    return max(edges_s)


def registered(model: Model, experiments: Sequence[Experiment], values: dict[str, float]) -> Model:
    """Return the model with one observed point for each recorded station, at its place in the first recorded frames.

    The names link_1 ... link_n mean the link tips. Any other point is attached to the nearest link, the last station of
    an experiment to the last link. Its position comes from the first experiment that shows it: from the first frames,
    with the chain at rest or held in its unloaded shape, or, after a release from a measured pose, from the last frames
    with the chain at rest.
    """
    known = {p.name: p for p in model.points}
    points = {p.name: p for p in model.stations}
    for exp in experiments:
        if exp.without_positions:
            points = turning_points(model, exp, known) | points
            continue
        m = apply(model, {**values, **exp.known})
        straight = exp.excitation == "release" and exp.held is None
        pulled = [f for f in exp.forces if not isinstance(f.at, str) or f.at in {p.name for p in m.points}]
        load = loads_at(m, pulled, float(exp.time[0])) if pulled and not straight else None
        phi = mechanics_of(m).coordinates(np.zeros(m.size) if straight else equilibrium(m, link_load=load))
        for k, name in enumerate(exp.stations):
            if name in known:
                points[name] = known[name]
            elif name not in points:
                positions = exp.position[np.isfinite(exp.position[:, k]).all(axis=1), k]
                link = m.n - 1 if name == exp.stations[-1] else None
                still = positions[:5] if exp.held is None else positions[-5:]
                points[name] = placed(m, phi, name, np.median(still, axis=0), link)
    return model.with_(stations=tuple(points.values()))


def turning_points(model: Model, exp: Experiment, known: Mapping[str, Station]) -> dict[str, Station]:
    """Return one observed point per station for an experiment that has angles only: the tip of the station's link.

    The link is the one at the station's arc length. Without arc lengths, the stations are distributed evenly over the
    links, the last at the tip.
    """
    count = len(exp.stations)
    arc = np.arange(1, count + 1) / count * model.length if exp.arc_length is None else exp.arc_length
    links = np.clip(np.ceil(arc / model.length * model.n - 1e-6).astype(int) - 1, 0, model.n - 1)
    return {name: known.get(name, Station(name, int(i), float(model.link_length[i]), 0.0))
            for name, i in zip(exp.stations, links, strict=True)}  # fmt: skip


def placed(model: Model, phi: Array, name: str, point: Array, link: int | None) -> Station:
    """Return a `Station` of the model at `point` [m], on the link `link` or, if that is None, on the nearest link."""
    length = np.concatenate([[model.base_length], model.link_length])
    beside = mechanics_of(model).beside_links(phi, point[None])[0]  # (n + 1, 3)
    apart = np.linalg.norm(beside - np.stack([np.clip(beside[:, 0], 0.0, length), *[0.0 * length] * 2], axis=1), axis=1)
    i = int(np.argmin(apart)) if link is None else link + 1
    return Station(name, i - 1, *beside[i].tolist())


def stiffness_for_frequency(model: Model, exp: Experiment, frequency: float) -> float:
    """Return the joint stiffness [N m/rad] at which the model's first mode, under gravity, has this
    `frequency` [Hz].
    """

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


def estimate(
    model: Model, experiments: Sequence[Experiment], parameters: Sequence[Parameter],
) -> tuple[Model, list[Parameter]]:
    """Return the model with an observed point for each station, and the fit parameters with all start values estimated.

    Raises FitError for a parameter whose start value cannot be estimated.
    """
    values = values_of(parameters)
    wanted = {shared_name(p.name) for p in parameters if p.value is None}
    begun = {k: v for k, v in values.items() if not unfinished_law(k, wanted)}
    base, experiments = apply(model, begun), [e.synchronised(values) for e in experiments]
    guess = DEFAULTS | {
        "mass": float(model.link_mass.sum()),
        **space_start(model), "gravity_angle": float(np.arctan2(-model.gravity[0], model.gravity[1])),
        **{f"gravity_{axis}": float(g) for axis, g in zip("xyz", model.gravity, strict=False)},
        "rest_angle": float(model.rest_angle.mean()),
        **{f"rest_angle_{i + 1}": float(a) for i, a in enumerate(model.rest_angle)},
        **chambers_start(model, experiments),
    }
    for exp in experiments:
        guess |= {f"{exp.name}.{k}": v for k, v in edges(exp).items()}
    guess |= ring_start(base, experiments, wanted)
    limits = {p.name for p in parameters if p.value is None and shared_name(p.name) in chamber_guess(1.0)}
    base = apply(base, {k: guess[k] for k in ("stiffness", *limits) if k in guess and (k in wanted or "." in k)})
    base = registered(base, experiments, values)
    laws = torque_starts(base, experiments, {p.name for p in parameters if p.value is None}, values)
    guess |= laws | extension_starts(base, experiments, {**values, **laws})
    for point in base.points:
        guess |= {f"{point.name}.{k}": getattr(point, k) for k in ("along", "across", "aside")}
    typical = typical_sizes(base, experiments)
    filled = []
    for p in parameters:
        value = p.value if p.value is not None else guess.get(p.name, guess.get(shared_name(p.name)))
        if value is None:
            raise FitError(
                f"parameter {p.name} needs a start value: it cannot be estimated from the recordings, so give one"
            )
        scale = p.scale or kind_of(p.name).scale or abs(value) or typical.get(shared_name(p.name), 1.0)
        source = p.source or ("estimated" if p.value is None else "given")
        filled.append(p.with_(value=float(np.clip(value, p.lower, p.upper)), scale=scale, source=source))
    return base, filled


def prepare(
    experiments: Sequence[Experiment], model: Model, parameters: Sequence[Parameter | str],
) -> tuple[Model, list[Parameter]]:
    """Return the model with observed points, and all parameters of a fit, edge times included, with start values."""
    listed = each_joint((Parameter(p) if isinstance(p, str) else p for p in parameters), model.n)
    records = [e.name for e in experiments]
    if not records or len(set(records)) < len(records):
        raise InputError(f"a fit needs at least one experiment, and each needs a name of its own, got "
                         f"{', '.join(records) or 'none'}")  # fmt: skip
    names = {p.name for p in listed}
    for exp in experiments:
        span = float(np.ptp(exp.time))
        listed += [
            Parameter(n, lower=float(exp.time[0]) - span, upper=float(exp.time[-1]) + span)
            for n in exp.own_parameters if n not in names
        ]
    listed += bands_of_layouts(listed, experiments, model)
    stations = {s for e in experiments for s in e.stations} | {s.name for s in model.points}
    others = {p.name.partition(".")[0] for p in listed if "." in p.name and not p.free}  # of an earlier fit
    others -= stations | {*owners(model), *segments(model)}
    check_driven(model, experiments)
    check_names(listed, model, {*records, *others}, stations)
    return estimate(model, experiments, listed)


def ring_start(model: Model, experiments: Sequence[Experiment], wanted: set[str]) -> dict[str, float]:
    """Return start values of stiffness and damping, by parameter name, from the free decays in the recordings.
    Without a free decay the model's own values are returned.
    """
    start = {"stiffness": float(model.stiffness.mean()), "damping": float(model.damping.mean())}
    if not wanted & {"stiffness", "damping"}:
        return start
    rings = [(exp, ring) for exp in experiments if (ring := free_decay(exp)) is not None]
    if rings and "stiffness" in wanted:
        start["stiffness"] = float(np.median([stiffness_for_frequency(model, e, ring.frequency) for e, ring in rings]))
    if rings and "damping" in wanted:
        omega = 2 * np.pi * np.median([ring.frequency for _, ring in rings])
        zeta = float(np.median([ring.damping_ratio for _, ring in rings]))
        start["damping"] = float(2 * zeta * start["stiffness"] / omega)
    return start


def chambers_start(model: Model, experiments: Sequence[Experiment]) -> dict[str, float]:
    """Return start values by parameter name: gains and tendon parameters as in the model, and wall limits of twice the
    peak pressure.
    """
    guess = chamber_guess(highest_level(experiments))
    for start, chamber in zip(prefixes(model), model.chambers, strict=True):
        driven = [t for e in experiments for name, t in e.drives.items() if name == chamber.name]
        highest = max([abs(t.peak) for t in driven], default=highest_level(experiments))
        guess |= {f"{start}{k}": v for k, v in chamber_guess(highest).items()}
        guess[f"{start}gain"] = float(chamber.joint_gain.mean())
        guess |= {f"{start}{name}": float(getattr(chamber, field)) for name, field in fitted(TENDON).items()
                  if chamber.signs}  # fmt: skip
        for field in ("joint_gain", "cross_gain"):
            gains = np.broadcast_to(getattr(chamber, field), model.n)
            guess |= {f"{start}{field}_{i + 1}": float(a) for i, a in enumerate(gains)}
            turned = np.hypot(chamber.joint_gain, chamber.cross_gain) > 0
            guess[f"{start}gain_{'xy'[field == 'cross_gain']}"] = float(gains[turned].mean()) if turned.any() else 0.0
    return guess


def bands_of_layouts(
    parameters: Sequence[Parameter], experiments: Sequence[Experiment], model: Model,
) -> list[Parameter]:
    """Return, as fixed parameters, the limits of the range in which branches approximate a springpot (lowest and
    highest frequency [Hz]) or Payne's curve (lowest and highest joint rotation [rad]). Limits that are stated or not
    needed are left out.
    """
    names = {p.name for p in parameters}
    chosen = {"fractional": lambda: band_of_rates(experiments), "payne": lambda: band_of_swings(experiments, model)}
    listed = []
    for law, band in chosen.items():
        ends = [f"{law}_low", f"{law}_high"]
        if not {shared_name(name) for name in names} & {*fitted(LAYOUTS[law])} - {*ends}:
            continue
        if moving := [p.name for p in parameters if p.free and shared_name(p.name) in ends]:
            raise InputError(
                f"parameter {moving[0]} bounds the range of {law}_* and cannot be fitted: give it free = false"
            )
        listed += [Parameter(name, value, free=False, source="the recordings' span")
                  for name, value in zip(ends, band(), strict=True) if name not in names]
    return listed


def band_of_rates(experiments: Sequence[Experiment]) -> tuple[float, float]:
    """Return the lowest and highest frequency [Hz] in recordings: 1 / longest duration, half the frame rate."""
    low = 1.0 / max(float(np.ptp(e.time)) for e in experiments)
    high = 0.5 / min(float(np.median(np.diff(e.time))) for e in experiments)
    return low, min(high, MOST_BAND * low)


def band_of_swings(experiments: Sequence[Experiment], model: Model) -> tuple[float, float]:
    """Return the range of joint rotations [rad] in the recordings, up to twice the peak rotation of a joint.

    The peak rotation of a joint follows from the peak displacement of the tip, for a body bent evenly: the tip moves by
    half its angle times the length.
    """
    turns = [e.travel if e.without_positions else 2.0 * e.travel / model.length for e in experiments]
    joint = max(turns) / model.n
    return LEAST_SWING * joint, 2.0 * joint
