"""Where tendons of given length end, from motions that another formula and the simulated body give."""

from __future__ import annotations

import numpy as np
import pytest

from pliant.study.tendon_ends import ends_of_held_tendons

HEIGHTS = np.array([0.1, 0.2])  # m
AZIMUTHS = np.radians([10.0, 130.0, 60.0, 100.0])
ENDS = (2, 1, 1, 2)


def gains_of_stiff_tendons(ends: tuple[int, ...]) -> np.ndarray:
    """Displacements per unit of each tendon, where the lengths of all tendons are given exactly: the bends of two
    parts in two directions solve four linear equations.
    """
    rows = np.zeros((4, 4))
    for k, (azimuth, end) in enumerate(zip(AZIMUTHS, ends, strict=True)):
        for part in range(end):
            rows[k, 2 * part : 2 * part + 2] = 0.1 * 0.01 * np.cos(azimuth), 0.1 * 0.01 * np.sin(azimuth)
    bends = np.linalg.solve(rows, 1e-3 * np.eye(4)).T.reshape(4, 2, 2)  # 1/m, for 1 mm of each
    places = np.zeros((4, 2, 2))
    for k in range(4):
        turn, place = np.zeros(2), np.zeros(2)
        for part in range(2):
            place = place + 0.1 * turn + 0.5 * 0.1**2 * bends[k, part]
            turn = turn + 0.1 * bends[k, part]
            places[k, part] = place
    return places


def test_the_ends_of_stiff_tendons_are_those_of_the_linear_equations_of_their_lengths():
    found = ends_of_held_tendons(gains_of_stiff_tendons(ENDS), HEIGHTS, [None] * 4)
    assert [end for _, end in found] == [HEIGHTS[e - 1] for e in ENDS]
    turned = np.radians([azimuth for azimuth, _ in found]) - AZIMUTHS
    assert np.abs(np.angle(np.exp(1j * turned))).max() < np.radians(8.0)


def test_a_stated_end_is_kept_and_missing_stations_are_left_out():
    gains = gains_of_stiff_tendons(ENDS)
    found = ends_of_held_tendons(gains, HEIGHTS, [0.2, None, None, None])
    assert found[0][1] == pytest.approx(0.2)
    gains[2, 1] = np.nan
    others = (0, 1, 3)
    found = ends_of_held_tendons(gains, HEIGHTS, [None] * 4)
    assert [found[k][1] for k in others] == [HEIGHTS[ENDS[k] - 1] for k in others]


def test_an_input_that_never_moves_does_not_mislead_the_others():
    gains = np.concatenate([gains_of_stiff_tendons(ENDS), np.zeros((1, 2, 2))])
    found = ends_of_held_tendons(gains, HEIGHTS, [None] * 5)
    assert [end for _, end in found[:4]] == [HEIGHTS[e - 1] for e in ENDS]
    assert found[4] == (0.0, HEIGHTS[-1])
    assert ends_of_held_tendons(np.zeros((2, 2, 2)), HEIGHTS, [None] * 2) == [(0.0, HEIGHTS[-1])] * 2
