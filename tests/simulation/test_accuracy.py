"""How wrong a simulation is: the estimate against closed forms, what is reported, and the step that is chosen."""

from __future__ import annotations

import warnings

import numpy as np
import pytest
import xarray as xr
from scipy.linalg import expm

import pliant
from pliant.actuators import chen2018
from pliant.errors import InputError, SimulationError
from pliant.model import Extension, Memory, Model
from pliant.simulation import extrapolation, solve
from pliant.simulation.balance import EnergyWarning, energy_defects
from pliant.simulation.forces import PointForce
from pliant.simulation.time_step import (
    TOLERANCE,
    TYPICAL,
    AccuracyWarning,
    longest_step,
    mode_steps,
    nice,
    resolving_step,
    step_for,
    tip_error,
)

LENGTH, MASS, STIFFNESS = 0.1, 0.05, 0.4
SWING = Model(link_length=LENGTH, link_mass=MASS, stiffness=STIFFNESS, damping=0.0, torque=[1e-6])
OMEGA = np.sqrt(STIFFNESS / (MASS * LENGTH**2 / 3.0))
NOTHING = pliant.Step(0.0)


def swing_error(motion: xr.Dataset, start: float) -> float:
    """Largest error [m] of the tip of one link that swings from `start` [rad], by q = start cos(w t)."""
    q = start * np.cos(OMEGA * motion.time.values)
    exact = LENGTH * np.stack([-np.sin(q), np.cos(q)], axis=-1)
    return float(np.linalg.norm(motion.tip_position.values[:, -1] - exact, axis=-1).max())


@pytest.mark.parametrize("step", [1e-4, 3e-4, 5e-4, 1e-3])
def test_the_estimate_holds_the_error_of_a_closed_form(step):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", AccuracyWarning)
        motion = pliant.simulate(SWING, NOTHING, duration=1.0, time_step=step, initial_angle=[0.5])
    error = swing_error(motion, 0.5)
    assert error < motion.attrs["tip_error"] < 4.0 * error


def test_a_step_that_is_too_long_is_reported_and_the_proposed_one_is_right():
    with pytest.warns(AccuracyWarning, match=r"wrong by .* mm, .* % of the length.*time_step=0\.0005 or leave it out"):
        motion = pliant.simulate(SWING, NOTHING, duration=1.0, time_step=2e-3, initial_angle=[0.5])
    assert swing_error(motion, 0.5) > 0.01 * LENGTH
    motion = pliant.simulate(SWING, NOTHING, duration=1.0, time_step=5e-4, initial_angle=[0.5])
    assert swing_error(motion, 0.5) < 0.01 * LENGTH


@pytest.mark.parametrize("start", [0.2, 1.2])
def test_the_default_step_is_right(start):
    motion = pliant.simulate(SWING, NOTHING, duration=2.0, initial_angle=[start])
    assert motion.sizes["time"] == 2001
    assert swing_error(motion, start) < motion.attrs["tip_error"] < 0.01 * LENGTH


def test_the_default_step_is_shortened_where_small_motions_do_not_tell_it(monkeypatch):
    monkeypatch.setattr(solve, "resolving_step", lambda *_: 4e-3)
    motion = pliant.simulate(SWING, NOTHING, times=np.linspace(0.0, 1.0, 101), initial_angle=[0.5])
    assert motion.attrs["step_s"] < 4e-3
    assert swing_error(motion, 0.5) < 0.01 * LENGTH


def test_the_longest_step_errs_by_its_tolerance():
    """One mode, undamped, let go where a typical pressure holds it: phase error over one second."""
    step = longest_step(SWING)
    motion = pliant.simulate(SWING, NOTHING, duration=1.0, time_step=step, initial_angle=[TYPICAL], check=False)
    assert swing_error(motion, TYPICAL) / LENGTH == pytest.approx(TOLERANCE, rel=0.1)


def test_modes_that_hardly_move_or_soon_decay_leave_the_step_long():
    paper = chen2018.model()
    assert resolving_step(paper) == 1e-3
    assert resolving_step(paper.with_(damping=0.0)) < 5e-4
    stiff = Extension(stiffness=1e6, damping=0.0)
    assert longest_step(paper.with_(extensions=(stiff,))) > 1e-3


def test_an_initial_bend_that_excites_a_fast_mode_shortens_the_step():
    paper = chen2018.model(damping=1e-5)
    assert longest_step(paper, np.array([0.3, -0.3, 0.3, -0.3, 0.3])) < 0.5 * longest_step(paper)


def test_a_motion_too_fast_for_the_first_step_is_refused_unless_a_shorter_one_is_right(monkeypatch):
    monkeypatch.setattr(solve, "resolving_step", lambda *_: 4e-3)
    how = {"times": np.linspace(0.0, 0.4, 101), "initial_angle": [0.5], "initial_rate": [300.0]}
    with pytest.raises(SimulationError, match=r"more than a radian within the step of 4 ms"):
        pliant.simulate(SWING, NOTHING, **how, time_step=4e-3)
    motion = pliant.simulate(SWING, NOTHING, **how)
    q = 0.5 * np.cos(OMEGA * motion.time) + 300.0 / OMEGA * np.sin(OMEGA * motion.time)
    assert np.abs(motion.joint_angle[:, 0] - q).max() < 0.02
    with pytest.raises(SimulationError, match=r"more than a radian within the step of 1 ms"):
        pliant.simulate(SWING, pliant.Step(1e12), duration=0.1)


@pytest.mark.parametrize(("step", "expected"), [(1e-3, 1e-3), (9e-4, 5e-4), (3e-4, 2e-4), (1.7e-5, 1e-5), (0.0, 1e-6)])
def test_steps_are_round_and_not_longer(step, expected):
    assert nice(step) == expected


def again_of(*errors: float):
    """Repetitions of a motion with errors by the step's factor: of 1, 2 and 1/2."""
    one, double, half = errors
    return lambda factor: (np.array([[one, 0.0]]), np.array([[double if factor > 1 else half, 0.0]]))


def test_the_estimate_of_a_rule_of_second_order():
    assert tip_error(again_of(0.02, 0.08, 0.005)) == pytest.approx(1.1 * 0.02)
    assert tip_error(again_of(2e-4, 8e-4, 5e-5)) == pytest.approx(6e-4)  # cleared at first sight: three times the error


def test_differences_that_do_not_follow_the_order_raise_the_estimate():
    assert tip_error(again_of(0.02, 0.22, 0.0155)) > 0.02  # a ratio of 44: the longer step is lost
    assert tip_error(again_of(0.02, 0.02 + 0.006, 0.02 - 0.008)) > 0.0117

    def lost(factor):
        if factor > 1:
            raise SimulationError("a link turns by more than a radian")
        return np.array([[0.02, 0.0]]), np.array([[0.005, 0.0]])

    assert tip_error(lost) == pytest.approx(1.1 * 0.02)
    assert step_for(0.02) == pytest.approx(0.5)
    assert step_for(np.inf) == 0.1


def test_without_the_check_nothing_is_estimated_or_reported():
    motion = pliant.simulate(SWING, NOTHING, duration=1.0, time_step=2e-3, initial_angle=[0.5], check=False)
    assert "tip_error" not in motion.attrs
    checked = pliant.simulate(SWING, NOTHING, duration=1.0, time_step=2e-4, initial_angle=[0.5])
    bare = pliant.simulate(SWING, NOTHING, duration=1.0, time_step=2e-4, initial_angle=[0.5], check=False)
    assert np.array_equal(checked.joint_angle, bare.joint_angle)


def test_lengthening_links_that_lose_their_energy_are_reported():
    """Two links on a soft axial spring, undamped, with a step that cannot follow them."""
    body = Model(link_length=[0.06, 0.06], link_mass=[0.3, 0.02], stiffness=[0.5, 0.2], damping=0.0, torque=[1e-6],
                 tip_mass=0.02, extensions=(Extension(stiffness=60.0),))  # fmt: skip
    with pytest.warns(AccuracyWarning, match="tip may be wrong by"):
        motion = pliant.simulate(body, NOTHING, duration=0.5, time_step=2e-3, initial_angle=[0.9, -1.4, 0.1])
    assert max(motion.attrs["energy_loss"], motion.attrs["energy_gain"]) > 0.01


def test_energy_defects_count_both_directions():
    time = np.arange(3.0)
    names = ("kinetic_energy", "elastic_energy", "gravitational_energy", "input_work", "dissipated_energy")
    rows = ([0.0, 1.0, 0.0], [2.0, 1.0, 1.5], [0.0, 0.0, 0.0], [0.0, 0.2, 0.2], [0.0, 0.0, 0.5])
    motion = xr.Dataset({n: ("time", np.array(r)) for n, r in zip(names, rows, strict=True)}, coords={"time": time})
    gain, loss = energy_defects(motion)
    assert gain == pytest.approx(0.0)
    assert loss == pytest.approx(0.2 / 1.0)  # what is stored less work plus losses: 2, 1.8, 1.8
    gain, loss = energy_defects(motion.assign(input_work=("time", np.array([0.0, -0.3, -0.3]))))
    assert (gain, loss) == (pytest.approx(0.3), pytest.approx(0.0))


def test_a_stepper_says_at_its_construction_that_its_step_is_too_long():
    undamped = chen2018.model(damping=0.0)
    with pytest.warns(AccuracyWarning, match=r"a step of 2 ms is too long for the mode of .* Hz.*time_step=0\.0002"):
        pliant.Stepper(undamped, time_step=2e-3)
    pliant.Stepper(undamped, time_step=2e-4)
    pliant.Stepper(chen2018.model(), time_step=2e-3)


@pytest.mark.parametrize("tolerance", [1e-3, 1e-6])
def test_the_accurate_method_keeps_its_tolerance(tolerance):
    motion = pliant.simulate(SWING, NOTHING, duration=1.0, method="accurate", tolerance=tolerance, initial_angle=[1.2])
    assert swing_error(motion, 1.2) < tolerance * LENGTH
    assert motion.attrs["tip_error"] <= tolerance * LENGTH


def test_the_accurate_method_follows_friction_and_forces():
    """Against a step of a fortieth: neither has an error that could be extrapolated."""
    model = chen2018.model(memory=Memory(slip_share=(0.2,), slip_angle=(0.02,)))
    pull = PointForce([0.0, 0.1, 0.1], [[0.0, 0.0], [0.1, 0.0], [0.0, 0.0]], model.points[-1].name)
    pulse = pliant.Pulse(8e4, 0.02, 0.1)
    how = {"times": np.linspace(0.0, 0.2, 21), "forces": [pull]}
    best = pliant.simulate(model, pulse, **how, method="accurate", tolerance=1e-4)
    fine = pliant.simulate(model, pulse, **how, time_step=2.5e-5)
    assert np.abs(best.tip_position - fine.tip_position).max() < 1e-4 * model.length


def test_the_accurate_method_refuses_what_it_cannot_bound(monkeypatch):
    monkeypatch.setattr(extrapolation, "MOST_STEPS", 3000)
    with pytest.raises(SimulationError, match=r"cannot be computed to 1e-06 % of the length.*simulate a shorter time"):
        pliant.simulate(SWING, NOTHING, duration=1.0, method="accurate", tolerance=1e-8, initial_angle=[1.2])
    with pytest.raises(InputError, match="tolerance must be a positive fraction"):
        pliant.simulate(SWING, NOTHING, duration=1.0, method="accurate", tolerance=0.0)
    with pytest.raises(SimulationError, match="more than a radian"):
        pliant.simulate(SWING, pliant.Step(1e9), duration=0.1, method="accurate")


def test_missing_energy_alone_is_reported_beyond_a_hundredth(monkeypatch):
    monkeypatch.setattr(solve, "energy_defects", lambda _motion: (0.0, 0.02))
    with pytest.warns(EnergyWarning, match="loses 2 % of its energy without dissipation: the step of 0.1 ms"):
        pliant.simulate(SWING, NOTHING, duration=0.1, time_step=1e-4, initial_angle=[0.5])
    monkeypatch.setattr(solve, "energy_defects", lambda _motion: (0.009, 0.0))
    pliant.simulate(SWING, NOTHING, duration=0.1, time_step=1e-4, initial_angle=[0.5])


@pytest.mark.parametrize(("ratio", "omega"), [(0.05, 30.0), (2.0, 40.0), (20.0, 80.0)])
def test_the_midpoint_rule_is_off_by_the_tolerance_at_the_longest_step_of_a_mode(ratio, omega):
    """For one oscillator, over-damped ones in their slow motion: against its exact motion by a matrix exponential."""
    (step,) = mode_steps(np.array([omega]), np.array([ratio * omega]), np.array([1.0]), tolerance=1e-3)
    A = np.array([[0.0, 1.0], [-(omega**2), -2.0 * ratio * omega]])
    midpoint = np.linalg.solve(np.eye(2) - 0.5 * step * A, np.eye(2) + 0.5 * step * A)
    slow = np.array([1.0, np.linalg.eigvals(A).real.max()]) if ratio > 1 else np.array([1.0, 0.0])
    exact, stepped, worst = slow, slow, 0.0
    for _ in range(int(3.0 / step)):
        exact, stepped = expm(step * A) @ exact, midpoint @ stepped
        worst = max(worst, abs(exact[0] - stepped[0]))
    assert 0.4e-3 < worst < 1.2e-3
