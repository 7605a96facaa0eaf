"""The first model of a body that follows its inputs slowly, without ringing: in space, its settled shapes come first.

Nothing that rings shows no scale of the stiffness, and an estimate of it from the motion leads far off. But the frames
of such recordings are nearly settled shapes under inputs behind one lag. A few of them determine gains, axial gains and
the places of markers in seconds, and the lag gives the damping; a fit of the motion then begins near its optimum.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from pliant.errors import SimulationError
from pliant.identification.experiment import Experiment
from pliant.identification.fit_step import fit_step
from pliant.identification.initial_guess import free_decay
from pliant.identification.lagged_inputs import behind_lags
from pliant.identification.names import stem_of
from pliant.identification.parameters import Parameter, apply, each_joint, shared_name
from pliant.identification.starts import AtRest
from pliant.mechanics import mechanics_of
from pliant.model import Model
from pliant.selection.criterion import criterion, groups_of, left_out, noise_of
from pliant.selection.first_model import Entry, beginning, with_alike, with_places
from pliant.selection.fitted import FitSetting, FittedModel, fitted
from pliant.selection.terms import Term
from pliant.simulation import Pulse, Trace
from pliant.simulation.state import equilibrium, modal

Array = np.ndarray
CONSTANTS, RINGS = 20, 10  # time constants, and frequencies of a damped oscillation, that are tried
RATIOS = (0.05, 0.2)  # damping ratios that are tried
EXPLAINED = 0.5  # of the variance of the motion that the inputs behind one lag must explain
NO_WORSE = 1.02  # error behind one lag over that behind a damped oscillation, at most
GAIN = 0.98  # error behind one lag over that without any, at most
FRAMES = 40  # settled shapes of each recording
STATIC_EVALUATIONS = 30
APART = 2.0  # angular frequency of the first mode times the time constant, at least: the body is over-damped
SOFTER = (1.0, 8.0)  # factors on the least stiffness: the settled shapes choose
TURNED = 0.1  # rad, typical rotation of a joint under the highest input
SMALL = 1e-3  # of that, at the start
MOST_DOUBLINGS = 60
MATERIAL = 0.03  # of the criterion: a smaller gain does not make the body lengthen


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
    errors = [left_by([one.real], moved) for one in behind[: lags.size]]
    best = int(np.argmin(errors))
    lagging = left_by([now, behind[best].real], moved)
    ringing = min(left_by([one.real, one.imag], moved) for one in behind[lags.size :])
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
        seen = np.isfinite(e.last_station).all(axis=1)
        sources = [e.driving(name) or Pulse(0.0) for name in names]
        moved.append(e.last_station[seen])
        now.append(np.stack([one(e.time) for one in sources], axis=1)[seen])
        behind.append([one[seen] for one in behind_lags(e.time, sources, constants)])
    return np.concatenate(moved), np.concatenate(now), [np.concatenate(one) for one in zip(*behind, strict=True)]


def left_by(columns: Sequence[Array], moved: Array) -> float:
    """Return the sum of squares [m^2] that a linear map of columns (N, C) leaves of positions (N, d) [m]."""
    table = np.hstack(columns)
    table = (table - table.mean(axis=0)) / np.maximum(table.std(axis=0), 1e-300)
    A = np.column_stack([np.ones(len(table)), table])
    return float(np.sum((moved - A @ np.linalg.lstsq(A, moved, rcond=1e-6)[0]) ** 2))


def settled(exp: Experiment, constant: float) -> Experiment:
    """Return up to `FRAMES` frames of an experiment as settled shapes under its inputs behind a lag [s]."""
    seen = np.flatnonzero(np.isfinite(exp.compared).all(axis=(1, 2)))
    rows = seen[np.unique(np.linspace(0, seen.size - 1, FRAMES).astype(int))]
    (behind,) = behind_lags(exp.time, list(exp.traces.values()), [constant])
    traces = {name: Trace(exp.time[rows], behind[rows, k]) for k, name in enumerate(exp.traces)}
    few = replace(exp, start=AtRest(), warm_up=0.0).of_frames(np.isin(np.arange(exp.time.size), rows))
    return replace(few, poses=True, drives={n: t for n, t in traces.items() if n}, pressure=next(iter(traces.values())))


def may_be_slow(train: Sequence[Experiment]) -> bool:
    """Return whether all recordings show positions under measured inputs alone, without a free decay."""
    plain = all(e.excitation == "trace" and not (e.poses or e.without_positions or e.forces or e.further or e.base)
                for e in train)  # fmt: skip
    return plain and all(free_decay(e) is None for e in train)


@dataclass(frozen=True)
class SlowBody:
    """Recordings of a body that follows its inputs with a time constant [s], and their settled shapes: none in a plane,
    where a chain has no poses.
    """

    setting: FitSetting
    shapes: FitSetting | None
    constant: float

    @classmethod
    def of(cls, setting: FitSetting, model: Model) -> SlowBody | None:
        """Return the recordings of a setting if they show such a body, else None."""
        if not may_be_slow(setting.experiments):
            return None
        constant = time_constant(setting.experiments, model.actuation.names)
        if constant is None:
            return None
        if model.space is None:
            return cls(setting, None, constant)
        shapes = tuple(settled(e, constant) for e in setting.experiments)
        return cls(setting, replace(setting, experiments=shapes), constant)

    def first_model(
        self, model: Model, common: Sequence[Entry], lengthening: Term | None, time_step: float | None,
    ) -> tuple[FitSetting, FittedModel, list[Term]]:
        """Return the setting of all fits of a search, the model with which it begins, fitted to the recordings, and the
        term that lengthens the body if the recordings, or their settled shapes, are then predicted better from each
        other.
        """
        least = least_stiffness(model, self.constant)
        if self.shapes is None:
            fits = [self.in_plane(one, common, least, time_step)
                    for one in (model, *([] if lengthening is None else [lengthening.model(model)]))]  # fmt: skip
            longer = len(fits) > 1 and score(fits[1]) < (1.0 - MATERIAL) * score(fits[0])
            best = fits[longer]
            setting = replace(self.setting, time_step=best.problem.time_step)
            return setting, best, [lengthening] if longer and lengthening else []
        best = min((self.static(model, common, factor * least) for factor in SOFTER), key=lambda fit: fit.cost)
        chosen = []
        if lengthening is not None:
            stiffness = float(apply(best.model, best.values).stiffness.mean())
            longest = self.static(lengthening.model(model), common, stiffness)
            if score(longest) < (1.0 - MATERIAL) * score(best):
                best, chosen = longest, [lengthening]
        setting = self.stepped(best.model, parameters := self.moving(best, common), time_step)
        return setting, fitted(setting, best.model, parameters, prior_weight=best.prior_weight), chosen

    def stepped(self, model: Model, parameters: Sequence[Parameter], time_step: float | None) -> FitSetting:
        """Return the setting of fits of the motion, with the step that suits the start values if none is given."""
        values = {p.name: p.value for p in parameters if p.value is not None}
        return replace(self.setting, time_step=time_step or fit_step(model, values, self.setting.experiments))

    def in_plane(
        self, model: Model, common: Sequence[Entry], stiffness: float, time_step: float | None,
    ) -> FittedModel:
        """Return the fit of the first model to the motion in a plane, with the `stiffness` [N m/rad] of its joints held
        unless `common` states one, and damping from the time constant at the start.
        """
        model = model.with_(stiffness=stiffness)
        known = {"stiffness": stiffness, "damping": joint_damping(model, self.constant),
                 "axial_damping": self.constant * float(np.mean([e.stiffness for e in model.extensions] or [0.0]))}
        listed = [p if p.value is not None or (kind := shared_name(p.name)) not in known
                  else p.with_(value=known[kind], free=p.free and kind != "stiffness")
                  for p in first_parameters(model, self.setting.experiments, common)]  # fmt: skip
        setting = self.stepped(model, listed, time_step)
        return with_alike(fitted(setting, model, listed), setting)

    def static(self, model: Model, common: Sequence[Entry], stiffness: float) -> FittedModel:
        """Return the fit of the first model to the settled shapes, with `stiffness` [N m/rad] for its joints unless
        `common` states one.
        """
        model = model.with_(stiffness=stiffness)
        listed = first_parameters(model, self.setting.experiments, common)
        shapes = self.shapes or self.setting
        first = fitted(shapes, model, [self.begun(p, model) for p in listed], evaluations=0)
        acting = {p.name for p, column in zip(first.problem.free, first.jacobian.T, strict=True) if column.any()}
        parameters = [replace(p, free=p.name in acting) for p in first.parameters]
        parent = fitted(shapes, first.model, parameters, evaluations=STATIC_EVALUATIONS)
        return with_places(with_alike(parent, shapes), shapes)

    def begun(self, parameter: Parameter, model: Model) -> Parameter:
        """Return a parameter of the first model with its start value: stiffness held, gains without torque."""
        kind, name = shared_name(parameter.name), parameter.name
        if parameter.value is not None:
            return parameter
        if kind == "stiffness":
            return parameter.with_(value=float(model.stiffness.mean()), free=False)
        chamber = next((c for c in model.chambers if name.startswith(f"{c.name}.")), model.chambers[0])
        if stem_of(name) not in ("gain_x", "gain_y") or chamber.signs:
            return parameter
        level = max((abs(t.peak) for e in self.setting.experiments if (t := e.driving(chamber.name))), default=0.0)
        torque = abs(float(chamber.torque_at(level))) or 1.0
        scale = TURNED * float(model.stiffness.mean()) / torque
        return parameter.with_(value=SMALL * scale, scale=scale)

    def moving(self, static: FittedModel, common: Sequence[Entry]) -> list[Parameter]:
        """Return the parameters of a fit of the motion, at the values of the settled shapes: damping follows from the
        time constant, and the stiffness is held unless `common` states it.
        """
        model = apply(static.model, static.values)
        free = {p.name for p in first_parameters(model, self.setting.experiments, common) if p.free}
        values = {**static.values, "damping": joint_damping(model, self.constant)}
        values |= {p.name: self.constant * model.extensions[0].stiffness for p in static.parameters
                   if shared_name(p.name) == "axial_damping"}  # fmt: skip
        held = {"stiffness"} - {e if isinstance(e, str) else e.name for e in common}
        return [
            replace(p, value=float(np.clip(values[p.name], p.lower, p.upper)), free=p.name in free - held,
                    source="held: the recordings show its ratio to torque and damping alone" if p.name in held
                    else p.source)
            for p in static.parameters
        ]  # fmt: skip


def first_parameters(model: Model, train: Sequence[Experiment], common: Sequence[Entry]) -> list[Parameter]:
    """Return the parameters of the first model, those of joints one for each joint."""
    listed = [Parameter(e) if isinstance(e, str) else e for e in beginning(model, train, common)]
    return each_joint(listed, model.n)


def score(fit: FittedModel) -> float:
    """Return the criterion of a fit: the error of parts of the recordings as predicted from the others."""
    groups = groups_of(fit)
    return criterion(fit.problem, left_out(fit.linear, groups, noise_of(fit)), groups)


def first_mode(model: Model) -> tuple[float, Array]:
    """Return angular frequency [rad/s] and mass-normalised shape (N,) of the lowest mode without inputs."""
    omega, shapes, _ = modal(model, *mechanics_of(model).linear_parts(equilibrium(model)))
    return float(omega[0]), shapes[:, 0]


def least_stiffness(model: Model, constant: float) -> float:
    """Return the least stiffness [N m/rad] of joints with which the body is over-damped if its slow motion has the time
    constant [s], and no softer than gravity.
    """
    weight = float(model.link_mass.sum() * np.linalg.norm(model.gravity)) * model.length / 2.0
    stiffness = max(weight * model.n, 1e-9)
    for _ in range(MOST_DOUBLINGS):
        with suppress(SimulationError):
            if first_mode(model.with_(stiffness=stiffness))[0] * constant >= APART:
                break
        stiffness *= 2.0
    return stiffness


def joint_damping(model: Model, constant: float) -> float:
    """Return the damping [N m s/rad] of joints with which the first mode decays with the time constant [s]."""
    omega, shape = first_mode(model)
    one, none = (mechanics_of(model.with_(damping=value)).joints.D for value in (1.0, 0.0))
    return float((constant * omega**2 + 1.0 / constant) / (shape @ ((one - none) * shape)))
