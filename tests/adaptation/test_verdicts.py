"""Verdicts on days of virtual arms whose truth is known; `virtual_days` prints the table for more of them."""

from __future__ import annotations

import pytest
import rod_days
from virtual_days import KINDS, named, verdicts


@pytest.mark.slow
@pytest.mark.parametrize(("kind", "seed"), [(KINDS[0], 1), (KINDS[0], 2), (KINDS[1], 1)])
def test_a_joint_that_changed_is_named_and_a_mounting_is_no_change(kind, seed):
    found = verdicts(kind, seed, ("re-mounted", "one joint"))
    mounted, _ = found["re-mounted"]
    assert mounted.verdict == "re-mounted", mounted.sentence
    changed, names = found["one joint"]
    assert changed.verdict == "changed body", changed.sentence
    assert named(changed, names), changed.sentence


@pytest.mark.slow
def test_verdicts_on_rods_of_another_solver():
    found = rod_days.verdicts(204, ("same", "leak", "other"))
    assert {case: day.verdict for case, day in found.items()} == {
        "same": "same arm", "leak": "changed body", "other": "another arm"}  # fmt: skip
    assert found["leak"].changed == ("left.torque_1",), found["leak"].sentence
