"""Control of one pressure: shaping, feedforward, PI-D, linear-quadratic and predictive control."""

from pliant.control.equilibria import Rests, rests
from pliant.control.feedforward import Feedforward
from pliant.control.limits import Limits
from pliant.control.lqr import Lqr, LqrDesign, Tuning, design_lqr
from pliant.control.mpc import Mpc, MpcTuning, symbolic_step
from pliant.control.pid import Pid, PidTuning
from pliant.control.shaping import Shaper, shaper
from pliant.control.task import Prepared, Task, prepare_control
from pliant.control.tip import PidControl, SetPoint, TipControl
from pliant.control.trajectory import Planner, Reference
from pliant.control.valve import SupplyValve, ValveFit, ValveRun, identify_valve, supply_of, valve_answer
from pliant.control.valve_states import ValveFollower

__all__ = [
    "Feedforward", "Limits", "Lqr", "LqrDesign", "Mpc", "MpcTuning", "Pid", "PidControl", "PidTuning", "Planner",
    "Prepared", "Reference", "Rests", "SetPoint", "Shaper", "SupplyValve", "Task", "TipControl", "Tuning", "ValveFit",
    "ValveFollower", "ValveRun", "design_lqr", "identify_valve", "prepare_control", "rests", "shaper", "supply_of",
    "symbolic_step", "valve_answer",
]
