"""From a model and a few frames at rest to an estimator and a controller that fit each other."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from pliant.control.limits import Limits
from pliant.control.lqr import LqrDesign, Tuning, design_lqr
from pliant.control.mpc import Mpc, MpcTuning
from pliant.control.pid import PidTuning
from pliant.control.shaping import shaper
from pliant.control.tip import PidControl, SetPoint, TipControl
from pliant.control.trajectory import Planner, Reference
from pliant.control.valve import SupplyValve
from pliant.errors import InputError
from pliant.estimation.adaptive_observer import AdaptiveObserver, frozen
from pliant.estimation.link_angles import LinkAngles, calibrated
from pliant.model import Model
from pliant.simulation import modes

Array = np.ndarray
KINDS = ("lqr", "mpc", "pid")


@dataclass(frozen=True)
class Task:
    """What the tip shall do.

    Parameters
    ----------
    time, displacement : array (k,)
        From each time [s] on that tip displacement [m]; straight between them where `path` is true.
    duration : float
        s
    path : bool
    ramp : float
        s, of a change without a planned reference.
    planned : bool
        Whether the changes are planned ahead as fast as the limits allow; for "pid": shaped (ZVD).
    feedback : {"lqr", "mpc", "pid"}
    tuning, mpc, pid : Tuning, MpcTuning, PidTuning
    """

    time: Array
    displacement: Array
    duration: float
    path: bool = False
    ramp: float = 0.03
    planned: bool = True
    feedback: str = "lqr"
    tuning: Tuning = field(default_factory=Tuning)
    mpc: MpcTuning = field(default_factory=MpcTuning)
    pid: PidTuning = field(default_factory=lambda: PidTuning(0.0, 4e6))

    def __post_init__(self) -> None:
        if self.feedback not in KINDS:
            raise InputError(f"unknown feedback {self.feedback!r}: use one of {', '.join(KINDS)}")


@dataclass(frozen=True)
class Prepared:
    """What a loop needs.

    Attributes
    ----------
    estimator : AdaptiveObserver
    control : TipControl or PidControl
    design : LqrDesign
        Its margins are told by ``print``.
    reference : Reference or None
    """

    estimator: AdaptiveObserver
    control: TipControl | PidControl
    design: LqrDesign
    reference: Reference | None


def prepare_control(
    model: Model, arc_length: Array, frames: Array, task: Task, limits: Limits, period: float, *, late: int = 0,
    supply: SupplyValve | None = None,
) -> Prepared:
    """Calibrate the rest, design the gains, plan the reference, make estimator and controller.

    Parameters
    ----------
    model : Model
        With its memory.
    arc_length : array (S,)
        Of the points along the body, m.
    frames : array (T, S, 2)
        The body at rest without pressure, m.
    task : Task
    limits : Limits
    period : float
        Of frames and control, s.
    late : int
        Periods by which a frame is old when it arrives.
    supply : SupplyValve, optional
        The rig's valve; default: the model's.

    Returns
    -------
    Prepared

    Raises
    ------
    InputError
        When the task is out of reach, or the parts do not fit.

    Examples
    --------
    >>> ready = prepare_control(model, plant.arc_length, frames, task, Limits(190e3), 4e-3, late=1)  # doctest: +SKIP
    >>> print(ready.design)  # doctest: +SKIP
    """
    body = calibrated(model, arc_length, frames)
    body = body if supply is None else body.with_(valve=supply.mean)
    design = design_lqr(frozen(body), limits.highest, period, tuning=task.tuning, latency=late * period)
    estimator = AdaptiveObserver(body, LinkAngles(body, arc_length), period, late=late)
    if task.path:
        clock = np.arange(round(task.duration / period)) * period
        wanted = np.interp(clock, task.time, task.displacement)
        setpoint = SetPoint(clock, wanted, 0.0)
    else:
        setpoint = SetPoint(task.time, task.displacement, task.ramp)
    if task.feedback == "pid":
        frequency, damping = (float(row[0]) for row in modes(frozen(body, 0.5)))
        shaping = shaper(frequency, damping, "ZVD") if task.planned else None
        return Prepared(estimator, PidControl(body, task.pid, limits, setpoint, period, shaping), design, None)
    reference = None
    if task.planned:
        planner = Planner(design, body, limits, valve=supply)
        reference = planner.path(wanted) if task.path else planner.steps(task.time, task.displacement, task.duration)
    law = None
    if task.feedback == "mpc":
        law = Mpc(frozen(body), limits, period, tuning=task.mpc, latency=late * period, supply=supply)
    control = TipControl(design, limits, setpoint, estimator, late, reference, supply, law)
    for _ in range(2):  # compiled here, not in the loop's first period
        control.step(0.0, *estimator.update(0.0, frames[np.isfinite(frames).all(axis=(1, 2))][0]), 0.0)
    estimator.reset()
    control.reset()
    return Prepared(estimator, control, design, reference)
