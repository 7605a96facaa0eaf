"""Control of one pressure: linearisation, shaping, feedforward, PI-D and linear-quadratic control."""

from pliant.runtime.control.chords import Chords, calibrated
from pliant.runtime.control.discrete import Margins, margins
from pliant.runtime.control.feedforward import Feedforward
from pliant.runtime.control.limits import Limits
from pliant.runtime.control.linear import LinearModel, linearise
from pliant.runtime.control.lqr import Lqr, LqrDesign, Tuning, design_lqr
from pliant.runtime.control.mpc import Mpc, MpcTuning, symbolic_step
from pliant.runtime.control.observer import Differences, Follower, frozen
from pliant.runtime.control.pid import Pid, PidTuning
from pliant.runtime.control.prepare import Prepared, Task, prepare_control
from pliant.runtime.control.reference import Planner, Reference
from pliant.runtime.control.shaping import Shaper, shaper
from pliant.runtime.control.target import Rests, rests
from pliant.runtime.control.tip import PidControl, SetPoint, TipControl
from pliant.runtime.control.valve import SupplyValve, ValveFit, ValveRun, identify_valve, supply_of, valve_answer
from pliant.runtime.control.valve_states import ValveFollower

__all__ = [
    "Chords", "Differences", "Feedforward", "Follower", "Limits", "LinearModel", "Lqr", "LqrDesign", "Margins", "Mpc",
    "MpcTuning", "Pid", "PidControl", "PidTuning", "Planner", "Prepared", "Reference", "Rests", "SetPoint", "Shaper",
    "SupplyValve", "Task", "TipControl", "Tuning", "ValveFit", "ValveFollower", "ValveRun", "calibrated", "design_lqr",
    "frozen", "identify_valve", "linearise", "margins", "prepare_control", "rests", "shaper", "supply_of",
    "symbolic_step", "valve_answer",
]
