"""`pliant new` on recordings that leave the plane: what it says, both options, and a fit of what it drafts."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from pliant.errors import InputError
from pliant.model import Chamber, Station, chain_model
from pliant.recording import make_recording, write
from pliant.simulation import Trace, simulate
from pliant.study import run_study
from pliant.study.body import study_model
from pliant.study.draft import draft_study
from pliant.study.draft_inputs import azimuths
from pliant.study.schema import load_study

TIME = np.arange(0, 1.6, 0.02)
TURN = Rotation.random(rng=8)
ALPHA = np.radians([90.0, 210.0])
GRAVITY = TURN.apply([0, 0, 9.81]).tolist()


def body(links=3):
    chambers = tuple(
        Chamber(torque=[2e-6], joint_gain=np.full(links, np.sin(a)), cross_gain=np.full(links, -np.cos(a)), name=name)
        for name, a in zip(("left", "right"), ALPHA, strict=True)
    )
    points = [Station(f"p{i}", i, length, 0.003, -0.002) for i, length in enumerate([0.1, 0.1, 0.05])]
    return chain_model(length=0.3, mass=0.1, links=links, joint_placement="midsegment", stiffness=0.45, damping=0.01,
                       space=True, gravity=[0, 0, 9.81], chambers=chambers, stations=points)  # fmt: skip


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Two recordings of a body with two chambers, in a tracker's axes."""
    path, rng = tmp_path_factory.mktemp("space"), np.random.default_rng(0)
    for k, rates in enumerate([(2.0, 3.1), (2.7, 1.3)]):
        pressure = np.stack([np.where(TIME < 0.4, 0.0, 2e4 * np.sin(r * (TIME - 0.4)) ** 2) for r in rates], -1)
        drive = [Trace(TIME, p) for p in pressure.T]
        place = simulate(body(), drive, times=TIME, time_step=4e-3)["station_position"].values
        place = np.concatenate([np.zeros((len(TIME), 1, 3)), place], axis=1)
        place = place + 1e-5 * rng.standard_normal(place.shape)
        tracked = TURN.apply(place.reshape(-1, 3)).reshape(place.shape) + 0.2
        write(make_recording(TIME, tracked, station=["base", "p0", "p1", "p2"], pressure=pressure, pressure_time=TIME,
                             chamber=["left", "right"]), path / f"run{k}.nc")  # fmt: skip
    return path


def swinging(pressures):
    """A tip that goes round at rates of its own towards x and y of the base frame, after a moment of rest."""
    moves = np.where(TIME < 0.4, 0.0, TIME - 0.4)
    pressure = 1e4 * np.stack([np.sin(6 * moves) ** 2, np.sin(4 * moves) ** 2], -1)
    tip = -2e-6 * pressure @ np.stack([np.cos(ALPHA), np.sin(ALPHA)], -1)
    place = np.stack([0 * tip, 0.3 * tip, tip], 1)
    place = np.concatenate([place, np.broadcast_to([[0.0], [0.15], [0.3]], (len(TIME), 3, 1))], axis=2)
    place = TURN.apply(place.reshape(-1, 3)).reshape(place.shape) + 1e-5 * np.random.default_rng(1).random(place.shape)
    given = {"pressure": pressure, "pressure_time": TIME, "chamber": ["left", "right"]} if pressures else {}
    return make_recording(TIME, place, station=["base", "middle", "tip"], **given)


def test_a_body_in_space_is_recognised_and_both_options_are_offered(tmp_path):
    write(swinging(pressures=True), tmp_path / "run.nc")
    draft = draft_study([tmp_path / "run.nc"], tmp_path / "s.toml", mass=0.1, gravity=GRAVITY)
    assert "space = true  #" in draft.text
    assert "of the motion is out of its best-fit plane; remove this line to model the motion in" in draft.text
    assert 'drive = { left = "left", right = "right" }' in draft.text
    found = [float(line.split()[2]) for line in draft.text.splitlines() if line.startswith("azimuth_deg")]
    assert (found[1] - found[0]) % 360 == pytest.approx(120, abs=1.1)  # whole degrees
    assert "base_tilt" not in draft.text  # a term that the run chooses
    (tmp_path / "s.toml").write_text(draft.text)
    model = study_model(load_study(tmp_path / "s.toml").actuator, None)
    np.testing.assert_allclose(model.chambers[1].joint_gain, np.sin(np.radians(found[1])), atol=1e-12)
    np.testing.assert_allclose(model.chambers[1].cross_gain, -np.cos(np.radians(found[1])), atol=1e-12)
    assert model.gravity.shape == (3,)


def test_the_other_option_is_a_study_in_the_plane(tmp_path):
    write(swinging(pressures=False), tmp_path / "run.nc")
    for space in (None, True):
        assert "\nspace = true  #" in draft_study([tmp_path / "run.nc"], tmp_path / "s.toml", space=space).text
    flat = draft_study([tmp_path / "run.nc"], tmp_path / "s.toml", space=False)
    assert "\n# space = true  # " in flat.text
    assert "\nspace" not in flat.text


def test_azimuths_of_chambers_by_the_motion():
    out = np.stack([np.sin(9 * TIME), np.cos(5 * TIME)], -1)
    gains = -np.array([[np.cos(a), np.sin(a)] for a in ALPHA])
    place = np.concatenate([1e-6 * out @ gains, np.full((len(TIME), 1), 0.3)], axis=1)[:, None]
    ds = make_recording(TIME, place, frame="spatial", pressure=out, pressure_time=TIME)
    np.testing.assert_allclose(azimuths(ds), np.degrees(ALPHA), atol=1e-6)


def test_what_cannot_be_drafted_in_space_says_so(tmp_path):
    place = np.zeros((len(TIME), 3, 3)) + np.linspace(0, 0.3, 3)[:, None]
    place[:, 2, 0] += 0.05 * np.sin(5 * TIME)
    write(make_recording(TIME, place[..., [0, 2]], frame="planar"), tmp_path / "flat.nc")
    with pytest.raises(InputError, match="holds a planar recording: a study in space needs"):
        draft_study([tmp_path / "flat.nc"], tmp_path / "s.toml", space=True)
    inputs = {"actuation": np.sin(TIME)[:, None], "input_kind": "angle", "input_time": TIME}
    write(make_recording(TIME, place[..., [0, 2]], frame="planar", **inputs), tmp_path / "motor.nc")
    with pytest.raises(InputError, match="holds a planar recording: a study in space needs"):  # tendons pull in space
        draft_study([tmp_path / "motor.nc"], tmp_path / "s.toml")


@pytest.mark.slow
def test_the_drafted_study_finds_the_body(folder):
    draft = draft_study([folder / "run0.nc", folder / "run1.nc"], folder / "s.toml", mass=0.1, gravity=GRAVITY)
    text = draft.text.replace("links = 5", "links = 3")
    text = f"time_step = 5e-3\n{text}"
    (folder / "s.toml").write_text(text)
    outcome = run_study(load_study(folder / "s.toml"))
    fit = outcome.fits[0].result
    values = {name: entry["value"] for name, entry in fit.to_dict()["parameters"].items()}
    assert values["stiffness"] == pytest.approx(0.45, rel=0.02)  # the error of the base tangent was not worth a term
    size = [np.hypot(values[f"{c}.gain_x"], values[f"{c}.gain_y"]) for c in ("left", "right")]
    np.testing.assert_allclose(size, 2.0, rtol=0.02)  # of 1e-6 N m/Pa
    turns = [np.arctan2(values[f"{c}.gain_x"], -values[f"{c}.gain_y"]) for c in ("left", "right")]
    assert np.degrees(turns[1] - turns[0]) % 360 == pytest.approx(120, abs=0.5)
    held_out = next(r for r in outcome.fits[0].records if r.name == "run1")
    assert held_out.metrics["rmse_percent_of_travel"] < 0.5
