from __future__ import annotations

import numpy as np
import pytest
from oracles.packed_page import unpack

from pliant.view.data import LEVELS, Pack


@pytest.mark.parametrize("shape", [(400,), (400, 3, 2), (1, 2), (0, 2)])
def test_arrays_come_back_to_a_part_of_their_range(shape, rng):
    values = rng.normal(size=shape).cumsum(axis=0)
    values[rng.random(shape) < 0.1] = np.nan
    pack = Pack()
    pack.add(rng.normal(size=7))
    note = pack.add(values)
    found = unpack(pack.text(), note)
    assert found.shape == shape
    assert (np.isnan(found) == np.isnan(values)).all()
    if values.size:
        np.testing.assert_allclose(found, values, atol=0.51 * np.ptp(values[np.isfinite(values)]) / LEVELS)


def test_what_never_changes_and_what_was_never_seen():
    pack = Pack()
    notes = [pack.add(np.full(5, 3.25)), pack.add(np.full((4, 2), np.nan))]
    text = pack.text()
    np.testing.assert_allclose(unpack(text, notes[0]), 3.25)
    assert np.isnan(unpack(text, notes[1])).all()


def test_the_same_arrays_give_the_same_text(rng):
    values = rng.normal(size=(50, 2))
    texts = []
    for _ in range(2):
        pack = Pack()
        pack.add(values)
        texts.append(pack.text())
    assert texts[0] == texts[1]
