"""Fits made by helper processes: the same numbers, every fit, one sentence, and nobody left behind."""

from __future__ import annotations

import time
from pathlib import Path
from threading import Event
from typing import Any

import pytest
from small_study import STUDY, changed, write_study

from pliant.study import load_study, parallel_fits
from pliant.study.run import prepare_all
from pliant.validation.outcome import FitOutcome

FIT = STUDY["fits"]["linear"]
NAMES = ["linear", "other", "third"]
MINUTE = 60.0


def line_of(folder: Path, told: list[str], **fits: Any) -> Any:
    """Study, experiments and model of the small study with more fits."""
    study = load_study(write_study(folder, changed("fits", **(fits or dict.fromkeys(NAMES[1:], FIT)))))
    ready = prepare_all(study, told.append)
    return study, ready.experiments, ready.model


def held_up(monkeypatch: pytest.MonkeyPatch, until: Event) -> None:
    """Let helpers start at once, and let this process begin its fits only when something has come to pass."""
    own = parallel_fits.fit_or_error

    def fit_or_error(*arguments: Any) -> Any:
        assert until.wait(MINUTE)
        return own(*arguments)

    monkeypatch.setattr(parallel_fits, "HEAD_START", 0.0)
    monkeypatch.setattr(parallel_fits, "fit_or_error", fit_or_error)


@pytest.mark.slow
def test_a_helper_finds_the_same_numbers_to_the_bit(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    told: list[str] = []
    line = line_of(tmp_path, told)
    alone = parallel_fits.run_fits(*line, told.append, workers=1)
    helped, by_helper = Event(), []

    def tell(text: str) -> None:
        by_helper.append(text)
        helped.set()

    held_up(monkeypatch, helped)
    together = parallel_fits.run_fits(*line, tell, workers=2)
    assert [name for name, _ in together] == [name for name, _ in alone] == NAMES
    assert by_helper[0].startswith("fit other: ")  # while the first waited here
    for (_, one), (_, other) in zip(alone, together, strict=True):
        assert isinstance(one, FitOutcome)
        assert isinstance(other, FitOutcome)
        assert one.result.values == other.result.values
        assert [r.metrics for r in one.records] == [r.metrics for r in other.records]


def test_what_a_helper_had_when_it_ended_is_made_here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    told: list[str] = []
    line = line_of(tmp_path, told)
    gone = Event()
    held_up(monkeypatch, gone)
    ready = parallel_fits.send

    def send(pipe: Any, what: Any) -> None:
        ready(pipe, what)
        if isinstance(what, str):  # the name of a fit
            helper.process.kill()

    class Watched(parallel_fits.Helper):
        def __init__(self, *arguments: Any) -> None:
            nonlocal helper
            super().__init__(*arguments)
            helper = self

        def run(self) -> None:
            super().run()
            gone.set()

    helper: Any = None
    monkeypatch.setattr(parallel_fits, "send", send)
    monkeypatch.setattr(parallel_fits, "Helper", Watched)
    made = parallel_fits.run_fits(*line, told.append, workers=2)
    assert [name for name, _ in made] == NAMES
    assert all(isinstance(fit, FitOutcome) for _, fit in made)
    assert sum("a helper process ended early" in text for text in told) == 1


def test_an_unexpected_error_ends_the_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """One that no computation ends in on purpose: the fits behind it are not begun."""
    line = line_of(tmp_path, [])
    own = parallel_fits.run_fit

    def run_fit(study: Any, name: str, *others: Any) -> FitOutcome:
        if name == "other":
            raise KeyError(name)
        return own(study, name, *others)

    monkeypatch.setattr(parallel_fits, "run_fit", run_fit)
    told: list[str] = []
    with pytest.raises(KeyError, match="other"):
        parallel_fits.run_fits(*line, told.append, workers=1)
    assert any(text.startswith("fit linear") for text in told)
    assert not any(text.startswith("fit third") for text in told)


def test_an_interrupt_ends_the_helpers(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    line = line_of(tmp_path, [])
    helpers: list[parallel_fits.Helper] = []

    class Watched(parallel_fits.Helper):
        def __init__(self, *arguments: Any) -> None:
            super().__init__(*arguments)
            helpers.append(self)

    def stopped(*_: object) -> None:
        while helpers[0].process is None:
            time.sleep(0.01)
        raise KeyboardInterrupt

    monkeypatch.setattr(parallel_fits, "HEAD_START", 0.0)
    monkeypatch.setattr(parallel_fits, "Helper", Watched)
    monkeypatch.setattr(parallel_fits, "fit_or_error", stopped)
    with pytest.raises(KeyboardInterrupt):
        parallel_fits.run_fits(*line, lambda _line: None, workers=2)
    helpers[0].join(MINUTE)
    assert helpers[0].process is not None
    assert helpers[0].process.poll() is not None
