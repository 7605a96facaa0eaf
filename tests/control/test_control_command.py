"""`pliant control`: from a task to a report."""

from __future__ import annotations

from pathlib import Path

import pytest
import typer
from typer.testing import CliRunner

from pliant.cli.control import control
from pliant.control import read_task
from pliant.errors import InputError
from pliant.loop import read_log

MODEL = Path(__file__).parents[2] / "examples" / "control" / "model_a.json"


@pytest.mark.slow
def test_a_task_is_done(tmp_path, capsys):
    task = tmp_path / "task.toml"
    valve = "[valve]\nrise_hz = 9.01\nfall_hz = 6.46\ndamping_ratio = 0.765\ndead_time_ms = 8.12\n"
    task.write_text("duration_s = 0.6\n[[setpoint]]\ntime_s = 0.1\ndisplacement_mm = 15.0\n" + valve)
    control(model=MODEL, task=task, plant="testbed:a", output=tmp_path / "out", real_time=False)
    said = capsys.readouterr().out
    assert "phase margin" in said
    assert "fault: none" in said
    assert "settling: " in said
    assert "command change motion" in said
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
    wanted = read_task(tmp_path / "t.toml")
    assert (wanted.task.time, wanted.task.displacement, wanted.period) == (0.0, 0.025, 4e-3)
    assert (wanted.limits.highest, wanted.supply.dead_time) == pytest.approx((190e3, 8.12e-3))


@pytest.mark.parametrize(
    ("text", "sentence"),
    [("speed = 3\n", "'speed' is not a known entry.*use one of period_ms.*and 3 more"),
     ("[valve]\nrise_hz = 9.0\nfall_hz = 6.0\ndamping_ratio = 0.9\ndead_time_ms = 8.0\ncolour = 3\n",
      "'valve.colour' is not a known entry: remove it, or use one of rise_hz, fall_hz"),
     ("highest_kpa = -1\n", "'highest_kpa' must be a positive number.*-1"),
     ("ramp_s = true\n", "'ramp_s' must be a positive number"), ("", "at least one"),
     ("[[setpoint]]\ntime_s = 0\n", r"'setpoint.0' needs displacement_mm for one chamber"), ("[[", "is not valid TOML"),
     ("[[setpoint]]\ntime_s = 'now'\ndisplacement_mm = 3\n", "'setpoint.0.time_s' must be a number"),
     ("planned = 1\n", "'planned' must be true or false"), ("[valve]\nrise_hz = 3\n", "'valve.fall_hz' is missing"),
     ("[path]\ntime_s = [0]\n", "'path' needs displacement_mm for one chamber, or some of tip_x_mm"),
     ("[path]\ntime_s = [0]\ndisplacement_mm = [1, 2]\n", "as many displacements as times"),
     ("feedback = 'bang'\n", "unknown controller 'bang': use one of lqr, mpc, pid")],
)  # fmt: skip
def test_tasks_that_are_none(tmp_path, text, sentence):
    (tmp_path / "t.toml").write_text(text)
    with pytest.raises(InputError, match=sentence) as caught:
        read_task(tmp_path / "t.toml")
    assert str(tmp_path / "t.toml") in str(caught.value)


@pytest.mark.parametrize(("estimator", "bound"), [("filter", 1e-3), ("differences", 4e-3)])
def test_another_estimator_by_its_name(tmp_path, capsys, estimator, bound):
    """Without a model nothing but the slow integral makes up for what the body has and the model lacks."""
    (tmp_path / "t.toml").write_text(
        "duration_s = 0.4\nplanned = false\n[[setpoint]]\ntime_s = 0.0\ndisplacement_mm = 10.0\n"
    )
    control(model=MODEL, task=tmp_path / "t.toml", plant="testbed:a", output=tmp_path / "out", estimator=estimator)
    said = capsys.readouterr().out
    assert "fault: none" in said
    table = read_log(tmp_path / "out" / "log.csv")
    assert abs(table["error_m"].iloc[-20:].mean()) < bound
    for text in (said, (tmp_path / "out" / "report.md").read_text(), *table.attrs["remarks"]):
        assert "gain margin" in text
        assert "rehearsed on the model within 0 ... 190 kPa: set-points settle after" in text


def test_an_estimator_that_is_none(tmp_path):
    with pytest.raises(InputError, match="unknown estimator 'guess': use one of observer, filter, differences"):
        control(model=MODEL, plant="testbed:a", output=tmp_path / "out", estimator="guess")
