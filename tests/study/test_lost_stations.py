"""A study of recordings with lost stations, spikes and glitches gives the result of clean ones and names each."""

from __future__ import annotations

import json

import numpy as np
import pytest

from pliant.study.schema import Targets
from pliant.study.verdict import judged
from tests.command_line import invoke
from tests.small_study import HEADER, LEVELS_KPA, STUDY, changed, table, write_recording, write_study


def run(folder, content=None, spoil=None):
    """Run the small study through the command; return its output and metrics."""
    path = write_study(folder, content)
    for name, level in LEVELS_KPA.items():
        columns = table(level).copy()
        if spoil is not None:
            spoil(columns)
        write_recording(folder / f"{name}.csv", columns)
    result = invoke("run", path, "--output", folder / "out")
    metrics = folder / "out" / "metrics.json"
    return result, json.loads(metrics.read_text()) if metrics.is_file() else {}


TIP, BASE = slice(5, 8), slice(2, 5)


def lose(mark):
    def spoil(columns):
        columns[:2, 2:] = mark
        columns[70:73, TIP] = mark
    return spoil


@pytest.mark.slow
def test_zeros_of_a_lost_tracker_give_the_result_of_gaps(tmp_path):
    (tmp_path / "gaps").mkdir()
    (tmp_path / "zeros").mkdir()
    _, gaps = run(tmp_path / "gaps", spoil=lose(np.nan))
    shown, zeros = run(tmp_path / "zeros", spoil=lose(0.0))
    assert shown.exit_code == 0, shown.output
    for key in ("rmse_mm", "travel_mm", "max_mm", "points_not_seen"):
        assert zeros["records"]["middle"][key] == gaps["records"]["middle"][key]
    assert zeros["records"]["middle"]["points_not_seen"] == 5
    assert any("position exactly 0, 0, 0; read as gaps: tip 5, base 2" in f for f in zeros["findings"]["middle"])


@pytest.mark.slow
def test_a_spike_is_no_motion_of_the_body(tmp_path):
    def spike(columns):
        columns[70, TIP] += 0.02

    (tmp_path / "kept").mkdir()
    (tmp_path / "left").mkdir()
    kept = json.loads(json.dumps(STUDY))
    for entry in kept["recordings"].values():
        entry["spikes"] = "keep"
    _, right = run(tmp_path / "left", spoil=spike)
    assert right["records"]["middle"]["points_not_seen"] == 1
    assert right["records"]["middle"]["max_mm"] < 5.0
    assert any("left its path for one frame: tip 1" in line for line in right["findings"]["middle"])
    _, wrong = run(tmp_path / "kept", kept, spike)
    assert wrong["records"]["middle"]["max_mm"] > 15.0
    assert wrong["records"]["middle"]["travel_mm"] == pytest.approx(right["records"]["middle"]["travel_mm"], rel=1e-2)


def test_a_station_beyond_the_reach_of_the_body_makes_the_recording_unusable(tmp_path):
    def wander(columns):  # an hour-glass of 20 frames: no spike, no repeated position
        columns[70:90, TIP] += 0.4 * np.sin(np.linspace(0.0, np.pi, 20))[:, None]

    path = write_study(tmp_path)
    columns = table(LEVELS_KPA["middle"]).copy()
    wander(columns)
    write_recording(tmp_path / "middle.csv", columns, HEADER)
    result = invoke("run", path, "--output", tmp_path / "out")
    assert result.exit_code == 0, result.output
    metrics = json.loads((tmp_path / "out" / "metrics.json").read_text())
    said = "recording middle is dropped: station tip is 7"
    assert any(w.startswith(said) and "in frame 8" in w and "(at 0.7" in w for w in metrics["headline"]["warnings"])
    assert "middle" not in metrics["records"]


def test_a_study_without_a_usable_recording_names_the_frame(tmp_path):
    result, _ = run(tmp_path, changed("actuator", length=0.06))
    assert result.exit_code != 0
    assert "low, high cannot be used" in str(result.exception)
    assert "station tip is 1" in str(result.exception)
    assert not (tmp_path / "out" / "metrics.json").exists()


def test_the_rigid_part_before_the_body_counts_as_reach(tmp_path):
    result, metrics = run(tmp_path, changed("actuator", length=0.06, base_length=0.06))
    assert result.exit_code == 0, result.output
    assert not any("state length" in w or "dropped" in w for w in metrics["headline"]["warnings"])


def of_errors(most):
    pair = {"measured": None, "modelled": None}
    return {"rmse_percent_of_travel": 1.6, "travel_mm": 100.0, "max_mm": most, "rmse_mm": 1.6,
            "steady_state_mm": pair, "frequency_hz": pair, "damping_ratio": pair,
            "frequency_large_hz": pair, "frequency_small_hz": pair}  # fmt: skip


def test_no_target_is_met_by_a_miss_of_nearly_the_whole_motion():
    targets = Targets(rmse_percent_of_travel=5.0)
    assert judged(of_errors(60.0), targets) == " (target 5 %: met)"
    said = judged(of_errors(96.0), targets)
    assert said == " (target 5 %: missed; the largest error, 96 mm, is 96 % of the peak displacement: missed)"
    assert judged(of_errors(96.0), Targets()) == ""


def test_a_glitch_of_the_pressure_drives_no_model(tmp_path):
    def glitch(columns):
        columns[:, 1] += 2.0 * np.random.default_rng(3).standard_normal(len(columns))
        columns[60, 1] = 900.0

    result, metrics = run(tmp_path, spoil=glitch)
    assert result.exit_code == 0, result.output
    assert any("left out glitches of inputs" in line for line in metrics["findings"]["middle"])
    assert metrics["records"]["middle"]["rmse_percent_of_travel"] < 3.0
