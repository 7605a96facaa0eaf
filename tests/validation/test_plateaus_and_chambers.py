"""Ends of plateaus, and laws of bodies of several chambers, as metrics and figures show them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pliant.identification import Experiment
from pliant.model import Chamber
from pliant.simulation import Trace
from pliant.validation import metrics
from pliant.validation.curves import laws_of

T = np.arange(0.0, 4.0, 0.01)


def test_a_steady_error_is_that_of_the_end_of_a_plateau():
    """Its last fifth of a second, whatever came before; of the record where there is no plateau."""
    lean = np.zeros((T.size, 2))
    off = np.zeros((T.size, 2))
    off[(T > 2.81) & (T < 3.0), 0] = 0.03
    off[T > 3.82, 0] = 0.05

    def chain(direction):
        return np.cumsum(0.05 * np.stack([-np.sin(direction), np.cos(direction)], axis=-1), axis=1)

    moving = chain(lean)
    moving[5:, 1, 0] += 1e-9  # a body that never moves is no recording
    exp = Experiment("p", T, moving, ("mid", "tip"), "pulse", level=1e4)
    on = (T > 1.0) & (T < 3.0)
    assert metrics.swing_metrics(exp, chain(off), on)["joint_steady_error_mrad"][0] == pytest.approx(30.0, abs=1e-3)
    for none in (None, np.zeros(T.size, bool)):
        errors = metrics.swing_metrics(exp, chain(off), none)["joint_steady_error_mrad"]
        assert errors[0] == pytest.approx(50.0, abs=1e-3)


def test_each_of_several_chambers_has_a_law_and_the_levels_of_its_own_records(outcome):
    """By its name; a record marks the chambers that it drives, by the highest pressure of each."""
    fit = outcome.fits[0]
    near, far = (Chamber([k * 1e-6], name=name) for k, name in ((1, "near"), (2, "far")))
    traces = {name: Trace([0.0, 1.0, 2.0], [0.0, p, 0.0]) for name, p in (("near", 1e4), ("far", 2e4))}
    both, one = (replace(fit.records[0], role=role, experiment=replace(
        fit.records[0].experiment, excitation="trace", pressure=None, level=0.0,
        drives={k: v for k, v in traces.items() if k in names},
    )) for role, names in (("train", "near far"), ("held_out", "far")))  # fmt: skip
    made = replace(fit, result=replace(fit.result, model=fit.result.model.with_(chambers=(near, far))),
                   records=(both, one))  # fmt: skip
    found = laws_of(made)
    assert [title for title, *_ in found] == [f"{fit.title}, near", f"{fit.title}, far"]
    assert [c.name for _, c, _ in found] == ["near", "far"]
    assert [marks for *_, marks in found] == [{1e4: "train"}, {2e4: "held_out"}]
