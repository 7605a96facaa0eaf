"""The first model of a body that follows its inputs slowly, without ringing: in space, its settled shapes come first.

A recording without ringing does not show the scale of the stiffness, and an estimate of it from the motion leads far
off. But its frames are nearly settled shapes under inputs behind one lag. A few of them determine gains, axial gains
and the places of markers in seconds, and the lag gives the damping; a fit of the motion then begins near its optimum.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import ClassVar, Self

import numpy as np

from pliant.identification.chamber_parameters import prefixes
from pliant.identification.experiment import Experiment
from pliant.identification.initial_guess import free_decay
from pliant.identification.parameters import Parameter, apply, each_joint, shared_name
from pliant.identification.prediction import fit_step
from pliant.identification.starts import AtRest
from pliant.mechanics import Mechanics, PlanarChain, SpatialChain, mechanics_of
from pliant.model import Model
from pliant.selection.criterion import MATERIAL, parts_of, score_of
from pliant.selection.first_model import Entry, beginning, first_mode, least_stiffness, name_of, with_alike, with_places
from pliant.selection.fitted import FitSetting, FittedModel, fitted
from pliant.selection.terms import Term
from pliant.simulation import Pulse, Trace
from pliant.simulation.drive import behind_lags

Array = np.ndarray
CONSTANTS, RINGS = 20, 10  # time constants, and frequencies of a damped oscillation, that are tried
RATIOS = (0.05, 0.2)  # damping ratios that are tried
EXPLAINED = 0.5  # of the variance of the motion that the inputs behind one lag must explain
NO_WORSE = 1.02  # error behind one lag over that behind a damped oscillation, at most
GAIN = 0.98  # error behind one lag over that without any, at most
FRAMES = 40  # settled shapes of each recording
STATIC_EVALUATIONS = 30
TURNED = 0.1  # rad, typical rotation of a joint under the highest input
SMALL = 1e-3  # of that, at the start


def time_constant(train: Sequence[Experiment], names: Sequence[str]) -> float | None:
    """Return the time constant [s] of the first-order lag with which the last station follows the inputs `names`; None
    if these explain less than half of the motion's variance, or if a damped oscillation or no lag explains it as well.
    """
    spacing = max(float(np.median(np.diff(e.time))) for e in train)
    span = max(float(np.ptp(e.time)) for e in train)
    lags = np.geomspace(0.1 * spacing, 0.1 * span, CONSTANTS)
    omega = np.geomspace(2 * np.pi / span, np.pi / (2.0 * spacing), RINGS)
    poles = [w * complex(-z, np.sqrt(1.0 - z * z)) for w in omega for z in RATIOS]
    moved, now, behind = moved_and_inputs(train, names, [*lags.tolist(), *(-1.0 / p for p in poles)])
    errors = [left_by([root.real], moved) for root in behind[: lags.size]]
    best = int(np.argmin(errors))
    lagging = left_by([now, behind[best].real], moved)
    ringing = min(left_by([root.real, root.imag], moved) for root in behind[lags.size :])
    total = float(np.sum((moved - moved.mean(axis=0)) ** 2))
    if lags[best] < spacing or errors[best] > min(EXPLAINED * total, GAIN**2 * errors[0]):
        return None
    return None if lagging > NO_WORSE**2 * ringing else float(lags[best])


def moved_and_inputs(
    train: Sequence[Experiment], names: Sequence[str], constants: Sequence[complex],
) -> tuple[Array, Array, list[Array]]:
    """Return the positions (N, d) [m] of the last station in the N frames of all recordings that show it, the C inputs
    `names` there (N, C) [SI], and these behind each of several lags [s].
    """
    moved, now, behind = [], [], []
    for e in train:
        complete = np.isfinite(e.last_station).all(axis=1)
        sources = [e.driving(name) or Pulse(0.0) for name in names]
        moved.append(e.last_station[complete])
        now.append(np.stack([one(e.time) for one in sources], axis=1)[complete])
        behind.append([one[complete] for one in behind_lags(e.time, sources, constants)])
    return np.concatenate(moved), np.concatenate(now), [np.concatenate(one) for one in zip(*behind, strict=True)]


def left_by(columns: Sequence[Array], moved: Array) -> float:
    """Return the sum of squares [m^2] that a linear map of columns (N, C) leaves of positions (N, d) [m]."""
    table = np.hstack(columns)
    table = (table - table.mean(axis=0)) / np.maximum(table.std(axis=0), 1e-300)
    A = np.column_stack([np.ones(len(table)), table])
    return float(np.sum((moved - A @ np.linalg.lstsq(A, moved, rcond=1e-6)[0]) ** 2))


def settled(exp: Experiment, constant: float = 0.0, most: int = FRAMES) -> Experiment:
    """Return up to `most` frames of an experiment as settled shapes under its inputs, behind a lag [s] if any."""
    complete = np.flatnonzero(np.isfinite(exp.compared).all(axis=(1, 2)))
    rows = complete[np.unique(np.linspace(0, complete.size - 1, most).astype(int))]
    sources = list(exp.traces.values())
    behind = (behind_lags(exp.time, sources, [constant])[0] if constant
              else np.stack([one(exp.time) for one in sources], axis=1))
    traces = {name: Trace(exp.time[rows], behind[rows, k]) for k, name in enumerate(exp.traces)}
    few = replace(exp, start=AtRest(), warm_up=0.0).of_frames(np.isin(np.arange(exp.time.size), rows))
    return replace(few, poses=True, drives={n: t for n, t in traces.items() if n}, pressure=next(iter(traces.values())))


def of_inputs_alone(train: Sequence[Experiment]) -> bool:
    """Return whether all recordings show positions under measured inputs alone."""
    return all(e.excitation == "trace" and not (e.poses or e.without_positions or e.forces or e.further or e.base)
               for e in train)  # fmt: skip


def may_be_slow(train: Sequence[Experiment]) -> bool:
    """Return whether all recordings show positions under measured inputs alone, without a free decay."""
    return of_inputs_alone(train) and all(free_decay(e) is None for e in train)


@dataclass(frozen=True)
class SlowBody:
    """Recordings of a body in a plane that follows its inputs with a time constant [s]. Its chain has no settled
    shapes: the first model is fitted to the motion.
    """

    setting: FitSetting
    constant: float
    factors: ClassVar[tuple[float, ...]] = (1.0,)  # on the least stiffness, which are tried

    @classmethod
    def shown_in(cls, setting: FitSetting, constant: float) -> Self:
        """Return the body that the recordings of `setting` show, with its time constant [s]."""
        return cls(setting, constant)

    @property
    def sentence(self) -> str:
        """Return what is known of the body, as a line of progress."""
        return f"the body follows its inputs within {self.constant:.2g} s without ringing"

    def briefly(self, experiments: Sequence[Experiment]) -> Self:
        """Return the same body with other recordings of it, and with fits of a single step."""
        return replace(self, setting=replace(self.setting, experiments=tuple(experiments), evaluations=1))

    def first_model(
        self, model: Model, common: Sequence[Entry], lengthening: Term | None, time_step: float | None,
    ) -> tuple[FitSetting, FittedModel, list[Term]]:
        """Return the setting of all fits of a search, the model with which it begins, fitted to the recordings, and the
        term that lengthens the body if the recordings, or their settled shapes, are then predicted better from each
        other.
        """
        least = least_stiffness(model, self.constant)
        tried = (self.begun(model, common, factor * least, time_step) for factor in self.factors)
        best, chosen = min(tried, key=lambda fit: fit.cost), []
        if lengthening is not None:
            stiffness = float(apply(best.model, best.values).stiffness.mean())
            longer = self.begun(lengthening.model(model), common, stiffness, time_step)
            if score_of(longer, parts_of(longer)) < (1.0 - MATERIAL) * score_of(best, parts_of(best)):
                best, chosen = longer, [lengthening]
        fit = self.of_motion(best, common, time_step)
        return replace(self.setting, time_step=fit.problem.time_step), fit, chosen

    def begun(
        self, model: Model, common: Sequence[Entry], stiffness: float, time_step: float | None,
    ) -> FittedModel:
        """Return the first model, fitted to the motion.

        The joints keep the `stiffness` [N m/rad] unless `common` states one; the damping starts from the time constant.
        """
        model = model.with_(stiffness=stiffness)
        known = {"stiffness": stiffness, **damping_starts(model, self.constant)}
        parameters = [
            p if p.value is not None or (kind := shared_name(p.name)) not in known else p.with_(value=known[kind])
            for p in first_parameters(model, self.setting.experiments, common)
        ]  # fmt: skip
        return with_alike(*self.moved(model, held_stiffness(parameters, common), time_step))

    def moved(
        self, model: Model, parameters: Sequence[Parameter], time_step: float | None, prior_weight: float | None = None,
    ) -> tuple[FittedModel, FitSetting]:
        """Return the fit of the motion, and its setting, with the step that suits the start values if none is given."""
        values = {p.name: p.value for p in parameters if p.value is not None}
        step = time_step or fit_step(model, values, self.setting.experiments)
        setting = replace(self.setting, time_step=step)
        return fitted(setting, model, parameters, prior_weight=prior_weight), setting

    def of_motion(self, best: FittedModel, _common: Sequence[Entry], _time_step: float | None) -> FittedModel:
        """Return the fit of the motion that begins with a fit of `begun`, which is one already."""
        return best


@dataclass(frozen=True)
class SlowSpatialBody(SlowBody):
    """Recordings of a body in space that follows its inputs with a time constant, and their settled shapes."""

    shapes: FitSetting
    factors: ClassVar[tuple[float, ...]] = (1.0, 8.0)

    @classmethod
    def shown_in(cls, setting: FitSetting, constant: float) -> Self:
        """Return the body that the recordings of `setting` show, with its time constant [s] and its settled shapes."""
        shapes = tuple(settled(e, constant) for e in setting.experiments)
        return cls(setting, constant, replace(setting, experiments=shapes))

    @property
    def sentence(self) -> str:
        """Return what is known of the body, and that settled shapes come first."""
        return f"{super().sentence}: settled shapes come first"

    def briefly(self, experiments: Sequence[Experiment]) -> Self:
        """Return the same body with other recordings of it, and with fits of a single step."""
        return replace(super().briefly(experiments), shapes=replace(self.shapes, evaluations=1))

    def begun(
        self, model: Model, common: Sequence[Entry], stiffness: float, time_step: float | None,
    ) -> FittedModel:
        """Return the fit of the first model to the settled shapes, with `stiffness` [N m/rad] for its joints unless
        `common` states one.
        """
        del time_step
        model = model.with_(stiffness=stiffness)
        scales = gain_scales(model, self.setting.experiments)

        def begun(p: Parameter) -> Parameter:
            if p.value is None and p.name in scales:
                return p.with_(value=SMALL * scales[p.name], scale=scales[p.name])
            stiff = p.value is None and shared_name(p.name) == "stiffness"
            return p.with_(value=stiffness, free=False) if stiff else p

        listed = [begun(p) for p in first_parameters(model, self.setting.experiments, common)]
        first = fitted(self.shapes, model, listed, evaluations=0)
        acting = {p.name for p, column in zip(first.problem.free, first.jacobian.T, strict=True) if column.any()}
        parameters = [replace(p, free=p.name in acting) for p in first.parameters]
        parent = fitted(self.shapes, first.model, parameters, evaluations=STATIC_EVALUATIONS)
        return with_places(with_alike(parent, self.shapes), self.shapes)

    def of_motion(self, best: FittedModel, common: Sequence[Entry], time_step: float | None) -> FittedModel:
        """Return the fit of the motion that begins with the values of the settled shapes. Damping that `common` does
        not state follows from the time constant.
        """
        model = apply(best.model, best.values)
        asked = {p.name: p for p in first_parameters(model, self.setting.experiments, common)}
        known = damping_starts(model, self.constant)
        parameters = []
        for p in best.parameters:
            parameter, value = asked.get(p.name, p), best.values[p.name]
            if parameter.value is None:
                value = known.get(shared_name(p.name), value)
            parameters.append(p.with_(value=float(np.clip(value, p.lower, p.upper)), free=parameter.free))
        return self.moved(best.model, held_stiffness(parameters, common), time_step, best.prior_weight)[0]


def slow_body(setting: FitSetting, model: Model) -> SlowBody | None:
    """Return the recordings of a setting if they show a body that follows its inputs slowly, else None."""
    if not may_be_slow(setting.experiments):
        return None
    constant = time_constant(setting.experiments, model.actuation.names)
    if constant is None:
        return None
    return SLOW_BODIES[type(mechanics_of(model))].shown_in(setting, constant)


SLOW_BODIES: dict[type[Mechanics], type[SlowBody]] = {PlanarChain: SlowBody, SpatialChain: SlowSpatialBody}


def held_stiffness(parameters: Sequence[Parameter], common: Sequence[Entry]) -> list[Parameter]:
    """Return the parameters with the stiffness held, unless `common` names it."""
    if "stiffness" in {*map(name_of, common)}:
        return list(parameters)
    source = "held: the recordings show its ratio to torque and damping alone"
    return [p.with_(free=False, source=source) if p.name == "stiffness" else p for p in parameters]


def damping_starts(model: Model, constant: float) -> dict[str, float]:
    """Return the damping of joints [N m s/rad] and of segments that lengthen [N s] with which a body moves with a time
    constant [s], by the name of the parameter.
    """
    axial = float(np.mean([e.stiffness for e in model.extensions] or [0.0]))
    return {"damping": joint_damping(model, constant), "axial_damping": constant * axial}


def gain_scales(model: Model, train: Sequence[Experiment]) -> dict[str, float]:
    """Return the gains of chambers about x and y that turn a joint by `TURNED` under their highest pressure, by the
    name of the parameter.
    """
    scales = dict[str, float]()
    for start, chamber in zip(prefixes(model), model.chambers, strict=True):
        level = max((abs(t.peak) for e in train if (t := e.driving(chamber.name))), default=0.0)
        torque = 0.0 if chamber.signs else abs(float(chamber.torque_at(level))) or 1.0
        scales |= {f"{start}gain_{axis}": TURNED * float(model.stiffness.mean()) / torque for axis in "xy" if torque}
    return scales


def first_parameters(model: Model, train: Sequence[Experiment], common: Sequence[Entry]) -> list[Parameter]:
    """Return the parameters of the first model, those of joints one for each joint."""
    listed = [Parameter(e) if isinstance(e, str) else e for e in beginning(model, train, common)]
    return each_joint(listed, model.n)


def joint_damping(model: Model, constant: float) -> float:
    """Return the damping [N m s/rad] of joints with which the first mode decays with the time constant [s]."""
    omega, shape = first_mode(model)
    one, none = (mechanics_of(model.with_(damping=value)).joints.D for value in (1.0, 0.0))
    return float((constant * omega**2 + 1.0 / constant) / (shape @ ((one - none) * shape)))
