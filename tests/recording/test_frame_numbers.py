"""Frame numbers of a DeepLabCut table rise, are whole and lie close enough for the rows that there are."""

from __future__ import annotations

import numpy as np
import pytest

from pliant.errors import InputError
from pliant.recording.deeplabcut import whole_clock

POINTS = np.arange(24.0).reshape(4, 3, 2)
LIKELY = np.full((4, 3), 0.9)


@pytest.mark.parametrize("frames", [[0, 1, 1, 2], [0, 1, 3, 2], [3, 2, 1, 0], [0, 1, 2.25, 3], [0, 1, 1.75, 3]])
def test_numbers_that_do_not_rise_or_are_not_whole_are_refused(frames):
    with pytest.raises(InputError, match="frame numbers that increase"):
        whole_clock(np.array(frames, dtype=float), POINTS, LIKELY, "a.csv")


def test_frames_may_begin_anywhere_and_gaps_are_counted():
    points, likely, said = whole_clock(np.array([7.0, 8.0, 11.0, 12.0]), POINTS, LIKELY, "a.csv")
    np.testing.assert_array_equal(points[[0, 1, 4, 5]], POINTS)
    assert np.isnan(points[2:4]).all()
    np.testing.assert_array_equal(likely, [[0.9] * 3] * 2 + [[0.0] * 3] * 2 + [[0.9] * 3] * 2)
    assert said == ["2 frames are missing in a.csv and are gaps"]
    assert whole_clock(np.arange(4.0), POINTS, None, "a.csv")[1:] == (None, [])


def test_a_number_far_from_the_rest_is_damage():
    assert len(whole_clock(np.array([0.0, 1.0, 2.0, 399.0]), POINTS, LIKELY, "a.csv")[0]) == 400
    with pytest.raises(InputError, match="4 rows for frames 0 to 400: the file is damaged"):
        whole_clock(np.array([0.0, 1.0, 2.0, 400.0]), POINTS, LIKELY, "a.csv")
