"""A study with a model selection: the chosen stage is the study's model, and the page shows what each stage bought."""

from __future__ import annotations

import json
import tomllib
from pathlib import Path
from typing import Any

import pytest

from pliant.errors import InputError
from pliant.study import demo_study, load_study, run_study
from pliant.validation.metrics_file import MetricsFile


def written(folder: Path, **selection: Any) -> Path:
    """The demo's study with a model selection in the place of its fits."""
    content = tomllib.loads(demo_study().read_text(encoding="utf-8"))
    (fit, *_) = content.pop("fits").values()
    content.pop("forecasts", None)
    content["folder"] = str(demo_study().parent)
    common = {"torque_1": "free", "start": "free"}
    content["model_selection"] = {"common": common, "train": fit["train"], "held_out": fit["held_out"], **selection}
    path = folder / "selection.json"
    path.write_text(json.dumps(content), encoding="utf-8")
    return path


@pytest.mark.slow
def test_the_chosen_stage_is_the_model_and_the_page_shows_all(tmp_path: Path) -> None:
    study = load_study(written(tmp_path, stages=["given", "elastic"], bootstrap=20, choose_by="training"))
    outcome = run_study(study, tmp_path / "out")
    metrics = json.loads((tmp_path / "out" / "metrics.json").read_text(encoding="utf-8"))
    MetricsFile.model_validate(metrics)
    assert list(metrics["model_selection"]["stages"]) == ["given", "elastic"]
    assert metrics["model_selection"]["chosen"] == "elastic"
    assert outcome.verdict[0].startswith("Model selection chose K and D: lowest BIC of the training recordings")
    assert outcome.verdict[0].endswith("held-out recordings had no part in it.")
    assert outcome.fits[0].name == "model_selection"
    assert outcome.fits[0].result.covariance.source == "block bootstrap"
    for name, record in metrics["records"].items():
        assert ("within_band_percent" in record) == (record["role"] == "held_out"), name
        assert 50 < record.get("within_band_percent", 99) <= 100
    page = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    assert "<h2>Model selection</h2>" in page
    assert "uncertainty (block bootstrap)" in page


def test_a_stage_that_nobody_knows_is_refused_before_any_work(tmp_path: Path) -> None:
    told: list[str] = []
    with pytest.raises(InputError, match="names an unknown stage 'moon'"):
        run_study(load_study(written(tmp_path, stages=["moon"])), progress=told.append)
    assert told == []


def test_a_model_selection_s_records_must_be_listed(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="uses recording 'nowhere'"):
        load_study(written(tmp_path, train=["nowhere"]))
