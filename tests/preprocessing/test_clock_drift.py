"""A drift between clocks is reported where single changes of the input show it, and not where lags do."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from scipy.signal import lfilter

from pliant.preprocessing.lag_model import begins_high, pressure_course, second_order
from pliant.preprocessing.quality import quality
from pliant.preprocessing.sync import input_events, sync
from pliant.recording import make_recording

STEP = 2e-3  # s of the simulated course


def bench(command, *, drift=0.0, fall=0.03, seed=0):
    """A body behind a valve that falls with another time constant than it rises; its clock runs faster by `drift`."""
    rng = np.random.default_rng(seed)
    fine = STEP * np.arange(len(command))
    pressure = np.zeros(len(command))
    for k in range(1, len(command)):
        lag = 0.03 if command[k] > pressure[k - 1] else fall
        pressure[k] = pressure[k - 1] + STEP * (command[k] - pressure[k - 1]) / lag
    moved = lfilter(*second_order(2.0, 0.5, STEP), pressure + 0.2 * pressure**2)
    time = np.arange(0, fine[-1] - 0.2, 1 / 60)
    bend = np.interp((time - 0.1) / (1 + drift), fine, moved)
    tip = np.stack([0.05 * np.sin(bend), 0.1 * np.cos(0.5 * bend), 0 * bend], -1) + rng.normal(0, 2e-5, (len(time), 3))
    clock = fine[::5]
    return make_recording(time, np.stack([0 * tip, tip], 1), station=["base", "tip"], pressure_time=clock,
                          pressure=4e4 * pressure[::5] + rng.normal(0, 50, len(clock)))  # fmt: skip


def square(periods, seconds=20.0):
    phase = np.arange(0, seconds, STEP) * periods / seconds % 1
    return ((phase > 0.3) & (phase < 0.8)).astype(float)


def irregular(changes=16, seconds=30.0):
    """Changes between two levels at irregular times."""
    lengths = np.random.default_rng(3).uniform(0.6, 2.4, changes)
    edges = np.cumsum(lengths) * (seconds - 2.0) / lengths.sum()
    return (np.searchsorted(edges, np.arange(0, seconds, STEP)) % 2).astype(float)


@pytest.mark.parametrize("fall", [0.03, 0.2])
def test_one_pulse_shows_no_drift(fall):
    """A lag that differs between rise and fall looks like a drift of thousands of ppm."""
    assert sync(bench(square(1, 10.0), fall=fall), drift=True).drift == 0.0


def test_a_drift_that_many_changes_show_is_found_in_spite_of_a_valve_that_falls_slowly():
    found = sync(bench(irregular(), drift=2e-3, fall=0.1), drift=True)
    assert found.drift == pytest.approx(2e-3, abs=4 * found.drift_uncertainty)
    assert found.drift_uncertainty < 4e-4
    assert sync(bench(irregular(), fall=0.1), drift=True).drift == 0.0


def test_events_of_an_input_are_its_changes_in_one_direction():
    recording = bench(square(4))
    events = input_events(pressure_course(recording))
    signs = [sign for _, _, sign, _ in events]
    assert sorted(signs) == [-1] * 4 + [1] * 4
    assert all(a != b for a, b in pairwise(signs))
    assert [end for _, end, _, _ in events[:-1]] == [start for start, *_ in events[1:]]


def logged(columns, names=None):
    clock = 0.02 * np.arange(len(columns))
    return pressure_course(make_recording(pressure=1e3 * np.asarray(columns), pressure_time=clock, chamber=names))


def test_inputs_that_begin_at_rest_are_not_high():
    """Whatever the sign and the number of inputs."""
    wave = np.clip(np.sin(np.arange(400) / 30), 0, 1)
    other = np.clip(-np.sin(np.arange(400) / 30), 0, 1)
    assert not begins_high(logged(np.stack([wave, other], 1), ["left", "right"]))
    assert not begins_high(logged(np.stack([wave, other, other * wave], 1)[::1], ["a", "b", "c"]))
    assert not begins_high(logged(-wave))
    assert not begins_high(logged(np.sin(np.arange(400) / 30)))
    assert begins_high(logged(1.0 - np.clip(np.arange(400) / 200, 0, 1)))
    assert begins_high(logged(np.stack([wave, 1.0 - wave * (np.arange(400) > 20)], 1), ["left", "right"]))


def test_how_far_clocks_overlap_is_told():
    position = np.random.default_rng(0).normal(0, 1e-3, (100, 1, 3))
    time, pressure = np.arange(100) / 10, np.arange(60.0) * 1e3
    half = quality(make_recording(time, position, pressure=pressure, pressure_time=np.arange(60) / 12))
    assert half.input_overlap == {"pressure": 0.5}
    assert any("covers 50 % of the shape's frames: it has 0 to 4.91667 s, the shape 0 to 9.9 s" in line
               for line in half.findings)  # fmt: skip
    whole = quality(make_recording(time, position, pressure=np.arange(120.0) * 1e3, pressure_time=np.arange(120) / 12))
    assert whole.input_overlap == {"pressure": 1.0}
    assert not [line for line in whole.findings if "covers" in line]
