"""Short steps after each jump: where they lie, and what they are for, a stiff arm in space that is released."""

from __future__ import annotations

import numpy as np
import pytest

from pliant.model import Model, Valve, chain_model
from pliant.simulation import Pulse, Step, simulate
from pliant.simulation.drive import drive, grade

pytestmark = pytest.mark.slow  # kernels of their own are compiled first

TIMES = np.linspace(0, 0.12, 7)
BENT = np.array([0.17, 0.5, 0.4, 0.0, 0.65, -0.5])


@pytest.fixture(scope="module")
def arm() -> Model:
    """Three strongly damped links in space under gravity across them: decay rates up to 20 000 1/s."""
    return chain_model(length=0.17, mass=0.069, links=3, joint_placement="midsegment", stiffness=1.6, damping=8e-3,
                       gravity=[9.81, 0.0, 0.0], space={"radius": 0.012}, torque=[1e-6])  # fmt: skip


@pytest.fixture(scope="module")
def errors_mm(arm):
    """Return a function from settings of `simulate` to the largest error of the tip against LSODA, mm."""
    exact = simulate(arm, Step(0.0), times=TIMES, initial_angle=BENT, method="LSODA", rtol=1e-10).tip_position

    def measure(h, **settings):
        run = simulate(arm, Step(0.0), times=TIMES, initial_angle=BENT, time_step=h, check=False, **settings)
        return 1e3 * float(np.abs(run.tip_position - exact).max())

    return measure


def test_the_first_two_steps_and_those_after_a_jump_are_divided():
    nodes = np.array([0.0, 0.32, 0.64, 1.0, 2.0])
    wanted = [0.01, 0.02, 0.04, 0.08, 0.16, 0.48]
    for jumps in ([], [-0.1], [2.0], [3.0], [0.0]):
        np.testing.assert_allclose(grade(nodes, np.array(jumps), 1e-9), np.sort([*nodes, *wanted]), rtol=1e-15)
    both = np.sort([*nodes, *wanted, *(1.0 + np.array([1, 2, 4, 8, 16]) / 32)])
    next_but_last = np.sort([*nodes, *wanted, *(0.64 + 0.36 * np.array([1, 2, 4, 8, 16]) / 32), 1.5])
    np.testing.assert_allclose(grade(nodes, np.array([0.64]), 1e-9), next_but_last, rtol=1e-15)
    for jump in (1.0, 1.0 + 5e-10, 1.0 - 5e-10):  # equal to the end of a step but for rounding
        np.testing.assert_allclose(grade(nodes, np.array([jump]), 1e-9), both, rtol=1e-15)


def test_a_plan_keeps_its_outputs_and_its_impulse(paper):
    """The jump comes a dead time after that of the command; nothing else changes."""
    model, pulse, times = paper.with_(valve=Valve(dead_time=0.011)), Pulse(1e5, 0.1, 0.3), np.linspace(0, 1, 11)
    plain, graded = (drive(model, pulse, times, 8e-3, graded=g) for g in (False, True))
    nodes = np.append(0.0, np.cumsum(graded.h))
    for jump in (0.0, 0.111, 0.411):
        after = nodes[(nodes > jump + 1e-9) & (nodes < jump + 8.1e-3)] - jump
        np.testing.assert_allclose(after[:6] / after[5], 0.5 ** np.arange(5, -1, -1), rtol=1e-9)
    assert graded.h.size == plain.h.size + 18
    assert nodes[np.flatnonzero(graded.keep >= 0) + 1] == pytest.approx(times[1:])
    assert (graded.h * graded.torque[:, 0]).sum() == pytest.approx((plain.h * plain.torque[:, 0]).sum(), rel=1e-12)
    np.testing.assert_array_equal(graded.pressure, plain.pressure)


def test_a_released_arm_needs_fewer_steps(errors_mm):
    for method, steps, fraction in (("midpoint", (4e-3, 2e-3, 1e-3), 0.25), ("extrapolated", (4e-3, 2e-3), 0.02)):
        for h in steps:
            assert errors_mm(h, method=method, graded=True) < fraction * errors_mm(h, method=method), (method, h)


def test_a_motion_says_whether_its_steps_are_graded(paper):
    runs = [simulate(paper, Step(0.0), duration=0.01, check=False, **graded) for graded in ({}, {"graded": True})]
    assert [run.attrs["graded"] for run in runs] == [0, 1]


def test_the_order_of_convergence_stays(errors_mm):
    steps = np.array([4e-3, 2e-3, 1e-3])
    errors = [errors_mm(h, graded=True) for h in steps]
    assert np.polyfit(np.log(steps), np.log(errors), 1)[0] == pytest.approx(2.0, abs=0.2), errors


def test_less_energy_is_lost_without_a_source(arm):
    plain, graded = (
        simulate(arm, Step(0.0), times=TIMES, initial_angle=BENT, time_step=2e-3, check=False, graded=g).attrs
        for g in (False, True)
    )
    defect = [run["energy_gain"] + run["energy_loss"] for run in (plain, graded)]
    assert 0.0 < defect[1] < 0.2 * defect[0]


def test_the_error_of_the_tip_is_estimated_on_graded_steps(arm, errors_mm):
    run = simulate(arm, Step(0.0), times=TIMES, initial_angle=BENT, time_step=2e-3, graded=True)
    assert errors_mm(2e-3, graded=True) < 1e3 * run.attrs["tip_error"] < 5 * errors_mm(2e-3, graded=True)
