import json

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from planar_bodies import arc, wavy

from pliant.errors import InputError
from pliant.numerics.spline import BOUNDARIES, spline_matrix
from pliant.recording import make_recording
from pliant.reduction import select_order
from pliant.reduction.body import body_of
from pliant.reduction.error import spline_map
from pliant.reduction.placement import equal_nodes


def worst_mm(recording, n, boundary, **options):
    return select_order(recording, max_order=n, boundary=boundary, **options).max_error[-1].max() * 1e3


def test_quarter_circle_with_five_segments():
    assert worst_mm(arc(np.pi / 2), 5, "natural") == pytest.approx(0.528, abs=1e-3)
    assert worst_mm(arc(np.pi / 2), 5, "not-a-knot") == pytest.approx(0.030, abs=1e-3)


@pytest.mark.parametrize(("n", "natural", "not_a_knot"), [(3, 1.51, 0.33), (4, 0.83, 0.068), (10, 0.13, 0.002)])
def test_quarter_circle_with_other_orders(n, natural, not_a_knot):
    assert worst_mm(arc(np.pi / 2), n, "natural") == pytest.approx(natural, abs=6e-3)
    assert worst_mm(arc(np.pi / 2), n, "not-a-knot") == pytest.approx(not_a_knot, abs=3e-3)


@pytest.mark.parametrize(("boundary", "slope"), [("natural", -2), ("not-a-knot", -4), ("clamped+not-a-knot", -4)])
def test_order_of_convergence(boundary, slope):
    result = select_order(arc(np.pi / 2, stations=1000), max_order=20, boundary=boundary)
    keep = np.array(result.orders) >= 8
    fit = np.polyfit(np.log(np.array(result.orders)[keep]), np.log(result.max_error.max(axis=1)[keep]), 1)
    assert fit[0] == pytest.approx(slope, abs=0.3)


@pytest.mark.parametrize("boundary", BOUNDARIES)
def test_naive_twin(boundary):
    from scipy.interpolate import CubicSpline

    recording, _ = wavy(frames=4, stations=20)
    result = select_order(recording, max_order=4, boundary=boundary)
    s, frames = recording["arc_length"].values, recording["position"].values
    knots = result.node_arc_length[-1]
    condition = ((1, np.array([0.0, 1.0])), "not-a-knot") if boundary == "clamped+not-a-knot" else boundary
    for k, frame in enumerate(frames):
        curve = CubicSpline(knots, frame[np.isin(s, knots)], bc_type=condition)(s)
        distance = np.hypot(*(curve - frame).T)
        assert result.max_error[-1, k] == pytest.approx(distance.max(), rel=1e-9)
        assert result.mean_error[-1, k] == pytest.approx(distance.mean(), rel=1e-9)


@pytest.mark.parametrize("boundary", BOUNDARIES)
def test_node_errors_are_zero(boundary):
    recording, _ = wavy(frames=3, stations=21)
    body = body_of(recording)
    one = spline_map(body.arc_length, equal_nodes(body.arc_length, 5), boundary)
    at = np.searchsorted(body.arc_length, one.knots)
    curve = np.matmul(one.spline, np.matmul(one.nodes, body.position))
    curve += one.slope[:, None] * body.tangent[:, None]
    np.testing.assert_allclose(curve[:, at], body.position[:, at], atol=1e-15)


def moved(recording, angle, shift, mirror, scale):
    """The planar body as a tracker sees it: turned about an oblique axis, shifted, mirrored, scaled."""
    axis = np.array([0.36, 0.48, 0.8])
    K = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
    R = np.eye(3) + np.sin(angle) * K + (1 - np.cos(angle)) * K @ K
    flat = recording["position"].values
    points = np.concatenate((flat, np.zeros((*flat.shape[:2], 1))), axis=2) * [mirror, 1, 1]
    return make_recording(recording["time"].values, scale * points @ R.T + np.asarray(shift))


@settings(max_examples=15, deadline=None)
@given(
    angle=st.floats(-3, 3),
    shift=st.tuples(*[st.floats(-1, 1)] * 3),
    mirror=st.sampled_from([-1, 1]),
    scale=st.floats(0.1, 10),
    boundary=st.sampled_from(BOUNDARIES),
    metric=st.sampled_from(["arc", "closest"]),
    stations=st.sampled_from([20, 80]),
)
def test_motion_and_mirror_leave_errors_and_scaling_scales_them(
    angle, shift, mirror, scale, boundary, metric, stations
):
    recording, _ = wavy(frames=3, stations=stations)
    options = {"max_order": 5, "boundary": boundary, "metric": metric}
    still = select_order(moved(recording, 0, (0, 0, 0), 1, 1), **options)
    other = select_order(moved(recording, angle, shift, mirror, scale), **options)
    np.testing.assert_allclose(other.max_error, scale * still.max_error, rtol=1e-6, atol=1e-11)
    np.testing.assert_allclose(other.mean_error, scale * still.mean_error, rtol=1e-6, atol=1e-11)


def test_closest_point_of_the_clamped_spline_by_brute_force():
    recording, _ = wavy(frames=3, stations=40, bend=4)
    result = select_order(recording, max_order=3, metric="closest")
    body = body_of(recording)
    fine = np.linspace(0, body.arc_length[-1], 20001)
    one = spline_map(body.arc_length, result.node_arc_length[-1], "clamped+not-a-knot")
    B, slope = spline_matrix(one.knots, fine, one.boundary)
    for k, frame in enumerate(body.position):
        curve = B @ (one.nodes @ frame) + slope[:, None] * [0, 1]
        exact = np.array([np.hypot(*(curve - p).T).min() for p in frame])
        assert result.max_error[-1, k] == pytest.approx(exact.max(), abs=2e-8)
        # between its points, 8.4 um apart, the brute force cannot see a distance of zero
        assert exact.mean() - 4.3e-6 <= result.mean_error[-1, k] <= exact.mean() + 1e-9


@pytest.mark.parametrize("boundary", BOUNDARIES)
@pytest.mark.parametrize("stations", [20, 90])
def test_best_placement_is_never_worse_and_helps(boundary, stations):
    recording, _ = wavy(frames=30, stations=stations, bend=3)
    equal = select_order(recording, max_order=6, boundary=boundary).max_error.max(axis=1)
    best = select_order(recording, max_order=6, boundary=boundary, placement="best").max_error.max(axis=1)
    assert (best <= equal * (1 + 1e-12)).all()
    assert (best < 0.9 * equal).any()


def test_best_placement_finds_the_exhaustive_optimum():
    from itertools import combinations

    from pliant.reduction.error import frame_errors

    recording, _ = wavy(frames=30, stations=17, bend=3)
    body = body_of(recording)
    knots = [
        body.arc_length[[0, *inner, 16]] for inner in combinations(range(2, 15), 3) if min(np.diff([0, *inner, 16])) > 1
    ]
    optimum = frame_errors(body, [spline_map(body.arc_length, k, "natural") for k in knots])[0].max(axis=1).min()
    result = select_order(recording, max_order=4, boundary="natural", placement="best")
    assert result.max_error[-1].max() == pytest.approx(optimum, rel=1e-9)


def test_choice_is_the_lowest_order_within_the_bound():
    recording, _ = wavy()
    free = select_order(recording)
    assert free.chosen is None
    assert "no bound" in free.reason
    bound = float(free.max_error[2].max()) + 1e-9
    result = select_order(recording, bound=bound)
    assert result.chosen == 4
    assert "n = 4" in result.summary()
    assert result.fraction_within(4) == 1.0
    assert result.fraction_within(2) < 1.0
    impossible = select_order(recording, bound=1e-12)
    assert impossible.chosen is None
    assert "No order up to 8" in impossible.reason
    assert "smallest maximum" in impossible.reason


def test_json_form():
    recording, _ = wavy(frames=5)
    text = json.loads(json.dumps(select_order(recording, max_order=3, bound=3e-3).to_dict()))
    assert set(text) == {"orders", "chosen", "bound_mm", "frames", "stations"}
    assert set(text["orders"]) == {"2", "3"}
    assert set(text["orders"]["2"]) == {"max_mm", "mean_mm", "median_of_max_mm", "p95_of_max_mm"}
    assert text["frames"] == 5
    assert text["stations"] == 212


def test_worst_frames():
    recording, _ = wavy()
    result = select_order(recording, max_order=4)
    time, error = result.worst_frames(3, 1)[0]
    assert error == result.max_error[1].max()
    assert time in recording["time"].values
    assert result.operations(5) == 271


def test_few_stations_are_said_and_not_trusted():
    recording, _ = wavy(stations=7)
    result = select_order(recording, max_order=8, bound=0.05)
    assert result.chosen == 2
    assert "too few to judge" in result.reason
    assert result.orders[-1] < 7
    assert any("more than 7 stations" in note for note in result.notes)
    blind = select_order(recording, max_order=5, bound=1e-9)
    assert blind.chosen is None


def test_missing_stations_are_counted():
    recording, _ = wavy()
    holed = recording.copy(deep=True)
    holed["position"][3, 10] = np.nan
    holed["position"][7, 0] = np.nan
    before = holed.copy(deep=True)
    result = select_order(holed, max_order=3)
    assert result.frames == 10
    assert result.frames_left_out == 2
    assert "2 frame(s)" in result.summary()
    assert holed.identical(before)


def test_stretch_is_told():
    recording, _ = wavy()
    position = recording["position"].values * np.linspace(1, 1.1, 12)[:, None, None]
    result = select_order(make_recording(recording["time"].values, position, frame="planar"), max_order=3)
    assert any("length varies by" in note for note in result.notes)
    assert any("joints keep their fraction of the length" in note for note in result.notes)


@pytest.mark.parametrize("boundary", BOUNDARIES)
@pytest.mark.parametrize("metric", ["arc", "closest"])
def test_a_body_that_stretches_evenly_needs_no_more_links(boundary, metric):
    """Each frame's error is that of its shape unstretched, times its stretch; joints stay where they are."""
    recording, _ = wavy()
    stretch, time, s = np.linspace(1, 1.12, 12), recording["time"].values, recording["arc_length"].values
    longer = make_recording(
        time, recording["position"].values * stretch[:, None, None], arc_length=s, frame="planar",
    )
    options = {"boundary": boundary, "metric": metric, "bound": 5e-4}
    plain, stretched = select_order(recording, **options), select_order(longer, **options)
    np.testing.assert_allclose(stretched.max_error, stretch * plain.max_error, rtol=1e-3)
    np.testing.assert_array_equal(stretched.node_arc_length[2], plain.node_arc_length[2])
    assert stretched.chosen == plain.chosen is not None


def test_a_length_that_stays_leaves_the_slope_at_the_base_alone():
    recording, _ = wavy()
    np.testing.assert_array_equal(body_of(recording).tangent, np.tile([0.0, 1.0], (12, 1)))


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"boundary": "periodic"}, "boundary must be one of natural"),
        ({"placement": "random"}, "placement must be one of equal, best"),
        ({"metric": "dtw"}, "metric must be one of arc, closest"),
        ({"max_order": 1}, "2 segments or more"),
        ({"bound": -3}, "positive length in metres"),
        ({"bound": float("nan")}, "positive length in metres"),
    ],
)
def test_bad_options(options, message):
    with pytest.raises(InputError, match=message):
        select_order(wavy(frames=2, stations=20)[0], **options)


def test_bad_recordings():
    with pytest.raises(InputError, match="at least 4 stations"):
        select_order(make_recording([0.0], np.zeros((1, 3, 3))))
    with pytest.raises(InputError, match="stations 0 and 1, counted from 0, coincide"):
        select_order(make_recording([0.0], np.zeros((1, 5, 3))))
    recording, _ = wavy(frames=2, stations=20)
    lost = recording.copy(deep=True)
    lost["position"][:, 4] = np.nan
    with pytest.raises(InputError, match="station 4, counted from 0, is missing in 2 of 2 frames"):
        select_order(lost)
    with pytest.raises(InputError, match="the recording has no positions"):
        select_order(make_recording(pressure=[0.0, 1.0], pressure_time=[0.0, 1.0]))
