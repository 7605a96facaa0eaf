"""What a controller is: a state of the body goes in, a command comes out."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import NamedTuple, Protocol

import numpy as np

from pliant.control.limits import Limits
from pliant.control.lqr import LqrDesign, Tuning
from pliant.control.mpc import MpcTuning
from pliant.control.output_design import OutputDesign
from pliant.control.pid import PidTuning
from pliant.control.setpoint import Course
from pliant.control.valve import SupplyValve
from pliant.estimation.contract import Estimator, Measure, State
from pliant.model import Model

Array = np.ndarray


class Controller(Protocol):
    """What turns a state into a command.

    Attributes
    ----------
    chambers : int
        Whose pressures it takes and commands: a float for one, an array (C,) for more.
    target, error : float or array (m,)
        m, where the tip is wanted now, and how far along its path it was from there at the last step; of each output
        that several chambers bring to its place, m and rad.
    saturated : int
        Steps whose command met a limit.
    fault : str
        Why the last command is not the one that the law asks for, in one sentence; empty while it is. The loop counts
        it, tells it in summary and log, and vents when it lasts (`Bounds.controller_faults`).
    """

    chambers: int

    @property
    def target(self) -> float | Array:
        """Where the tip is wanted now, m; or each output."""

    @property
    def error(self) -> float | Array:
        """Of the tip along its path at the last step, m; or of each output."""

    @property
    def saturated(self) -> int:
        """Steps whose command met a limit."""

    @property
    def fault(self) -> str:
        """Why the last command is not the one that the law asks for; empty while it is."""

    def step(self, time: float, state: State, pressure: float | Array) -> float | Array:
        """Command [Pa] for the period that begins at `time` [s], from a state and the pressure's reading [Pa]."""

    def reset(self) -> None:
        """Start anew from no pressure."""


class Pipeline(NamedTuple):
    """From the shape to the command: what a loop runs every period."""

    measure: Measure
    estimator: Estimator
    controller: Controller


@dataclass(frozen=True)
class Task:
    """What the tip shall do.

    Parameters
    ----------
    time, displacement : array (k,)
        From each time [s] on that tip displacement [m]; straight between them where `path` is true. With several
        chambers (k, m): changes of the outputs from the rest, m and rad.
    duration : float
        s
    path : bool
    ramp : float
        s, of a change that is not planned.
    planned : bool
        Whether the changes are planned ahead as fast as the limits allow; for "pid": shaped (ZVD).
    feedback : str
        Name of the controller: "lqr", "mpc", "pid", or one that an installed package offers.
    tuning, mpc, pid : Tuning, MpcTuning, PidTuning
    outputs : tuple of str
        What several chambers bring to its place: of tip_x, tip_y [m] and angle_sum [rad], the angle of the last link.
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
    outputs: tuple[str, ...] = ()


class Plan(NamedTuple):
    """What a controller is made from."""

    task: Task
    body: Model  # calibrated, with its memory and the mean of the rig's valve
    design: LqrDesign
    limits: Limits
    period: float  # s
    late: int  # periods by which the state is older than the command
    course: Course  # what is wanted, and when
    supply: SupplyValve | None  # the rig's valve, where more is known of it than the model holds


@dataclass(frozen=True)
class ControllerKind:
    """An entry of the list of controllers.

    Attributes
    ----------
    make : callable
        Controller of a Plan.
    follows : bool
        Whether it follows a trajectory that was planned ahead.
    tunable : bool
        Whether the weights of the task's `Tuning` change it.
    outputs : callable, optional
        Controller of an OutputDesign, Task and Limits: of a body of several chambers; without it the body has one.
    """

    name: str
    make: Callable[[Plan], Controller]
    follows: bool = True
    tunable: bool = True
    outputs: Callable[[OutputDesign, Task, Limits], Controller] | None = None
