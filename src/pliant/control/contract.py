"""The interface of a controller: a state of the body goes in, a command comes out."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np

from pliant.control.plan import Plan
from pliant.estimation.contract import Estimator, Measure, State

Array = np.ndarray


class Controller(Protocol):
    """A law that turns a state into a command.

    Attributes
    ----------
    chambers : int
        Number C of those whose pressures (C,) it takes and commands.
    target, error : float or array (m,)
        m, where the tip is wanted now, and how far along its path it was from there at the last step; of each output
        that several chambers bring to its place, m and rad.
    saturated : int
        Steps whose command met a limit.
    fault : str
        Why the last command is not the one that the law asks for, in one sentence; empty while it is. The loop counts
        it, writes it to summary and log, and vents when it lasts (`Bounds.controller_faults`).
    """

    chambers: int

    @property
    def target(self) -> float | Array:
        """Return the present target of the tip, m; or of each output."""

    @property
    def error(self) -> float | Array:
        """Return the tip's error along its path at the last step, m; or that of each output."""

    @property
    def saturated(self) -> int:
        """Steps whose command met a limit."""

    @property
    def fault(self) -> str:
        """Return why the last command deviates from the control law; empty if it does not."""

    def step(self, time: float, state: State, pressure: float | Array) -> Array:
        """Commands (C,) [Pa] for the period from `time` [s] on, by a state and the readings (C,) of pressures [Pa]."""

    def reset(self) -> None:
        """Start anew from no pressure."""


class Pipeline(NamedTuple):
    """From the shape to the command: what a loop runs every period."""

    measure: Measure
    estimator: Estimator
    controller: Controller
    axes: int = 2  # coordinates of a point of the shape: 3 in space


@dataclass(frozen=True)
class ControllerKind:
    """An entry of the list of controllers.

    Attributes
    ----------
    make : callable
        Controller of a Plan.
    follows : {"trajectory", "path", "levels"}
        What it takes of a motion of the tip that is planned ahead: the motion and its command, the displacement alone,
        or nothing.
    tunable : bool
        Whether the weights of the task's `Tuning` change it.
    several : bool
        Whether it takes several chambers, and bodies that lengthen.
    """

    name: str
    make: Callable[[Plan], Controller]
    follows: str = "trajectory"
    tunable: bool = True
    several: bool = True
