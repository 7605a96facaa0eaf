"""The body cut out of a fibre, whichever way it is bent."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from pliant.preprocessing.align import align
from pliant.study.dense import body_of_fibre
from pliant.study.schema import Fibre
from pliant.testbed import SCENARIOS, generate
from pliant.testbed.rod import actuator
from pliant.testbed.scenarios import Command

FIBRE = Fibre(body_length=0.17, cap_curvature=50.0, cap_length=0.03, gauge_length=2.4e-3)


def test_the_cap_tells_to_which_side_a_curled_body_bends():
    """Soft as this body is, the pressure curls it so far that its tip moves to the other side."""
    soft = replace(actuator("a"), elements=40, bending_stiffness=0.012, gain_slope=0.0)
    ramp = Command("triangle", ((0.1, 0.0), (0.3, 200e3)))
    case = replace(SCENARIOS["still"], name="curled", duration=1.2, command=ramp)
    made = generate(case, soft, 1)
    assert made.truth["curvature"].values[-1, :40].sum() * 0.17 / 40 > 3.5
    whole = align(made.recording, base="000", tangent="clamp")
    assert np.nanmedian(whole["position"].values[:5, -1, 0]) > 0  # alone, the motion is misread
    body, _ = body_of_fibre(made.recording, FIBRE)
    off = np.linalg.norm(body["position"].values[:, -1, :2] - made.truth["position"].values[:, 40], axis=1)
    assert np.nanmedian(off) < 0.01
