"""What cannot be simulated is refused in one sentence; no number comes out that is not one."""

from __future__ import annotations

import numpy as np
import pytest

from pliant.errors import InputError, SimulationError
from pliant.model import Model
from pliant.simulation import Pulse, Step, Stepper, Trace, simulate


class Broken:
    """An input that turns into not-a-number."""

    jumps = breakpoints = np.array([])

    def __call__(self, t):
        return np.where(np.asarray(t) < 0.05, 1e4, np.nan)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"time_step": 0.03}, "too long: the first mode rings at 5.01 Hz"),
        ({"time_step": 0.0}, "time_step must be a positive time"),
        ({"time_step": -1e-3}, "time_step must be a positive time"),
        ({"time_step": np.nan}, "time_step must be a positive time"),
        ({"time_step": 1e-12}, "too many steps"),
        ({"duration": None, "times": np.array([0.0, 1.0]), "time_step": 1e-12}, "too many steps"),
        ({"duration": 0.0}, "duration must be a positive time"),
        ({"duration": np.inf}, "duration must be a positive time"),
        ({"duration": None}, "either duration"),
        ({"times": np.array([0.0, 1.0])}, "either duration"),
        ({"method": "ode15s"}, "unknown method 'ode15s': use midpoint, extrapolated, accurate, LSODA, BDF, Radau"),
        ({"method": "LSODA", "graded": True}, "method='LSODA' chooses its own steps: leave out graded=True"),
        ({"initial_angle": np.zeros(4)}, "5 finite numbers"),
        ({"initial_angle": np.full(5, np.nan)}, "5 finite numbers"),
        ({"initial_rate": 0.0}, "5 finite numbers"),
        ({"pressure": Broken()}, "not finite everywhere"),
        ({"pressure": 119e3}, "must be an input"),
        ({"pressure": np.array([1.0, 2.0])}, "must be an input"),
    ],
)
def test_bad_arguments(paper, changes, words):
    values = {"model": paper, "pressure": Pulse(1e5), "duration": 0.1, **changes}
    with pytest.raises(InputError, match=words) as caught:
        simulate(**values)
    assert "\n" not in str(caught.value)
    assert caught.value.exit_code == 2


@pytest.mark.parametrize("method", ["midpoint", "LSODA"])
def test_a_pressure_that_is_not_finite_is_refused_by_every_method(paper, method):
    with pytest.raises(InputError, match="not finite"):
        simulate(paper, Broken(), duration=0.1, method=method)


@pytest.mark.parametrize("level", [1e7, 1e8, 1e12, 1e200, 1e300])
def test_a_pressure_that_throws_the_links_about_is_refused(paper, level):
    """10 MPa would turn links by radians within a step: the numbers stay finite for a while and mean nothing."""
    with pytest.raises(SimulationError, match="faster than the step can follow") as caught:
        simulate(paper, Pulse(level, 0.01), duration=0.3, time_step=1e-3)
    assert "0.01" in str(caught.value) or "0.02" in str(caught.value)
    assert caught.value.exit_code == 1


def test_what_is_not_refused_is_right(paper, errors_mm):
    """At 1 MPa, eight times the paper's pressure, links turn by a tenth of a radian within a step."""
    assert errors_mm(paper, Step(1e6), np.linspace(0, 0.2, 21), [1e-3])[0] < 0.1


def test_a_law_that_overflows_is_refused(paper):
    with pytest.raises(SimulationError), np.errstate(over="ignore", invalid="ignore"):
        simulate(paper.with_(torque=[1e-6, 0.0, 1e3]), Pulse(1e200, 0.01), duration=0.1)


def test_a_standing_chain_that_buckles_is_refused(paper):
    with pytest.raises(SimulationError, match="buckles"):
        simulate(paper.with_(stiffness=0.02, gravity=[0.0, -9.81]), Pulse(0.0), duration=0.1)


def test_a_stepper_refuses_what_it_cannot_do(paper):
    with pytest.raises(InputError, match="too long"):
        Stepper(paper, 0.03)
    with pytest.raises(InputError, match="time_step must be a positive time"):
        Stepper(paper, 0.0)
    with pytest.raises(InputError, match="time_step must be a positive time"):
        Stepper(paper, float("nan"))
    with pytest.raises(InputError, match="finite pressure"):
        Stepper(paper, pressure=float("nan"))
    stepper = Stepper(paper)
    for bad, words in ((np.nan, "the input is not finite"), (np.inf, "is not finite"), (1e9, "more than a radian")):
        stepper.reset()
        with pytest.raises(SimulationError, match=words) as caught:
            drive_on(stepper, bad)
        assert "\n" not in str(caught.value)


def drive_on(stepper, pressure):
    for _ in range(20):
        stepper.step(pressure)


def test_times_may_start_anywhere_and_be_irregular():
    one = Model(link_length=0.1, link_mass=0.05, stiffness=0.4, damping=1e-3, torque=1e-6)
    run = simulate(one, Trace([-5, 5], [0, 1e5]), times=np.array([-3.0, -2.99, -1.0, 2.0]))
    assert np.isfinite(run.to_array()).all()
    assert run.time.values.tolist() == [-3.0, -2.99, -1.0, 2.0]
