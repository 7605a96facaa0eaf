"""The model with which a search begins: stiffness, damping and a torque proportional to each input."""

from __future__ import annotations

from collections.abc import Callable, Container, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from pliant.errors import PliantError, SimulationError
from pliant.identification.chamber_parameters import ALIKE_GAINS, OF_ONE_SIGN, has_effect, prefixes
from pliant.identification.drives import pressures_at
from pliant.identification.edges import EDGES, displacement, edges
from pliant.identification.experiment import Experiment
from pliant.identification.names import path_of
from pliant.identification.parameters import Parameter, shared_name
from pliant.mechanics import Mechanics, PlanarChain, SpatialChain, mechanics_of
from pliant.model import Model
from pliant.model.parts import STATION
from pliant.selection.criterion import DETERMINED
from pliant.selection.fitted import FitSetting, FittedModel, fitted
from pliant.selection.terms import Term
from pliant.simulation.state import equilibrium, modal

Array = np.ndarray
Entry = Parameter | str
OVER_DAMPED = 2.0  # angular frequency of the first mode times the time constant, at least: the body is over-damped
QUASI_STATIC = 10.0  # angular frequency of the first mode times the time constant, above which inertia hardly shows
FAR = 0.1  # largest ratio of a softer stiffness to the fitted one for which the fit ran along a flat valley
STIFFER = 10.0  # factor between the softer stiffnesses that are tried, from the least one on
NEARLY = 1.2  # largest ratio of the cost with a softer stiffness to the cost of the fit
MOST_DOUBLINGS = 60
HARDLY = 0.2  # of the range of the input that moves most: an input that moves less hardly moves
EDGE = 0.02  # of the duration of a recording: how near edges that its motion shows are, at least
BESIDE = 0.1  # of the length: farther from the axis than a marker on a body lies
STILL, LEAST_MOVED = 0.005, 0.05  # of that: an input that moves less never moves; has a prior as close as this
LEAST_SCATTER = 1.0  # of the mean: standard deviation of alike gains, at least


def beginning(model: Model, train: Sequence[Experiment], common: Sequence[Entry]) -> list[Entry]:
    """Return the parameters with which a search begins: those in `common`, and unless these replace them stiffness,
    damping and a torque proportional to each input; of a body that lengthens also axial damping and the axial force of
    each chamber. Its axial stiffness is stated: only the ratio of the forces to it shows.
    """
    stated = {*map(name_of, common)}
    kinds = {shared_name(name.removesuffix("_*")) for name in stated}
    names = [n for n in ("stiffness", "damping") if n not in kinds and "body_stiffness" not in kinds]
    if any(e.excitation != "release" for e in train):
        names += [n for n in torque_names(model) if n not in stated]
    if mechanics_of(model).lengthens and not model.chambers[0].signs:
        names += [n for n in ("axial_damping",) if n not in kinds]
        names += [f"{start}axial_gain" for start, chamber in zip(prefixes(model), model.chambers, strict=True)
                  if chamber.uses("axial_gain") and f"{start}axial_gain" not in stated]  # fmt: skip
    return [*common, *names, *(p for e in train for p in edge_limits(e) if p.name not in stated)]


def name_of(entry: Entry) -> str:
    """Return the name of a parameter that is stated by its name alone or with its properties."""
    return entry if isinstance(entry, str) else entry.name


def edge_limits(exp: Experiment) -> list[Parameter]:
    """Return the times at which a pressure switches that was not measured, with the bounds of a search: a pressure does
    not start before the first frame of a body at rest, which would then be at rest under it, whenever it started.
    """
    first, last, span = float(exp.time[0]), float(exp.time[-1]), float(np.ptp(exp.time))
    earliest = {"start": first if exp.start.from_rest else first - span, "stop": first - span}
    return [Parameter(f"{exp.name}.{edge}", lower=earliest[edge], upper=last + span) for edge in fitted_edges(exp)]


def edge_times(exp: Experiment) -> list[Parameter]:
    """Return the times at which a pressure switches that was not measured, as near to those that the motion shows as it
    takes to half its peak. A first model without the right law would move them anywhere.
    """
    if not (names := fitted_edges(exp)):
        return []
    first, last, shown = float(exp.time[0]), float(exp.time[-1]), edges(exp)
    high = exp.time[displacement(exp) >= 0.5 * exp.travel]
    half = {"start": high[0], "stop": high[-1]}
    near = {edge: max(abs(float(half[edge]) - shown[edge]), EDGE * (last - first)) for edge in names}
    return [Parameter(f"{exp.name}.{edge}", lower=max(shown[edge] - near[edge], first),
                      upper=min(shown[edge] + near[edge], last)) for edge in names]  # fmt: skip


def fitted_edges(exp: Experiment) -> list[str]:
    """Return which edges of a pressure that was not measured are fitted to a recording."""
    return [edge for edge in EDGES if f"{exp.name}.{edge}" in exp.own_parameters]


def torque_names(model: Model) -> list[str]:
    """Return the names of the parameters that scale the torque of each input: gains in space, coefficients in a plane.

    A chamber in the plane that has a torque law other than a linear one keeps it.
    """
    return TORQUE_NAMES[type(mechanics_of(model))](model)


def gain_names(model: Model) -> list[str]:
    """Return the names of the gains about x and y of each input of a model in space that has several."""
    return [f"{start}gain_{axis}" for start in prefixes(model) if start for axis in "xy"]


def coefficient_names(model: Model) -> list[str]:
    """Return the names of the coefficients of linear torque laws of a model in a plane."""
    chambers = zip(prefixes(model), model.chambers, strict=True)
    return [f"{start}torque_1" for start, c in chambers if has_effect("torque_1", c) and not c.torque.any()]


TORQUE_NAMES: dict[type[Mechanics], Callable[[Model], list[str]]] = {
    PlanarChain: coefficient_names, SpatialChain: gain_names,
}


def determined(parent: FittedModel, setting: FitSetting) -> FittedModel:
    """Return a fit of the first model in which every parameter is determined, rests on a prior or is held.

    An input that hardly moves in the recordings gets the size of the input that shows most as a prior. What still has
    no effect is held at its value. If the recordings do not determine the stiffness, it is held too: stiffness, damping
    and torque then have a common scale that no recording of this body shows, and the other parameters are determined
    relative to the stiffness.
    """
    parent = with_alike(parent, setting)
    errors, value = parent.standard_errors, parent.values.get("stiffness", 0.0)
    fixed = {name: "held: no effect on these recordings" for name, error in errors.items() if error is None}
    error = errors.get("stiffness", 0.0)
    hidden = error is None  # far along a flat valley, rounding hides the effect of the other parameters too
    if hidden:
        fixed = {"stiffness": "held: the recordings show its ratio to torque and damping alone"}
    elif error is not None and error > DETERMINED * value:
        fixed["stiffness"] = f"held: the recordings show only {value:.3g} +- {error:.2g}"
    if not fixed or not {p.name for p in parent.problem.free} - set(fixed):
        return parent  # a fit needs a free parameter

    def held(parameters: Sequence[Parameter]) -> FittedModel:
        listed = [replace(p, free=False, source=fixed[p.name]) if p.name in fixed else p for p in parameters]
        return fitted(setting, parent.model, listed, prior_weight=parent.problem.size)

    fit = (softer(parent, held) if "stiffness" in fixed else None) or held(parent.parameters)
    return determined(fit, setting) if hidden else fit


def softer(parent: FittedModel, held: Callable[[Sequence[Parameter]], FittedModel]) -> FittedModel | None:
    """Return a fit like `parent` with a much softer stiffness, which is held; None if none follows the recordings
    nearly as well.

    Where recordings show only the ratios of stiffness, damping and torque, a fit may end at any stiffness, also at one
    that no body has. The softest stiffness at which inertia hardly shows is tried first, then stiffer ones. Damping and
    torque begin in the ratios of the parent. `held` fits parameters with the stiffness held.
    """
    stiffness, damping = (parent.values.get(name, 0.0) for name in ("stiffness", "damping"))
    if stiffness <= 0 or damping <= 0:
        return None
    factor = least_stiffness(parent.model, damping / stiffness, QUASI_STATIC) / stiffness
    while factor < FAR:
        with suppress(PliantError):
            fit = held([replace(p, value=p.value * factor) if p.value and on_scale(p) else p
                        for p in parent.parameters])  # fmt: skip
            if fit.cost <= NEARLY * parent.cost:
                return fit
        factor *= STIFFER
    return None


def on_scale(parameter: Parameter) -> bool:
    """Return whether a parameter of the first model goes with the common scale of stiffness, damping and torque."""
    path = path_of(parameter.name)
    gains = [name for kind in ALIKE_GAINS if kind != OF_ONE_SIGN for name in kind]
    return path.own in ("stiffness", "damping", *gains) or (path.quantity.per == "power" and parameter.free)


def first_mode(model: Model) -> tuple[float, Array]:
    """Return angular frequency [rad/s] and mass-normalised shape (N,) of the lowest mode without inputs."""
    omega, shapes, _ = modal(model, *mechanics_of(model).linear_parts(equilibrium(model)))
    return float(omega[0]), shapes[:, 0]


def least_stiffness(model: Model, constant: float, quickness: float = OVER_DAMPED) -> float:
    """Return the least stiffness [N m/rad] of joints, no softer than gravity, with which the angular frequency of the
    first mode times the time constant [s] of its slow motion reaches `quickness`; by default that of an over-damped
    body.
    """
    weight = float(model.link_mass.sum() * np.linalg.norm(model.gravity)) * model.length / 2.0
    stiffness = max(weight * model.n, 1e-9)
    for _ in range(MOST_DOUBLINGS):
        with suppress(SimulationError):
            if first_mode(model.with_(stiffness=stiffness))[0] * constant >= quickness:
                break
        stiffness *= 2.0
    return stiffness


def scale_of(parameters: Sequence[Parameter], stated: Container[str]) -> list[Term]:
    """Return the term that frees the stiffness, if the parameters of a fit hold it and it is not `stated`.

    Beside other terms, recordings may show the scale of stiffness, damping and torque that they did not show to the
    first model.
    """
    held = [p.value for p in parameters if p.name == "stiffness" and not p.free and p.value]
    if "stiffness" in stated or not held:
        return []
    value = held[0]
    return [Term("stiffness", "free stiffness", (Parameter("stiffness", value),), {"stiffness": value})]


class GainPrior(NamedTuple):
    """The prior of a gain, as fields of its `Parameter`: mean and standard deviation (SI), and where they are from."""

    prior: float
    prior_std: float
    source: str


def gain_prior(kind: tuple[str, ...], shown: Mapping[str, Sequence[float]]) -> GainPrior:
    """Return the prior of gains of a `kind` that the recordings do not determine, from the values `shown` by input that
    they determine: of one sign, about their mean; else about zero, with the size of the largest.
    """
    if kind == OF_ONE_SIGN:
        mean, scatter = float(np.mean(list(shown.values()))), float(np.std(list(shown.values())))
        return GainPrior(mean, max(scatter, LEAST_SCATTER * abs(mean)),
                         f"not determined; a prior from the gains of {', '.join(shown)}")  # fmt: skip
    largest = max(shown, key=lambda owner: float(np.linalg.norm(shown[owner])))
    size = float(np.linalg.norm(shown[largest]))
    return GainPrior(0.0, size, f"not determined; a prior of the size that {largest} shows")


def with_alike(parent: FittedModel, setting: FitSetting) -> FittedModel:
    """Return a fit in which the gains of inputs that the recordings do not determine rest on a prior: zero, with the
    size of the largest gain that they determine; for axial gains, which have one sign, the mean of the gains that they
    determine, with the scatter of these. Differences between recordings pass for the gain of an input that hardly
    moves, which therefore counts as not determined, however small its standard error; the less it moves, the closer the
    prior.
    """
    priors: dict[str, GainPrior] = {}
    still = hardly_moving(parent.model, setting.experiments)
    for kind in ALIKE_GAINS:
        values, doubts = dict[str, list[float]](), dict[str, float]()
        for p in parent.problem.free:
            owner, _, parameter = p.name.rpartition(".")
            if owner and parameter in kind and not p.prior_std:
                error = parent.standard_errors[p.name]
                values.setdefault(owner, []).append(parent.values[p.name])
                error = np.inf if error is None or owner in still else error
                doubts[owner] = float(np.hypot(doubts.get(owner, 0.0), error))
        sizes = {owner: float(np.linalg.norm(v)) for owner, v in values.items()}
        vague = [owner for owner, size in sizes.items() if doubts[owner] > DETERMINED * size]
        shown = [owner for owner in sizes if owner not in vague]
        if shown:
            prior = gain_prior(kind, {owner: values[owner] for owner in shown})
            priors |= {f"{owner}.{parameter}": prior._replace(prior_std=still.get(owner, 1.0) * prior.prior_std)
                       for owner in vague for parameter in kind}  # fmt: skip
    if not priors:
        return parent
    parameters = [replace(p, **priors[p.name]._asdict()) if p.name in priors else p for p in parent.parameters]
    return fitted(setting, parent.model, parameters, prior_weight=parent.prior_weight)


def hardly_moving(model: Model, train: Sequence[Experiment]) -> dict[str, float]:
    """Return the inputs that move by less than a fifth of the range of the input of their kind that moves most, in the
    frames of all recordings that are compared, each with its range over that fifth; 1 for one that never moves, since
    no difference between recordings passes for its gain.
    """
    compared = np.concatenate([np.isfinite(e.compared).any(axis=(1, 2)) for e in train])
    ranges = np.ptp(pressures_at(model, train)[compared], axis=0)
    kinds, hardly = np.array(model.actuation.kinds), dict[str, float]()
    for name, kind, moved in zip(model.actuation.names, kinds, ranges, strict=True):
        share = float(moved / (HARDLY * max(ranges[kinds == kind].max(), 1e-300)))
        if share < 1.0:
            hardly[name] = max(share, LEAST_MOVED) if share > STILL else 1.0
    return hardly


def with_places(parent: FittedModel, setting: FitSetting) -> FittedModel:
    """Return a fit in which a marker beside the axis rests on a prior, near the axis, if it would lie farther away than
    a tenth of the body's length or the recordings do not determine it.
    """
    near, errors = BESIDE * parent.model.length, parent.standard_errors

    def loose(p: Parameter) -> bool:
        error = errors.get(p.name)
        sure = error is not None and error <= near
        path = path_of(p.name)
        beside = path.part is STATION and path.own in ("across", "aside")
        return p.free and not p.prior_std and beside and not (sure and abs(parent.values[p.name]) <= near)

    if not any(map(loose, parent.parameters)):
        return parent
    source = "not determined; a prior near the axis"
    parameters = [replace(p, prior=0.0, prior_std=near, value=0.0, source=source) if loose(p) else p
                  for p in parent.parameters]  # fmt: skip
    return fitted(setting, parent.model, parameters, prior_weight=parent.prior_weight)
