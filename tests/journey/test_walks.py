"""From the files of laboratories to a verdict by the console script: few lines typed, and errors like those by hand.

`walks.py` walks each way, and prints the numbers of all.
"""

from __future__ import annotations

import re

import laboratories
import pytest
from walks import WALKS, drafted, walked

MOST_LINES, MOST_ERROR = 6, 1.3  # of a mapping; times the held-out error of the study by hand
WALKED = ("vrpn", "motive", "bars", "bag", "gratings")


@pytest.mark.slow
@pytest.mark.parametrize("name", WALKED)
def test_a_draft_predicts_nearly_as_well_as_a_study_by_hand(tmp_path, name):
    outcome = walked(name, tmp_path)
    assert outcome.lines <= MOST_LINES
    assert outcome.asked == set(WALKS[name].answers)
    assert outcome.draft <= MOST_ERROR * outcome.hand


@pytest.mark.slow
@pytest.mark.usefixtures("untried")
@pytest.mark.parametrize("name", ["poses", "bag", "film", "coils", "gratings"])
def test_a_draft_without_a_mapping_asks_only_what_the_laboratory_knows(tmp_path, name):
    study, _ = drafted(name, getattr(laboratories, name)(tmp_path).files, tmp_path)
    assert not WALKS[name].mapping
    assert set(re.findall(r'(\w+) = "\?"', study.read_text())) == set(WALKS[name].answers)
