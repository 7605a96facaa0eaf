"""Recordings that rest in different places, moved to one rest."""

from __future__ import annotations

import numpy as np
import pytest

from pliant.errors import InputError
from pliant.preprocessing.align import align
from pliant.recording import make_recording
from pliant.study.aligned import Aligned, at_common_rest

TIME = np.arange(60) / 100.0


def recorded(rest: float, names: tuple[str, ...] = ("base", "tip")) -> Aligned:
    """A tip that rests `rest` [m] to the side for 0.2 s, then moves on by 10 mm."""
    position = np.zeros((TIME.size, len(names), 3))
    position[:, 1, 0] = 0.1
    position[:, 1, 1] = rest + np.where(TIME > 0.2, 0.01, 0.0)
    ds = make_recording(TIME, position, station=list(names))
    return Aligned(align(ds, tangent="+x", plane=[0.0, 0.0, 1.0], bend=None, rest=[0.0, 0.2]), ("read",))


def test_every_recording_rests_where_the_first_one_does_and_moves_as_before() -> None:
    given = {"a": recorded(0.0), "b": recorded(2e-3)}
    made = at_common_rest(given)
    for name, one in made.items():
        places, before = one.body["position"].values, given[name].body["position"].values
        assert places[0] == pytest.approx(given["a"].body["position"].values[0], abs=1e-12)
        assert places - places[0] == pytest.approx(before - before[0], abs=1e-12)
    assert made["a"].findings == ("read",)
    assert made["b"].findings[1:] == ("shifted by up to 2 mm, station by station, to the rest position of a",)


def test_other_stations_and_recordings_without_a_rest_are_refused() -> None:
    with pytest.raises(InputError, match="recording b has other stations than a"):
        at_common_rest({"a": recorded(0.0), "b": recorded(0.0, ("base", "end"))})
    bare = recorded(0.0)
    del bare.body.attrs["alignment"]
    with pytest.raises(InputError, match="b was aligned before the study"):
        at_common_rest({"a": recorded(0.0), "b": bare})
