"""The plain map of a run, through the command: where it wins the verdict says so first, and the files hold it."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from command_line import invoke
from small_study import HEADER, LEVELS_KPA, changed, table, write_recording, write_study

from pliant.validation.metrics_file import MetricsFile
from pliant.validation.store import load_outcome

HALF_THE_TORQUE = {"stiffness": {"value": 0.5, "free": False}, "damping": "free",
                   "torque_1": {"value": 3e-7, "free": False}}  # fmt: skip


def run(folder: Path, content: dict[str, Any] | None = None) -> tuple[str, dict[str, Any]]:
    """Run a study from its file; return what the command prints and the content of metrics.json."""
    done = invoke("run", write_study(folder, content), "-o", folder / "out")
    assert done.exit_code == 0, done.output
    metrics = json.loads((folder / "out" / "metrics.json").read_text(encoding="utf-8"))
    MetricsFile.model_validate(metrics)
    return done.output, metrics


@pytest.fixture(scope="module")
def weak(tmp_path_factory: pytest.TempPathFactory) -> tuple[str, dict[str, Any], Path]:
    """A study whose model has half of the body's torque."""
    folder = tmp_path_factory.mktemp("weak")
    output, metrics = run(folder, changed("fits", "linear", parameters=HALF_THE_TORQUE))
    return output, metrics, folder / "out"


def test_the_verdict_begins_with_the_map_that_wins(weak: tuple[str, dict[str, Any], Path]) -> None:
    output, metrics, _ = weak
    first = metrics["verdict"][0]
    assert first.startswith("linear: A plain map without mechanics (")
    assert "predicts the held-out record better than the model: middle " in first
    assert "a static function of the inputs explains" in first
    assert metrics["headline"]["sentence"].startswith("A plain map without mechanics (")
    assert metrics["headline"]["state"] == "missed"
    assert any("a static function of the inputs explains" in line for line in metrics["headline"]["warnings"])
    flat = " ".join(output.split())
    assert "A plain map without mechanics" in flat
    assert "plain map mm" in flat


def test_metrics_hold_the_choice_and_the_errors_in_the_models_measures(weak: tuple[str, dict[str, Any], Path]) -> None:
    _, metrics, _ = weak
    plain = metrics["baseline"]["linear"]
    assert plain["better"] == ["middle"]
    assert plain["degree"] in (1, 2, 3)
    assert plain["coefficients"] % 2 == 0
    assert plain["outside_percent"]["middle"] == 0.0
    assert plain["explained"]["static"] > 0.5
    assert set(plain["records"]) == set(LEVELS_KPA)
    own = {k for k in metrics["fits"]["linear"]["records"]["middle"] if not k.startswith("within_band")}
    assert set(plain["records"]["middle"]) == own
    assert plain["records"]["middle"]["rmse_mm"] < metrics["records"]["middle"]["rmse_mm"]


def test_figures_and_report_of_the_run_show_the_map(weak: tuple[str, dict[str, Any], Path]) -> None:
    _, _, out = weak
    done = invoke("figures", out, "-o", out / "figures", "--format", "svg", "--records", "middle")
    assert done.exit_code == 0, done.output
    assert "plain map" in (out / "figures" / "linear-middle-motion.svg").read_text(encoding="utf-8")
    page = (out / "report.html").read_text(encoding="utf-8")
    assert '<section id="plain_map">' in page
    record = load_outcome(out).fits[0].records[2]
    error = 1e3 * np.sqrt(np.nanmean(np.sum((record.baseline - record.experiment.compared) ** 2, axis=2)))
    plain = load_outcome(out).fits[0].baseline
    assert plain is not None
    assert error == pytest.approx(plain.records[record.name]["rmse_mm"], rel=1e-6)


def test_a_model_that_is_better_keeps_the_first_word(tmp_path: Path) -> None:
    _, metrics = run(tmp_path)
    assert metrics["baseline"]["linear"]["better"] == []
    assert metrics["verdict"][0].startswith("linear: held-out record middle is predicted")
    assert "A plain map (" in metrics["verdict"][1]
    assert metrics["headline"]["state"] == "good"


def two_pressures(folder: Path, *, apart: bool) -> dict[str, Any]:
    """The small study with a second pressure: always half of the first, or at rest."""
    for name, level in LEVELS_KPA.items():
        rows = table(level)
        second = 0.5 * rows[:, 1] if not apart else 0.0 * rows[:, 1]
        header = ["t", "p_kpa_left", "p_kpa_right", *HEADER[2:]]
        write_recording(folder / f"{name}.csv", np.column_stack([rows[:, :2], second, rows[:, 2:]]), header)
    content = changed("recordings", **{
        name: {"file": f"{name}.csv", "drive": {"near": "left", "far": "right"}} for name in LEVELS_KPA})
    content["actuator"]["chambers"] = [{"name": "near"}, {"name": "far", "joint_gain": -1.0}]
    content["fits"]["linear"]["parameters"] = {"stiffness": {"value": 0.5, "free": False}, "damping": "free",
                                               "near.torque_1": "free"}
    return content


@pytest.mark.parametrize(("apart", "sentence"), [
    (False, "Inputs near, far always move together in the training recordings (far = 0.5 near)"),
    (True, "Input far never moves in the training recordings: the plain map leaves it out."),
])  # fmt: skip
def test_inputs_that_show_too_little_are_named(tmp_path: Path, *, apart: bool, sentence: str) -> None:
    path = write_study(tmp_path, two_pressures(tmp_path, apart=apart), recordings=False)
    done = invoke("run", path, "-o", tmp_path / "out")
    assert done.exit_code == 0, done.output
    metrics = json.loads((tmp_path / "out" / "metrics.json").read_text(encoding="utf-8"))
    assert any(sentence in line for line in metrics["verdict"])


def test_a_map_that_cannot_be_computed_does_not_end_the_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fails(_train: object) -> None:
        raise ArithmeticError("no map today")

    monkeypatch.setattr("pliant.study.run.plain_map", fails)
    _, metrics = run(tmp_path)
    assert metrics["baseline"] == {}
    assert any("the plain map could not be computed: no map today" in line for line in metrics["verdict"])
