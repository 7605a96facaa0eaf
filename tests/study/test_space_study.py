"""A study in space: one base frame for all recordings, gravity in it, fibres with and without a cap."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from pliant.errors import InputError
from pliant.numerics.curve import spatial_curve
from pliant.preprocessing.align import align
from pliant.preprocessing.side import alignment_of
from pliant.recording import make_recording, write
from pliant.study.body import in_base_frame, study_model
from pliant.study.body_tables import ActuatorEntry, TendonTable
from pliant.study.dense import body_of_fibre, shape_of
from pliant.study.prepare import aligned_recording, all_aligned, in_frame
from pliant.study.schema import Fibre, Reduction, Study, check_chambers

TURN, SHIFT = Rotation.random(rng=8), np.array([0.2, 0.5, -0.1])
TIME = np.arange(150) / 50
S = np.linspace(0, 0.3, 31)
WAVE = np.where(TIME < 1, 0.0, np.sin(4 * (TIME - 1)))[:, None]


def points(first, second, s=S):
    """Places (T, S, 3) in the base frame: curvatures towards x and y, which change along the body."""
    still = np.stack([2.0 + 0 * s, 3 * s / s[-1]], -1)
    moving = np.stack([first * WAVE + 0 * s, second * WAVE * s / s[-1]], -1)
    place = spatial_curve(still + moving, s)[0]
    return place[..., [0, 2, 1]] * [-1, 1, 1]  # from a tangent along y, m1 = -x, m2 = z


def tracked(place, **more):
    return make_recording(TIME, TURN.apply(place.reshape(-1, 3)).reshape(place.shape) + SHIFT, **more)


@pytest.fixture
def study(tmp_path):
    write(tracked(points(4, 1)), tmp_path / "one.nc")
    write(tracked(points(-1, 5)), tmp_path / "two.nc")
    return Study.model_validate({
        "name": "arm", "folder": str(tmp_path), "actuator": {"length": 0.3, "mass": 0.1, "space": True},
        "alignment": {"options": {"tangent": list(TURN.apply([0, 0, 1.0]))}},
        "recordings": {n: {"file": f"{n}.nc", "excitation": "release"} for n in ("one", "two")},
        "fits": {"a": {"train": ["one"], "held_out": ["two"], "parameters": {"stiffness": "free"}}},
    })  # fmt: skip


def test_all_recordings_share_the_base_frame_of_the_first(study):
    aligned = all_aligned(study)
    one, two = (alignment_of(aligned[n].body) for n in ("one", "two"))
    np.testing.assert_allclose(one.rotation, two.rotation, atol=1e-12)
    assert one.out_of_plane_rms_m < two.out_of_plane_rms_m  # x is normal to the plane in which the first moves most
    to_base = np.array(one.rotation) @ TURN.as_matrix()  # a turn about z
    np.testing.assert_allclose(to_base[2], [0, 0, 1], atol=1e-12)
    for name, place in (("one", points(4, 1)), ("two", points(-1, 5))):
        np.testing.assert_allclose(aligned[name].body["position"], place @ to_base.T, atol=1e-12)
    down = TURN.apply([0, 0, -9.81])
    np.testing.assert_allclose(in_base_frame(down, np.array(one.rotation), 1, 3), [0, 0, -9.81], atol=1e-12)
    with pytest.raises(InputError, match="x, y, z"):
        in_base_frame(np.array([0, 9.81]), None, 1, 3)


def test_recordings_aligned_otherwise_are_refused(study):
    flat = study.model_copy(update={"actuator": study.actuator.model_copy(update={"space": False})})
    raw = tracked(points(4, 1))
    spatial, planar = align(raw, space=True), align(raw)
    with pytest.raises(InputError, match=r"holds positions in space, but .* space is false"):
        in_frame(flat, "one", spatial, flat.alignment, None)
    with pytest.raises(InputError, match=r"holds positions in a plane, but .* space is true"):
        in_frame(study, "one", planar, study.alignment, None)
    assert in_frame(study, "one", spatial, study.alignment, None)[1] is spatial
    asked = study.alignment.model_copy(update={"options": {"space": True}})
    with pytest.raises(InputError, match="'space' is unknown"):
        in_frame(study, "one", raw, asked, None)


def fibre(lead, cap):
    """A fibre with a straight lead, a body, and a cap of curvature 50 1/m over 30 mm where `cap` is set; and a tail."""
    s = np.arange(0, lead + 0.3 + 0.05, 0.001)
    kappa = np.zeros((len(TIME), len(s), 2))
    inside = (s >= lead) & (s < lead + 0.3)
    along = (s[inside] - lead) / 0.3
    kappa[:, inside, 0] = 3 + 4 * WAVE * along
    kappa[:, inside, 1] = 5 * along
    if cap:
        kappa[:, (s >= lead + 0.3) & (s < lead + 0.33)] = [30.0, -40.0]
    return tracked(spatial_curve(kappa, s)[0], arc_length=s)


def test_the_body_of_a_fibre_in_space_by_its_start_or_its_cap():
    stated, told = body_of_fibre(fibre(0.04, cap=False), Fibre(body_length=0.3, start=0.04), space=True)
    assert "40.0 to 340.0 mm along the fibre, as stated" in told
    capped, told = body_of_fibre(fibre(0.04, cap=True), Fibre(body_length=0.3, cap_curvature=-50, cap_length=0.03),
                                 space=True)  # fmt: skip
    for body in (stated, capped):
        assert body.attrs["frame"] == "spatial"
        assert body["arc_length"].values[-1] == pytest.approx(0.3, abs=1e-9)
    one, two = (body["position"].values[:, -1] for body in (stated, capped))
    np.testing.assert_allclose(one[:, 2], two[:, 2], atol=1e-3)  # each has its own direction of x
    np.testing.assert_allclose(np.hypot(*one.T[:2]), np.hypot(*two.T[:2]), atol=1e-3)
    shape = shape_of("a", stated, told, Reduction(bound_mm=1.0, joint_placement="midsegment"))
    n = shape.links.n
    assert 3 <= n <= 5
    assert shape.links.rest_angle.shape == (2 * n,)
    np.testing.assert_allclose(shape.links.node_arc_length, 0.3 / n * np.append(np.arange(n) + 0.5, n))
    middle = slice(60, -60)
    np.testing.assert_allclose(shape.rest_curvature[middle], np.hypot(3, 5 * shape.arc_length / 0.3)[middle], rtol=0.05)
    with pytest.raises(ValueError, match="cap_curvature and cap_length, or start"):
        Fibre(body_length=0.3)
    with pytest.raises(ValueError, match="cap_curvature and cap_length, or start"):
        Fibre(body_length=0.3, start=0.1, cap_curvature=5.0)


TENDON = {"name": "red", "driven_by": "angle", "azimuth_deg": 60, "lever": 8e-3, "pulley": 0.01, "joints": [1, 2]}


def test_tendons_of_a_study_become_inputs_of_its_model():
    actuator = {"length": 0.3, "mass": 0.1, "links": 4, "space": True, "tendons": [TENDON],
                "chambers": [{"name": "air", "torque": [1e-6]}]}  # fmt: skip
    model = study_model(ActuatorEntry.model_validate(actuator), None)
    assert model.actuation.names == ("air", "red")
    assert model.actuation.units == ("Pa", "rad")
    turned = model.actuation.gain[1].reshape(4, 2)  # a tendon bends the body towards itself: about -sin, cos
    np.testing.assert_allclose(turned[:2], np.tile(8e-3 * np.array([-np.sin(np.pi / 3), 0.5]), (2, 1)), atol=1e-15)
    assert not turned[2:].any()


@pytest.mark.parametrize(("change", "sentence"), [
    ({"joints": [5]}, "tendon red acts on joint 5"), ({"pulley": 0.0}, "needs the radius of the pulley"),
    ({"driven_by": "tension", "pulley": 0.0, "lever": 1e3}, "lever must have a size"),
])  # fmt: skip
def test_tendons_that_a_chain_cannot_have_are_refused(change, sentence):
    actuator = {"length": 0.3, "mass": 0.1, "links": 4, "space": True, "tendons": [TENDON | change]}
    with pytest.raises(InputError, match=sentence):
        study_model(ActuatorEntry.model_validate(actuator), None)


def test_tendons_of_a_body_in_a_plane_are_refused(study):
    flat = study.actuator.model_copy(update={"space": False, "tendons": [TendonTable(**TENDON)]})
    with pytest.raises(InputError, match="needs a body in space"):
        check_chambers(study.model_copy(update={"actuator": flat}))


def test_a_study_leaves_frozen_frames_out_and_draws_lines_through_held_inputs(study):
    place = points(4, 1)[:, [0, 15, 30]]
    place[80:90, 2] = place[79, 2]  # the tip's last place, repeated
    smooth = np.where(TIME < 1, 0.0, np.sin(4 * (TIME - 1)))
    held = np.repeat(smooth[::3], 3)
    raw = tracked(place, station=["base", "middle", "tip"], actuation=held[:, None], input_kind="tension",
                  input_names=["cord"])  # fmt: skip
    write(raw, Path(study.folder) / "one.nc")
    entry = study.recordings["one"].model_copy(update={"staircase": "lines"})
    aligned = aligned_recording(study.model_copy(update={"recordings": {"one": entry}}), "one")
    np.testing.assert_array_equal(np.isnan(aligned.body["position"].values).any((1, 2)),
                                  (np.arange(150) >= 80) & (np.arange(150) < 90))  # fmt: skip
    error = np.abs(aligned.body["actuation"].values[:, 0] - smooth)[60:147].max()
    assert error < 0.2 * np.abs(held - smooth)[60:147].max()
    assert "left out frames in which a station was frozen: tip 10" in aligned.findings
    assert "straight lines between the changes of cord" in aligned.findings
    as_it_is = aligned_recording(study, "one").body["actuation"].values[:, 0]
    np.testing.assert_array_equal(as_it_is, held)
