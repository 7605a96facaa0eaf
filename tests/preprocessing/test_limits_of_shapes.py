"""Alignment, caps, clusters, curvature and plausibility at their limits, on shapes whose answer is known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import savgol_filter
from scipy.spatial.transform import Rotation

from pliant.errors import InputError
from pliant.model import chain_model
from pliant.preprocessing.align import _out_of_plane, align, alignment_of
from pliant.preprocessing.base import (
    _clamp_tangent,
    bending_normal,
    input_normal,
    named_axis,
    still_noise,
    unit_vector,
)
from pliant.preprocessing.cap import CapTemplate, _consensus, find_tip
from pliant.preprocessing.clusters import _fixes_orientation, _mean_shape, _poses, assemble
from pliant.preprocessing.curvature import _Model, curvature_of, differences, fit_curvature, savgol_curvature, turning
from pliant.preprocessing.plausibility import Case, body, pressure, shape
from pliant.preprocessing.rotations import angle_about, continuous, from_matrix, mean_rotation, to_matrix
from pliant.recording import make_recording

TIME = np.arange(200) / 100


# the base frame


def swinging(stations=3, out=0.0, base=0.0, swing=0.02):
    """A body along y of the tracker that swings about z after 1 s, and out of that plane for some frames."""
    place = np.zeros((200, stations, 3))
    place[..., 1] = 0.05 * np.arange(stations)
    rise = np.where(TIME > 1, np.sin(20 * (TIME - 1)), 0.0)
    place[..., 0] = -swing * rise[:, None] * np.arange(stations) / (stations - 1)
    place[150:160, -1, 2] += out
    place[170, 0, 0] += base
    return make_recording(TIME, place, station=[f"p{k}" for k in range(stations)])


def test_motion_out_of_the_plane_is_measured_from_each_stations_mean():
    ds = swinging(out=0.004, base=0.0015)
    report = alignment_of(align(ds, tangent="+y", plane=[0, 0, 1], rest=(0.0, 0.9)))
    place = ds["position"].values
    off = place - place.mean(axis=0)
    rms, whole = np.sqrt((off[..., 2] ** 2).sum() / 600), np.sqrt((off**2).sum() / 600)
    assert report.out_of_plane_rms_m == pytest.approx(rms)
    assert report.out_of_plane_max_m == pytest.approx(0.004 * 0.95)
    assert report.out_of_plane_share == pytest.approx(rms / whole)
    assert report.base_travel_m == pytest.approx(0.0015)
    told = align(ds, tangent="+y", plane=[0, 0, 1], rest=(0.0, 0.9)).attrs["history"]
    frame = "base p0 at the origin, tangent +y along +y, plane given [0.0, 0.0, 1.0]"
    out = f"{1e3 * rms:.3g} mm rms ({100 * rms / whole:.2g} % of the motion)"
    for line in (f"aligned: {frame}, rest 0 to 0.9 s, bending sign +1", f"out of plane {out}, left out",
                 "the base moved up to 1.5 mm; its motion is kept as part of the motion"):  # fmt: skip
        assert line in told
    assert "vague" not in told
    assert _out_of_plane(np.zeros((3, 1, 3)), np.zeros((1, 3)), np.array([0, 0, 1.0]))["out_of_plane_share"] == 0.0
    still = align(swinging(), tangent="+y", plane=[0, 0, 1], rest=(0.0, 0.9)).attrs["history"]
    assert "the base moved" not in still


@pytest.mark.parametrize(("ratio", "vague"), [(0.48, False), (0.52, True)])
def test_a_plane_is_vague_where_the_motion_across_it_is_half_of_that_in_it(ratio, vague):
    """Two swings square to each other, the second a quarter of a period late."""
    place = np.zeros((200, 2, 3))
    place[:, 1, 1] = 0.1
    turn = 2 * np.pi * np.arange(150) / 150
    place[50:, 1, 0], place[50:, 1, 2] = 0.02 * np.sin(turn), ratio * 0.02 * np.cos(turn)
    mean = place.mean(axis=0)
    normal, flatness = bending_normal("motion", np.array([0, 1.0, 0]), place, {"motion": mean}, 0.0)
    moved = (place - mean)[:, 1]
    assert flatness == pytest.approx(np.sqrt((moved[:, 2] ** 2).sum() / (moved[:, 0] ** 2).sum()), rel=1e-6)
    np.testing.assert_allclose(np.abs(normal), [0, 0, 1], atol=1e-9)
    told = align(make_recording(TIME, place), tangent="+y", rest=(0.0, 0.4)).attrs["history"]
    line = f"the plane of bending is uncertain: the motion across it is {100 * flatness:.0f} % of the motion in it"
    assert (line in told) == vague


def test_a_normal_stands_square_to_the_tangent():
    y = np.array([0.0, 1.0, 0.0])
    for across, allowed in ((0.049, False), (0.051, True)):
        given = np.array([np.sqrt(1 - across**2), across, 0.0])[[1, 0, 2]]  # nearly along the tangent
        if allowed:
            normal, ratio = bending_normal(given, y, np.zeros((3, 1, 3)), {}, 0.0)
            np.testing.assert_allclose(normal, [1, 0, 0], atol=1e-12)
            assert ratio == 0.0
        else:
            with pytest.raises(InputError, match="must not be parallel"):
                bending_normal(given, y, np.zeros((3, 1, 3)), {}, 0.0)
    for moved, noise, seen in ((0.9e-6, 0.0, False), (1.1e-6, 0.0, True), (5.9e-3, 1e-3, False), (6.1e-3, 1e-3, True)):
        place = np.zeros((20, 1, 3))
        place[10, 0] = [moved, 9.0, 0.0]
        if seen:
            assert abs(bending_normal("motion", y, place, {"motion": np.zeros((1, 3))}, noise)[0][2]) == pytest.approx(
                1
            )
        else:
            with pytest.raises(InputError, match="no station moves across"):
                bending_normal("motion", y, place, {"motion": np.zeros((1, 3))}, noise)
            with pytest.raises(InputError, match="the body does not bend across"):
                bending_normal("body", y, place, {"body": np.zeros((1, 3))}, noise)
    for way in ([1.0, 0.3, 0.2], [-0.4, 0.1, -1.0], [0.1, 0.0, 1.0]):  # its largest component is positive
        place = np.outer(np.sin(np.arange(20.0)), way)[:, None]
        normal, _ = bending_normal("motion", y, place, {"motion": np.zeros((1, 3))}, 0.0)
        assert normal[np.abs(normal).argmax()] > 0
        assert normal @ y == pytest.approx(0.0, abs=1e-12)
        assert normal @ way == pytest.approx(0.0, abs=1e-9)
        assert np.linalg.norm(normal) == pytest.approx(1.0)


def test_directions_by_name_and_by_numbers():
    turn = Rotation.from_euler("z", 90, degrees=True).as_matrix()
    for name, axis in (
        ("+x", [1, 0, 0]),
        ("-y", [0, -1, 0]),
        ("+z", [0, 0, 1]),
        ("base:+x", [0, 1, 0]),
        ("base:-y", [1, 0, 0]),
    ):
        np.testing.assert_allclose(named_axis(name, turn), axis, atol=1e-12)
    assert named_axis("x", turn) is named_axis("base:x", turn) is named_axis("+w", turn) is None
    np.testing.assert_allclose(unit_vector([3e200, 0, 4e200], "w"), [0.6, 0, 0.8])
    np.testing.assert_allclose(unit_vector([0, -2e-300, 0], "w"), [0, -1, 0])
    for wrong in ([1, np.inf, 0], [1, 2], [[1, 2, 3]], "ab", [0, 0, 0]):
        with pytest.raises(InputError, match="w must be three"):
            unit_vector(wrong, "w")


def test_a_clamp_holds_the_first_three_stations_or_those_within_its_length():
    place = np.array([[0.0, 0, 0], [0, 0.01, 0], [0, 0.02, 0], [0.03, 0.02, 0], [0.9, 0.02, 0]])
    np.testing.assert_allclose(_clamp_tangent(place, None), [0, 1, 0], atol=1e-12)
    np.testing.assert_allclose(_clamp_tangent(place, 0.02), [0, 1, 0], atol=1e-12)
    assert _clamp_tangent(place, 0.05)[0] > 0.3
    np.testing.assert_allclose(_clamp_tangent(-place, None), [0, -1, 0], atol=1e-12)
    np.testing.assert_allclose(_clamp_tangent(place[:2], None), [0, 1, 0], atol=1e-12)
    with pytest.raises(InputError, match=r"two stations in the clamp, but there is 1 within 9 mm: increase"):
        _clamp_tangent(place, 0.009)
    with pytest.raises(InputError, match=r"two stations in the clamp, but there is 1$"):
        _clamp_tangent(place[:1], None)


def test_the_first_of_two_inputs_gives_the_plane():
    """The displacement is 2e-7 p1 along x and 5e-7 p2 along z, beside a constant and motion along the tangent."""
    p = np.stack([5e4 * np.sin(9 * TIME) ** 2, 3e4 * np.cos(4 * TIME) ** 2], axis=1)
    place = np.zeros((200, 3, 3))
    place[..., 1] = [0, 0.1, 0.2]
    for s, part in ((1, 0.3), (2, 1.0)):
        place[:, s, 0] = part * (2e-7 * p[:, 0] + 0.01)
        place[:, s, 2] = part * 5e-7 * p[:, 1]
        place[:, s, 1] += 0.05 * np.sin(3 * TIME)  # along the tangent
    place[7, 2] = np.nan
    ds = make_recording(TIME, place, pressure=p, chamber=["a", "b"])
    y, pose = np.array([0.0, 1.0, 0.0]), np.array([[0, 0, 0], [0, 0.1, 0], [0, 0.2, 0.0]])
    np.testing.assert_allclose(input_normal(ds, y, place, pose), [0, 0, -1.0], atol=1e-6)
    with pytest.raises(InputError, match="causes no motion across"):
        input_normal(ds, y, place * [1e-5, 1, 1], pose)
    with pytest.raises(InputError, match="needs a measured input"):
        input_normal(ds.drop_vars(["pressure", "pressure_time", "chamber"]), y, place, pose)
    assert still_noise(np.full((9, 2, 3), np.nan)) == 0.0


@pytest.mark.parametrize(("stations", "known"), [(7, False), (8, True)])
def test_eight_stations_give_their_arc_length(stations, known):
    ds = swinging(stations)
    made = align(ds, tangent="+y", plane=[0, 0, 1], rest=(0, 0.9), origin_offset=0.02)
    assert ("arc_length" in made.coords) == known
    np.testing.assert_allclose(made["position"].values[0, :, 1], 0.05 * np.arange(stations) - 0.02)
    if known:
        np.testing.assert_allclose(made["arc_length"], 0.05 * np.arange(8) - 0.02, atol=1e-12)
        later = align(ds, base="p2", tangent="+y", plane=[0, 0, 1], rest=(0, 0.9), origin_offset=[0.0, 0.0, 0.3])
        np.testing.assert_allclose(later["arc_length"], 0.05 * (np.arange(8) - 2), atol=1e-12)
    at = align(ds, tangent="+y", plane=[0, 0, 1], rest=(0, 0.9), origin=[0.0, -0.1, 0.0])
    np.testing.assert_allclose(at["position"].values[0, :, 1], 0.05 * np.arange(stations) + 0.1)
    with pytest.raises(InputError, match="origin must be three numbers"):
        align(ds, tangent="+y", plane=[0, 0, 1], origin=[0.0, 0.0])
    with pytest.raises(InputError, match="origin and origin_offset are both set"):
        align(ds, tangent="+y", plane=[0, 0, 1], origin=[0.0, 0, 0], origin_offset=0.1)
    with pytest.raises(InputError, match="a length along the tangent or three numbers"):
        align(ds, tangent="+y", origin_offset=np.inf)
    with pytest.raises(
        InputError, match=r"the rest window 3 to 4 s contains no frame: set rest within 0 to 1\.99 s"
    ):
        align(ds, rest=(3, 4))
    assert alignment_of(align(ds, tangent="+y", rest=(0.5, 0.5))).rest_s == (0.5, 0.5)


def test_rotations_there_and_back():
    turns = Rotation.random(50, rng=4)
    np.testing.assert_allclose(to_matrix(turns.as_quat()), turns.as_matrix(), atol=1e-12)
    quaternion = turns.as_quat()
    np.testing.assert_allclose(from_matrix(turns.as_matrix()), quaternion * np.sign(quaternion[:, 3:]), atol=1e-12)
    for k in range(3):  # turns by pi
        half = np.zeros(4)
        half[k] = 1.0
        assert np.abs(from_matrix(to_matrix(half))[k]) == pytest.approx(1.0)
    axis = np.array([0.6, 0.0, 0.8])
    for angle in (-2.5, 0.3, 3.1):
        assert angle_about(Rotation.from_rotvec(angle * axis).as_matrix(), axis) == pytest.approx(angle)
    mixed = Rotation.from_rotvec(0.7 * axis) * Rotation.from_rotvec([0, 0.4, 0])  # twist times swing
    assert angle_about(mixed.as_matrix(), axis) == pytest.approx(0.7)
    flips = np.array([1, 1, -1, -1, 1])[:, None, None] * np.tile([0.0, 0, 0.6, 0.8], (5, 1, 1))
    made, turned = continuous(flips)
    assert turned == 2
    np.testing.assert_allclose(made, np.tile([0.0, 0, 0.6, 0.8], (5, 1, 1)))
    some = turns.as_matrix()[:6].copy()
    some[2] = np.nan
    np.testing.assert_allclose(mean_rotation(some), turns[[0, 1, 3, 4, 5]].mean().as_matrix(), atol=1e-9)
    assert np.isnan(mean_rotation(np.full((3, 3, 3), np.nan))).all()


# caps


def consensus(place, without=0, ambiguous=0, contrast=0.6, spacing=1e-3):
    count = len(place) + without + ambiguous
    whole = np.append(place, np.full(without + ambiguous, np.nan))
    clear = np.arange(count) < len(place)
    return _consensus(
        whole, clear | (np.arange(count) >= len(place) + without), clear, np.full(count, contrast), spacing
    )


def test_confidence_is_agreement_times_contrast_times_steadiness():
    found = consensus([0.1] * 8, without=2, ambiguous=3)
    assert (found.found, found.confidence) == (True, pytest.approx(0.8))  # those that bend like the cap do not count
    assert (found.frames_used, found.frames_without_cap, found.frames_ambiguous, found.frames_rejected) == (8, 2, 3, 0)
    counted = "8 of 13 frame(s): 2 without a cap, 3 with a body curved like the cap, 0 far from the median"
    assert found.status == f"Tip at 100.00 mm, confidence 0.80, from {counted}."
    assert consensus([0.1] * 4, contrast=0.15).confidence == pytest.approx(0.5)  # half of a clear contrast
    assert consensus([0.1] * 4, contrast=0.15).found
    assert not consensus([0.1] * 4, contrast=0.149).found
    assert consensus([0.1] * 4, contrast=0.3).confidence == 1.0
    wide = consensus([0.099, 0.099, 0.1, 0.101, 0.101])
    assert wide.confidence == pytest.approx(1 / (1 + (1.4826 / 2) ** 2))
    assert wide.standard_deviation == pytest.approx(1.4826e-3)
    refused = consensus([0.09, 0.09, 0.1, 0.11, 0.11])
    assert not refused.found
    assert np.isnan(refused.arc_length)
    assert refused.status.startswith("No tip: the frames do not agree, confidence 0.02 (5 frame(s): 0 without")
    for off, agree in ((0.9e-3, 7), (1.1e-3, 6)):  # by one spacing where the others do not differ
        assert consensus([0.1] * 6 + [0.1 + off]).frames_used == agree
    for off, agree in ((5.8e-3, 7), (6.1e-3, 6)):  # by four robust deviations
        made = consensus([0.098, 0.099, 0.1, 0.1, 0.101, 0.101, 0.1 + off], spacing=1e-4)
        assert made.frames_used == agree
        assert made.frames_rejected == 7 - agree
    assert "there is no cap of this curvature and length (3 frame(s)" in consensus([], without=3).status
    assert "the body is curved like the cap (1 frame(s)" in consensus([], ambiguous=1).status


S = np.arange(200) * 1e-3


def steps(body=0.0, cap=20.0, tail=0.0, tip=0.12, length=0.03):
    return np.where(tip - 5e-4 > S, body, np.where(tip + length - 5e-4 > S, cap, tail))[None]


@pytest.mark.parametrize(
    ("change", "capped", "clear"),
    [
        ({}, True, True),
        ({"cap": 24.8}, True, True),
        ({"cap": 25.2}, False, False),
        ({"cap": 15.2}, True, True),
        ({"cap": 14.8}, False, False),
        ({"tail": 4.8}, True, True),
        ({"tail": 5.2}, False, False),
        ({"tail": -4.8}, True, True),
        ({"tail": -5.2}, False, False),
        ({"body": 16.8}, True, True),
        ({"body": 17.2}, True, False),
        ({"body": 23.2}, True, True),
        ({"body": 22.8}, True, False),
    ],
)
def test_a_cap_has_its_curvature_and_a_body_another(change, capped, clear):
    found = find_tip(steps(**change), 1e-3, cap_curvature=20.0, cap_length=0.03)
    assert found.frames_without_cap == (not capped)
    assert found.frames_ambiguous == (capped and not clear)
    if clear:
        assert found.per_frame[0] == pytest.approx(0.1195, abs=6e-4)


def test_a_template_in_closed_form():
    template = CapTemplate(1e-3, 20.0, 0.03, 4e-3, 1.0)
    assert (template.before, template.samples) == (19, 2 * 19 + 31)  # half of the cap and the gauge to both sides
    assert CapTemplate(0.1, 20.0, 0.03, 1e-3, 0.0).before == 3
    np.testing.assert_allclose(template.s[[0, 19, -1]], [-0.019, 0.0, 0.049])
    shares = template.shares(np.array([1e-3]))
    np.testing.assert_allclose(shares[0][0], np.clip((1e-3 + 2e-3 - template.s) / 4e-3, 0, 1))
    np.testing.assert_allclose(shares[1][0], np.clip((template.s + 2e-3 - 0.031) / 4e-3, 0, 1), atol=1e-12)
    for edge in (-7e-4, 0.0, 4e-4):
        body, tail = template.shares(np.array([edge]))
        kappa = np.concatenate(
            [np.full((1, 40), 5.0), 5.0 * body + 20.0 * (1 - body - tail) + tail, np.ones((1, 30))], axis=1
        )
        place, (mean, plateau, end, error) = template.locate(kappa)
        assert place[0] == pytest.approx((40 + 19) * 1e-3 + edge, abs=1e-9)
        assert (mean[0], plateau[0], end[0]) == pytest.approx((5.0, 20.0, 1.0))
        assert error[0] == pytest.approx(0.0, abs=1e-6)
    edge, mean = np.zeros(1), np.array([5.0])
    body, tail = (a[0] for a in template.shares(edge))
    inside, behind = body + tail < 1e-3, tail > 0.999
    rng = np.random.default_rng(2)
    window = 5 * body + 20 * (1 - body - tail) + tail + rng.normal(size=69)
    levels = template._levels(window[None], edge, mean)[:, 0]
    scatter = np.concatenate([window[inside] - window[inside].mean(), window[behind] - window[behind].mean()])
    sigma = np.sqrt((scatter**2).sum() / (len(scatter) - 2))
    assert levels == pytest.approx([5.0, window[inside].mean(), window[behind].mean(), sigma / np.sqrt(inside.sum())])



# clusters


@pytest.mark.parametrize(("off", "fixed"), [(0.019, False), (0.021, True)])
def test_markers_on_a_line_fix_no_orientation(off, fixed):
    """Two singular values of their places, the second a fiftieth of the first."""
    cross = np.array([[1.0, 0, 0], [-1.0, 0, 0], [0, off, 0], [0, -off, 0]])
    assert _fixes_orientation(cross + 3.0) == fixed
    assert not _fixes_orientation(cross[:2])
    assert _fixes_orientation(np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]]))


def test_poses_of_a_cluster_from_the_markers_that_are_seen():
    rng = np.random.default_rng(5)
    markers = np.array([[0.0, 0, 0], [0.1, 0, 0], [0, 0.1, 0], [0, 0, 0.1]])
    turns = Rotation.random(30, rng=6)
    shifts = rng.normal(size=(30, 3))
    points = np.stack([turn.apply(markers) + shift for turn, shift in zip(turns, shifts, strict=True)])
    mean = _mean_shape(points[0], points)
    np.testing.assert_allclose(mean, points[0] - points[0].mean(axis=0), atol=1e-12)
    seen = points.copy()
    seen[3, 2], seen[4, :2] = np.nan, np.nan
    rotation, centre, residual = _poses(mean, seen)
    since = (turns * turns[0].inv()).as_matrix()
    whole = np.arange(30) != 4
    np.testing.assert_allclose(rotation[whole], since[whole], atol=1e-9)
    np.testing.assert_allclose(centre[whole], points.mean(axis=1)[whole], atol=1e-9)
    np.testing.assert_allclose(residual[whole], 0.0, atol=1e-9)
    assert np.isnan(rotation[4]).all()
    bent = points.copy()
    bent[7, 0] += 0.02
    _, _, residual = _poses(mean, bent)
    far = 0.02 * np.sqrt(3)  # of one marker of four, without a turn: the root of 3/16 of that
    assert 0.3 * far < residual[7] < np.sqrt(3 / 16) * far


@pytest.mark.parametrize(("wobble", "rigid"), [(0.95, True), (1.05, False)])
def test_a_cluster_is_rigid_to_the_tolerance(wobble, rigid):
    """A marker that goes out of the plane of three others by a leaves a residual of a fourth of it in each."""
    square = np.array([[0.0, 0, 0], [0.1, 0, 0], [0.1, 0.1, 0], [0, 0.1, 0]])
    points = np.tile(square, (100, 1, 1))
    points[::2, :, 2] = wobble * 1e-3 * np.array([1, -1, 1, -1])
    points[1::2, :, 2] = -wobble * 1e-3 * np.array([1, -1, 1, -1])
    ds = make_recording(np.arange(100) / 100, points, station=[*"abcd"])
    if rigid:
        made = assemble(ds, {"body": [*"abcd"]}, tolerance_mm=1.0)
        assert made["rigidity"].values[0] == pytest.approx(wobble * 1e-3, rel=1e-6)
        assert "rigid within 0.950 mm (95 % of the frames)" in made.attrs["history"]
        np.testing.assert_allclose(made["position"].values[:, 0], np.tile([0.05, 0.05, 0.0], (100, 1)), atol=1e-9)
        at = assemble(ds, {"body": {"markers": [*"abcd"], "point": "c", "offset": [0.0, 0.0, 0.01]}}, tolerance_mm=2.0)
        np.testing.assert_allclose(at["position"].values[50, 0], [0.1, 0.1, 0.01], atol=2e-3)
        return
    with pytest.raises(InputError, match=r"deviate by 1\.05 mm \(95 % of the frames\), more than 1\.00 mm"):
        assemble(ds, {"body": [*"abcd"]}, tolerance_mm=1.0)


def test_clusters_tell_what_is_lost_and_left_out():
    points = np.tile(np.array([[0.0, 0, 0], [0.1, 0, 0], [0, 0.1, 0], [9, 9, 9]]), (20, 1, 1))
    points[3:7, 0] = np.nan
    ds = make_recording(np.arange(20) / 100, points, station=["a1", "a2", "a3", "far"])
    told = assemble(ds, {"Base": ["a*"]}).attrs["history"]
    assert "pose of 3 markers, rigid within 0.000 mm (95 % of the frames), 4 frame(s) lack markers and stay NaN" in told
    assert "1 marker(s) belong to no cluster and were left out: far" in told
    two = assemble(ds, {"a": ["a1", "a2"], "b": "far"})
    assert "position of 2 marker(s), no orientation, 4 frame(s) lack" in two.attrs["history"]
    np.testing.assert_allclose(two["position"].values[0], [[0.05, 0, 0], [9, 9, 9]])
    point = assemble(ds, {"a": {"markers": ["a1", "a2"], "point": "a2"}})
    np.testing.assert_allclose(point["position"].values[:, 0], np.tile([0.1, 0, 0], (20, 1)))
    with pytest.raises(InputError, match="2 clusters have the role base: base, base_2"):
        assemble(ds, {"base": "a1", "base_2": "a2"})
    assert assemble(ds, {"base": "a1", "base_2": {"markers": ["a2"], "role": "body"}}).sizes["station"] == 2


# curvature


def test_derivatives_are_those_of_savitzky_and_golay():
    rng = np.random.default_rng(8)
    values = rng.normal(size=40)
    for window in (5, 11, 39):
        for order, rows in enumerate(differences(40, window, 0.02), 1):
            np.testing.assert_allclose(
                rows @ values, savgol_filter(values, window, 4, deriv=order, delta=0.02), rtol=1e-8
            )


def helix(kappa, s, frames=2):
    place = np.stack([(np.cos(kappa * s) - 1) / kappa, np.sin(kappa * s) / kappa], axis=1)
    return np.tile(place, (frames, 1, 1))


@pytest.mark.parametrize("method", ["savgol", "spline", "basis"])
def test_every_method_gives_the_curvature_of_a_circle(method):
    s = np.linspace(0, 0.1, 61)
    place = helix(6.0, s) + 50.0  # far from the origin
    ds = make_recording(np.arange(2.0), place, frame="planar", arc_length=s)
    found = curvature_of(ds, method=method)
    np.testing.assert_allclose(found, 6.0, rtol=1e-3)
    mirrored = make_recording(np.arange(2.0), place * [-1, 1], frame="planar", arc_length=s)
    np.testing.assert_allclose(curvature_of(mirrored, method=method), -6.0, rtol=1e-3)
    if method != "basis":
        space = np.concatenate([place, np.full((2, 61, 1), 2.0)], axis=2)
        ds = make_recording(np.arange(2.0), space * [-1, 1, 1], arc_length=s)
        np.testing.assert_allclose(curvature_of(ds, method=method), 6.0, rtol=1e-3)  # in space without a sign
    np.testing.assert_allclose(turning(np.array([[[3.0, 0.0]]]), np.array([[[0.0, 2.0]]])), 2 * 3 / 27)


@pytest.mark.parametrize(("off", "even"), [(0.009, True), (0.011, False)])
def test_savitzky_and_golay_need_even_stations(off, even):
    s = np.arange(61) * 1e-3
    s[30:] += off * 1e-3
    spacing = np.diff(s)
    assert (np.abs(spacing / spacing.mean() - 1).max() > 0.01) != even
    if even:
        savgol_curvature(helix(6.0, s), s, 11)
        savgol_curvature(helix(6.0, s), s, 61)
        savgol_curvature(helix(6.0, s), s, 5)
        for window in (4, 3, 62, 63):
            with pytest.raises(InputError, match=f"above 4 and at most 61 stations, not {window}"):
                savgol_curvature(helix(6.0, s), s, window)
        return
    with pytest.raises(InputError, match=r"deviates by 1\.1 %"):
        savgol_curvature(helix(6.0, s), s, 11)


def test_a_fit_of_curvature_recovers_a_polynomial():
    s = np.linspace(0, 0.2, 40) ** 1.1
    fine = np.linspace(0, s[-1], 20001)
    kappa = 3 + 20 * fine - 60 * fine**2
    phi = 0.3 + np.concatenate([[0.0], np.cumsum((kappa[1:] + kappa[:-1]) / 2 * np.diff(fine))])
    way = np.stack([-np.sin(phi), np.cos(phi)], axis=1)
    path = np.concatenate([[[0.0, 0.0]], np.cumsum((way[1:] + way[:-1]) / 2 * np.diff(fine)[:, None], axis=0)])
    place = np.stack([np.interp(s, fine, path[:, k]) for k in (0, 1)], axis=1)[None] + np.array([0.7, -0.2])
    exact = 3 + 20 * s - 60 * s**2
    for count in (1, 70):  # more than one chunk of frames
        fit = fit_curvature(np.tile(place, (count, 1, 1)), s, terms=3, smoothing=0.0)
        np.testing.assert_allclose(fit.curvature, np.tile(exact, (count, 1)), atol=2e-3)
        assert (fit.terms, fit.unsettled) == (3, 0)
        assert fit.rms_distance < 1e-7
    shifted = place.copy()
    shifted[0, 1::2, 0] += 1e-4
    shifted[0, ::2, 0] -= 1e-4
    assert fit_curvature(shifted, s, terms=3, smoothing=0.0).rms_distance == pytest.approx(1e-4, rel=0.1)
    stiff = fit_curvature(place, s, terms=6, smoothing=1e6).curvature[0]  # nothing bends: a straight line of curvature
    assert np.abs(np.diff(stiff, 2) / np.diff(stiff).std()).max() < 5 or np.ptp(stiff) < np.ptp(exact)
    assert fit_curvature(place, s).terms == 10
    assert fit_curvature(place[:, :12], s[:12]).terms == 4
    for terms in (0, 77):
        with pytest.raises(InputError, match=f"between 1 and 76, not {terms}"):
            fit_curvature(place, s, terms=terms)
    with pytest.raises(InputError, match="must not be negative"):
        fit_curvature(place, s, smoothing=-1e-9)


def test_the_jacobian_of_positions_is_their_derivative():
    s = np.linspace(0, 0.2, 12)
    model = _Model(s, 4)
    rng = np.random.default_rng(1)
    x = np.concatenate([rng.normal(size=3), 5 * rng.normal(size=4)])[None]
    place = rng.normal(size=(1, 12, 2))
    _, jacobian = model.linearised(x, place)
    for k in range(7):
        step = np.zeros((1, 7))
        step[0, k] = 1e-6
        up, down = (model.linearised(x + sign * step, place)[0][0] for sign in (1, -1))
        np.testing.assert_allclose(jacobian[0, :, k], (up - down) / 2e-6, atol=1e-8)
    assert model.points_per_station == 2 * 10  # a hundred intervals along the body, and a few more
    assert model.weights.sum() == pytest.approx(0.2)
    start = model.start(np.tile(np.stack([-0.1 * s, s], axis=1), (1, 1, 1)))
    np.testing.assert_allclose(start[0, :3], [0, 0, np.arctan(0.1)], atol=1e-4)
    np.testing.assert_allclose(start[0, 3:], 0.0, atol=1e-3)


# plausibility


BODY = chain_model(length=0.12, mass=0.05, links=4, stiffness=0.08, damping=1e-3, torque=[4e-7])


def recording(place=None, **more):
    place = np.tile(np.linspace([0, 0, 0], [0, 0.1, 0], 4), (20, 1, 1)) if place is None else place
    return make_recording(np.arange(len(place)) / 10, place, **more)


@pytest.mark.parametrize(
    ("length", "said"),
    [
        (5.1e-3, False),
        (4.9e-3, True),
        (9.9, False),
        (10.1, True),
    ],
)
def test_a_body_is_longer_than_five_millimetres_and_shorter_than_ten_metres(length, said):
    assert bool(body.length(Case(length=length))) == said
    assert (
        bool(shape.length_unit(Case(recording(np.tile([[0.0, 0, 0], [0.6 * length, 0.8 * length, 0]], (9, 1, 1))))))
        == said
    )


@pytest.mark.parametrize(("length", "said"), [(0.071, False), (0.069, True), (0.499, False), (0.501, True)])
def test_a_stated_length_fits_what_was_seen(length, said):
    ds = recording()
    aligned = make_recording(ds["time"].values, ds["position"].values[..., :2], frame="planar")
    assert bool(found := body.length(Case(length=length, aligned=aligned))) == said
    if said:
        assert f"length = {length:g} m, but the recording reaches 0.1 m from the base" in found
    dense = make_recording(
        ds["time"].values, ds["position"].values[..., :2], frame="planar", arc_length=[0, 0.1, 0.2, 0.3]
    )
    assert body.reach(Case(aligned=dense)) == 0.3
    assert body.reach(Case()) is None


@pytest.mark.parametrize(("density", "said"), [(205.0, False), (195.0, True), (7900.0, False), (8100.0, True)])
def test_a_body_is_denser_than_foam_and_lighter_than_steel(density, said):
    mass = density * np.pi / 4 * 0.02**2 * 0.12
    assert bool(found := body.mass(Case(mass=mass, length=0.12, diameter=0.02))) == said
    if said:
        line = f"in 120 mm of 20 mm diameter is a density of {density:.3g} kg/m3, but soft bodies have 200 to 8000"
        assert line in found


@pytest.mark.parametrize(("wide", "said"), [(0.59, False), (0.61, True)])
def test_a_silicone_body_is_no_wider_than_six_tenths_of_its_length(wide, said):
    mass = 1100 * np.pi / 4 * (wide * 0.12) ** 2 * 0.12
    assert bool(found := body.mass(Case(mass=mass, length=0.12))) == said
    if said:
        assert f"a silicone body of 120 mm length {wide * 120:.3g} mm wide" in found
    assert body.mass(Case(mass=1e9, length=11.0)) == body.mass(Case(mass=1e9)) == body.mass(Case(length=0.1)) == ""


@pytest.mark.parametrize(
    ("gravity", "said"),
    [
        ((0, -9.81), False),
        ((0, -9.71, 0), False),
        ((0, -9.69, 0), True),
        ((0, -9.89, 0), False),
        ((0, 9.91, 0), True),
        ((0, -3.0), False),
        ((0, -9.95), True),
        ((0, 0, 0), False),
    ],
)
def test_gravity_is_the_earths(gravity, said):
    assert bool(body.gravity(Case(gravity=gravity))) == said


@pytest.mark.parametrize(("across", "said"), [(0.095, False), (0.105, True)])
def test_a_tenth_of_gravity_may_point_across_the_plane(across, said):
    aligned = align(swinging(), tangent="+y", plane=[0, 0, 1], rest=(0, 0.9))
    gravity = 9.81 * np.array([0.0, -np.sqrt(1 - across**2), across])
    assert bool(found := body.gravity(Case(aligned=aligned, gravity=tuple(gravity)))) == said
    if said:
        assert "1.03 of 9.81 m/s^2 of gravity point across the plane" in found
        assert "The body points along its y axis" in found
    space = align(swinging(), tangent="+y", plane=[0, 0, 1], rest=(0, 0.9), space=True)
    assert body.gravity(Case(aligned=space, gravity=tuple(gravity))) == ""


@pytest.mark.parametrize(
    ("step", "said"), [(0.99, ""), (1.01, "were times in ms or us"), (5.1e-5, ""), (4.9e-5, "Check time_unit")]
)
def test_samples_follow_each_other_as_those_of_sensors_do(step, said):
    place = np.tile(np.linspace([0, 0, 0], [0, 0.1, 0], 4), (20, 1, 1))
    slow = make_recording(np.arange(20) * step, place)
    assert said in pressure.time_unit(Case(slow))
    assert bool(pressure.time_unit(Case(slow))) == bool(said)
    log = make_recording(np.arange(20) / 10, place, pressure=np.arange(20.0), pressure_time=np.arange(20) * step)
    assert bool(pressure.time_unit(Case(log))) == bool(said)
    if said:
        assert "samples of pressure are" in pressure.time_unit(Case(log))
    assert pressure.time_unit(Case(make_recording([0.0, step], place[:2]))).startswith("the frames" if said else "")


@pytest.mark.parametrize(
    ("turn", "alone", "said"),
    [
        (419.0, True, ""),
        (421.0, True, "read as rad"),
        (3.2, True, ""),
        (3.1, True, "read as degrees"),
        (3.1, False, ""),
    ],
)
def test_a_body_turns_once_and_a_little_more(turn, alone, said):
    angle = np.radians(np.linspace(0.0, turn, 20))[:, None]
    place = None if alone else np.zeros((20, 1, 2))
    ds = make_recording(np.arange(20) / 10, place, angle=angle, station=["tip"], frame="planar")
    assert said in (found := shape.angle_unit(Case(ds)))
    assert bool(found) == bool(said)
    if turn == 3.1 and alone:
        far = make_recording(np.arange(20) / 10, angle=angle + 0.1, station=["tip"], frame="planar")
        assert shape.angle_unit(Case(far)) == ""  # it lies beyond what radians reach
        assert "by more than 3.1 degrees" in found


@pytest.mark.parametrize(("stations", "at"), [(4, 3), (7, 6), (8, 2), (10, 3)])
@pytest.mark.parametrize(("degrees", "said"), [(59.0, False), (61.0, True)])
def test_a_base_tangent_points_along_the_body(stations, at, degrees, said):
    place = np.zeros((200, stations, 3))
    place[..., 1] = 0.05 * np.arange(stations)
    place[..., 0] = -0.01 * np.where(TIME > 1, np.sin(20 * TIME), 0.0)[:, None] * np.arange(stations)
    lean = np.radians(degrees)
    place[:, at] += -place[:100, at].mean(axis=0) + 0.3 * np.array([np.sin(lean), np.cos(lean), 0.0])
    ds = make_recording(TIME, place)
    case = Case(ds, aligned=align(ds, tangent="+y", plane=[0, 0, 1], rest=(0.0, 0.9)))
    assert shape.tilt(case) == pytest.approx(degrees, abs=0.01)
    assert bool(shape.tangent(case)) == said
    assert shape.tilt(Case(ds)) is None


@pytest.mark.parametrize(("part", "said"), [(0.98, False), (1.02, True)])
def test_a_bending_stiffness_is_that_of_a_soft_body(part, said):
    """EI is the joint's stiffness times the length of its segment."""
    most = 5e3 * 0.12**4 / 0.03
    assert bool(body.stiffness(Case(model=BODY.with_(stiffness=part * most)))) == said
    second = np.pi / 64 * 0.02**4
    for modulus, sign in ((1e9, 1), (1e3, -1)):
        model = BODY.with_(stiffness=modulus * part**sign * second / 0.03)
        assert bool(found := body.stiffness(Case(model=model, diameter=0.02))) == said
        if said:
            assert "at 20 mm diameter, but soft bodies have 1e+03 to 1e+09 Pa" in found
    assert body.stiffness(Case()) == body.torque(Case()) == ""


@pytest.mark.parametrize(("part", "said"), [(0.98, False), (1.02, True)])
def test_a_torque_is_an_area_times_a_lever(part, said):
    for diameter in (0.02, None):
        most = np.pi / 8 * (0.02 if diameter else 0.4 * 0.12) ** 3
        found = body.torque(Case(model=BODY.with_(torque=[-part * most]), diameter=diameter))
        assert bool(found) == said


def driven(values):
    values = np.asarray(values, float)
    return Case(make_recording(pressure=values, pressure_time=np.arange(len(values)) / 100))


def course(low, high, count=400, seed=1):
    """Between two pressures, not in steps; it begins at the lower."""
    rng = np.random.default_rng(seed)
    return np.append(np.full(5, low), low + (high - low) * np.sort(rng.random(count)))


@pytest.mark.parametrize(
    ("highest", "said"), [(1010.0, ""), (990.0, "never exceeds 990 Pa"), (1.99e6, ""), (2.01e6, "reaches 2.01 MPa")]
)
def test_pressures_are_those_of_soft_actuators(highest, said):
    for sign in (1, -1):
        found = pressure.unit(driven(sign * np.linspace(0, highest, 50)))
        assert said in found
        assert bool(found) == bool(said)
    assert pressure.unit(driven(np.zeros(9))) == ""


@pytest.mark.parametrize(("start", "absolute"), [(78.5e3, False), (79.5e3, True), (107.5e3, True), (108.5e3, False)])
def test_an_absolute_pressure_begins_at_the_atmosphere(start, absolute):
    values = np.append(np.full(9, start), course(130e3, 200e3))
    assert pressure.is_absolute(values) == absolute
    lower = np.append(np.full(9, 150e3), np.append(course(130e3, 200e3), np.full(40, start)))  # or falls to it
    assert pressure.is_absolute(lower) == absolute
    assert bool(found := pressure.absolute(driven(values))) == absolute
    if absolute:
        assert f"reads {start / 1e3:.4g} kPa without load" in found
        assert f"offset = {-start / 1e3:.4g}, unit" in found
        assert f"reads {start / 1e3:.4g} kPa" in pressure.absolute(driven(lower))


@pytest.mark.parametrize(("low", "absolute"), [(19e3, False), (21e3, True)])
def test_an_absolute_pressure_never_comes_below_twenty_kilopascals(low, absolute):
    values = np.append(np.full(60, 100e3), np.append(course(100e3, 150e3), np.full(40, low)))
    assert pressure.is_absolute(values) == absolute


@pytest.mark.parametrize(("low", "said"), [(9.8e3, False), (10.4e3, True), (49e3, True), (51e3, False)])
def test_an_offset_lies_between_a_tenth_and_a_half_of_the_highest(low, said):
    values = np.append(course(low, 100e3), np.full(60, 100e3))
    assert pressure.ends(values) == pytest.approx((low, low, 100e3), rel=0.02)
    assert bool(found := pressure.offset(driven(values))) == said
    if said:
        assert f"starts at {low / 1e3:.3g} kPa and never falls below" in found
    two = make_recording(
        pressure=np.stack([values, values], 1), pressure_time=np.arange(len(values)) / 9, chamber=["a", "b"]
    )
    assert pressure.offset(Case(two)) == ""
    assert pressure.ends(np.linspace(-5e4, 1e5, 500))[1] == 0.0
    assert pressure.offset(driven(values * 0.009)) == ""


@pytest.mark.parametrize(
    ("unit", "step", "whole"),
    [
        (1e3, 1.0, True),
        (1e3, 64.0, True),
        (1e3, 65.0, False),
        (1e3, 1.37, False),
        (1.0, 3.0, True),
    ],
)
def test_whole_numbers_of_a_unit_are_counts(unit, step, whole):
    values = unit * step * np.array([3, 4, 5, 7, 9, 9, 12.0])
    assert pressure.whole_counts(values) == whole
    assert not pressure.whole_counts(values[:4])  # five levels are needed


def test_counts_that_rest_high_are_named():
    counts = 1e3 * np.rint(np.append(course(60, 300), np.full(60, 300)))
    found = pressure.raw_counts(driven(counts))
    assert "has only whole numbers and never falls below 20 % of its highest value" in found
    low = 1e3 * np.rint(np.append(course(3, 300), np.full(60, 300)))
    assert pressure.raw_counts(driven(low)) == ""
    both = make_recording(
        pressure=np.stack([low, counts], 1), pressure_time=np.arange(len(low)) / 9, chamber=["a", "b"]
    )
    assert pressure.raw_counts(Case(both)).startswith("the pressure b has only whole numbers")


def test_a_case_without_what_a_check_needs_finds_nothing():
    empty = Case()
    for module in (body, pressure, shape):
        assert all(check.find(empty) == "" for check in module.CHECKS)
    assert shape.extent(np.full((3, 2, 3), np.nan)) == 0.0
    assert shape.swapped(replace(empty, swapped={"a-b": 3, "c-d": 1})).startswith(
        "stations exchange their labels: a-b in 3 frames, c-d in 1 frames. Set swaps"
    )
