"""A study says when its step is too long for the motion that it predicts."""

from __future__ import annotations

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest

from pliant.failures import Failures
from pliant.identification import experiment
from pliant.model import chain_model
from pliant.recording import make_recording
from pliant.simulation import Pulse, simulate
from pliant.study.fits import outcome_of, warn_of_step

BODY = chain_model(length=0.12, mass=0.05, links=2, stiffness=0.5, damping=1e-5, torque=[6e-7])


@pytest.fixture(scope="module")
def swing():
    """A body that rings under a pulse, seen at 100 Hz, with the pressure that drove it."""
    time = np.arange(101) / 100.0
    motion = simulate(BODY, Pulse(9e4, 0.1, 0.4), times=time, time_step=1e-4)
    seen = make_recording(
        time, motion.tip_position.values, station=[p.name for p in BODY.points], frame="planar",
        pressure=motion.pressure.values, pressure_time=time, source="made",
    )
    return experiment("swing", seen)


@pytest.mark.parametrize(("step", "warned"), [(5e-4, False), (5e-3, True)])
def test_a_record_whose_motion_needs_a_shorter_step_is_named(swing, step, warned):
    values, lines = {}, []
    result = SimpleNamespace(model=BODY, values=values)
    made = outcome_of(swing, "train", result, values, step)
    warn_of_step(made, result, values, step, Failures("first", lines.append))
    fine = outcome_of(swing, "train", result, values, 1e-4)
    error = np.linalg.norm(made.body - fine.body, axis=-1).max()
    assert (error > 0.01 * BODY.length) == warned
    assert len(lines) == warned
    if warned:
        assert lines[0].startswith("warning: fit first: the simulated tip of record swing may be wrong by")
        assert "the step of 5 ms is too long for its motion; set time_step =" in lines[0]


@pytest.mark.parametrize("warm_up", [0.0, 0.9])
def test_a_step_that_is_too_long_in_the_warm_up_alone_is_not_named(swing, warm_up):
    damped, lines = BODY.with_(damping=2e-4), []
    result = SimpleNamespace(model=damped, values={})
    record = outcome_of(dataclasses.replace(swing, warm_up=warm_up), "train", result, {}, 5e-3)
    warn_of_step(record, result, {}, 5e-3, Failures("first", lines.append))
    assert len(lines) == (not warm_up)
