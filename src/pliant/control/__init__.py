"""Control by one pressure or several: shaping, feedforward, PI-D, linear-quadratic and predictive control."""

from pliant.control.contract import Controller, ControllerKind, Pipeline, Plan, Task
from pliant.control.equilibria import Equilibria, equilibria
from pliant.control.feedforward import Feedforward
from pliant.control.limits import Limits
from pliant.control.lqr import Lqr, LqrDesign, Tuning, design_lqr
from pliant.control.mpc import Mpc, MpcTuning
from pliant.control.output_control import OutputLqr
from pliant.control.output_design import OutputDesign, design_outputs
from pliant.control.pid import Pid, PidTuning
from pliant.control.preparation import Prepared, prepare_control
from pliant.control.registry import controllers
from pliant.control.setpoint import Course, SetPoint
from pliant.control.shaping import Shaper, shaper
from pliant.control.steady_inputs import steady_inputs
from pliant.control.task import TaskFile, read_task
from pliant.control.trajectory import Planner, Trajectory
from pliant.control.valve import SupplyValve, ValveFit, ValveRun, identify_valve, supply_of, valve_answer
from pliant.control.valve_states import ValveObserver

__all__ = [
    "Controller", "ControllerKind", "Course", "Equilibria", "Feedforward", "Limits", "Lqr", "LqrDesign", "Mpc",
    "MpcTuning", "OutputDesign", "OutputLqr", "Pid", "PidTuning", "Pipeline", "Plan", "Planner",
    "Prepared", "SetPoint", "Shaper", "SupplyValve", "Task", "TaskFile", "Trajectory", "Tuning", "ValveFit",
    "ValveObserver", "ValveRun", "controllers", "design_lqr", "design_outputs", "equilibria", "identify_valve",
    "prepare_control", "read_task", "shaper", "steady_inputs", "supply_of", "valve_answer",
]
