"""`pliant new` on recordings of tendons: what it drafts, and that inputs of other kinds are refused and named."""

from __future__ import annotations

import re

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from pliant.errors import InputError
from pliant.identification import experiment
from pliant.identification.drives import check_driven
from pliant.model import Tendon, chain_model
from pliant.numerics.curve import spatial_curve
from pliant.preprocessing.align import align
from pliant.recording import make_recording, write
from pliant.study.body import study_model
from pliant.study.draft import draft_study
from pliant.study.draft_inputs import tendon_ends
from pliant.study.prepare import aligned_recording, all_aligned, moving_stations
from pliant.study.run import prepare_all
from pliant.study.schema import load_study

TIME = np.arange(0, 4, 0.02)
S = np.linspace(0, 0.3, 31)
ENDS, AZIMUTHS = (0.1, 0.3, 0.2), np.radians([40.0, 200.0, 310.0])  # of three tendons, m and from x towards y
TURN = Rotation.from_euler("zx", [50, 200], degrees=True)  # of the tracker


def arm(kind="displacement", *, both=False):
    """A body of arcs: each tendon bends it evenly up to its end, towards itself; three stations and a base."""
    moves = np.where(TIME < 0.4, 0.0, TIME - 0.4)[:, None]
    drawn = 2e-3 * (np.sin([2.1, 3.2, 4.7] * moves) if both else np.sin([2.1, 3.2, 4.7] * moves) ** 2)
    curvature = np.zeros((len(TIME), len(S), 2))
    for u, end, a in zip(drawn.T, ENDS, AZIMUTHS, strict=True):
        curvature[:, end - 1e-9 >= S] += 400 * u[:, None, None] * [np.cos(a), np.sin(a)]
    place = spatial_curve(curvature, S)[0][..., [0, 2, 1]] * [-1, 1, 1]  # from +y to +z
    tracked = TURN.apply(place[:, [0, 10, 20, 30]].reshape(-1, 3)).reshape(-1, 4, 3)
    return make_recording(TIME, tracked + 0.1, station=["base", "first", "middle", "tip"], actuation=drawn,
                          input_kind=kind, input_names=["t1", "t2", "t3"])  # fmt: skip


@pytest.mark.parametrize("held", [False, True])
def test_azimuths_and_ends_of_tendons(held):
    """Tendons that do not hold each other: a ratio of stiffnesses near zero, for those whose lengths are the inputs."""
    body = align(arm(), base="base", tangent="chord", space=True)
    azimuth, end = np.array(tendon_ends(body, 3, held=held)).T
    np.testing.assert_allclose(end, ENDS, atol=2e-3)
    apart = np.degrees(AZIMUTHS - AZIMUTHS[0])
    np.testing.assert_allclose((azimuth - azimuth[0] - apart + 180) % 360, 180, atol=4)  # x is that of the motion


def test_a_study_of_tendons_is_drafted_and_builds_a_model(tmp_path):
    write(arm("angle", both=True), tmp_path / "run.nc")
    draft = draft_study([tmp_path / "run.nc"], tmp_path / "s.toml", mass=0.1)
    assert len(draft.questions) == 3  # gravity, and lever and pulley once, though three tendons ask them
    assert draft.text.count("[[actuator.tendons]]") == 3
    assert "pair = true  # its motor turns both ways" in draft.text
    text = draft.text.replace('lever = "?"', "lever = 8e-3").replace('pulley = "?"', "pulley = 0.01")
    text = text.replace('gravity = "?"', "gravity = [0.0, 0.0, -9.81]")
    (tmp_path / "s.toml").write_text(text)
    study = load_study(tmp_path / "s.toml")
    assert [t.joints for t in study.actuator.tendons] == [[1, 2], None, [1, 2, 3]]  # joints at 30, 90, 150, ... mm
    model = study_model(study.actuator, None)
    assert model.actuation.kinds == ("angle",) * 3
    assert study.recordings["run"].drive == {"t1": "t1", "t2": "t2", "t3": "t3"}
    words = "inputs, measured: t1 drives t1, t2 drives t2, t3 drives t3 (angle of a motor, rad)"
    assert words in all_aligned(study)["run"].findings
    silent = study.model_copy(update={"recordings": {
        "run": study.recordings["run"].model_copy(update={"signal": None, "drive": {}})}})  # fmt: skip
    words = "inputs, not stated whether measured or commanded: t1, t2, t3 (angle of a motor, rad)"
    assert words in aligned_recording(silent, "run").findings


@pytest.mark.parametrize("drive", [{"t1": "t1"}, None])
def test_an_input_of_another_kind_is_refused(drive):
    body = align(arm(), base="base", tangent="chord", space=True)
    body = body if drive else body.isel(input=[0])
    one = experiment("one", body, drive=drive)
    assert one.input_kinds == {"t1" if drive else "": "displacement"}
    cord = {"lever": 8e-3, "name": "t1"}
    right = chain_model(length=0.3, mass=0.1, links=3, stiffness=1.0, damping=0.01, space=True, chambers=[
        Tendon.at_azimuth(0.0, np.ones(3), driven_by="displacement", line_stiffness=1e3, **cord)])  # fmt: skip
    check_driven(right, [one])
    wrong = right.with_(chambers=[Tendon.at_azimuth(0.0, np.ones(3), driven_by="tension", **cord)])
    with pytest.raises(InputError, match=r"'t1' .* is a tension \[N\], but .* recorded as a displacement \[m\]"):
        check_driven(wrong, [one])


def test_the_run_estimates_the_azimuths_that_a_recording_without_rest_does_not_show(tmp_path):
    whole = arm()
    moving = whole.isel(time=slice(30, None), input_time=slice(30, None))
    write(moving, tmp_path / "run.nc")
    draft = draft_study([tmp_path / "run.nc"], tmp_path / "s.toml", mass=0.1)
    assert draft.text.count("[[actuator.tendons]]") == 3
    assert "azimuth_deg" not in draft.text
    assert "\nspace = true" in draft.text
    assert '"tip.aside" = "free"' in draft.text
    write(whole, tmp_path / "whole.nc")
    draft = draft_study([tmp_path / "run.nc", tmp_path / "whole.nc"], tmp_path / "s.toml", mass=0.1, length=0.3)
    assert draft.text.count("azimuth_deg = ") == 3  # the recording that could be aligned shows them
    assert draft.text.count("joints = ") == 2


def test_a_station_that_stands_still_is_part_of_a_settled_pose():
    """In a motion it may be the base, and the study must say so; between settled poses nothing moves anyway."""
    rng = np.random.default_rng(0)
    place = np.array([[0.0, 0, 0], [0, 0, 0.1], [0.01, 0, 0.2], [0.03, 0, 0.3]]) + np.zeros((80, 4, 3))
    place[:, 2:] += 1e-3 * np.sin(np.arange(80) / 9.0)[:, None, None]
    place += 1e-6 * rng.standard_normal(place.shape)
    recording = make_recording(np.arange(80) / 50.0, place, station=["base", "p1", "p2", "tip"])
    with pytest.raises(InputError, match="p1 does not move, like the base"):
        moving_stations("r", recording, "base")
    assert moving_stations("r", recording, "base", settled=True) == ["p1", "p2", "tip"]


@pytest.mark.slow  # two studies are prepared
def test_a_run_finds_where_tendons_end_that_the_study_says_nothing_of(tmp_path):
    """The base was not tracked when the draft was written; the run knows it, and sees how far each tendon bends."""
    write(arm("angle", both=True), tmp_path / "run.nc")
    draft = draft_study([tmp_path / "run.nc"], tmp_path / "s.toml", mass=0.1, length=0.3, gravity=[0.0, 0.0, 0.0])
    text = draft.text.replace('lever = "?"', "lever = 8e-3").replace('pulley = "?"', "pulley = 0.01")
    text = re.sub(r"^(azimuth_deg|joints) = .*\n", "", text, flags=re.MULTILINE)
    (tmp_path / "s.toml").write_text(text)
    notes: list[str] = []
    tendons = prepare_all(load_study(tmp_path / "s.toml"), notes.append).actuator.tendons
    assert [t.stop for t in tendons] == [pytest.approx(ENDS[0], abs=2e-3), None, pytest.approx(ENDS[2], abs=2e-3)]
    assert any("estimated azimuths of the inputs: t1" in note and "up to 100 mm" in note for note in notes)
    stated = text.replace('name = "t1"', 'name = "t1"\njoints = [1, 2, 3]')
    (tmp_path / "s.toml").write_text(stated)
    first = prepare_all(load_study(tmp_path / "s.toml"), notes.append).actuator.tendons[0]
    assert (first.stop, first.joints) == (None, [1, 2, 3])
