"""Results show themselves: short lines in a terminal, well-formed and escaped HTML in a notebook."""

from __future__ import annotations

from html.parser import HTMLParser
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import pliant
from pliant.actuators import chen2018
from pliant.display import Card, as_text
from pliant.identification import Experiment, Parameter
from pliant.identification.identifiability import Direction, Identifiability
from pliant.identification.prediction_bands import Band
from pliant.identification.result import FitResult
from pliant.preprocessing.quality import quality
from pliant.recording import make_recording
from pliant.reduction import select_order
from pliant.selection import ModelSelection, SelectionStep, TriedTerm
from pliant.validation.outcome import FitOutcome, RecordOutcome, StudyOutcome

HOSTILE = "<b>&"


def fitted() -> FitResult:
    parameters = (Parameter("stiffness", 1.6067, std=0.02), Parameter("tip_mass", 0.0, free=False))
    return FitResult(chen2018.model(), parameters, f"The fit converged {HOSTILE}.", {"low": 1e-3}, 12, 0.5, True)


def outcome() -> StudyOutcome:
    seen: Any = SimpleNamespace(without_positions=False)
    record = RecordOutcome("low", "held_out", seen, np.zeros(1), np.zeros(1), {"rmse_mm": 0.3, "max_mm": None})
    fit = FitOutcome("first", "First", fitted(), (record,), 0.5)
    return StudyOutcome("arm", HOSTILE, "", chen2018.model(), (fit,), verdict=("First: low to 0.3 mm.",))


def bent(frames: int = 8):
    t, s = np.arange(frames) / 10, np.linspace(0, 0.17, 40)
    kappa = np.linspace(1, 9, frames)[:, None]
    points = np.stack([np.cos(kappa * s) - 1, np.sin(kappa * s)], axis=2) / kappa[..., None]
    return make_recording(t, points, arc_length=s, frame="planar")


MADE = {
    "model": (chen2018.model, ["5 link(s)", "170 mm", "1.607", "1 to 5"]),
    "unequal": (lambda: chen2018.model().with_(stiffness=np.arange(1.0, 6.0)), ["  5  "]),
    "hundred": (lambda: pliant.chain_model(length=1, mass=1, links=100, stiffness=np.arange(1.0, 101.0), damping=0.1,
                                           torque=[1e-6]), ["... 88 more"]),
    "quality": (lambda: quality(bent()), ["8 frames of 40 station(s)"]),
    "order": (lambda: select_order(bent(), bound=3e-3, max_order=3), ["segments", "2 *"]),
    "fit": (fitted, ["converged", "stiffness", "+- 0.02", "N m/rad", "low 1 mm"]),
    "identifiability": (
        lambda: Identifiability(("mass", "damping"), (None, 2e-4), np.ones(2),
                                (Direction(("mass",), (1.0,), "null", "the recordings do not show mass", "fix mass"),)),
        ["Not every", "not shown", "fix mass."],
    ),
    "experiment": (
        lambda: Experiment("low", np.arange(20) / 10, np.linspace(0, 1e-2, 40).reshape(20, 1, 2), ("tip",),
                                  "pulse", level=3e4), ["'low'", "30 kPa", "20 frames of tip", "mm"]),
    "band": (lambda: Band(*np.zeros((3, 4, 1, 2)), np.ones((4, 1, 2)), 0.95), ["95 %", "4 frames", "500 mm"]),  # type: ignore[arg-type]
    "model_selection": (
        lambda: ModelSelection(
            (SelectionStep("", "stiffness and damping", "begins", ("stiffness", "damping"), 0.1,
                           {"low": 2.0}, {"low": 3.0},
                           (TriedTerm("creep", "creep", 0.09, 0.09, 0.2, "not determined"),)),),
            (), "no term is needed", fitted(), 1.5,
        ),
        ["stiffness and damping", "3", "No term is needed.", "Not taken: creep: not determined."],
    ),
    "outcome": (outcome, ["low", "held out", "0.3", "First: low to 0.3 mm."]),
}


class Tags(HTMLParser):
    def __init__(self, text: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.seen: set[str] = set()
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        self.open.append(tag)
        self.seen.add(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag


@pytest.mark.parametrize("name", MADE)
def test_a_result_shows_itself(name):
    make, told = MADE[name]
    result = make()
    text, page = repr(result), result._repr_html_()
    assert all(word in text for word in told), text
    assert max(map(len, text.splitlines())) < 200
    assert len(text.splitlines()) < 30
    tags = Tags(page)
    assert not tags.open
    assert "b" not in tags.seen  # user text stays text
    assert "array(" not in text


def test_a_table_is_aligned():
    lines = as_text(Card("title", ["below"], ["name", "mm"], [["a", "1.5"], ["long name", "12"]])).splitlines()
    assert lines == ["title", "  name        mm", "  a          1.5", "  long name   12", "below"]


def test_a_model_and_an_experiment_are_drawn():
    """By hand: a straight chain of two links of 0.1 m is 220 pixels high, and its tip bends to -x."""
    model = pliant.chain_model(length=0.2, mass=0.05, links=2, stiffness=1.0, damping=0.01, torque=[1e-6])
    page = model._repr_html_()
    rest = page.rpartition("<polyline")[2].partition('points="')[2].partition('"')[0]
    points = [tuple(map(float, p.split(","))) for p in rest.split()]
    base = points[0]
    assert [x - base[0] for x, _ in points] == pytest.approx([0.0, 0.0, 0.0], abs=0.11)
    assert [base[1] - y for _, y in points] == pytest.approx([0.0, 110.0, 220.0], abs=0.11)
    bent = page.partition("<polyline")[2].partition('points="')[2].partition('"')[0].split()[-1]
    assert float(bent.partition(",")[0]) < base[0] - 10
    exp = Experiment("a<b", np.arange(20) / 10, np.linspace(0.05, 0.1, 40).reshape(20, 1, 2), ("tip",), "pulse",
                            level=3e4)
    assert exp._repr_html_().count("<polyline") == 6  # five instants and the path
    assert "<svg" not in repr(model)
