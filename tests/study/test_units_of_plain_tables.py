"""Units of tables that state none: what the program takes by steps and ranges it says, or asks."""

from __future__ import annotations

import tomllib
from pathlib import Path

import numpy as np
import pytest
from command_line import invoke

pytestmark = pytest.mark.usefixtures("untried")

COUNT = 400


def written(path: Path, columns: dict[str, np.ndarray]) -> Path:
    """A text table of columns (T,) by name."""
    np.savetxt(path, np.column_stack([*columns.values()]), "%.9g", ",", header=",".join(columns), comments="")
    return path


def body(size: float = 0.3) -> dict[str, np.ndarray]:
    """A base at rest, and a tip that swings slowly under the pressure; both in space."""
    swing = np.sin(np.linspace(0.0, 6.0, COUNT)) ** 2
    still = np.zeros(COUNT)
    return {"p_kpa": 30.0 * swing, "base_x": still, "base_y": still, "base_z": still, "tip_x": 0.3 * size * swing,
            "tip_y": size * (1.0 - 0.1 * swing**2), "tip_z": still}  # fmt: skip


def drafted(folder: Path, file: Path, *options: str) -> tuple[dict, str]:
    done = invoke("new", folder / "s.toml", "--from", file, *options)
    assert done.exit_code == 0, done.exception or done.output
    text = (folder / "s.toml").read_text(encoding="utf-8")
    return tomllib.loads(text), text


@pytest.mark.parametrize("irregular", [False, True])
@pytest.mark.parametrize(("name", "step", "unit", "note"), [
    ("time", 10, "?", "times are taken in ms until time_unit is stated"),
    ("time", 60, "?", "times are taken in ms until time_unit is stated"),
    ("time", 8, "ms", "times are taken in ms, by their steps: correct time_unit if they are not"),
    ("time", 1, None, "times are taken in s, by their steps: correct time_unit if they are not"),
    ("time", 0.01, None, ""), ("time_ms", 10, "ms", ""), ("millis", 1, "ms", ""), ("time_s", 60, None, ""),
    ("time_ns", 10_000_000, "ns", ""),
])  # fmt: skip
def test_the_unit_of_times_is_stated_said_or_asked(tmp_path, name, step, unit, note, irregular):
    times = step * np.arange(COUNT)
    if irregular:  # one longer step
        times[COUNT // 2 :] += step
        unit, note = ("ms", note.replace(" until time_unit is stated", ", by their steps: correct time_unit if they "
                                         "are not")) if unit == "?" else (unit, note)  # fmt: skip
    file = written(tmp_path / "log.csv", {name: times, **body(300.0)})
    inspected = invoke("inspect", file).stdout
    study, text = drafted(tmp_path, file)
    assert study["mapping"].get("time_unit") == unit
    for output in (inspected, text):
        assert ("times are taken in" in output) == bool(note)
        assert note in output.replace("\n", " ")
    assert ("? time_unit: unit of the times" in inspected) == (unit == "?")


def test_a_unit_of_time_that_a_mapping_states_is_neither_asked_nor_said(tmp_path):
    (tmp_path / "columns.toml").write_text('time_unit = "s"\n', encoding="utf-8")
    file = written(tmp_path / "creep.csv", {"time": 10 * np.arange(COUNT), **body(300.0)})
    study, text = drafted(tmp_path, file, "--mapping", str(tmp_path / "columns.toml"))
    assert study["mapping"]["time_unit"] == "s"
    assert "times are taken" not in text
    assert "at 0.1 Hz" in text


@pytest.mark.parametrize(("size", "unit", "length"), [(30.0, "mm", 0.03), (0.03, None, 0.03), (2.5, None, 2.5)])
@pytest.mark.parametrize("still", [False, True])
def test_the_unit_of_positions_is_that_of_the_whole_body(tmp_path, size, unit, length, still):
    """Stations far apart, each of which moves little: no body of 30 m."""
    columns = {"t_s": 0.02 * np.arange(COUNT), **body(size)}
    if still:
        columns["tip_x"] = 0.1 * columns["tip_x"]
    file = written(tmp_path / "small.csv", columns)
    inspected = invoke("inspect", file).stdout
    study, _ = drafted(tmp_path, file)
    assert study.get("mapping", {}).get("length_unit") == unit
    assert ("positions are taken in mm, by their range" in inspected) == (unit == "mm")
    assert study["actuator"]["length"] == pytest.approx(length, rel=0.01)


@pytest.mark.parametrize(("names", "time"), [
    (("clock", "time"), "time"), (("time", "clock"), "time"), (("clock", "stamp"), None), (("clock", "timestamp"),
                                                                                           "timestamp"),
])  # fmt: skip
def test_a_column_that_does_not_rise_is_no_clock(tmp_path, names, time):
    """A duty value that is called clock."""
    duty, times = 0.5 + 0.4 * np.sin(np.arange(COUNT)), 0.02 * np.arange(COUNT)
    pair = {n: duty if n == "clock" else times for n in names}
    file = written(tmp_path / "run.csv", {**pair, **body(300.0)})
    study, _ = drafted(tmp_path, file)
    assert study["mapping"].get("time") == time
    assert study["mapping"].get("rate_hz") == (None if time else "?")


def test_of_two_columns_that_rise_time_is_the_clock(tmp_path):
    ramp = {"clock": np.linspace(0.0, 1.0, COUNT), "time": 0.02 * np.arange(COUNT)}
    study, _ = drafted(tmp_path, written(tmp_path / "run.csv", {**ramp, **body(300.0)}))
    assert study["mapping"]["time"] == "time"


def test_times_that_start_anew_in_each_trial_are_a_clock(tmp_path):
    columns = {"time": 0.02 * (np.arange(COUNT) % 100), "trial": np.arange(COUNT) // 100, **body(300.0)}
    study, _ = drafted(tmp_path, written(tmp_path / "run.csv", columns))
    assert study["mapping"]["time"] == "time"
