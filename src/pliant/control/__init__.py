"""Controllers that command one or several pressures or tendons: feedforward, PI-D, linear-quadratic and
predictive control.
"""

from pliant.control.contract import Controller, ControllerKind, Pipeline, controllers
from pliant.control.design import LqrDesign, design_lqr, design_outputs
from pliant.control.lqr import Lqr
from pliant.control.mpc import Mpc
from pliant.control.pid import Feedforward, Pid
from pliant.control.plan import Plan, SetPoint, Task
from pliant.control.preparation import Prepared, prepare_control
from pliant.control.rehearsal import Rehearsal
from pliant.control.steady_inputs import Equilibria, equilibria, steady_inputs
from pliant.control.task import TaskFile, read_task
from pliant.control.trajectory import Planner, Trajectory
from pliant.control.tuning import Limits, MpcTuning, PidTuning, Tuning
from pliant.control.valve import (
    SupplyValve,
    ValveFit,
    ValveObserver,
    ValveRun,
    identify_valve,
    supply_of,
    valve_response,
)

__all__ = [
    "Controller", "ControllerKind", "Equilibria", "Feedforward", "Limits", "Lqr", "LqrDesign", "Mpc", "MpcTuning",
    "Pid", "PidTuning", "Pipeline", "Plan", "Planner", "Prepared", "Rehearsal", "SetPoint", "SupplyValve",
    "Task", "TaskFile", "Trajectory", "Tuning", "ValveFit", "ValveObserver", "ValveRun", "controllers", "design_lqr",
    "design_outputs", "equilibria", "identify_valve", "prepare_control", "read_task", "steady_inputs",
    "supply_of", "valve_response",
]
