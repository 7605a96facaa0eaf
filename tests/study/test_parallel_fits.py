"""Fits made by worker processes: the same numbers, every fit, one sentence, and nobody left behind."""

from __future__ import annotations

import os
import signal
import time
from multiprocessing import active_children
from pathlib import Path
from threading import Event
from typing import Any

import pytest
from small_study import STUDY, changed, write_study

from pliant.errors import FitError
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


def die_of_a_fit(packed: bytes, name: str) -> Any:
    """Work of a helper that takes its process down once it has a fit."""
    if name:
        os.kill(os.getpid(), signal.SIGKILL)
    return parallel_fits.fit_in_worker(packed, name)


@pytest.mark.skipif(os.name != "posix", reason="signals of another kind")
def test_what_a_helper_had_when_it_ended_is_made_here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    told: list[str] = []
    line = line_of(tmp_path, told)
    gone = Event()

    def tell(text: str) -> None:
        told.append(text)
        if "a worker process ended early" in text:
            gone.set()

    held_up(monkeypatch, gone)
    monkeypatch.setattr(parallel_fits, "fit_in_worker", die_of_a_fit)
    made = parallel_fits.run_fits(*line, tell, workers=2)
    assert [name for name, _ in made] == NAMES
    assert all(isinstance(fit, FitOutcome) for _, fit in made)
    assert sum("a worker process ended early" in text for text in told) == 1


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


def break_at_a_fit(packed: bytes, name: str) -> Any:
    """Work of a helper that ends in an error which no computation ends in on purpose."""
    return {"": ([], None)}[name]


@pytest.mark.slow
def test_an_unexpected_error_of_a_helper_ends_the_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The third fit is not begun: by no helper, and not by this process, which is in its first."""
    line = line_of(tmp_path, [])
    before, begun = set(active_children()), list[str]()

    def fit_or_error(_common: Any, name: str, _notify: Any) -> FitError:
        begun.append(name)
        for present in (True, False):
            deadline = time.monotonic() + MINUTE
            while bool(set(active_children()) - before) != present and time.monotonic() < deadline:
                time.sleep(0.01)
        return FitError("as far as it came")

    monkeypatch.setattr(parallel_fits, "HEAD_START", 0.0)
    monkeypatch.setattr(parallel_fits, "fit_or_error", fit_or_error)
    monkeypatch.setattr(parallel_fits, "fit_in_worker", break_at_a_fit)
    with pytest.raises(KeyError, match="other"):
        parallel_fits.run_fits(*line, lambda _line: None, workers=2)
    assert begun == ["linear"]


def test_an_interrupt_ends_the_helpers(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    line = line_of(tmp_path, [])
    before, helpers = set(active_children()), list[Any]()

    def stopped(*_: object) -> None:
        while not helpers:
            helpers.extend(set(active_children()) - before)
            time.sleep(0.01)
        raise KeyboardInterrupt

    monkeypatch.setattr(parallel_fits, "HEAD_START", 0.0)
    monkeypatch.setattr(parallel_fits, "fit_or_error", stopped)
    with pytest.raises(KeyboardInterrupt):
        parallel_fits.run_fits(*line, lambda _line: None, workers=2)
    deadline = time.monotonic() + MINUTE
    while any(helper.exitcode is None for helper in helpers) and time.monotonic() < deadline:
        time.sleep(0.01)  # not `join`: where another thread has waited for the process first, it returns at once
    assert all(helper.exitcode is not None for helper in helpers)
