"""What `inspect` says of a log of pressure: what it is, how fast, and which of its samples are missing."""

from __future__ import annotations

import json

import numpy as np
import pytest
from command_line import invoke

from pliant.preprocessing.quality import quality
from pliant.recording import make_recording

TIME = np.arange(60) / 10


def log(keep=slice(None), time=TIME, chambers=None):
    time = np.asarray(time)[keep]
    p = np.linspace(0, 5e4, time.size)
    return make_recording(pressure=p if chambers is None else np.stack([p] * chambers, 1), pressure_time=time)


def without(*missing):
    return np.setdiff1d(np.arange(60), missing)


def test_a_log_says_what_it_is():
    first, advice, *rest = quality(log()).summary().split("\n")
    assert (first, advice[:17]) == ("log of 60 pressure samples, 5.90 s at 10 Hz", "it holds no shape")
    assert rest == ["pressure p: 0 to 50 kPa", "no faults were found"]
    assert quality(log(chambers=3)).summary().startswith("log of 60 pressure samples of 3 chambers, 5.90 s at 10 Hz\n")
    assert quality(log(slice(1))).summary().startswith("log of 1 pressure samples\n")


def test_missing_rows_are_named():
    found = quality(log(without(7, 20, 21, 22, 40)))
    assert found.pressure_gaps == tuple((k, pytest.approx(t), pytest.approx(s), n) for k, t, s, n in
                                        ((7, 0.6, 0.2, 1), (19, 1.9, 0.4, 3), (36, 3.9, 0.2, 1)))  # fmt: skip
    count, length = "5 of 60 samples of the pressure are missing, in 3 gap(s)", "the longest gap is 0.4 s (3 missing)"
    assert found.findings == (f"{count} after sample 7 (0.6 s), 19 (1.9 s), 36 (3.9 s); {length} at 1.9 s",)


@pytest.mark.parametrize("seed", range(5))
def test_any_24_of_60_are_counted(seed):
    missing = np.random.default_rng(seed).choice(np.arange(1, 59), 24, replace=False)
    found = quality(log(without(*missing), TIME + 1e-3 * np.random.default_rng(seed).uniform(-1, 1, 60)))
    assert sum(gap[3] for gap in found.pressure_gaps) == 24
    assert found.findings[0].startswith("24 of 60 samples of the pressure are missing")


@pytest.mark.parametrize("time", [
    TIME + np.random.default_rng(1).uniform(-0.02, 0.02, 60),
    np.cumsum(np.random.default_rng(2).uniform(0.09, 0.12, 60)),
])
def test_a_clock_that_trembles_misses_nothing(time):
    assert quality(log(time=time)).findings == ()


def test_a_log_of_events_is_irregular_and_misses_nothing():
    found = quality(log(time=np.cumsum(np.random.default_rng(3).exponential(0.1, 60))))
    assert found.pressure_gaps == ()
    assert found.findings[0].startswith("the times of the pressure are irregular: steps of ")


def test_a_pressure_beside_a_shape_has_a_line_where_its_clock_differs():
    place = 0.1 * np.random.default_rng(4).normal(size=(30, 3, 3)) + np.arange(3)[:, None]
    shape = {"time": np.arange(30) / 5, "position": place}
    own = quality(make_recording(**shape, pressure=np.linspace(0, 5e4, 60), pressure_time=TIME)).summary()
    assert "\npressure with its own times: 60 samples, 5.90 s at 10 Hz\n" in own
    same = quality(make_recording(**shape, pressure=np.linspace(0, 5e4, 30)))
    assert "its own times" not in same.summary()
    assert same.pressure_samples == 0


def test_inspect_tells_it(tmp_path):
    rows = [f"{t:.1f},{5 * t}" for t in TIME[without(5, 6)]]
    (tmp_path / "log.csv").write_text("\n".join(["t,p_kpa", *rows, ""]))
    text = invoke("inspect", tmp_path / "log.csv").output
    assert "log of 58 pressure samples, 5.90 s at 10 Hz" in text
    assert "! 2 of 60 samples of the pressure are missing, in 1 gap(s) after sample 5 (0.4 s)" in text
    told = json.loads(invoke("inspect", tmp_path / "log.csv", "--json").output)["quality"]
    assert (told["pressure_samples"], told["pressure_gaps"][0][3]) == (58, 2)
    assert told["pressure_rate_hz"] == pytest.approx(10)
