"""Time a step, and an evaluation of a fit with its derivatives, under each law, relative to the model without it.

The body is the paper's chain of five links. A step is one of 1 ms of a `Stepper`, which refuses some valves. An
evaluation computes the residuals of a pulse of 3 s at 100 Hz in steps of 2 ms, and their derivatives by stiffness,
damping, torque, the edges of the pulse and the parameters of the law. A law and the plain model are timed in turn, in
many rounds; a ratio is the median over the rounds of their processor times, so that other load affects both.
"""

# ruff: noqa: E402
from __future__ import annotations

import os

for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"):
    os.environ[_name] = "1"

import sys
from collections.abc import Callable
from functools import partial

import numpy as np
from harness import Case, measured
from speed.timing import in_turn

from pliant.actuators import chen2018
from pliant.errors import InputError
from pliant.identification import Experiment, Parameter
from pliant.identification.initial_guess import prepare
from pliant.identification.parameters import apply
from pliant.identification.problem import Problem
from pliant.model import Extension, Model
from pliant.simulation import Pulse, Stepper, simulate

LEVEL, BEGIN, WIDTH = 6e4, 0.1, 1.5  # Pa, s, s
TIMES = np.arange(0.0, 3.0, 0.01)  # s
SHARED = ("stiffness", "damping", "torque_1")
STEPS = 4000
LAWS: dict[str, dict[str, float]] = {
    "plain": {},
    "quadratic torque": {"torque_2": 1e-12},
    "springs that soften": {"stiffening": -0.5},
    "springs that soften within a bound": {"stiffening": -0.5, "stiffening_bound": 0.75},
    "springs that soften, then stiffen": {"stiffening": -0.5, "cubic_stiffening": 0.5},
    "one creep branch": {"creep_share_1": 0.2, "creep_time_1": 0.5},
    "two creep branches": {"creep_share_1": 0.2, "creep_time_1": 0.5, "creep_share_2": 0.1, "creep_time_2": 3.0},
    "springpot": {"fractional_share": 0.05, "fractional_order": 0.25, "fractional_low": 0.3, "fractional_high": 50.0},
    "one slip element": {"slip_share_1": 0.2, "slip_angle_1": 0.01},
    "two slip elements": {"slip_share_1": 0.2, "slip_angle_1": 0.01, "slip_share_2": 0.2, "slip_angle_2": 0.03},
    "Payne's curve": {"payne_share": 2.0, "payne_angle": 0.02, "payne_exponent": 0.4, "payne_low": 1e-3,
                      "payne_high": 0.3},
    "Bouc-Wen": {"boucwen_share": 0.2, "boucwen_beta": 20.0, "boucwen_gamma": 9.0, "boucwen_exponent": 1.5},
    "lag of the pressure": {"valve_rise_time": 0.03, "valve_fall_time": 0.05},
    "limited rates": {"valve_rise_rate": 5e5, "valve_fall_rate": 5e5},
    "dead band": {"valve_dead_band": 2e3},
    "opening": {"valve_opening_time": 0.1},
    "late settling": {"valve_settle_share": 0.2, "valve_settle_time": 0.5},
    "viscoelastic lag": {"torque_2": 1e-12, "swell_share": 0.3, "swell_time": 0.5},
    "hyperelastic wall": {"inflation_limit": 2e5, "inflation_time": 0.03},
    "wall of Gent's rubber": {"inflation_limit": 2e5, "inflation_time": 0.03, "inflation_jm": 5.0},
    "one segment that lengthens": {"axial_gain": 30.0, "axial_damping": 2.0},
    "and softens": {"axial_gain": 30.0, "axial_damping": 2.0, "axial_stiffening": -1.0},
    "and creeps": {"axial_gain": 30.0, "axial_damping": 2.0, "axial_creep_share_1": 0.2, "axial_creep_time_1": 0.5},
    "and slips": {"axial_gain": 30.0, "axial_damping": 2.0, "axial_slip_share_1": 0.2, "axial_slip_strain_1": 3e-3},
}  # fmt: skip


def body(law: dict[str, float]) -> Model:
    """Return the paper's chain without a law, with a segment that lengthens if the law needs one."""
    model = chen2018.model()
    return model.with_(extensions=(Extension(stiffness=200.0, damping=2.0),)) if "axial_gain" in law else model


def stepping(law: dict[str, float]) -> Callable[[], None] | None:
    """Return a function that takes `STEPS` steps from rest; None for a valve that a `Stepper` refuses."""
    try:
        stepper = Stepper(apply(body(law), law), time_step=1e-3)
    except InputError:
        return None

    def job() -> None:
        stepper.reset()
        stepper.step(LEVEL, STEPS)

    return job


def evaluating(law: dict[str, float]) -> Callable[[], None]:
    """Return a function that evaluates residuals and derivatives, each time at slightly other values."""
    plain = body(law)
    entries = [*(Parameter(name) for name in SHARED), Parameter("e.start", BEGIN), Parameter("e.stop", BEGIN + WIDTH)]
    entries += [Parameter(name, value, free=not name.endswith(("_low", "_high"))) for name, value in law.items()]
    motion = simulate(apply(plain, law), Pulse(LEVEL, BEGIN, WIDTH), times=TIMES, time_step=1e-3)
    positions, names = motion["station_position"].values, tuple(p.name for p in plain.points)
    record = Experiment("e", TIMES, positions, names, "pulse", level=LEVEL)
    made, parameters = prepare([record], plain, entries)
    problem, calls = Problem([record], made, parameters, 2e-3, "travel"), iter(range(1, sys.maxsize))

    def job() -> None:
        x = problem.start * (1.0 + 1e-9 * next(calls))  # no plan of the call before is used again
        problem.data_residual(x)
        problem.data_jacobian(x)
        assert not problem.broken, problem.broken

    return job


def row(name: str, rounds: int) -> dict[str, float | None]:
    """Return the median ratios of a law to the plain model; none for a valve that a `Stepper` refuses."""
    found: dict[str, float | None] = {}
    for kind, make in (("step", stepping), ("evaluation", evaluating)):
        jobs = {each: job for each in ("plain", name) if (job := make(LAWS[each])) is not None}
        for job in jobs.values():
            job()  # compiled here
        times = dict(zip(jobs, in_turn([*jobs.values()], rounds), strict=True))
        found[kind] = float(np.median(times[name] / times["plain"])) if name in times else None
    return found


if __name__ == "__main__":
    measured(__doc__, {"laws": [Case(name, partial(row, name)) for name in list(LAWS)[1:]]}, rounds=30)
