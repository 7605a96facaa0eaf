"""A study's fit that contains another one starts from its optimum, whichever is listed first, on the command line."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from command_line import invoke
from small_study import STUDY, changed, write_study

from pliant.study import load_study
from pliant.study.fits import smaller_fits
from pliant.study.run import prepare_all

LINEAR = STUDY["fits"]["linear"]


def study_of(**fits: Any) -> dict[str, Any]:
    return changed("fits", value={**fits, "linear": LINEAR})


MORE = {"like": "linear", "parameters": {"torque_2": "free"}}


def test_a_larger_fit_starts_from_a_smaller_one_and_does_not_end_above_it(tmp_path: Path) -> None:
    result = invoke("run", write_study(tmp_path, study_of(more=MORE)), "-o", tmp_path / "out")
    assert result.exit_code == 0, result.output
    assert "fit linear: start 1 of 1" in result.output
    assert "fit more: start 2 of 2" in result.output
    assert result.output.index("fit linear: The fit") < result.output.index("fit more: start 1")
    fits = json.loads((tmp_path / "out" / "metrics.json").read_text())["fits"]
    assert list(fits) == ["more", "linear"]
    errors = {name: sum(fit["records"][r]["rmse_mm"] ** 2 for r in LINEAR["train"]) for name, fit in fits.items()}
    assert errors["more"] <= 1.001 * errors["linear"]
    assert "only one start was tried" not in fits["more"]["status"]


@pytest.mark.parametrize(("change", "inside"), [
    ({}, ("linear",)), ({"train": ["low"], "held_out": []}, ()), ({"weighting": "metre"}, ()), ({"links": 3}, ()),
    ({"loss": "huber"}, ()), ({"held_out": []}, ("linear",)),
])  # fmt: skip
def test_only_fits_of_the_same_problem_are_nested(tmp_path: Path, change: dict[str, Any], inside: Any) -> None:
    study = load_study(write_study(tmp_path, study_of(more={**MORE, **change})))
    found = smaller_fits(study, prepare_all(study, lambda _line: None).model)
    assert found == {"more": inside, "linear": ()}


def test_a_fit_that_stays_above_its_smaller_one_is_named_everywhere(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    import importlib

    module = importlib.import_module("pliant.identification.fit")

    def above(_problem: Any, best: Any, warm: Any, *_others: Any) -> Any:
        return best, dict.fromkeys(warm, 0.55)

    monkeypatch.setattr(module, "below_nested", above)
    result = invoke("run", write_study(tmp_path, study_of(more=MORE)), "-o", tmp_path / "out", "--workers", "1")
    said = "The fit did not converge: its cost is 55 % above that of the fit linear"
    assert said in result.output
    metrics = json.loads((tmp_path / "out" / "metrics.json").read_text())
    assert metrics["fits"]["more"]["status"].startswith(said)
    assert metrics["fits"]["more"]["converged"] is False
    assert metrics["fits"]["linear"]["converged"] is True
    assert any(said in line for line in metrics["verdict"])
    assert said in (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
