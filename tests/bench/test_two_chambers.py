"""Bodies of two chambers: what one chamber at a time teaches of both, and intervals that hold the truth."""

from __future__ import annotations

import numpy as np
import pytest
import two_chambers
from benchmark_scripts import loaded

pytestmark = pytest.mark.slow
intervals = loaded("intervals")


@pytest.fixture(scope="module")
def recorded():
    both = ["first_150", *two_chambers.TOGETHER]
    names = {"two_segment": [*two_chambers.TRAIN, *two_chambers.TOGETHER, "both"], "antagonistic": both}
    return {body: two_chambers.recorded(body, 1, names[body]) for body in two_chambers.BODIES}


def test_one_chamber_at_a_time_teaches_what_both_do(recorded):
    body = "two_segment"
    experiments, model = recorded[body]
    fitted = two_chambers.taught(body, [experiments[name] for name in two_chambers.TRAIN], model)
    assert fitted.converged
    assert not any("hardly driven" in note for note in fitted.notes)
    assert two_chambers.missed(experiments["both"], fitted) < 4.0
    found, true = two_chambers.compliance(body, fitted)  # the rod's memory makes it stiffer than its springs are
    assert np.all(np.abs(found / true - 1.0) < 0.12)
    for p in fitted.parameters:  # the rod's memory makes the damping of one recording that of no other
        assert not p.free or p.std < 0.15 * abs(p.value) or p.name in ("start", "stiffening", "damping"), p


def test_a_virtual_chamber_that_nothing_drove_is_named_and_its_interval_says_nothing(recorded):
    """Its transducer shows a bias, noise, and what the bending body breathes through its tube."""
    body, second = "two_segment", "far"
    experiments, model = recorded[body]
    found = two_chambers.taught(body, [experiments["first_60"], experiments["first_150"]], model)
    assert any(note.startswith(f"Chamber {second} was hardly driven") for note in found.notes)
    law = next(p for p in found.parameters if p.name == f"{second}.torque_1")
    assert law.std > 0.5 * abs(law.value)
    assert any(f"fix {second}.torque_1" in note for note in found.notes)


def test_opposite_virtual_chambers_under_one_command_are_named(recorded):
    experiments, model = recorded["antagonistic"]
    found = two_chambers.taught("antagonistic", [experiments[name] for name in two_chambers.TOGETHER], model)
    assert any("left and right turn the same joints and were hardly driven separately" in note for note in found.notes)


def test_segments_under_one_command_rest_on_how_even_the_stiffness_is_and_say_so(recorded):
    """The rod's stiffness and gains vary along it; springs that may differ leave an interval that holds its bends."""
    experiments, model = recorded["two_segment"]
    train = [experiments[name] for name in two_chambers.TOGETHER]
    even = two_chambers.taught("two_segment", train, model)
    said = "Chambers near and far were hardly driven separately: only the shape distinguishes their laws"
    (note,) = (n for n in even.notes if n.startswith(said))
    assert "free stiffness_*" in note
    uneven = two_chambers.taught("two_segment", train, model, (two_chambers.UNEVEN,))
    assert f"{said}; record one of them alone." in uneven.notes
    gaps = []
    for fitted in (even, uneven):
        found, true = two_chambers.compliance("two_segment", fitted)
        std = next(p.std / p.value for p in fitted.parameters if p.name == "far.torque_1")
        gaps.append((abs(found[1] / true[1] - 1.0), std))
    (bare, narrow), (mended, wide) = gaps
    assert 0.2 < bare < 2.0 * narrow  # why the note is there; the recordings' scatter shows it too
    assert mended < 0.6 * bare
    assert mended < 1.5 * wide


def test_intervals_hold_the_truth_of_bodies_drawn_anew():
    z = np.array([[*intervals.errors("two segments", intervals.KEPT["white"], seed).values()] for seed in range(6)])
    assert np.mean(np.abs(z) < 1.96) > 0.85
    assert 0.75 < np.sqrt(np.mean(z**2)) < 1.3
    assert np.abs(z).max() < 4.5
