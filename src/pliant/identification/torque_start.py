"""Start values of a fit's torque laws, from recordings in which the pressure stays constant for a while (plateaus), and
of segments that lengthen.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from pliant.equations.chamber import lever_growth
from pliant.identification.chamber_parameters import owners, prefixes
from pliant.identification.drives import alone
from pliant.identification.edges import displacement, edges
from pliant.identification.experiment import Experiment
from pliant.identification.names import path_of, paths
from pliant.identification.observation import modelled_rows, points_at
from pliant.identification.parameters import shared_name
from pliant.identification.part_parameters import ALWAYS
from pliant.mechanics import mechanics_of
from pliant.model import ActuationInput, Model
from pliant.model.parts import CHAMBER
from pliant.model.torque_law import law_parameters, torque_laws
from pliant.numerics.curve import arc_lengths
from pliant.numerics.ringdown import peak
from pliant.simulation import equilibrium

Array = np.ndarray
BENT = 0.9  # of the peak displacement: frames beyond count as bent
MOST_INFLATED = 10.0  # upper limit on the growth of the lever in a start value: near the wall's limit it diverges


def torque_starts(
    model: Model, experiments: Sequence[Experiment], wanted: set[str], values: Mapping[str, float],
) -> dict[str, float]:
    """Return start values, by name, of each chamber's torque law from recordings in which only this chamber is driven.

    In a model of several chambers, one that is never driven alone gets a torque that bends a joint by 0.1 rad.
    """
    starts: dict[str, float] = {}
    several, sizes, mine = model.actuation.count > 1, typical_sizes(model, experiments), owners(model)
    shared = {shared_name(n) for n in wanted if n.partition(".")[0] not in mine}
    for start, chamber in zip(prefixes(model), model.chambers, strict=True):
        pushed = [e for e in experiments if alone(e, chamber.name) or (not several and e.excitation != "release")]
        of_chamber = {n.removeprefix(start) for n in wanted if n.startswith(start)}
        law = {n for n in of_chamber | shared if n.startswith("torque_") or n in law_parameters()}
        chamber_values = {**values, **{k.removeprefix(start): v for k, v in values.items() if k.startswith(start)}}
        begun = torque_start(model, pushed, law, chamber_values, chamber)
        if several and not pushed:
            level = np.array([max(highest_level(experiments), 1.0)])
            begun = {n: sizes.get(n, 0.0) if n == "torque_1" else 0.0 for n in law} | law_starts(
                law, level, sizes.get("torque_1", 0.0) * level
            )
        for n, v in begun.items():
            if pushed or (start + n if n in of_chamber else n) not in starts:
                starts[start + n if n in of_chamber else n] = v
    return starts


def torque_start(
    model: Model, pushed: Sequence[Experiment], wanted: set[str], values: Mapping[str, float], chamber: ActuationInput,
) -> dict[str, float]:
    """Return start values, by name, of one chamber's torque law. The law is fitted to the torques of all plateaus so
    that the relative errors are least.

    Coefficients in `values` are held constant.
    """
    if not wanted or not pushed:
        return {}
    levels = np.array([plateau(exp) for exp in pushed])
    torques = np.array([torque_for_plateau(model, e, u, chamber) for e, (_, u) in zip(pushed, levels, strict=True)])
    torques /= lever_growth(np.minimum(chamber.growth_at(levels[:, 0]), MOST_INFLATED))
    if named := law_starts(wanted, levels[:, 0], torques):
        return named
    weight = 1.0 / np.maximum(torques, 1e-12)
    known = [(path.number, values[n]) for n, path in paths(values, CHAMBER) if path.stem == "torque" and not path.owner]
    known_torque = sum(v * levels[:, 0] ** k for k, v in known)
    powers = np.array(sorted(path_of(n).number for n in wanted))
    basis = levels[:, :1] ** powers
    solution = np.linalg.lstsq(basis * weight[:, None], (torques - known_torque) * weight, rcond=None)[0]
    return {f"torque_{k}": float(v) for k, v in zip(powers, solution, strict=True)}


def law_starts(wanted: set[str], pressure: Array, torque: Array) -> dict[str, float]:
    """Return start values, by name, of a torque law's parameters, from static torques [N m] at pressures [Pa]."""
    laws = [law for law in torque_laws() if law.own(dict.fromkeys(wanted, 0.0))]
    begun = {f"{law.name}_{p}": v for law in laws for p, v in law.start(pressure, torque).items()}
    return {n: v for n, v in begun.items() if n in wanted}


def torque_for_plateau(model: Model, exp: Experiment, target: float, chamber: ActuationInput) -> float:
    """Return the torque [N m] of a chamber that displaces the last station by `target` [m; angles:
    rad] in equilibrium.
    """
    joints, c = mechanics_of(model).joints, [entry.name for entry in model.chambers].index(chamber.name)
    share = model.actuation.gain[c]
    k, last = next((k, p) for k, p in enumerate(model.points) if p.name == exp.stations[-1])

    def shown(q: Array) -> Array:
        phi = mechanics_of(model).coordinates(q)
        if exp.alone in exp.further:
            rows = points_at(mechanics_of(model.with_(stations=(last,))), phi)[None]
            fixed = exp.further[exp.alone].constants[-1:]
            return modelled_rows(rows, exp.alone, fixed, planar=exp.dimension == 2)[0, 0, : len(exp.axes)]
        return phi[last.link] if exp.without_positions else mechanics_of(model).stations(phi)[0][k]

    unloaded = equilibrium(model)
    rest = shown(unloaded)

    def gap(torque: float) -> float:
        return float(np.linalg.norm(shown(unloaded + share * torque / joints.K) - rest)) - target

    from scipy.optimize import brentq

    high = float(joints.K.mean() * 0.01)
    while gap(high) < 0 and high < joints.K.mean() * 2:
        high *= 2
    return float(brentq(gap, 0.0, high)) if gap(high) > 0 else high


def plateau(exp: Experiment) -> tuple[float, float]:
    """Return a recording's pressure [Pa] farthest from 0, and the last station's displacement [m; angles: rad] under
    this pressure.
    """
    u = displacement(exp)
    if exp.pressure is None:
        stop = edges(exp).get("stop", float(exp.time[-1]))
        level = exp.level
        window = (exp.time > stop - 0.2) & (exp.time < stop)
    else:
        p = exp.pressure(exp.time)
        level = peak(p)
        window = p / level > 0.95 if level else p == 0.0
    return level, float(np.median(u[window])) if window.any() else float(u.max())


def highest_level(experiments: Sequence[Experiment]) -> float:
    """Return the largest absolute pressure [Pa] of any plateau in the recordings; 0 if there is none."""
    return max([abs(plateau(exp)[0]) for exp in experiments if exp.excitation != "release"], default=0.0)


def typical_sizes(model: Model, experiments: Sequence[Experiment]) -> dict[str, float]:
    """Return, by name, typical sizes of parameters that may start at 0, such as the torque that bends a joint by 0.1
    rad.
    """
    K = float(model.stiffness.mean())
    level = highest_level(experiments)
    torque = {f"torque_{k}": 0.1 * K / level**k for k in range(1, 10)} if level > 0 else {}
    axial = 1e-3 * float(np.mean([e.stiffness for e in model.extensions] or [1e3]))
    return {"damping": 1e-3 * K, "axial_damping": axial, "axial_gain": 10.0, **torque}


def extension_starts(model: Model, experiments: Sequence[Experiment], torques: Mapping[str, float]) -> dict[str, float]:
    """Return start values, by name, of the extensible segments' parameters. Axial gains come from the measured strain.

    Each axial gain makes the largest torque lengthen the body as measured. `torques` holds the start coefficients of
    the chambers' torque laws.
    """
    if not mechanics_of(model).lengthens:
        return {}
    starts = {name: float(np.mean([getattr(e, f) for e in model.extensions])) for name, f in ALWAYS.items()}
    starts |= {f"{e.name}.{name}": getattr(e, f) for e in model.extensions for name, f in ALWAYS.items()}
    strain, force = max([grown(e) for e in experiments], default=0.0), starts["axial_stiffness"]
    for start, chamber in zip(prefixes(model), model.chambers, strict=True):
        law = {path.number: torques[n] for n, path in paths(torques, CHAMBER)
               if path.stem == "torque" and path.owner == start.removesuffix(".")}  # fmt: skip
        traces = [t for e in experiments if (t := e.driving(chamber.name))]
        level = max([t.peak for t in traces], key=abs, default=0.0)
        torque = sum(v * level**k for k, v in law.items()) or float(chamber.torque_at(level))
        starts[f"{start}axial_gain"] = strain * force / torque if torque > 0 else 0.0
    return {"axial_gain": float(np.mean([starts[f"{s}axial_gain"] for s in prefixes(model)]))} | starts


def grown(exp: Experiment) -> float:
    """Return the axial strain of the body at its peak displacement, from arcs through its stations; at least 0."""
    complete = np.isfinite(exp.position).all(axis=(1, 2))
    length, tip = arc_lengths(exp.position[complete]), exp.position[complete, -1]
    if length.size < 10:
        return 0.0
    moved = np.linalg.norm(tip - np.median(tip[:5], axis=0), axis=1)
    return max(float(np.median(length[moved > BENT * moved.max()]) / np.median(length[:5]) - 1.0), 0.0)
