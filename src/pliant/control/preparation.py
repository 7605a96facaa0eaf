"""From a model and a few frames at rest to an estimator and a controller that fit each other."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TypedDict, Unpack

import numpy as np

from pliant.control.contract import Controller, ControllerKind, Pipeline
from pliant.control.design import LqrDesign
from pliant.control.limits import Limits
from pliant.control.plan import Plan, Task
from pliant.control.registry import controller_kind
from pliant.control.rehearsal import Rehearsal, RehearsalSetting, limit_aware
from pliant.control.steady_inputs import output_weights
from pliant.control.trajectory import Trajectory
from pliant.control.valve import SupplyValve, check_followed
from pliant.errors import InputError
from pliant.estimation.contract import Estimator, EstimatorKind, Setting
from pliant.estimation.link_angles import LinkAngles, calibrated
from pliant.estimation.link_tips import LinkTips, rested
from pliant.estimation.registry import estimator_kind
from pliant.mechanics import mechanics_of
from pliant.model import Model
from pliant.options import with_defaults

Array = np.ndarray


@dataclass(frozen=True)
class Prepared:
    """The parts of a control loop, ready to run.

    Attributes
    ----------
    body : Model
        With the rest shape of the body at hand.
    link_angles : LinkAngles or LinkTips
        What its shapes are measured by.
    estimator : Estimator
    control : Controller
    design : LqrDesign or None
        ``print`` shows its margins; None of a controller without a linear design.
    trajectory : Trajectory or None
    rehearsal : Rehearsal or None
        How the loop behaves on the body's model within its limits; ``print`` shows it.
    """

    body: Model
    link_angles: LinkAngles | LinkTips
    estimator: Estimator
    control: Controller
    design: LqrDesign | None
    trajectory: Trajectory | None
    rehearsal: Rehearsal | None = None

    @property
    def summary(self) -> str:
        """The least margins of the linear loop and the rehearsal within the limits, in one line."""
        margins = f"without limits {self.design.least_margins}" if self.design else "no linear design"
        return "; ".join([margins, *str(self.rehearsal or "").splitlines()])

    @property
    def pipeline(self) -> Pipeline:
        """From the shape to the command, for a `ControlLoop`."""
        return Pipeline(self.link_angles.frame, self.estimator, self.control, mechanics_of(self.body).dimension)


class Rig(TypedDict, total=False):
    """The rig's delay and valves, and the estimator of its state, for `prepare_control`."""

    late: int
    supply: SupplyValve | Mapping[str, SupplyValve] | None
    estimator: str
    rides: bool


RIG: Rig = {"late": 0, "supply": None, "estimator": "observer", "rides": False}


def prepare_control(
    model: Model, arc_length: Array, frames: Array, task: Task, limits: Limits, period: float,
    **rig: Unpack[Rig],
) -> Prepared:
    """Calibrate the rest, design the gains, plan the trajectory, make estimator and controller, and rehearse the loop.

    The loop is rehearsed on the model of the body within its limits before it is returned: the task, its end held, and
    a disturbance as large as the task's largest displacement. The effort weight is raised until it settles.

    Parameters
    ----------
    model : Model
        With its memory.
    arc_length : array (S,)
        Of the points along the body, m.
    frames : array (T, S, 2), (T, S, 3) in space
        The body at rest without pressure, m.
    task : Task
    limits : Limits
    period : float
        Of frames and control, s.
    late : int
        Periods by which a frame is old when it arrives; default: 0.
    supply : SupplyValve or mapping, optional
        The rig's valve, that of every chamber, or by the names of chambers; default: the model's.
    estimator : str
        "observer" (the default), "filter", "differences", or one that an installed package offers. A body that
        lengthens, or moves in space, takes "filter".
    rides : bool
        Whether the points ride on the body as it stretches, as markers do; default: False, a dense curve.

    Returns
    -------
    Prepared

    Raises
    ------
    InputError
        When the task is out of reach, the parts do not fit, or no effort weight lets the rehearsed loop settle; and for
        a body that lengthens where the points do not ride on it: a dense curve does not show how it does.
    TypeError
        For an unknown keyword.

    Examples
    --------
    >>> ready = prepare_control(model, plant.arc_length, frames, task, Limits(190e3), 4e-3, late=1)  # doctest: +SKIP
    >>> print(ready.design)  # doctest: +SKIP
    """
    known = with_defaults(prepare_control, rig, RIG)
    seeing, law = estimator_kind(known["estimator"]), controller_kind(task.feedback)
    body, link_angles = calibration(model, arc_length, frames, seeing, rides=known["rides"])
    each = supplies(body, known["supply"])
    rest = frames[np.isfinite(frames).all(axis=(1, 2))][0]
    setting = RehearsalSetting(behind_rig(body, each), arc_length, each, period, known["late"])
    latency = 0.0 if seeing.predicts else setting.late * period  # a state that is predicted to the present is not late
    plan = Plan(task, setting.body, limits, period, latency, each, follows=law.follows)
    maker = Maker(link_angles, rest, seeing, law, plan, setting)
    weight = output_weights(body, task.outputs) if plan.several else np.ones(1)
    tuned, rehearsal = limit_aware(
        lambda tuned: maker.make(tuned).pipeline, setting, task, limits, weight, tunable=law.tunable
    )
    return replace(maker.make(tuned), rehearsal=rehearsal)


class Maker:
    """Makes estimator and controller of a body for tasks that differ in their tuning alone.

    Parameters
    ----------
    link_angles : LinkAngles or LinkTips
    rest : array (S, 2)
        A shape at rest, m.
    seeing : EstimatorKind
    law : ControllerKind
    plan : Plan
    setting : RehearsalSetting
    """

    def __init__(
        self, link_angles: LinkAngles | LinkTips, rest: Array, seeing: EstimatorKind, law: ControllerKind,
        plan: Plan, setting: RehearsalSetting,
    ) -> None:
        if plan.several and not law.several:
            raise InputError(f"the controller {law.name!r} takes one chamber and a fixed length: use lqr or mpc")
        self.link_angles, self.seeing, self.law, self._rest = link_angles, seeing, law, rest
        self.plan = replace(plan, trajectory=plan.planned())
        self._setting = Setting(plan.body, plan.period, setting.late)

    def make(self, task: Task) -> Prepared:
        """Estimator and controller at their beginning, not rehearsed."""
        plan = replace(self.plan, task=task)
        control, (first, estimator) = self.law.make(plan), (self.seeing.make(self._setting) for _ in range(2))
        warm_up(Pipeline(self.link_angles.frame, first, control), self._rest, plan.period)
        design = getattr(control, "design", None)
        return Prepared(plan.body, self.link_angles, estimator, control, design, plan.trajectory)


def calibration(
    model: Model, arc_length: Array, frames: Array, seeing: EstimatorKind, *, rides: bool,
) -> tuple[Model, LinkAngles | LinkTips]:
    """The model with the rest shape of the body at hand, and what its shapes are measured by."""
    if seeing.fixed_length and model.space is not None:
        raise InputError(
            f"{model.name!r} moves in space, which the estimator {seeing.name!r} does not follow: use filter"
        )
    if not mechanics_of(model).lengthens:
        if model.space is not None:
            return rested(model, arc_length, frames)
        body = calibrated(model, arc_length, frames)
        return body, LinkAngles(body, arc_length)
    if not rides:
        raise InputError(
            f"{model.name!r} lengthens, and a dense curve does not show which of its points belong to which link: take "
            "a plant whose points ride on the body (`rides`), or make a Pipeline of its stations, a KalmanFilter and "
            "an Lqr or Mpc of design_outputs"
        )
    if seeing.fixed_length:
        raise InputError(f"{model.name!r} lengthens, which the estimator {seeing.name!r} does not follow: use filter")
    return rested(model, arc_length, frames)


def supplies(model: Model, supply: SupplyValve | Mapping[str, SupplyValve] | None) -> tuple[SupplyValve | None, ...]:
    """The rig's valve of each chamber, None where the model's counts; InputError for a chamber that nobody has."""
    if not isinstance(supply, Mapping):
        return (supply,) * model.actuation.count
    if unknown := set(supply) - {c.name for c in model.chambers}:
        raise InputError(f"the rig's valves name {min(unknown)!r}, the model's chambers are {model.actuation.listing}")
    return tuple(supply.get(c.name) for c in model.chambers)


def behind_rig(model: Model, each: tuple[SupplyValve | None, ...]) -> Model:
    """The model with the valves of a rig, each by the one frequency that a linear design takes."""
    made = (c if s is None else replace(c, valve=s.mean) for c, s in zip(model.chambers, each, strict=True))
    rig = model.with_(chambers=tuple(made))
    check_followed(rig)
    return rig


def warm_up(pipeline: Pipeline, shape: Array, period: float) -> None:
    """Two frames of a shape (S, 2) at rest: what is compiled is compiled here, not in the loop's first period."""
    measure, estimator, controller, _ = pipeline
    none = np.zeros(controller.chambers)
    for k in range(2):
        estimator.push_pressure(k * period, none)
        estimator.push_frame(k * period, *measure(shape))
        controller.step(k * period, estimator.state(k * period), none)
    controller.reset()
