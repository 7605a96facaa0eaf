"""The step of the filter's predictions: shorter ones are tried where longer ones fail."""

from __future__ import annotations

import numpy as np
import pytest

from pliant.actuators import chen2018
from pliant.errors import SimulationError
from pliant.estimation import estimate, offline
from pliant.recording import make_recording
from pliant.simulation import Trace, simulate

PAPER, TIMES = chen2018.model(), np.linspace(0.0, 0.2, 21)


@pytest.fixture(scope="module")
def recording():
    """The tip of the paper's actuator under a rising pressure."""
    pressure = 2e5 * TIMES
    motion = simulate(PAPER, Trace(TIMES, pressure), times=TIMES)
    stations = [p.name for p in PAPER.points]
    return make_recording(time=TIMES, position=motion.station_position.values, station=stations, frame="planar",
                          pressure=pressure)  # fmt: skip


@pytest.fixture
def refusing(monkeypatch):
    """Return a function that lets the filter fail for steps beyond a bound; it returns the list of steps taken."""
    taken, run = [], offline.run

    def refuse(bound):
        def checked(model, measurement, plan, noise):
            taken.append(float(plan.h.max()))
            if taken[-1] > bound:
                raise SimulationError("the prediction fails")
            return run(model, measurement, plan, noise)

        monkeypatch.setattr(offline, "run", checked)
        return taken

    return refuse


def test_shorter_steps_are_tried_and_named(recording, refusing):
    assert estimate(recording, PAPER).attrs["step_s"] == 5e-3
    given = estimate(recording, PAPER, time_step=1e-3)
    taken = refusing(1.1e-3)
    found = estimate(recording, PAPER)
    assert taken == pytest.approx([5e-3, 2e-3, 1e-3])
    assert found.attrs["step_s"] == given.attrs["step_s"] == 1e-3
    np.testing.assert_array_equal(found.joint_angle, given.joint_angle)


def test_a_stated_step_is_kept_and_the_last_failure_is_raised(recording, refusing):
    taken = refusing(1e-5)
    with pytest.raises(SimulationError, match="fails"):
        estimate(recording, PAPER, time_step=2e-3)
    assert taken == pytest.approx([2e-3])
    with pytest.raises(SimulationError, match="fails"):
        estimate(recording, PAPER)
    assert taken[1:] == pytest.approx([5e-3, 2e-3, 1e-3, 5e-4])
