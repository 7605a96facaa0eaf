"""Interface of a controller, which turns the estimated state of the body into a command."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np

from pliant.control.plan import Plan
from pliant.estimation.contract import Estimator, Measure, State

Array = np.ndarray


class Controller(Protocol):
    """Interface of a control law that turns an estimated state into commands.

    Attributes
    ----------
    chambers : int
        Number C of chambers that the controller commands.
    target, error : float or array (m,)
        For one chamber: target of the tip's displacement, and the tip's error along its path at the last step [m]. For
        several chambers: target and error of each output [m, rad].
    saturated : int
        Number of steps in which a limit changed the command.
    fault : str
        Why the last command does not follow the control law, in one sentence; empty if it does. The loop counts faults,
        writes them to summary and log, and vents when they last (`Bounds.controller_faults`).
    """

    chambers: int

    @property
    def target(self) -> float | Array:
        """Present target of the tip's displacement [m], or of each output (m,) [m, rad]."""

    @property
    def error(self) -> float | Array:
        """Error of the tip along its path at the last step [m], or of each output (m,) [m, rad]."""

    @property
    def saturated(self) -> int:
        """Number of steps in which a limit changed the command."""

    @property
    def fault(self) -> str:
        """Why the last command deviates from the control law; empty if it does not."""

    def step(self, time: float, state: State, pressure: float | Array) -> Array:
        """Return the commands (C,) [Pa] for the period that starts at `time` [s].

        They follow from the estimated state and the pressure readings (C,) [Pa].
        """

    def reset(self) -> None:
        """Reset the controller to its initial state, with zero pressure."""


class Pipeline(NamedTuple):
    """Measurement, estimator and controller, which turn a shape into a command in every period of the loop."""

    measure: Measure
    estimator: Estimator
    controller: Controller
    axes: int = 2  # coordinates of a point of the shape; 3 in space


@dataclass(frozen=True)
class ControllerKind:
    """A registered type of controller: its constructor and its properties.

    Attributes
    ----------
    make : callable
        Function that returns the controller for a `Plan`.
    follows : {"trajectory", "path", "levels"}
        What the controller uses of a planned motion of the tip: the motion and its command ("trajectory"), the
        displacement only ("path"), or nothing ("levels").
    tunable : bool
        Whether the weights of the task's `Tuning` affect the controller.
    several : bool
        Whether the controller supports several chambers and bodies that lengthen.
    """

    name: str
    make: Callable[[Plan], Controller]
    follows: str = "trajectory"
    tunable: bool = True
    several: bool = True
