"""What a recording sees of a model's links: angles from the rest or the base, curves as joint angles, their noise."""

from __future__ import annotations

import numpy as np
import pytest
from oracles.estimates import nees

from pliant.equations.observation import ALONG_X, ALONG_Y, ANGLE, JOINT
from pliant.errors import InputError
from pliant.estimation import KalmanFilter, Noise
from pliant.estimation.link_angles import LinkTips, with_rest_shape
from pliant.estimation.measurement import measurement_of, rows_of
from pliant.estimation.noise import default_noise
from pliant.estimation.offline import averaged, mean_bounds, whiteness
from pliant.model import Chamber, Station, chain_model
from pliant.recording import make_recording
from pliant.simulation import equilibrium

TIME = np.arange(5) * 0.1
ARM = chain_model(
    length=0.2, mass=0.05, links=2, stiffness=1.0, damping=0.01, torque=[1e-6], rest_angle=[0.1, 0.05], base_angle=0.02,
    stations=[Station("mid", 0, 0.1), Station("tip", 1, 0.1, 0.004)],
)


@pytest.mark.parametrize("reference", ["rest", "base"])
def test_angles_beside_places_are_those_of_the_links(reference):
    places, angle = np.random.default_rng(1).normal(size=(5, 2, 2)), np.random.default_rng(2).normal(size=(5, 2))
    noise = Noise(position=1e-3, angle=0.02, stations={"tip": 5e-3})
    ds = make_recording(TIME, places, station=["mid", "tip"], angle=angle, angle_reference=reference, frame="planar")
    made = measurement_of(ds, ARM, noise)
    assert made.label == ("mid x", "mid y", "mid angle", "tip x", "tip y", "tip angle")
    np.testing.assert_allclose(made.rows, [
        (ALONG_X, 0, 0.1, 0), (ALONG_Y, 0, 0.1, 0), (ANGLE, 0, 0, 0),
        (ALONG_X, 1, 0.1, 0.004), (ALONG_Y, 1, 0.1, 0.004), (ANGLE, 1, 0, 0),
    ])  # fmt: skip
    np.testing.assert_allclose(made.variance, [1e-6, 1e-6, 4e-4, 25e-6, 25e-6, 4e-4])
    rest = 0.02 + np.cumsum(np.array([0.1, 0.05]) + equilibrium(ARM)) if reference == "rest" else np.zeros(2)
    np.testing.assert_allclose(made.value[:, [2, 5]], angle + rest)
    np.testing.assert_allclose(made.value[:, [0, 1, 3, 4]], places.reshape(5, 4))
    only = measurement_of(ds, ARM, noise, ("tip",))
    np.testing.assert_allclose(only.value, made.value[:, 3:])


def test_a_dense_curve_becomes_joint_angles_and_its_broken_frames_are_left_out():
    s = np.linspace(0.0, 0.2, 21)
    turns = np.linspace(0.0, 0.6, 5)[:, None]  # of circles, the base along +y
    radius = 0.2 / np.maximum(turns, 1e-9)
    place = np.stack([-radius * (1 - np.cos(turns * s / 0.2)), radius * np.sin(turns * s / 0.2)], axis=-1)
    place[3, 7] = np.nan
    ds = make_recording(TIME, place, station=[f"p{k}" for k in range(21)], arc_length=s, frame="planar")
    made = measurement_of(ds, ARM, Noise(angle=0.03))
    assert made.label == ("joint_1", "joint_2")
    np.testing.assert_allclose(made.rows[:, :2], [(JOINT, 0), (JOINT, 1)])
    np.testing.assert_allclose(made.variance, 9e-4)
    assert np.isnan(made.value[3]).all()
    whole = made.value[[0, 1, 2, 4]]
    np.testing.assert_allclose(whole, turns[[0, 1, 2, 4]] * [0.25, 0.5], atol=2e-3)  # chords of an arc
    assert made.notes[0] == "curve of 21 points compressed to 2 joint angles"


def test_what_shows_nothing_of_the_links_is_refused():
    with pytest.raises(InputError, match="lies on the base and does not depend on the links"):
        rows_of(ARM, (Station("foot", -1, 0.0),))
    few = make_recording(TIME, np.zeros((5, 5, 2)), station=list("abcde"), frame="planar")
    with pytest.raises(InputError, match=r"\(a, b, c, d, e\) is one of the model's .*at least 6 points"):
        measurement_of(few, ARM, Noise())
    with pytest.raises(InputError, match="station 'c' is not in both"):
        measurement_of(few, ARM, Noise(), ("c",))


def test_noise_in_proportion_to_the_stiffness():
    stiff = ARM.with_(stiffness=[1.0, 5.0])
    soft = default_noise(ARM)
    for name in ("torque", "random_walk", "initial_disturbance"):
        assert getattr(default_noise(stiff), name) == pytest.approx(3.0 * getattr(soft, name))
    assert default_noise(stiff).motion_growth == soft.motion_growth > 0
    alone = default_noise(stiff, disturbance=False)
    assert alone.random_walk == alone.initial_disturbance == 0.0
    assert alone.torque == pytest.approx(3.0 * default_noise(ARM, disturbance=False).torque)
    assert alone.torque > default_noise(stiff).torque  # it stands for what a disturbance would take up


def test_errors_and_innovations_are_judged_by_chi_square():
    rng = np.random.default_rng(3)
    root = np.array([[2.0, 0.0], [1.0, 0.5]])
    error = rng.normal(size=(4000, 2)) @ root.T
    squares = nees(error, np.broadcast_to(root @ root.T, (4000, 2, 2)))
    np.testing.assert_allclose(squares[:5], np.sum(np.linalg.solve(root, error[:5].T) ** 2, axis=0))
    low, high = mean_bounds(np.full(4000, 2.0))
    assert low < squares.mean() / 2.0 < high
    assert (low, high) == pytest.approx((1 - 1.96 * np.sqrt(2 / 8000), 1 + 1.96 * np.sqrt(2 / 8000)), abs=4e-4)
    assert mean_bounds(np.array([1.0])) == pytest.approx((0.000982, 5.0239), rel=1e-3)  # of any table
    with pytest.raises(InputError, match="at least one used value"):
        mean_bounds(np.zeros(3))
    lasting = np.zeros((400, 2))
    for k in range(1, 400):
        lasting[k] = 0.6 * lasting[k - 1] + rng.normal(size=2)
    lasting[50, 0] = np.nan
    correlation, bound = whiteness(lasting)
    assert correlation == pytest.approx(0.6, abs=0.08)
    assert bound == pytest.approx(1.96 / np.sqrt(2 * 399 - 2))
    assert abs(whiteness(rng.normal(size=(400, 2)))[0]) < 3 * bound / 1.96
    with pytest.raises(InputError, match="two consecutive frames"):
        whiteness(np.array([[1.0], [np.nan], [1.0]]))


def test_link_tips_lie_between_their_neighbours_and_the_rest_is_found_with_its_noise():
    rng, s = np.random.default_rng(4), np.array([0.0, 0.05, 0.08, 0.16, 0.2])
    straight = ARM.with_(rest_angle=[0.0, 0.0], base_angle=0.0)
    seen = LinkTips(straight, s, noise=2e-3)
    points = rng.normal(size=(5, 2))
    np.testing.assert_allclose(seen.tips(points), [0.75 * points[2] + 0.25 * points[3], points[4]])
    frame = seen.frame(points)
    np.testing.assert_allclose(frame[1], seen.tips(points).ravel())
    np.testing.assert_allclose(frame[2], 4e-6)
    for wrong in (s[::-1], s[:1], s[:-1], s + 0.15, np.stack([s, s])):
        with pytest.raises(InputError, match="at increasing arc lengths that cover 100 to 200 mm"):
            LinkTips(straight, wrong)
    with pytest.raises(InputError, match=r"5 points, .*\(4, 2\)"):
        seen.frame(points[:4])
    bent = np.cumsum([0.2, -0.1])
    joints = np.concatenate([[[0.0, 0.0]], np.cumsum(0.1 * np.stack([-np.sin(bent), np.cos(bent)], axis=1), axis=0)])
    nodes, exact = np.array([0.0, 0.1, 0.2]), np.array([0.0, 0.05, 0.1, 0.15, 0.2])
    shape = np.stack([np.interp(exact, nodes, joints[:, k]) for k in (0, 1)], axis=1)
    frames = shape + 1e-4 * rng.normal(size=(400, 5, 2))
    frames[0, 2] = np.nan
    body, places = with_rest_shape(straight, exact, frames)
    np.testing.assert_allclose(body.rest_angle + equilibrium(body), [0.2, -0.1], atol=3e-4)
    assert np.sqrt(places.frame(shape)[2]) == pytest.approx(1e-4, rel=0.1)
    with pytest.raises(InputError, match="at least 5 complete frames, got 4 of 5"):
        with_rest_shape(straight, exact, frames[:5])


@pytest.mark.parametrize("coarse", [False, True])
def test_a_pressure_is_averaged_over_a_window_about_each_time(coarse):
    """The mean of a straight line is the line, that of a step a ramp as wide as the window."""
    clock = np.array([0.0, 0.9, 1.0, 2.0, 3.0]) if coarse else np.arange(0.0, 3.001, 0.01)
    line = 2.0 + 3.0 * clock
    at, mean = averaged(clock, line, 0.4)
    np.testing.assert_allclose(mean, 2.0 + 3.0 * at, atol=1e-12)
    assert (at[0], at[-1]) == (0.0, 3.0)
    step = (clock >= 1.0).astype(float)
    at, mean = averaged(clock, step, 0.4)
    ramp = (clock[step > 0][0] - clock[step == 0][-1])
    far = (at < 1.0 - ramp - 0.2) | (at > 1.2)
    np.testing.assert_allclose(mean[far], (at > 1.0)[far])
    middle = 1.0 - 0.5 * ramp
    assert np.interp(middle, at, mean) == pytest.approx(0.5, abs=1e-9)
    np.testing.assert_array_equal(averaged(clock, step, 0.0)[1], step)


def test_a_filter_has_states_for_a_disturbance_where_there_may_be_one():
    plain, walks, begins = Noise(), Noise(random_walk=0.1), Noise(initial_disturbance=0.1)
    assert [noise.states(ARM) for noise in (plain, walks, begins)] == [4, 6, 6]
    assert plain.initial(ARM).shape == (4, 4)
    np.testing.assert_allclose(np.diag(begins.initial(ARM))[4:], 0.01)


@pytest.mark.parametrize("sample", [(np.nan, 1e4), (1e4, np.nan), (np.inf, np.nan)])
def test_every_pressure_of_a_sample_is_a_number(sample):
    two = tuple(Chamber([1e-6], joint_gain=np.ones(2), name=name) for name in "ab")
    live = KalmanFilter(ARM.with_(chambers=two), Noise())
    live.push_pressure(0.0, (0.0, 1e4))
    with pytest.raises(InputError, match="must be finite"):
        live.push_pressure(0.1, sample)
    with pytest.raises(InputError, match="must be finite"):
        live.push_pressure(np.nan, (0.0, 1e4))
