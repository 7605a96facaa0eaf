"""The virtual body in space: recordings agree with each other, PyElastica's rod with closed forms, a fit with both."""

from __future__ import annotations

import sys

import numpy as np
import pytest

from pliant.errors import InputError
from pliant.preprocessing.align import align
from pliant.recording import read
from pliant.study import run_study, space_study
from pliant.study.draft_inputs import azimuths
from pliant.study.schema import load_study
from pliant.testbed import space
from pliant.testbed.bundle import FOLDER
from pliant.testbed.space import TRACKER, BodyInSpace, Instruments, lagged, simulate_in_space

BODY, SEEN = BodyInSpace(), Instruments()
DOWN = (TRACKER @ [0.0, 0.0, -1.0]).tolist()  # the clamp, in the tracker's axes


def test_fibre_and_markers_see_the_same_shape():
    fibre = read(FOLDER / "space_fibre.csv", mapping={
        "components": ["kx_", "ky_"], "curvature_unit": "1/m", "arc_unit": "mm"}, format="curvature")  # fmt: skip
    curve = align(fibre, tangent="+y", plane="-x", space=True, bend=None)
    body = align(read(FOLDER / "space_mixed.nc"), base="base", tangent=DOWN, plane=(TRACKER @ [1.0, 0.0, 0.0]).tolist(),
                 space=True, bend=None, rest=[0, 0.4])  # fmt: skip
    s = (SEEN.elements[1] + 0.5) / BODY.elements * BODY.length
    arc, place = curve["arc_length"].values, curve["position"].values
    axis, beyond = (np.array([[np.interp(x, arc, row[:, k]) for k in range(3)] for row in place])
                    for x in (s, s + 2e-3))  # fmt: skip
    away = body["position"].sel(station="m2").values[::2] - axis
    tangent = (beyond - axis) / np.linalg.norm(beyond - axis, axis=-1, keepdims=True)
    np.testing.assert_allclose(np.linalg.norm(away, axis=-1), np.hypot(*SEEN.aside), atol=1.5e-3)  # of 23 mm of motion
    np.testing.assert_allclose((away * tangent).sum(-1), 0.0, atol=1e-3)


def test_chambers_lie_where_the_body_has_them():
    body = align(read(FOLDER / "space_one_by_one.nc"), base="base", tangent=DOWN, space=True, rest=[0, 0.4])
    np.testing.assert_allclose(np.diff(azimuths(body)) % 360, 120.0, atol=2.0)


def test_pressures_lag_behind_commands():
    time = np.arange(1000) * 1e-4
    step = lagged(np.ones((1000, 1)), 1e-4 / 0.03)[:, 0]
    np.testing.assert_allclose(step, 1 - np.exp(-(time + 1e-4) / 0.03), atol=1e-12)


def test_an_unknown_command_and_a_missing_library_are_said(monkeypatch):
    with pytest.raises(InputError, match="use one of one_by_one, around, mixed"):
        simulate_in_space("dance")
    monkeypatch.delattr("pliant.testbed.elastic_rod", raising=False)  # another test may have loaded it
    monkeypatch.setitem(sys.modules, "pliant.testbed.elastic_rod", None)
    with pytest.raises(InputError, match=r"needs PyElastica: pip install 'pliant\[bench\]'"):
        simulate_in_space("mixed")


@pytest.mark.slow
def test_the_rod_bends_and_lengthens_as_closed_forms_say(monkeypatch):
    pytest.importorskip("elastica", reason="PyElastica is not installed")
    body = BodyInSpace(length=0.05, elements=8, damping=60.0, lag=0.01)
    monkeypatch.setattr(space, "DURATION", 0.4)
    monkeypatch.setitem(space.COMMANDS, "held", lambda time: np.where(time[:, None] > 0.01, [60e3, 0, 0], 0.0))
    motion = simulate_in_space("held", body)
    expected = -60e3 * body.torque / body.bending_stiffness  # away from the chamber at +y
    np.testing.assert_allclose(motion.curvature[-1], np.tile([0.0, expected], (7, 1)), rtol=5e-3, atol=1e-9)
    length = np.linalg.norm(np.diff(motion.position[-1], axis=0), axis=-1).sum()
    axial = body.sleeve * body.youngs_modulus * np.pi * body.radius**2
    assert length / body.length - 1 == pytest.approx(60e3 * body.area / axial, rel=0.05)  # and its weight


@pytest.mark.slow
def test_the_study_of_the_demonstration_finds_the_body():
    study = load_study(space_study())
    fit = study.fits["gains"]
    few = {k: v for k, v in fit.parameters.items() if not k.startswith("tip")}
    study = study.model_copy(update={"time_step": 0.01, "fits": {"gains": fit.model_copy(update={
        "train": ["around"], "parameters": few})}})  # fmt: skip
    outcome = run_study(study)
    values = {p.name: p.value for p in outcome.fits[0].result.parameters}
    assert values["stiffness"] == pytest.approx(BODY.bending_stiffness / (BODY.length / 5), rel=0.04)
    for name in ("red", "green", "blue"):
        size = np.hypot(values[f"{name}.gain_x"], values[f"{name}.gain_y"])  # of 1e-6 N m/Pa
        assert size == pytest.approx(1e6 * BODY.torque, rel=0.03)
    turns = [np.arctan2(values[f"{n}.gain_x"], -values[f"{n}.gain_y"]) for n in ("red", "green", "blue")]
    np.testing.assert_allclose(np.degrees(np.diff(turns)) % 360, 120.0, atol=1.5)
    held_out = next(r for r in outcome.fits[0].records if r.name == "mixed")
    assert held_out.metrics["rmse_percent_of_travel"] < 3.0
