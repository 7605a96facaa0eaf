"""From the files of laboratories to a verdict by the console script: few lines typed, and errors like those by hand.

`walks.py` walks each way, and prints the numbers of all.
"""

from __future__ import annotations

import pytest
from walks import WALKS, walked

MOST_LINES, MOST_ERROR = 6, 1.3  # of a mapping; times the held-out error of the study by hand
WALKED = ("vrpn", "motive", "bars")


@pytest.mark.slow
@pytest.mark.parametrize("name", WALKED)
def test_a_draft_predicts_nearly_as_well_as_a_study_by_hand(tmp_path, name):
    outcome = walked(name, tmp_path)
    assert outcome.lines <= MOST_LINES
    assert outcome.asked == set(WALKS[name].answers)
    assert outcome.draft <= MOST_ERROR * outcome.hand
    assert outcome.draft < outcome.plain
