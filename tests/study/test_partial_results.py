"""What cannot be computed of a study is a result: its sentence is in table, metrics and report, the rest is there."""

from __future__ import annotations

import json
from pathlib import Path
from threading import Event
from typing import Any

import pytest
from small_study import STUDY, changed, write_study
from typer.testing import CliRunner

from pliant.cli import app
from pliant.errors import FitError, InputError, SimulationError
from pliant.study import load_study, parallel_fits, run_study
from pliant.study.run import prepare_all
from pliant.validation.draw import draw_figures
from pliant.validation.metrics_file import MetricsFile
from pliant.validation.outcome import FitOutcome
from pliant.validation.store import load_outcome

FIT: dict[str, Any] = STUDY["fits"]["linear"] | {"train": ["low", "middle"], "held_out": ["high"]}
KNOWN = {"stiffness": {"value": 0.5, "free": False}, "damping": {"value": 3e-3, "free": False}}
SOFT = FIT | {"parameters": KNOWN | {"torque_1": {"value": 5e-7}, "stiffening": {"value": -2.0, "free": False}}}
FIXED = FIT | {"parameters": KNOWN | {"torque_1": {"value": 6e-7, "free": False}}}
SENTENCE = "Fit soft: the prediction of record high could not be computed: "


def study_of(**fits: Any) -> dict[str, Any]:
    """The small study with these fits alone."""
    return changed("fits", value=fits)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Three fits: one whose springs run out of torque at the held-out pressure, a good one, one that cannot start."""
    where = tmp_path_factory.mktemp("partial")
    content = study_of(soft=SOFT, good=FIT, fixed=FIXED)
    content["forecasts"] = {
        "stronger": {"like": "low", "known": {"tip_mass": 0.01}},
        "torn": {"like": "high", "known": {"tip_mass": 0.01}},
    }
    ran = CliRunner().invoke(app, ["run", str(write_study(where, content)), "-o", str(where / "out")])
    assert ran.exit_code == 0, ran.output
    (where / "output.txt").write_text(ran.output, encoding="utf-8")
    return where


def test_the_run_ends_well_with_warnings_that_name_fit_and_record(folder: Path) -> None:
    lines = (folder / "output.txt").read_text(encoding="utf-8").splitlines()
    warned = [line for line in lines if line.startswith("warning: ")]
    assert len(warned) == 3
    assert warned[0].startswith(f"warning: {SENTENCE}")
    assert "the spring of joint 1" in warned[0]
    assert warned[1].startswith("warning: Fit fixed could not be computed: nothing to fit")
    assert warned[2].startswith("warning: Fit soft: the forecast torn could not be computed: ")


def test_everything_else_is_computed_and_judged(folder: Path) -> None:
    metrics = json.loads((folder / "out" / "metrics.json").read_text(encoding="utf-8"))
    MetricsFile.model_validate(metrics)
    assert list(metrics["fits"]) == ["soft", "good"]
    soft, good = (metrics["fits"][name]["records"] for name in ("soft", "good"))
    assert set(soft["high"]) == {"role", "not_computed"}
    assert soft["high"]["not_computed"].startswith(SENTENCE)
    assert soft["low"]["rmse_percent_of_travel"] < 20
    assert good["high"]["rmse_percent_of_travel"] < 1
    assert good["high"]["within_band_percent"] > 50
    assert metrics["records"]["high"]["fit"] == "good"  # the first fit that computes it
    assert list(metrics["forecasts"]) == ["stronger"]
    assert [(n["what"], n["fit"]) for n in metrics["not_computed"]] == [("fit", "fixed"), ("forecast torn", "soft")]
    assert any(line.startswith(SENTENCE) for line in metrics["verdict"])
    headline = metrics["headline"]
    assert headline["state"] == "missed"  # a target is stated, and the first fit cannot predict
    assert headline["sentence"].startswith("Held-out record high could not be predicted.")
    assert any("Fit fixed could not be computed" in line for line in headline["warnings"])


def test_the_report_has_the_sentence_in_the_row_of_the_record(folder: Path) -> None:
    page = (folder / "out" / "report.html").read_text(encoding="utf-8")
    row = page[page.index('id="records"'):].split('<th scope="row">high<span class="small">soft</span></th>')[1]
    assert row[: row.index("</tr>")].count(SENTENCE) == 1
    assert 'class="missing" title="Fit soft: the prediction' in page


def test_what_was_written_is_read_back(folder: Path) -> None:
    again = load_outcome(folder / "out")
    assert [n.what for n in again.not_computed] == ["fit", "forecast torn", "prediction"]
    assert again.fits[0].missing[0].sentence.startswith(SENTENCE)
    assert any("not computed" in row for row in again.card().rows)


@pytest.mark.slow
def test_the_figures_of_what_was_computed_are_drawn(folder: Path) -> None:
    drawn = CliRunner().invoke(app, ["figures", str(folder / "out"), "--format", "svg", "--all-fits"])
    assert drawn.exit_code == 0, drawn.output
    names = {path.stem for path in (folder / "out" / "figures").iterdir()}
    assert "good-high-motion" in names
    assert "soft-low-motion" in names
    assert "soft-high-motion" not in names


def test_a_record_that_no_fit_predicts_is_in_every_table(tmp_path: Path) -> None:
    outcome = run_study(load_study(write_study(tmp_path, study_of(soft=SOFT))), tmp_path / "out")
    metrics = json.loads((tmp_path / "out" / "metrics.json").read_text(encoding="utf-8"))
    assert metrics["records"]["high"]["not_computed"].startswith(SENTENCE)
    assert [m.record for m in load_outcome(tmp_path / "out").fits[0].missing] == ["high"]
    assert outcome.headline is not None
    with pytest.raises(InputError, match="no figure of record 'high' can be drawn: Fit soft"):
        list(draw_figures(outcome, tmp_path / "figures", records=["high"]))


def test_where_nothing_remains_the_run_fails_and_says_why_of_every_fit(tmp_path: Path) -> None:
    path = write_study(tmp_path, study_of(one=FIXED, other=FIXED))
    with pytest.raises(FitError, match=r"fit one: nothing to fit.*; fit other: nothing to fit"):
        run_study(load_study(path), tmp_path / "out")
    ran = CliRunner().invoke(app, ["run", str(path), "-o", str(tmp_path / "out")])
    assert ran.exit_code == 1
    assert not (tmp_path / "out" / "metrics.json").exists()


@pytest.mark.parametrize("error", [SimulationError("it buckles."), ArithmeticError("no number")])
def test_a_band_that_cannot_be_computed_leaves_the_prediction(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, error: Exception,
) -> None:
    def fail(*_: Any, **__: Any) -> Any:
        raise error

    monkeypatch.setattr("pliant.identification.prediction_bands.prediction_band", fail)
    outcome = run_study(load_study(write_study(tmp_path, study_of(good=FIT))), tmp_path / "out")
    (record,) = (r for r in outcome.fits[0].records if r.role == "held_out")
    assert record.band is None
    assert record.metrics["rmse_percent_of_travel"] < 1
    said = f"Fit good: the band of record high could not be computed: {str(error).rstrip('.')}."
    assert outcome.to_dict()["fits"]["good"]["records"]["high"]["not_computed"] == said
    assert said in outcome.verdict
    assert said in (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    assert load_outcome(tmp_path / "out").fits[0].not_computed == outcome.fits[0].not_computed


def test_a_motion_that_is_not_finite_is_no_small_error(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Frames of NaN count as not seen: a diverged motion would look like a good one."""
    from pliant.study import fits

    predict = fits.predict

    def diverging(model: Any, exp: Any, values: Any, step: float) -> Any:
        told = predict(model, exp, values, step)
        if exp.name == "high":
            told["compared"][90:] = float("nan")
        return told

    monkeypatch.setattr(fits, "predict", diverging)
    outcome = run_study(load_study(write_study(tmp_path, study_of(good=FIT))))
    assert [m.record for m in outcome.fits[0].missing] == ["high"]
    assert "not finite" in outcome.fits[0].missing[0].reason


@pytest.mark.parametrize("workers", [1, 2])
def test_a_fit_that_fails_in_a_helper_is_one_result_among_others(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, workers: int,
) -> None:
    study = load_study(write_study(tmp_path, study_of(good=FIT, fixed=FIXED, soft=SOFT)))
    ready = prepare_all(study, lambda _line: None)
    told: list[str] = []
    helped = Event()

    def tell(line: str) -> None:
        told.append(line)
        if line.startswith("warning: Fit fixed"):
            helped.set()

    if workers == 2:  # this process begins its first fit when the helper has failed in the second
        own = parallel_fits.fit_or_error

        def fit_or_error(*arguments: Any) -> Any:
            assert helped.wait(60.0)
            return own(*arguments)

        monkeypatch.setattr(parallel_fits, "HEAD_START", 0.0)
        monkeypatch.setattr(parallel_fits, "fit_or_error", fit_or_error)
    ends = dict(parallel_fits.run_fits(study, ready.experiments, ready.model, tell, workers=workers))
    assert list(ends) == ["good", "fixed", "soft"]
    assert isinstance(ends["fixed"], FitError)
    assert isinstance(ends["good"], FitOutcome)
    assert isinstance(ends["soft"], FitOutcome)
    assert [m.record for m in ends["soft"].missing] == ["high"]
    assert sum(line.startswith("warning: ") for line in told) == 2
