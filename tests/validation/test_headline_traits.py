"""Traits that a headline states: an oscillation that turns back, an overshoot of one step, a line of stations."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from made_study import outcome

from pliant.identification import Experiment
from pliant.numerics.ringdown import ring_down
from pliant.simulation import Trace
from pliant.study.schema import Targets
from pliant.study.verdict import headline, unlike
from pliant.validation.metrics import response

__all__ = ["outcome"]
T = np.arange(0.0, 8.0, 0.01)


def moved_by(trace, drives=None):
    """The recording of a tip that follows its pressure and rings behind its steps."""
    level = np.asarray(trace(T)) / 2e4
    kernel = np.exp(-T / 0.2) * np.sin(2 * np.pi * 3.0 * T)
    before = np.concatenate([np.full(T.size, level[0]), level])
    u = 0.02 * np.convolve(before, kernel / kernel.sum())[T.size : 2 * T.size]
    place = np.stack([u, np.full(T.size, 0.1)], axis=-1)
    return Experiment("e", T, place[:, None], ("tip",), "trace", pressure=trace, drives=drives or {})


def levels(*steps):
    """A trace that jumps to each of the levels [Pa] in turn, once a second."""
    times = np.ravel([[k + 0.999, k + 1.0] for k in range(len(steps))])
    return Trace([0.0, *times, 9.0], [0.0, 0.0, *np.repeat(steps, 2)])


@pytest.mark.parametrize("delay", [0.1, 0.25])
@pytest.mark.parametrize("noise", [0.0, 5e-5])
def test_an_over_damped_return_after_a_delay_does_not_oscillate(rng, delay, noise):
    u = 0.03 * np.where(delay > T, 1.0, np.exp(-np.maximum(T - delay, 0) / 0.05)) + noise * rng.standard_normal(T.size)
    assert ring_down(T, u) is None


def test_a_body_that_swings_back_after_a_fall_without_a_sine_oscillates():
    """The recording ends soon after a chamber has emptied: a monotone sequence is nearer than sine and return."""
    t = np.arange(0.0, 0.43, 0.01)
    after = np.maximum(t - 0.16, 0.0)
    swing = np.where(t < 0.16, 0.0, np.exp(-3.0 * after) * np.sin(2 * np.pi * 8.0 * after))
    fall = 0.026 * np.sin(0.5 * np.pi * np.minimum(t / 0.16, 1.0))
    assert ring_down(t, fall - 2e-3 * swing).frequency == pytest.approx(8, rel=0.1)
    assert ring_down(t, fall) is None


def test_vibration_of_the_rig_is_no_ring_down():
    assert ring_down(T, 0.03 * np.exp(-T / 0.2) + 2e-4 * np.sin(2 * np.pi * 4.81 * T)) is None
    assert ring_down(T, 0.03 * np.exp(-T) * np.cos(2 * np.pi * 4.81 * T)).frequency == pytest.approx(4.81, rel=1e-3)


def test_a_climb_through_seven_levels_has_no_overshoot():
    climb = moved_by(levels(3e3, 6e3, 9e3, 12e3, 15e3, 18.5e3, 2e4))
    found = response(climb, climb.last_station)
    assert found["overshoot_percent"] is None
    assert found["steady_state_mm"] == pytest.approx(20, rel=0.02)
    step = moved_by(levels(2e4, 2e4, 2e4, 0.0, 0.0, 0.0, 0.0))
    assert response(step, step.last_station)["overshoot_percent"] > 3


def test_a_step_among_steps_of_other_inputs_has_no_overshoot():
    first = levels(2e4, 2e4, 2e4, 0.0, 0.0, 0.0, 0.0)
    other = Trace(first.time, np.interp(first.time, [0, 2.0, 2.001, 9], [0, 0, 9e3, 9e3]))
    quiet = Trace(first.time, np.zeros_like(first.time))
    values = {}
    for name, second in (("moving", other), ("quiet", quiet)):
        exp = moved_by(first, {"a": first, "b": second})
        values[name] = response(exp, exp.last_station)["overshoot_percent"]
    assert values["moving"] is None
    assert values["quiet"] > 3


def lengthened(measured, modelled):
    return {"frequency_hz": {"measured": 3.0, "modelled": 3.0}, "extension_mm": 0.2 * measured,
            "extension_percent": measured, "extension_modelled_percent": modelled}  # fmt: skip


def test_stations_beside_the_axis_do_not_make_a_body_lengthen():
    line = " The line through the stations lengthens by 2.7 mm (13.6 %), in the model by 13.4 %."
    assert unlike(lengthened(13.6, 13.4)) == line
    not_so = "in the model it does not: the body lengthens, or stations lie beside its axis"
    assert not_so in unlike(lengthened(13.6, 0.1))


def test_the_headline_of_several_fits_names_its_fit(outcome):
    def full(fit):
        return replace(fit, title="Linear law", records=fit.records[:2])

    fits = tuple(full(fit) for fit in outcome.fits)
    several = headline(replace(outcome, fits=fits), Targets())
    assert several.sentence.startswith("The model of the fit Linear law predicts")
    assert headline(replace(outcome, fits=fits[:1]), Targets()).sentence.startswith("The model predicts")
