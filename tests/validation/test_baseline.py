"""The plain map beside a model: what the model's residual looks like, and what the report and the figures say."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from pliant.identification import Experiment, FitResult
from pliant.model import chain_model
from pliant.simulation import Trace
from pliant.validation.baseline import (
    DIRECTION,
    DRIFT,
    RATE,
    STATIC,
    Residual,
    better_sentence,
    explained,
    plain_map_sentence,
    suggestion,
    with_baseline,
)
from pliant.validation.figures import comparison_figure, record_figure
from pliant.validation.map_inputs import InputTable
from pliant.validation.metrics import compare
from pliant.validation.outcome import FitOutcome, RecordOutcome, Role, StudyOutcome, in_recorded_axes
from pliant.validation.plain_map import plain_map
from pliant.validation.store import load_outcome, save_results
from pliant.validation.wording import digits
from pliant.view.report import content

T = np.arange(0.0, 40.0, 0.05)
TABLE = InputTable(("left",))


def pressure(seed: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return 50e3 * (1.0 + np.sin(np.outer(T, 0.3 + rng.uniform(0, 1, 3)) + rng.uniform(0, 6, 3)).mean(axis=1))


def driven(name: str, seed: int, tip: np.ndarray | None = None, **more: np.ndarray) -> Experiment:
    """A recording whose tip is a straight function of its pressure."""
    p = pressure(seed)
    tip = np.stack([1e-6 * p, 0.1 + 0 * p], axis=1) if tip is None else tip
    return Experiment(name, T, tip[:, None], ("tip",), "trace", drives={"left": Trace(T, p)})


def rate_of(p: np.ndarray) -> np.ndarray:
    return np.gradient(p, T)


SHAPES = {
    STATIC: lambda p: 1e-8 * p + 2e-13 * p**2,
    DRIFT: lambda p: 1e-4 * (T - 10.0),
    DIRECTION: lambda p: 1e-3 * np.sign(rate_of(p)),
    RATE: lambda p: 5e-8 * rate_of(p),
}


@pytest.mark.parametrize("kind", SHAPES)
def test_what_a_residual_is_made_of_is_recognised(kind: str) -> None:
    rng = np.random.default_rng(2)
    residuals = []
    for k in range(2):
        shape = SHAPES[kind](pressure(k))
        noise = 0.1 * np.std(shape) * rng.standard_normal((T.size, 1, 2))
        residuals.append(Residual(driven(f"e{k}", k), shape[:, None, None] * np.array([1.0, 0.3]) + noise))
    fractions = explained(residuals, TABLE)
    assert max(fractions, key=lambda name: fractions[name]) == kind
    assert fractions[kind] > 0.6
    assert all(0.0 <= value <= 1.0 for value in fractions.values())


def test_a_recorded_input_that_drives_nothing_is_named() -> None:
    spare = 1e4 * np.sin(0.9 * T)
    missed = (1e-7 * spare)[:, None, None] * np.ones((1, 1, 2))
    residual = Residual(driven("e", 1), missed, {"middle": Trace(T, spare)})
    fractions = explained([residual], TABLE)
    assert fractions["middle"] > 0.8
    assert "the recorded input middle, which drives no input of the model, explains" in suggestion(fractions)


def test_noise_is_explained_by_nothing() -> None:
    rng = np.random.default_rng(3)
    fractions = explained([Residual(driven("e", 1), rng.standard_normal((T.size, 1, 2)))], TABLE)
    assert max(fractions.values()) < 0.05
    assert "no simple regressor explains more than" in suggestion(fractions)


def test_too_short_recordings_have_no_explanation() -> None:
    short = Experiment("e", T[:12], np.random.default_rng(1).normal(size=(12, 1, 2)), ("tip",), "release")
    assert explained([Residual(short, short.position)], InputTable(())) == {}
    assert "too short" in suggestion({})


def outcome_with(scale: float) -> FitOutcome:
    """A fit whose model errs by a quadratic function of the pressure, `scale` times a tenth of the motion."""
    model = chain_model(length=0.1, mass=0.05, links=2, stiffness=0.5, damping=3e-3, torque=[1e-7])

    def record(name: str, role: Role, seed: int) -> RecordOutcome:
        exp = driven(name, seed)
        off = scale * 0.1 * (exp.position[:, 0, 0] - 0.05) ** 2 / 0.05
        modelled = exp.position + np.stack([off, 0 * off], axis=1)[:, None]
        return RecordOutcome(name, role, exp, modelled, pressure(seed)[:, None], compare(exp, modelled, 0.1),
                             inputs={"left": "Pa"})  # fmt: skip

    records = (record("one", "train", 1), record("two", "held_out", 2), record("three", "held_out", 3))
    result = FitResult(model, (), "converged", {}, 1, 0.1, True, None)
    fit = FitOutcome("only", "Only fit", result, records, 0.1)
    return with_baseline(fit, plain_map([driven("one", 1)]))


def test_a_better_map_is_named_with_its_records_and_the_suggestion() -> None:
    fit = outcome_with(1.0)
    baseline = fit.baseline
    assert baseline is not None
    assert baseline.better == ("two", "three")
    assert baseline.explained[STATIC] > 0.9
    assert "a static function of the inputs explains" in baseline.suggestion
    assert "predicts 2 of 2 held-out records better than the model: " in better_sentence(fit)
    assert baseline.records["two"]["role"] == "held_out"
    assert baseline.records["two"]["rmse_mm"] < 0.01 * fit.records[1].metrics["rmse_mm"]
    assert set(baseline.records["two"]) == {"role", *fit.records[1].metrics}


def test_a_worse_map_is_reported_and_not_called_better() -> None:
    fit = outcome_with(0.0)
    assert fit.baseline is not None
    assert (fit.baseline.better, fit.baseline.suggestion, better_sentence(fit)) == ((), "", "")
    assert "predicts the held-out records with an RMS error of" in plain_map_sentence(fit)


def study_of(fit: FitOutcome) -> StudyOutcome:
    return StudyOutcome("s", "S", "", fit.result.model, (fit,), findings={r.name: () for r in fit.records})


def test_the_map_survives_metrics_and_results(tmp_path) -> None:
    fit = outcome_with(1.0)
    study = study_of(fit)
    save_results(study, tmp_path)
    content_of_file = json.dumps(study.to_dict(), allow_nan=False)
    (tmp_path / "metrics.json").write_text(content_of_file, encoding="utf-8")
    loaded = load_outcome(tmp_path)
    assert loaded.fits[0].baseline == fit.baseline
    np.testing.assert_array_equal(loaded.fits[0].records[1].baseline, fit.records[1].baseline)


def test_the_map_is_turned_with_the_recording() -> None:
    fit = outcome_with(1.0)
    turned = in_recorded_axes(study_of(fit), {}, dict.fromkeys(("one", "two", "three"), -1))
    before, after = fit.records[1].baseline, turned.fits[0].records[1].baseline
    np.testing.assert_array_equal(after, before * [-1.0, 1.0])


def dotted(figure) -> list:
    return [line for ax in figure.axes for line in ax.get_lines() if line.get_label() == "plain map"]


def test_figures_draw_the_map_dotted_and_keep_their_scale() -> None:
    fit = outcome_with(1.0)
    record = fit.records[1]
    lines = dotted(record_figure(record))
    assert len(lines) == 2
    assert all(line.is_dashed() for line in lines)
    wild = replace(record, baseline=100.0 * record.baseline)
    low, high = record_figure(wild).axes[0].get_ylim()
    assert high - low < 2.0 * np.ptp(1e3 * record.modelled[:, 0, 0])
    assert len(dotted(comparison_figure([fit], "two"))) == 2
    assert not dotted(record_figure(replace(record, baseline=None)))


def test_the_report_has_the_map_in_its_tables() -> None:
    fit = outcome_with(1.0)
    page = content(study_of(fit))
    row, = page["fits"]["plain"]
    assert row["title"] == fit.baseline.title
    assert [cell[0] for cell in row["cells"]] == ["held_out", "held_out", "train"]
    assert page["records"]["held_out"][0]["plain"] == digits(fit.baseline.records["two"]["rmse_mm"])
    section, = page["plain_maps"]
    assert any("better than the model" in line for line in section["lines"])
    assert page["records"]["held_out"][0]["name"] == "two"


def test_the_table_on_the_terminal_has_the_map() -> None:
    fit = outcome_with(1.0)
    card = study_of(fit).card()
    assert card.head[-1] == "plain map mm"
    assert float(card.rows[1][-1]) == pytest.approx(fit.baseline.records["two"]["rmse_mm"], rel=0.01)
    assert study_of(replace(fit, baseline=None)).card().head[-1] == "largest mm"
