"""Tendons whose tensions find no agreement with the motion end a step, a march, a hold, a batch and a fit's motion."""

from __future__ import annotations

import numpy as np
import pytest
from oracles.space import random_space_chain, with_tendons

import pliant
from pliant.batch import one_by_one
from pliant.batch.batch import simulate_batch
from pliant.compiler.choose import twin
from pliant.compiler.twin import rebuild
from pliant.equations import observation, spatial_observation, spatial_points, spatial_springs, tendon
from pliant.errors import SimulationError
from pliant.identification import follow_loops, following
from pliant.identification.experiment import Experiment
from pliant.identification.prediction import predict
from pliant.model import Space, Station, Tendon
from pliant.simulation import Pulse, Stepper, Trace, initial_value, march_loops, simulate, stepper

TIMES, STEP = 1e-3 * np.arange(6), 1e-3
CORD = Tendon.at_azimuth(0.3, [1.0], driven_by="displacement", lever=8e-3, line_stiffness=2e3, friction=0.2, name="a")
MODEL = pliant.chain_model(
    length=0.3, mass=0.1, links=1, stiffness=0.5, damping=4e-3, gravity=(0.0, 0.0, 0.0), space=Space(), chambers=[CORD],
    stations=(Station("tip", 0, 0.3),),
)  # fmt: skip
PULL = Pulse(2e-3, 2.5e-3, 1.0)  # at rest for two steps and a half
WORDS = "iteration for the tensions of the tendons does not converge within a step: use a shorter step"


@pytest.fixture
def impatient(monkeypatch):
    """The loops as plain text; Newton's method has one round, enough for a chain at rest and for nothing else."""
    monkeypatch.setattr(tendon, "ROUNDS", 1)
    in_space = {name: getattr(spatial_observation, name) for name in ("place_links", "point_at")}
    instead = {"step": tendon.step, "follows": spatial_springs.follows, "add_step_work": spatial_points.add_step_work,
               "observe": rebuild(observation.observe, lambda kernel: kernel, in_space)}  # fmt: skip
    for module in (march_loops, follow_loops):
        for name, kernel in instead.items():
            if hasattr(module, name):
                monkeypatch.setattr(module, name, kernel)
    monkeypatch.setattr(march_loops, "of_records", march_loops.of_records.__wrapped__)  # not as others left it
    for module in (initial_value, stepper):
        monkeypatch.setattr(module, "twin", lambda kernel, *_: kernel)
    monkeypatch.setattr(one_by_one, "free_twin", lambda kernel, *_: kernel)
    monkeypatch.setattr(following, "REAL", following.REAL._replace(twin=lambda kernel, *_: kernel))


@pytest.mark.usefixtures("impatient")
def test_a_march_names_the_time_and_the_step():
    with pytest.raises(SimulationError, match=f"^0.003 s after the start the {WORDS}"):
        simulate(MODEL, PULL, times=TIMES, time_step=STEP)


@pytest.mark.usefixtures("impatient")
def test_a_stepper_stops_there():
    arm = Stepper(MODEL, STEP)
    arm.step(0.0, steps=2)
    with pytest.raises(SimulationError, match=f"^at 0.003 s, under 0.002 m, the {WORDS}"):
        arm.step(2e-3, steps=3)


@pytest.mark.usefixtures("impatient")
def test_a_batch_tells_which_sample_fails_and_when():
    pulls = [(PULL,), (Pulse(0.0, 0.0, 1.0),)]
    made = simulate_batch([MODEL, MODEL], pulls, times=TIMES, time_step=STEP, failures="mark")
    with pytest.raises(SimulationError, match=r"sample 0 at 0.003 s: .* tensions of tendons do not converge"):
        simulate_batch([MODEL, MODEL], pulls, times=TIMES, time_step=STEP)
    assert made.failed_at.to_numpy() == pytest.approx([3e-3, np.nan], nan_ok=True)


@pytest.mark.usefixtures("impatient")
def test_the_motion_of_a_fit_fails_with_these_words():
    seen = Experiment(
        name="pulled", time=STEP * np.arange(12), position=np.arange(36.0).reshape(12, 1, 3), stations=("tip",),
        excitation="trace", pressure=Trace(STEP * np.arange(12), [0.0, 0.0, 0.0, *[2e-3] * 9]),
    )  # fmt: skip
    with pytest.raises(SimulationError, match=WORDS):
        predict(MODEL, seen, {}, STEP)


@pytest.mark.slow
def test_compiled_steps_agree_or_say_that_they_do_not(rng):
    """Stiffness far beyond what the step resolves: rates after it keep the momentum balance, or are beyond bounds."""
    failed, step = 0, twin(tendon.step)
    for _ in range(40):
        chain = with_tendons(random_space_chain(rng, 2), rng, stiffness=1e10, friction=0.4)
        x, v, work, h = chain.x.copy(), chain.v.copy(), chain.work(), 1e-2
        torque = np.array([0.0, 0.0, 0.0, 0.0, 2.0, 1.0, -1.0])
        step(x, v, h, torque, chain.body, chain.joints, work)
        refused = not spatial_springs.follows(x, v, h, chain.joints)
        if np.abs(v).max() > 1e90:
            failed += 1
            assert refused
        else:
            push = h * (work.t - work.f + work.pull + work.rub)
            lower = np.tril(work.A)
            left = push - (lower + np.tril(lower, -1).T) @ work.a
            assert np.abs(left).max() <= tendon.NEAR * np.abs(push).max()
    assert 0 < failed < 40
