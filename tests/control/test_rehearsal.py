"""A designed loop is rehearsed within its limits before it runs: what would grow is made quieter, or refused."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pliant.actuators import chen2018
from pliant.control import Limits, PidTuning, SupplyValve, Task, design_lqr, design_outputs, prepare_control
from pliant.control import rehearsal as rehearsals
from pliant.control.model_plant import ModelPlant
from pliant.control.preparation import behind_rig
from pliant.errors import InputError
from pliant.loop import Bounds, ControlLoop, VirtualActuator, VirtualClock, Watchdog
from pliant.model import Valve, chain_model, load_model

MODEL = Path(__file__).parents[2] / "examples" / "control" / "model_a.json"
PERIOD, HIGHEST, LEVEL = 4e-3, 190e3, 8e-3


def prepared(body, limits, estimator="observer", **task):
    """A controller of a body, and a noisy plant of it at rest."""
    plant = ModelPlant(body, noise=1e-5, pressure_noise=30.0)
    frames = np.array([plant.advance(0.0)[1] for _ in range(20)])
    task = Task(**{"time": [0.0], "displacement": [LEVEL], "duration": 1.0, "planned": False} | task)
    return prepare_control(body, plant.arc_length, frames, task, limits, PERIOD, estimator=estimator), plant


def run(ready, plant, seconds, push=0.0):
    """True displacement of the plant's tip; the body is displaced by a share of its bend halfway through."""
    arm, rest, still = VirtualActuator(plant, clock := VirtualClock()), plant.tip, plant.position
    loop = ControlLoop([arm], arm, ready.pipeline, Watchdog(Bounds(1.15 * HIGHEST)), PERIOD, clock)
    moved, deadline, periods = [], clock.now(), round(seconds / PERIOD)
    for k in range(periods):
        if k == periods // 2:
            plant.displace(push * (still - plant.position))
        clock.sleep_until(deadline)
        loop.period(deadline, deadline)
        deadline += round(PERIOD * 1e9)
        moved.append(np.linalg.norm(plant.tip - rest))
    assert not loop.watchdog.fault
    return np.array(moved)


@pytest.mark.parametrize(
    ("slew", "estimator"), [(3e5, "observer"), pytest.param(5e5, "filter", marks=pytest.mark.slow)],
)  # fmt: skip
def test_a_slew_limit_makes_the_design_quieter(slew, estimator, monkeypatch):
    """8 mm away; with the effort weight that was asked for the same loop ends farther off than its target."""
    body, limits = load_model(MODEL), Limits(HIGHEST, slew)
    ready, plant = prepared(body, limits, estimator)
    assert ready.rehearsal.effort > ready.rehearsal.wanted_effort == 0.3
    assert "the effort weight was raised from 0.3 to" in str(ready.rehearsal)
    assert np.abs(run(ready, plant, 1.6, push=0.5)[-50:] - LEVEL).max() < 1e-4
    monkeypatch.setattr(rehearsals.Rehearsal, "settles", True)
    ready, plant = prepared(body, limits, estimator)
    assert ready.rehearsal.effort == 0.3
    assert ready.rehearsal.final_error > LEVEL or ready.rehearsal.recovery is None
    assert np.abs(run(ready, plant, 1.6)[-50:] - LEVEL).max() > LEVEL


@pytest.mark.parametrize("seed", [0, *(pytest.param(s, marks=pytest.mark.slow) for s in (1, 2, 3))])
def test_no_limit_lets_a_loop_grow(seed):
    """Random limits and steps, three bodies: the tip comes back to its target after a push, or a sentence refuses."""
    rng = np.random.default_rng(seed)
    soft = chain_model(length=0.16, mass=0.06, links=3, stiffness=1.2, damping=6e-3, torque=[3e-6])
    for body in (chen2018.model(), load_model(MODEL), soft):
        limits = Limits(rng.uniform(0.5, 1.0) * HIGHEST, 10 ** rng.uniform(4.8, 6.5))
        level = rng.uniform(2e-3, 8e-3)
        try:
            ready, plant = prepared(body, limits, displacement=[level], duration=0.2)
        except InputError as error:
            assert "does not settle in a simulation of its own model" in str(error)  # noqa: PT017  either will do
            continue
        moved = run(ready, plant, 2.0 * (ready.rehearsal.recovery + 0.6), push=0.5)
        assert np.abs(moved[-50:] - level).max() < max(0.02 * level, 2e-4), limits


def test_what_never_settles_is_refused_in_a_sentence(monkeypatch):
    body = load_model(MODEL)
    words = r"not settle .* of 0 \.\.\. 190 kPa and its present tuning: .* mm from its target"
    with pytest.raises(InputError, match=words):
        prepared(body, Limits(HIGHEST), feedback="pid", pid=PidTuning(0.0, 4e8))
    monkeypatch.setattr(rehearsals, "RAISES", (1.0,))
    with pytest.raises(InputError, match=r"190 kPa and 300 kPa/s and any effort weight from 0.3 to 0.3"):
        prepared(body, Limits(HIGHEST, 3e5))


def test_margins_and_rehearsal_are_one_line():
    ready, _ = prepared(chen2018.model(), Limits(HIGHEST, 4e5), duration=0.1)
    said, found = ready.summary, ready.rehearsal
    assert said.startswith("without limits gain margin ")
    assert f"set-points settle after {found.settling[0]:.3g} s; error" in said
    assert "\n" not in said
    assert found.summary["rehearsed_recovery_s"] == found.recovery
    assert found.summary["effort_weight"] == 0.3
    assert found.disturbance > 0.5 * LEVEL
    lost = replace(found, settling=(None,), recovery=None)
    assert "set-points settle after not before the next one" in str(lost)
    assert not lost.settles


def test_the_end_of_a_trajectory_is_a_rest():
    """A path that stops while it moves: the last point is held, not the last motion."""
    body = load_model(MODEL)
    ready, plant = prepared(
        body, Limits(HIGHEST), planned=True, path=True, time=[0.0, 0.4], displacement=[0.0, 1e-2], duration=0.4
    )
    last = ready.trajectory.lead[-1]
    assert np.abs(ready.trajectory.lead[-2]).max() > 0.0
    assert np.abs(last).max() == 0.0
    assert np.abs(run(ready, plant, 1.2)[-50:] - 1e-2).max() < 2e-4


@pytest.mark.parametrize(
    "law", [{"settle_share": 0.2}, {"natural_frequency": 8.0, "dead_band": 2e3}, {"opening_time": 0.05}]
)
def test_a_valve_that_no_controller_follows_is_refused_and_the_rigs_own_takes_its_place(law):
    body, plant, (name, *_) = load_model(MODEL), ModelPlant(load_model(MODEL), noise=1e-5), reversed(law)
    other = body.with_(chambers=(replace(body.chambers[0], valve=Valve(**law)),))
    rest = np.array([plant.advance(0.0)[1] for _ in range(5)])
    with pytest.raises(InputError, match=f"a controller does not support .* set {name} to 0"):
        ModelPlant(other)
    with pytest.raises(InputError, match=f"a controller does not support .* set {name} to 0"):
        design_lqr(other, HIGHEST, PERIOD)
    with pytest.raises(InputError, match=f"a controller does not support .* set {name} to 0"):
        design_outputs(other, ("tip_x",), np.zeros((3, 1)), Limits(HIGHEST), PERIOD)
    task = Task(time=[0.0], displacement=[LEVEL], duration=0.2, planned=False, feedback="pid")
    with pytest.raises(InputError, match=f"a controller does not support .* set {name} to 0"):
        prepare_control(other, plant.arc_length, rest, task, Limits(HIGHEST), PERIOD)
    assert behind_rig(other, (SupplyValve(9.0, 6.5, 0.75),)).valve.natural_frequency > 0
