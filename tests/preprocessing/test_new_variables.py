"""A variable that is new to recordings is carried by each step of preprocessing, or refused: never lost in silence."""

from __future__ import annotations

import numpy as np
import pytest

from pliant.errors import InputError
from pliant.preprocessing.align import align
from pliant.preprocessing.cut import cut_body, cut_time
from pliant.recording import make_recording
from pliant.recording.rules import VARIABLES

TIME, S = np.linspace(0.0, 1.0, 41), 12


@pytest.fixture
def recording(monkeypatch):
    """A body that bends to one side, with a distance of each station that the schema knows since a moment ago."""
    monkeypatch.setitem(VARIABLES, "distance", ((("time", "station"),), "m", "distance from the base"))
    s, bend = np.linspace(0.0, 0.1, S), np.clip(3.0 * TIME - 1.0, 0.0, 1.0)[:, None]
    place = np.stack([40.0 * bend * s**2, np.tile(s, (TIME.size, 1)), np.zeros((TIME.size, S))], axis=2)
    made = make_recording(TIME, place, arc_length=s, source="made")
    far = np.linalg.norm(place, axis=2)
    return made.assign(distance=(("time", "station"), far, {"units": "m", "long_name": "distance from the base"}))


@pytest.mark.parametrize("step", [
    lambda r: align(r, tangent="+y"),
    lambda r: cut_body(r, 0.013, 0.081),
], ids=["align", "cut_body"])  # fmt: skip
def test_a_step_that_does_not_know_it_refuses(recording, step):
    with pytest.raises(InputError, match="would lose distance of the recording"):
        step(recording)
    assert "position" in step(recording.drop_vars("distance"))


def test_a_cut_in_time_carries_it(recording):
    assert cut_time(recording, 0.2, 0.8).distance.sizes["time"] == cut_time(recording, 0.2, 0.8).sizes["time"]
