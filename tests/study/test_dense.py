"""The body cut out of a fibre, whichever way it is bent."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pliant.study.dense import body_of_fibre
from pliant.study.schema import Fibre
from pliant.testbed import SCENARIOS, generate
from pliant.testbed.rod import actuator
from pliant.testbed.scenarios import Command

FIBRE = Fibre(body_length=0.17, cap_curvature=50.0, cap_length=0.03, gauge_length=2.4e-3)


@pytest.mark.parametrize(("name", "level"), [("still", 0.0), ("x", 0.0), ("curled", 1.0)])
def test_the_cap_tells_to_which_side_a_still_or_a_curled_body_bends(name, level):
    """Soft as this body is, the pressure curls it by more than a turn: its tip moves to the other side."""
    soft = replace(actuator("a"), elements=40, bending_stiffness=0.012)
    ramp = Command("triangle", ((0.3, 0.0), (0.7, level * 130e3)))
    case = replace(SCENARIOS["still"], name=name, duration=1.0, command=ramp)
    made = generate(case, soft, 1)
    body, _ = body_of_fibre(made.recording, FIBRE)
    tip, true = body["position"].values[:, -1], made.truth["position"].values[:, 40]
    assert np.nanmedian(np.linalg.norm(tip[:, :2] - true, axis=1)) < 0.01
    turned = made.truth["curvature"].values[-1, :40].sum() * 0.17 / 40
    assert (turned > 3.5) == (name == "curled")
