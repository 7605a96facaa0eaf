"""Interface of a controller, which computes pressure commands from the estimated state of the actuator."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np

from pliant.control.plan import Plan
from pliant.estimation.contract import Estimator, Measure, State
from pliant.plugins import chosen, offered
from pliant.shapes import Float

Array = np.ndarray


class Controller(Protocol):
    """Interface of a control law, which computes the pressure commands of every period from the estimated state.

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
    def target(self) -> float | Float[Array, " m"]:
        """Present target. For a controller of the tip displacement by one chamber, this is that displacement [m].
        For a controller of m outputs it is their change from rest (m,), such as of a tip coordinate [m] or angle [rad].
        """

    @property
    def error(self) -> float | Float[Array, " m"]:
        """Control error at the last step, actual value minus target. For a controller of the tip displacement by one
        chamber, this is one error [m]. For a controller of m outputs it is the error of each (m,) [m or rad].
        """

    @property
    def saturated(self) -> int:
        """Number of control steps in which a limit of pressure or slew rate changed the command."""

    @property
    def fault(self) -> str:
        """Sentence that explains why the last command deviates from the control law; empty if it does not."""

    def step(self, time: float, state: State, pressure: float | Float[Array, " C"]) -> Float[Array, " C"]:
        """Return the commands (C,) [Pa] of the C chambers for the control period that starts at `time` [s].

        They follow from the estimated state and the pressure readings (C,) [Pa].
        """

    def reset(self) -> None:
        """Reset the controller to its initial state, in which the commanded pressures are zero."""


class Pipeline(NamedTuple):
    """Measurement, state estimator and controller, which together compute the commands from the measured shape in every
    period.
    """

    measure: Measure
    estimator: Estimator
    controller: Controller
    axes: int = 2  # coordinates of a point of the shape; 3 in space


@dataclass(frozen=True)
class ControllerKind:
    """A type of controller: its name, the function that creates it and the tasks that it supports.

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


GROUP = "pliant.controllers"
BUILT_IN = {
    "lqr": "pliant.control.lqr:CONTROLLER",
    "mpc": "pliant.control.mpc:CONTROLLER",
    "pid": "pliant.control.pid:CONTROLLER",
}


def controllers() -> dict[str, ControllerKind]:
    """Return all known controllers, built-in or from installed packages, as {name: controller type}."""
    return offered(GROUP, BUILT_IN, ControllerKind)


def controller_kind(name: str) -> ControllerKind:
    """Return the controller type with the given name; raise InputError with a list of the known
    names if there is none.
    """
    return chosen(GROUP, BUILT_IN, ControllerKind, name)
