"""A study with a model selection: the chosen model is the study's, and the page shows what was tried."""

from __future__ import annotations

import json
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from command_line import program

from pliant.errors import InputError
from pliant.identification import Band
from pliant.study import demo_study, load_study, run_study
from pliant.validation.metrics_file import MetricsFile
from pliant.validation.store import load_outcome


def written(folder: Path, **selection: Any) -> Path:
    """The demo's study with a model selection in the place of its fits."""
    content = tomllib.loads(demo_study().read_text(encoding="utf-8"))
    content.pop("fits", None)
    content.pop("forecasts", None)
    content["folder"] = str(demo_study().parent)
    content["model_selection"] = {"train": ["pulse_60", "pulse_180"], "held_out": ["pulse_119"], **selection}
    path = folder / "selection.json"
    path.write_text(json.dumps(content), encoding="utf-8")
    return path


@pytest.mark.slow
def test_the_chosen_model_is_the_study_s_and_the_page_shows_what_was_tried(tmp_path: Path) -> None:
    path = written(tmp_path, terms=["softening", "slip", "clock"], common={"stiffness_*": {"shrink": 0.3}})
    done = program("run", path, "-o", tmp_path / "out")
    assert done.returncode == 0, done.stderr
    metrics = json.loads((tmp_path / "out" / "metrics.json").read_text(encoding="utf-8"))
    MetricsFile.model_validate(metrics)
    chosen = metrics["model_selection"]
    assert "softening" in chosen["terms"]
    assert set(chosen["terms"]) <= {"softening", "slip", "clock"}
    assert list(metrics["fits"]) == ["model_selection"]
    assert metrics["verdict"][0].startswith("Model selection chose ")
    errors = [sum(s["left_out"].values()) for s in chosen["steps"]]
    assert errors == sorted(errors, reverse=True)
    assert metrics["records"]["pulse_119"]["rmse_percent_of_travel"] < 2.0
    page = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    assert "<h2>Model selection</h2>" in page
    assert "left-out parts are predicted" in page
    again = load_outcome(tmp_path / "out")
    assert again.model_selection.to_dict() == chosen


@pytest.mark.parametrize(("entries", "words"), [
    ({"terms": ["moon"]}, ["moon", "softening"]), ({"without": ["moon"]}, ["moon", "softening"]),
    ({"stages": ["given"]}, ["stages", "remove", "terms"]), ({"choose_by": "training"}, ["choose_by", "remove"]),
    ({"minutes": 0}, ["minutes", "greater than 0"]), ({"train": ["nowhere"]}, ["nowhere", "pulse_60"]),
])  # fmt: skip
def test_a_wrong_entry_is_refused_before_any_work(tmp_path: Path, entries: dict[str, Any], words: list[str]) -> None:
    done = program("run", written(tmp_path, **entries), "-o", tmp_path / "out")
    assert done.returncode == 2
    assert all(word in done.stderr for word in words), done.stderr
    assert not (tmp_path / "out").exists()
    with pytest.raises(InputError):
        load_study(written(tmp_path, **entries))


@pytest.mark.slow
def test_minutes_limits_a_run_that_then_goes_on_in_the_same_folder(tmp_path: Path) -> None:
    path, out = written(tmp_path, terms=["softening"]), tmp_path / "out"
    done = program("run", path, "-o", out, "--minutes", "0.01")
    assert done.returncode == 0, done.stderr
    assert "the time limit was reached" in json.loads((out / "metrics.json").read_text())["model_selection"]["reason"]
    assert (out / "search.json").is_file()
    again = program("run", path, "-o", out)
    assert again.returncode == 0, again.stderr
    assert "goes on from a run that was stopped" in (out / "run.log").read_text()
    assert "softening" in json.loads((out / "metrics.json").read_text())["model_selection"]["terms"]
    assert not (out / "search.json").exists()


def test_rivals_widen_the_band_where_they_predict_something_else() -> None:
    line = np.zeros((3, 1, 2))
    band = Band(line, line + 3.0, line - 1.96 * 3.0, line + 1.96 * 3.0, 0.95)
    wider = band.widened(line + 4.0)
    assert np.allclose(wider.std, 5.0)
    assert np.allclose(wider.upper, 5.0 * 1.959964)
    assert np.allclose(wider.lower, -wider.upper)


def test_minutes_needs_a_model_selection(tmp_path: Path) -> None:
    done = program("run", demo_study_without_selection(tmp_path), "-o", tmp_path / "out", "--minutes", "1")
    assert done.returncode == 2
    assert "[model_selection]" in done.stderr
    assert not (tmp_path / "out").exists()


def demo_study_without_selection(folder: Path) -> Path:
    content = tomllib.loads(demo_study().read_text(encoding="utf-8"))
    content.pop("model_selection")
    path = folder / "plain.json"
    path.write_text(json.dumps({**content, "folder": str(demo_study().parent)}), encoding="utf-8")
    return path


@pytest.mark.slow
def test_a_model_selection_ends_at_its_time_limit(tmp_path: Path) -> None:
    outcome = run_study(load_study(written(tmp_path, minutes=1e-6, held_out=[])))
    assert outcome.model_selection is not None
    assert outcome.model_selection.terms == ()
    assert "the time limit was reached" in outcome.model_selection.reason
    assert outcome.fits[0].result.values["torque_1"] > 0
