"""Updates of an input that its neighbours and its sister channels contradict are named and left out; pulses are not."""

from __future__ import annotations

import numpy as np
import pytest

from pliant.preprocessing.glitches import AROUND, input_glitches, leave_out_glitches, usual_steps
from pliant.preprocessing.quality import quality
from pliant.recording import make_recording

TIME = np.arange(0.0, 40.0, 0.01)
EVERY = 17  # samples of the log from one reading to the next


def pouches(seed=1, count=3, every=EVERY):
    """Pressures (T, C) [Pa] of pouches of one segment that are fed together, read more slowly than they are logged."""
    rng = np.random.default_rng(seed)
    level = 7e3 * (1 + np.sin(2 * np.pi * 0.1 * TIME) * np.exp(-TIME / 60))
    values = level[:, None] * (1 + 0.02 * np.arange(count)) + 60 * rng.standard_normal((TIME.size, count))
    return values[(np.arange(TIME.size) // every) * every]


def log(values, **kwargs):
    names = [f"pouch_{k}" for k in range(values.shape[1])]
    return make_recording(pressure=values, pressure_time=TIME, chamber=names, **kwargs)


def spoilt(values, updates=1, begin=60 * EVERY, column=1, by=1.9e5):
    changed = values.copy()
    changed[begin : begin + updates * EVERY, column] += by
    return changed


@pytest.mark.parametrize(("updates", "by"), [(1, 1.9e5), (3, 1.9e5), (8, 1.9e5), (1, 2.4e4), (1, -1.5e4), (3, 2.4e4)])
def test_an_update_that_sister_channels_contradict_is_a_glitch(updates, by):
    values = pouches()
    wrong = log(spoilt(values, updates, by=by))
    found = input_glitches(wrong)
    assert list(found) == ["pouch_1"]
    assert [(time, count) for time, _, count in found["pouch_1"]] == [(pytest.approx(10.2), updates * EVERY)]
    mended = leave_out_glitches(wrong)
    away = np.abs(mended["pressure"].values - values)
    assert away[:, [0, 2]].max() == 0
    assert away[:, 1].max() < (1e3 if updates == 1 else 5e3)
    assert "left out glitches of inputs and joined their neighbours: pouch_1 1 (at 10.20 s)" in mended.attrs["history"]


def test_inspect_names_the_glitch_and_leaves_it_out_of_the_range():
    found = quality(log(spoilt(pouches())))
    line = next(line for line in found.findings if line.startswith("glitches of input pouch_1"))
    assert "kPa at 10.20 s" in line
    assert found.pressure_kpa["pouch_1"][1] < 20.0


def test_a_single_channel_has_a_glitch_only_far_outside_of_its_range():
    one = pouches(count=1)
    assert list(input_glitches(log(spoilt(one, column=0)))) == ["pouch_0"]
    assert not input_glitches(log(spoilt(one, column=0, by=4e3)))


def pulses(width, every=EVERY):
    """Chambers that are driven one after the other, by pulses of `width` updates."""
    values = np.zeros((TIME.size, 3))
    for k in range(12):
        begin = (5 + 18 * k) * every
        values[begin : begin + width * every, k % 3] = 4e4
    return values + np.repeat(50 * np.random.default_rng(2).standard_normal((TIME.size // every + 1, 3)), every, 0)[
        : TIME.size
    ]


@pytest.mark.parametrize("width", [1, 2, 5])
def test_pulses_of_single_chambers_are_no_glitches(width):
    assert not input_glitches(log(pulses(width)))
    assert not input_glitches(log(pulses(width)[:, :1]))


def test_inputs_without_a_glitch_are_returned_unchanged():
    recording = log(pouches())
    assert leave_out_glitches(recording) is recording


def test_a_pulse_of_all_chambers_is_no_glitch():
    values = pouches()
    values[60 * EVERY : 61 * EVERY] += 5e4
    assert not input_glitches(log(values))


def test_samples_without_a_value_are_no_glitches():
    values = pouches()
    values[60 * EVERY : 61 * EVERY, 1] = np.nan
    assert not input_glitches(log(values))


@pytest.mark.parametrize("count", [1, 6, 7, 12, 13, 14, 200])
def test_the_usual_step_is_the_median_of_the_steps_around_it(count):
    size = np.random.default_rng(count).integers(0, 40, count) * 0.1
    plain = [np.median([size[j] for j in range(count) if abs(j - k) <= AROUND]) for k in range(count)]
    assert np.array_equal(usual_steps(size), plain)
