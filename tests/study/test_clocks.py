"""A pressure log in a file of its own, on a clock of its own."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from command_line import invoke
from small_study import HEADER, LEVELS_KPA, STIFFNESS, TORQUE, changed, table, write_recording, write_study

from pliant.errors import InputError
from pliant.recording import make_recording
from pliant.recording.inputs import recorded_inputs
from pliant.study import load_study, run_study
from pliant.study.aligned import with_pressure
from pliant.validation.metrics_file import MetricsFile

OFFSETS = {"low": 5.3, "middle": -0.697, "high": 12.0}
LOG = {"header": True, "time": "t_ms", "time_unit": "ms", "pressure": {"columns": ["psi"], "unit": "psi"}}


def two_files(folder: Path, **entries: Any) -> Path:
    """The small study with its pressure in logs of their own, at 250 Hz, whose clocks began at other times."""
    content = changed("fits", "linear")
    for name in LEVELS_KPA:
        content["recordings"][name] |= {"pressure_file": f"{name}_log.csv", "pressure_mapping": LOG, **entries}
    path = write_study(folder, content, recordings=False)
    for name, level in LEVELS_KPA.items():
        columns = table(level)
        shape = [k for k, h in enumerate(HEADER) if h != "p_kpa"]
        write_recording(folder / f"{name}.csv", columns[:, shape], [HEADER[k] for k in shape])
        clock = np.arange(0.0, 1.59, 0.004)
        psi = np.interp(clock, [0.2, 0.21, 0.9, 0.91], [0.0, level, level, 0.0]) / 6.894757293168361
        ticks = np.round(1e3 * (clock - OFFSETS[name] + 20.0))
        write_recording(folder / f"{name}_log.csv", np.column_stack([ticks, psi]), ["t_ms", "psi"])
    return path


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("clocks")
    two_files(folder)
    return folder


@pytest.mark.slow
def test_a_study_brings_each_log_onto_the_clock_of_its_shape(folder: Path) -> None:
    told: list[str] = []
    outcome = run_study(load_study(folder / "study.json"), folder / "out", progress=told.append)
    for name, offset in OFFSETS.items():
        assert outcome.clocks[name].delay == pytest.approx(offset - 20.0, abs=0.004)
        assert any(line.startswith(f"{name}: the pressure's clock is moved by") for line in told)
        assert any("clock is moved" in line for line in outcome.findings[name])
    values = outcome.fits[0].result.values
    assert values["stiffness"] == pytest.approx(STIFFNESS, rel=0.02)
    assert values["torque_1"] == pytest.approx(TORQUE, rel=0.02)
    assert all(r.metrics["rmse_percent_of_travel"] < 2.0 for r in outcome.fits[0].records)
    page = (folder / "out" / "report.html").read_text()
    assert page.count("the pressure&#39;s clock is moved by") >= 3
    assert page.count('id="plot-clock-') == 3
    metrics = json.loads((folder / "out" / "metrics.json").read_text())
    MetricsFile.model_validate(metrics)
    assert metrics["clocks"]["middle"]["delay_s"] == pytest.approx(-20.697, abs=0.004)


def test_a_stated_offset_is_taken_as_it_is(tmp_path: Path) -> None:
    path = two_files(tmp_path)
    content = json.loads(path.read_text())
    for name, offset in OFFSETS.items():
        content["recordings"][name]["clock"] = offset - 20.0
    path.write_text(json.dumps(content))
    outcome = run_study(load_study(path))
    assert not outcome.clocks
    assert any("-20697 ms, as stated" in line for line in outcome.findings["middle"])
    assert all(r.metrics["rmse_percent_of_travel"] < 2.0 for r in outcome.fits[0].records)


@pytest.mark.parametrize(("entries", "said"), [
    ({"pressure_file": None, "clock": "align"}, "there is no measured pressure"),
    ({"pressure_file": "low.csv", "pressure_mapping": None}, "holds no pressure"),
    ({"pressure_file": "absent.csv"}, "absent"),
])
def test_what_does_not_go_together_is_refused(folder: Path, tmp_path: Path, entries: dict[str, Any], said: str) -> None:
    content = json.loads((folder / "study.json").read_text())
    content["folder"] = str(folder)
    content["recordings"]["low"] |= entries
    path = tmp_path / "study.json"
    path.write_text(json.dumps(content))
    with pytest.raises(InputError, match=said):
        run_study(load_study(path))


def test_the_command_finds_the_offset_and_draws_it(folder: Path, tmp_path: Path) -> None:
    mapping = tmp_path / "log.toml"
    mapping.write_text('header = true\ntime = "t_ms"\ntime_unit = "ms"\n'
                       'pressure = { columns = ["psi"], unit = "psi" }\n')
    files = [str(folder / "middle.csv"), str(folder / "middle_log.csv"), "--pressure-mapping", str(mapping)]
    done = invoke("sync", *files, "--figure", str(tmp_path / "c.png"), "-o", str(tmp_path / "joined.nc"))
    assert "the pressure's clock is moved by -2069" in done.stdout
    assert "clock = -20.69" in done.stdout
    assert (tmp_path / "c.png").stat().st_size > 5000
    again = json.loads(invoke("sync", str(tmp_path / "joined.nc"), "--json").stdout)
    assert abs(again["delay_s"]) < 0.002


def test_a_log_on_a_later_clock_is_judged_as_one_on_the_right_clock(tmp_path: Path) -> None:
    """0.6 s late: a rest window before its rise would hold the motion, a plateau read off it the ring-down."""
    path = write_study(tmp_path, changed("fits", "linear", "parameters", start=-0.6))
    for name, level in LEVELS_KPA.items():
        columns = table(level).copy()
        columns[:, 1] = np.interp(columns[:, 0] - 0.6, columns[:, 0], columns[:, 1])
        write_recording(tmp_path / f"{name}.csv", columns)
    outcome = run_study(load_study(path))
    for record in outcome.fits[0].records:
        assert record.metrics["rmse_percent_of_travel"] < 1.0
        steady = record.metrics["steady_state_mm"]
        assert steady["measured"] > 0.4 * record.metrics["travel_mm"]
        assert abs(record.metrics["steady_state_error_mm"]) < 0.02 * record.metrics["travel_mm"]


def test_a_separate_log_may_hold_tensions() -> None:
    clock, time = np.arange(50) * 0.02, np.arange(40) * 0.025
    shape = make_recording(time, np.zeros((40, 1, 3)) + time[:, None, None], station=["tip"], frame="spatial")
    log = make_recording(actuation=np.stack([clock, 2 * clock], axis=1), input_time=clock, input_names=["a", "b"],
                         input_kind=["tension", "angle"])  # fmt: skip
    joined = with_pressure(shape, log, "r", "log.csv")
    found = [(one.name, one.unit) for one in recorded_inputs(joined)]
    assert found == [("a", "N"), ("b", "rad")]
    np.testing.assert_array_equal(joined["actuation"], log["actuation"])
    assert "actuation from log.csv" in joined.attrs["history"]
    with pytest.raises(InputError, match="recording r holds inputs already"):
        with_pressure(joined, log, "r", "log.csv")
    with pytest.raises(InputError, match="holds no pressure or other input: state its columns"):
        with_pressure(shape, shape, "r", "log.csv")
