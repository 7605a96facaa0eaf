"""Doors whose options a `TypedDict` names: every option has its default, and no other keyword is taken."""

from __future__ import annotations

import pytest

from pliant.batch.batch import BATCH_OPTIONS, BatchOptions, simulate_batch
from pliant.control.preparation import RIG, Rig, prepare_control
from pliant.estimation.adaptive_observer import OBSERVER_NOISE, AdaptiveObserver, ObserverNoise
from pliant.identification.fit import FIT_OPTIONS, FitOptions, fit
from pliant.options import with_defaults
from pliant.selection.select import SEARCH_OPTIONS, SearchOptions, select_model
from pliant.sweep.sweep import WORKERS, Workers, run_sweep

DOORS = [
    (fit, 3, FitOptions, FIT_OPTIONS),
    (select_model, 2, SearchOptions, SEARCH_OPTIONS),
    (simulate_batch, 2, BatchOptions, BATCH_OPTIONS),
    (run_sweep, 3, Workers, WORKERS),
    (prepare_control, 6, Rig, RIG),
    (AdaptiveObserver, 2, ObserverNoise, OBSERVER_NOISE),
]


@pytest.mark.parametrize(("door", "positional", "names", "defaults"), DOORS, ids=lambda x: getattr(x, "__name__", ""))
def test_every_option_has_a_default_and_no_other_is_taken(door, positional, names, defaults):
    assert set(defaults) == set(names.__annotations__)
    with pytest.raises(TypeError, match=rf"{door.__name__} has no parameter 'stepp': it takes ") as told:
        door(*[None] * positional, stepp=1.0)
    taken = str(told.value).partition("it takes ")[2].split(", ")
    assert set(defaults) < set(taken)
    assert not {"options", "who", "rig", "self"} & set(taken)


def test_what_is_given_counts_and_nothing_else_changes():
    assert with_defaults(fit, {"starts": 7}, FIT_OPTIONS) == {**FIT_OPTIONS, "starts": 7}
    assert FIT_OPTIONS["starts"] == 3
