"""Preparation of a control loop: estimator and controller from a model and some frames of the actuator at rest."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TypedDict, Unpack

import numpy as np

from pliant.control.contract import Controller, Pipeline, controller_kind
from pliant.control.design import LqrDesign
from pliant.control.plan import Plan, Task
from pliant.control.rehearsal import Rehearsal, RehearsalSetting, limit_aware
from pliant.control.steady_inputs import output_weights
from pliant.control.trajectory import Trajectory
from pliant.control.tuning import Limits
from pliant.control.valve import SupplyValve, check_followed
from pliant.errors import InputError
from pliant.estimation.contract import Estimator, EstimatorKind, Setting, estimator_kind
from pliant.estimation.link_angles import LINK_ANGLES, LinkAngles, LinkTips, calibrated, with_rest_shape
from pliant.mechanics import mechanics_of
from pliant.model import Model
from pliant.options import with_defaults
from pliant.shapes import Float

Array = np.ndarray


@dataclass(frozen=True)
class Prepared:
    """The parts of a control loop, ready to run: calibrated model, measurement, estimator, controller and rehearsal.

    Attributes
    ----------
    body : Model
        Model with the measured rest shape of the body.
    link_angles : LinkAngles or LinkTips
        Converts shapes to measurements of the estimator.
    estimator : Estimator
    control : Controller
    design : LqrDesign or None
        Linear design; ``print`` shows its stability margins. None for a controller without one.
    trajectory : Trajectory or None
    rehearsal : Rehearsal or None
        Simulated response of the loop on the body's model within the limits; ``print`` shows it.
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
        """Stability margins of the linear loop and the result of the simulated rehearsal, as one line of text."""
        margins = f"without limits {self.design.least_margins}" if self.design else "no linear design"
        return "; ".join([margins, *str(self.rehearsal or "").splitlines()])

    @property
    def pipeline(self) -> Pipeline:
        """Measurement, estimator and controller as one object, from which a `ControlLoop` is created."""
        return Pipeline(self.link_angles.frame, self.estimator, self.control, mechanics_of(self.body).dimension)


class Rig(TypedDict, total=False):
    """Type of the optional keyword arguments of `prepare_control`: delay, valves and estimator of the test rig."""

    late: int
    supply: SupplyValve | Mapping[str, SupplyValve] | None
    estimator: str
    rides: bool


RIG: Rig = {"late": 0, "supply": None, "estimator": "observer", "rides": False}


def prepare_control(
    model: Model, arc_length: Float[Array, " S"], frames: Float[Array, "T S d"], task: Task, limits: Limits,
    period: float, **rig: Unpack[Rig],
) -> Prepared:
    """Return a control loop ready to run: rest shape calibrated, controller designed, estimator created, loop tested in
    simulation.

    The rehearsal simulates the loop on the model of the body within its limits: the task, its end held, and a
    disturbance as large as the task's largest displacement. The effort weight is increased until the loop settles.

    Parameters
    ----------
    model : Model
        Model of the body with its hysteresis.
    arc_length : array (S,)
        Arc lengths [m] of the points along the body.
    frames : array (T, S, 2), (T, S, 3) in space
        Shapes [m] of the body at rest without pressure.
    task : Task
    limits : Limits
    period : float
        Period of frames and control [s].
    late : int
        Number of periods by which a frame is old when it arrives; default: 0.
    supply : SupplyValve or mapping, optional
        The rig's valve for all chambers, or a mapping from chamber names; default: the model's valves.
    estimator : str
        "observer" (the default), "filter", "differences", or one that an installed package provides. A body that
        lengthens or moves in space needs "filter".
    rides : bool
        True if the points are material points of the stretching body, as markers are. Default: False, for a dense curve
        whose points are not.

    Returns
    -------
    Prepared

    Raises
    ------
    InputError
        When the task is out of reach, the parts do not fit together, or the rehearsed loop settles with no effort
        weight. Also for a body that lengthens if the points are not material points.
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
    if plan.several and not law.several:
        raise InputError(f"the controller {law.name!r} needs one chamber and a fixed length: use lqr or mpc")
    plan, estimator_setting = replace(plan, trajectory=plan.planned()), Setting(plan.body, period, setting.late)

    def made(tuned: Task) -> Prepared:
        """Return a new estimator and controller for a task, without a simulated rehearsal of the loop."""
        final = replace(plan, task=tuned)
        control, (first, estimator) = law.make(final), (seeing.make(estimator_setting) for _ in range(2))
        warm_up(Pipeline(link_angles.frame, first, control), rest, period)
        return Prepared(final.body, link_angles, estimator, control, getattr(control, "design", None), final.trajectory)

    weight = output_weights(body, task.outputs) if plan.several else np.ones(1)
    tuned, rehearsal = limit_aware(
        lambda tuned: made(tuned).pipeline, setting, task, limits, weight, tunable=law.tunable
    )
    return replace(made(tuned), rehearsal=rehearsal)


def calibration(
    model: Model, arc_length: Array, frames: Array, seeing: EstimatorKind, *, rides: bool,
) -> tuple[Model, LinkAngles | LinkTips]:
    """Return the model with the measured rest shape, and the object that converts measured shapes to link angles or
    positions.
    """
    if mechanics_of(model).lengthens and not rides:
        raise InputError(
            f"model {model.name!r} lengthens, so it needs a plant that measures material points of the body "
            "(rides = True), but this one measures points on a curve: use markers, or build a Pipeline of the "
            "stations, a KalmanFilter, and an Lqr or Mpc with design_outputs"
        )
    seeing.consumer.check(model)
    if not LINK_ANGLES.lacks(model):
        body = calibrated(model, arc_length, frames)
        return body, LinkAngles(body, arc_length)
    return with_rest_shape(model, arc_length, frames)


def supplies(model: Model, supply: SupplyValve | Mapping[str, SupplyValve] | None) -> tuple[SupplyValve | None, ...]:
    """Return the measured valve (`SupplyValve`) of the rig for each chamber, or None where the model's valve is used.

    Raises InputError for a chamber name that the model does not have.
    """
    if not isinstance(supply, Mapping):
        return (supply,) * model.actuation.count
    if unknown := set(supply) - {c.name for c in model.chambers}:
        raise InputError(
            f"the rig's valves name chamber {min(unknown)!r}, the model has {model.actuation.listing}: correct the name"
        )
    return tuple(supply.get(c.name) for c in model.chambers)


def behind_rig(model: Model, each: tuple[SupplyValve | None, ...]) -> Model:
    """Return the model with the rig's valves in place of its own, each with one mean frequency for filling and
    emptying.
    """
    chambers = (c if s is None else replace(c, valve=s.mean) for c, s in zip(model.chambers, each, strict=True))
    rig = model.with_(chambers=tuple(chambers))
    check_followed(rig)
    return rig


def warm_up(pipeline: Pipeline, shape: Array, period: float) -> None:
    """Run the control pipeline for two frames of the shape (S, 2 or 3) [m] at rest, so that its kernels are compiled
    before use.
    """
    measure, estimator, controller, _ = pipeline
    none = np.zeros(controller.chambers)
    for k in range(2):
        estimator.push_pressure(k * period, none)
        estimator.push_frame(k * period, *measure(shape))
        controller.step(k * period, estimator.state(k * period), none)
    controller.reset()
