"""The tip of virtual actuators under a controller that was tuned on another one; the loop in virtual time."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from pliant.actuators import chen2018
from pliant.control import Limits, SupplyValve, Task, Tuning, design_lqr, equilibria, prepare_control
from pliant.control.model_plant import ModelPlant
from pliant.linear import linearise
from pliant.linear.sampled import Sampled, loop_curve, sample
from pliant.loop import Bounds, ControlLoop, VirtualActuator, VirtualClock, Watchdog
from pliant.model import load_model
from pliant.testbed.plant import Plant

pytestmark = pytest.mark.slow  # kernels of their own are compiled first

MODEL = Path(__file__).parents[2] / "examples" / "control" / "model_a.json"  # identify.py there: actuator a alone
VALVE = SupplyValve(9.01, 6.46, 0.765, 8.12e-3)  # the same for all: the rig's
PERIOD, HIGHEST = 4e-3, 190e3


class Run:
    """A plant under control for a while, with its true tip after every period."""

    def __init__(self, body, *, perfect=False, estimator="observer", **task):
        self.plant = Plant(body, perfect=perfect)
        late = 0 if perfect else 1
        frames = np.array([self.plant.advance(0.0).shape for _ in range(50)])
        task = Task(**{"time": [0.0], "displacement": [0.025], "duration": 1.0} | task)
        self.ready = prepare_control(
            load_model(MODEL), self.plant.arc_length, frames, task, Limits(HIGHEST), PERIOD, late=late, supply=VALVE,
            estimator=estimator,
        )
        self.design, self.trajectory = self.ready.design, self.ready.trajectory
        self.clock = VirtualClock()
        self.arm = VirtualActuator(self.plant, self.clock)
        watchdog = Watchdog(Bounds(1.15 * HIGHEST))
        self.loop = ControlLoop([self.arm], self.arm, self.ready.pipeline, watchdog, PERIOD, self.clock)
        self.rest = self.plant.tip

    def go(self, seconds):
        moved, command = [], []
        deadline = self.clock.now()
        for _ in range(round(seconds / PERIOD)):
            self.clock.sleep_until(deadline)
            self.loop.period(deadline, deadline)
            deadline += round(PERIOD * 1e9)
            moved.append(np.linalg.norm(self.plant.tip - self.rest))
            command.append(self.loop.command)
        self.clock.sleep_until(deadline)
        return np.array(moved), np.array(command)


def settled(moved, level):
    outside = np.flatnonzero(np.abs(moved - level) > 0.02 * level)
    return (outside[-1] + 1) * PERIOD if outside.size else 0.0


@pytest.fixture(scope="module")
def reached():
    """The step of 25 mm on b with perfect sensors, then a push of 50 mN at the cap for 0.64 s, then none."""
    run = Run("b", perfect=True)
    parts = [run.go(1.0)]
    run.plant.push(0.05)
    parts.append(run.go(0.64))
    run.plant.push(0.0)
    parts.append(run.go(0.6))
    return run, parts


def test_a_step_of_the_tip_on_another_actuator(reached):
    """25 mm with the sensors' errors switched off: what is left is the model's, which was learnt on a."""
    run, ((moved, command), *_) = reached
    assert not run.loop.watchdog.fault
    assert settled(moved, 0.025) < 0.25
    assert command.max() < HIGHEST
    assert abs(moved[-100:].mean() - 0.025) < 3e-4


def test_a_push_is_rejected(reached):
    run, (_, (pushed, _), (after, _)) = reached
    assert not run.loop.watchdog.fault
    for part in (pushed, after):
        assert np.abs(part[-50:] - 0.025).max() < 5e-4


def test_the_trajectory_is_what_the_model_does(reached):
    """The planned motion arrives and stays within 1 % on the model itself, between the limits."""
    planned = reached[0].trajectory
    arrived = np.flatnonzero(np.abs(planned.displacement - 0.025) > 2.5e-4)[-1] + 1
    assert arrived * PERIOD < 0.16
    command = planned.lead[:, -1] + planned.target
    assert command.min() > -1e3
    assert np.all(planned.wanted == 0.025)


def test_another_actuator_with_all_errors():
    """Actuator c through its noisy, late, biased fibre: no oscillation left; the fibre's bias bounds the rest."""
    run = Run("c")
    moved, _ = run.go(1.0)
    assert not run.loop.watchdog.fault
    assert np.abs(moved[150:] - 0.025).max() < 1.8e-3
    assert abs(moved[-100:].mean() - 0.025) < 1.2e-3


@pytest.mark.slow
def test_predictive_control_follows_the_trajectory():
    pytest.importorskip("osqp", reason="the extra mpc is not installed")
    run = Run("a", perfect=True, feedback="mpc", duration=0.6)
    moved, command = run.go(0.6)
    law = run.ready.control
    assert (run.loop.watchdog.fault, law.failed) == ("", 0)
    assert settled(moved, 0.025) < 0.25
    assert command.min() >= 0.0
    assert command.max() <= HIGHEST


def on_its_model(body, limits, **task):
    """A controller of the paper's actuator on the model itself; tips' displacements and commands of a run."""
    plant = ModelPlant(body, noise=1e-6, pressure_noise=10.0)
    frames = np.array([plant.advance(0.0)[1] for _ in range(20)])
    ready = prepare_control(body, plant.arc_length, frames, Task(**task), limits, PERIOD)
    arm, rest = VirtualActuator(plant, clock := VirtualClock()), plant.tip
    loop = ControlLoop([arm], arm, ready.pipeline, Watchdog(Bounds(1.15 * HIGHEST)), PERIOD, clock)
    moved, command, deadline = [], [], clock.now()
    for _ in range(round(task["duration"] / PERIOD)):
        clock.sleep_until(deadline)
        loop.period(deadline, deadline)
        deadline += round(PERIOD * 1e9)
        moved.append(np.linalg.norm(plant.tip - rest))
        command.append(loop.command)
    return ready, loop, np.array(moved), np.array(command)


@pytest.mark.parametrize(
    ("slew", "planned"),
    [pytest.param(slew, planned, marks=() if (slew, planned) == (2e6, True) else pytest.mark.slow)
     for slew in (0.4e6, 2e6, np.inf) for planned in (True, False)],
)  # fmt: skip
def test_prediction_finds_a_command_in_every_period(slew, planned):
    """The paper's actuator from rest to where 20 kPa brings it: no program is left unsolved, under no slew limit."""
    body = chen2018.model()
    family = equilibria(body, HIGHEST)
    level = float(np.interp(20e3, family.pressure, family.displacement))
    ready, loop, moved, command = on_its_model(
        body, Limits(HIGHEST, slew), feedback="mpc", time=[0.1], displacement=[level], duration=0.8, planned=planned,
    )
    assert (ready.control.failed, ready.control.fault, loop.watchdog.fault) == (0, "", "")
    assert ready.control.solved == 199  # no frame has come in the first period
    assert np.abs(moved[-50:] - level).max() < 1.5e-4
    assert np.abs(np.diff(command, axis=0, prepend=0.0)).max() <= slew * PERIOD * (1 + 1e-9)
    assert command.min() >= 0.0


def test_feedforward_with_pid_holds_the_tip():
    run = Run("a", perfect=True, feedback="pid", duration=1.2)
    moved, _ = run.go(1.2)
    assert not run.loop.watchdog.fault
    assert np.abs(moved[-50:] - 0.025).max() < 1.5e-3  # the integral is slow: what it starts from is the model


def test_a_path_is_planned():
    """A slow swing of the tip: the model follows the plan closely."""
    run = Run("a", perfect=True, path=True, duration=0.6, time=[0.0, 0.1, 0.4, 0.6],
              displacement=[0.0, 0.0, 0.012, 0.012])  # fmt: skip
    assert np.abs(run.trajectory.displacement - run.trajectory.wanted).max() < 1e-3


def test_the_loop_bears_a_plain_estimator():
    """Filtered differences instead of the model: slower and noisier, but stable."""
    run = Run("a", estimator="differences", planned=False, tuning=Tuning(0.3, integral_band=2e-3))
    moved, _ = run.go(1.6)
    assert not run.loop.watchdog.fault
    assert np.abs(moved[-100:] - 0.025).max() < 6e-3


@pytest.mark.parametrize(
    ("body", "perfect", "bound"), [pytest.param("b", True, 3e-4, marks=pytest.mark.slow), ("a", False, 1.2e-3)],
)  # fmt: skip
def test_the_filter_closes_the_loop(body, perfect, bound):
    """The Kalman filter in place of the observer: it predicts to the present, so the design knows of no delay."""
    run = Run(body, perfect=perfect, estimator="filter")
    assert run.design.latency == 0.0
    moved, command = run.go(1.0)
    assert not run.loop.watchdog.fault
    assert command.max() <= HIGHEST
    assert abs(moved[-100:].mean() - 0.025) < bound


def test_margins_are_told(reached):
    design = reached[0].design
    assert "phase margin" in str(design)
    told = [m for each in design.margins.values() for m in each]
    assert all(m.phase_deg > 40 and m.modulus > 0.6 for m in told)
    assert design.least_margins.phase_deg == min(m.phase_deg for m in told)
    for gains in design.gains:
        assert np.abs(np.linalg.eigvals(gains.A - gains.B @ gains.K)).max() <= 1.0 + 1e-9  # one integral stays


@pytest.mark.parametrize("latency", [0.0, PERIOD, 2.25 * PERIOD])
def test_a_loop_ends_where_its_margins_say(latency):
    """The curve against direct solves; and the gain upwards that makes the loop unstable, often at half the rate."""
    design = design_lqr(chen2018.model(), 190e3, PERIOD, latency=latency, grid=5)
    assert list(design.margins) == [0, 1, 2, 3, 4]
    for gains, (told,) in zip(design.gains, design.margins.values(), strict=True):
        A, B, K = gains.A, gains.B, gains.K[0]
        curve = loop_curve(Sampled(A, B, (0,)), K, PERIOD, 50)
        z = np.exp(1j * curve.omega * PERIOD)[:, None, None]
        states = np.linalg.solve(z * np.eye(len(A)) - A, B.astype(complex))[..., 0]
        np.testing.assert_allclose(curve.value, states @ K, rtol=1e-9)
        bound = 10 ** (told.gain_db / 20)
        for factor, holds in ((0.99, True), (1.01, False)):
            size = np.sort(np.abs(np.linalg.eigvals(A - factor * bound * B * K)))
            assert (size[-1] < 1.0 + 1e-9) == holds  # one integral is not driven


def test_the_sampled_model_of_a_gain_is_the_linear_one():
    """State and input of the regulator against `sample`, pressures in kPa, and the integral of the tip's error."""
    design = design_lqr(chen2018.model(), 190e3, PERIOD, latency=PERIOD, grid=3)
    for gains, p in zip(design.gains, design.pressure[:, 0], strict=True):
        linear = linearise(design.model, float(p))
        plant, n = sample(linear, PERIOD, PERIOD), design.model.n
        N = plant.A.shape[0]
        unit = np.where(np.arange(N) < 2 * n, 1.0, 1e3)
        np.testing.assert_allclose(gains.A[:N, :N], plant.A * unit / unit[:, None], rtol=1e-9, atol=1e-12)
        np.testing.assert_allclose(gains.B[:N], plant.B * 1e3 / unit[:, None], rtol=1e-9, atol=1e-12)
        rows = np.array([linear.row("tip_x"), linear.row("tip_y")])
        np.testing.assert_allclose(gains.A[N:, : rows.shape[1]], PERIOD * rows, atol=1e-15)
