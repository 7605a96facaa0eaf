"""`pliant control`: from a task to a report."""

from __future__ import annotations

from pathlib import Path

import pytest
import typer
from typer.testing import CliRunner

from pliant.cli.control import control, read_task
from pliant.errors import InputError
from pliant.loop import read_log

MODEL = Path(__file__).parents[2] / "examples" / "control" / "model_a.json"


def test_a_task_is_done(tmp_path, capsys):
    task = tmp_path / "task.toml"
    valve = "[valve]\nrise_hz = 9.01\nfall_hz = 6.46\ndamping_ratio = 0.765\ndead_time_ms = 8.12\n"
    task.write_text("duration_s = 0.6\n[[setpoint]]\ntime_s = 0.1\ndisplacement_mm = 15.0\n" + valve)
    control(model=MODEL, task=task, plant="testbed:a", output=tmp_path / "out", real_time=False)
    said = capsys.readouterr().out
    assert "phase margin" in said
    assert "fault: none" in said
    names = {p.name for p in (tmp_path / "out").iterdir()}
    assert names == {"log.csv", "report.md", "control.png", "control.svg"}
    table = read_log(tmp_path / "out" / "log.csv")
    assert abs(table["error_m"].iloc[-20:].mean()) < 1.5e-3


def test_the_example_is_a_task_and_asks_for_nothing(tmp_path):
    app = typer.Typer()
    app.command()(control)
    done = CliRunner().invoke(app, ["--example"])
    assert done.exit_code == 0
    (tmp_path / "t.toml").write_text(done.stdout)
    assert read_task(tmp_path / "t.toml")["setpoint"] == [(0.0, 0.025)]


@pytest.mark.parametrize(
    ("text", "sentence"),
    [("speed = 3\n", "unknown entry"), ("highest_kpa = -1\n", "positive number"), ("", "at least one"),
     ("[[setpoint]]\ntime_s = 0\n", "displacement_mm"), ("[[", "cannot read"), ("planned = 1\n", "true or false"),
     ("[valve]\nrise_hz = 3\n", "fall_hz"), ("[path]\ntime_s = [0]\n", "as many of each")],
)  # fmt: skip
def test_tasks_that_are_none(tmp_path, text, sentence):
    (tmp_path / "t.toml").write_text(text)
    with pytest.raises(InputError, match=sentence):
        read_task(tmp_path / "t.toml")
