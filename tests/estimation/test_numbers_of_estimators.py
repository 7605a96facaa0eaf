"""Numbers of the estimators against closed forms; what they refuse, from just below and just above."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.linalg import expm, solve_discrete_are

from pliant.errors import InputError
from pliant.estimation import KalmanFilter, LinkAngles, Noise, estimate, frozen
from pliant.estimation.adaptive_observer import AdaptiveObserver, in_torques, stationary, with_shifts
from pliant.estimation.differences import Differences
from pliant.estimation.link_angles import LinkTips, calibrated, joint_rows, needs_joint_rows
from pliant.estimation.measurement import Measurement, bends_away, measurement_of, row_width, rows_of
from pliant.estimation.noise import default_noise, scales
from pliant.estimation.offline import (
    averaged,
    input_of,
    judged,
    mean_bounds,
    primitive,
    smooth,
    standard_deviations,
    whiteness,
)
from pliant.estimation.symbols import FilterOutput, make_output, make_workspace
from pliant.linear.linearisation import linearise
from pliant.model import Extension, Memory, Station, Valve, chain_model
from pliant.recording import make_recording
from pliant.simulation import equilibrium

pytestmark = pytest.mark.slow  # kernels of their own are compiled first

BODY = chain_model(length=0.2, mass=0.05, links=2, stiffness=[1.0, 1.5], damping=0.01, torque=[1e-6])
ARM = chain_model(length=0.3, mass=0.05, links=3, stiffness=[1.0, 1.5, 2.0], damping=0.01, torque=[1e-6])
PERIOD = 5e-3  # compiled kernels are those of three links, which other tests take too


# differences


def test_rates_are_differences_behind_a_first_order_filter():
    made = Differences(BODY.with_(rest_angle=[0.1, 0.2], base_angle=0.05), cutoff=20.0)
    rows, variance = joint_rows(BODY), np.array([1e-6, 4e-6])
    before = made.state(0.0)
    np.testing.assert_allclose(before.angle, [0.15, 0.35])
    np.testing.assert_allclose(before.covariance[:2, :2], np.pi**2 * np.array([[1, 1], [1, 2]]))
    made.push_frame(1.0, rows, np.array([0.1, 0.2]), variance)
    assert made.state(0.0).rate.tolist() == [0.0, 0.0]
    made.push_frame(1.01, rows, np.array([0.2, 0.1]), variance)
    keep = math.exp(-2 * np.pi * 20 * 0.01)
    found = made.state(9.0)
    np.testing.assert_allclose(found.angle, [0.2, 0.3])
    np.testing.assert_allclose(found.rate, (1 - keep) * np.array([10.0, 0.0]))
    assert found.time == 1.01
    gain = (1 - keep) / 0.01
    own = np.array([[1e-6, 1e-6], [1e-6, 5e-6]])
    np.testing.assert_allclose(found.covariance[:2, :2], own)
    np.testing.assert_allclose(found.covariance[:2, 2:], gain * own)
    np.testing.assert_allclose(found.covariance[2:, :2], gain * own)
    np.testing.assert_allclose(found.covariance[2:, 2:], 2 * gain**2 / (1 + keep) * own)
    made.push_frame(1.02, rows, np.array([0.2, 0.1]), variance)
    np.testing.assert_allclose(made.state(0.0).rate, keep * (1 - keep) * np.array([10.0, 0.0]))
    for time, values in ((1.02, [0.5, 0.5]), (1.01, [0.5, 0.5]), (1.03, [0.5, np.nan])):
        made.push_frame(time, rows, np.array(values), variance)
        assert made.state(0.0).time == 1.02
    for cutoff in (0.0, -1.0, np.inf, np.nan):
        with pytest.raises(InputError, match="cutoff must be positive"):
            Differences(BODY, cutoff)
    assert Differences(BODY)._omega == pytest.approx(2 * np.pi * 25)


def test_the_variance_of_filtered_differences_is_that_of_many_draws():
    rng = np.random.default_rng(2)
    made = Differences(BODY)
    rows, rates = joint_rows(BODY), []
    for k in range(4000):
        made.push_frame(k * PERIOD, rows, 1e-3 * rng.normal(size=2), np.full(2, 1e-6))
        rates.append(made.state(0.0).rate)
    np.testing.assert_allclose(np.cov(np.array(rates[100:]).T), made.state(0.0).covariance[2:, 2:], rtol=0.1)


# link angles and tips


def test_link_angles_from_points_that_do_not_lie_at_the_joints():
    s = np.array([0.0, 0.04, 0.13, 0.2])
    link = LinkAngles(BODY, s)
    points = np.array([[0.0, 0.0], [0.01, 0.04], [0.02, 0.12], [-0.03, 0.19]])
    joint = points[1] + (0.1 - 0.04) / 0.09 * (points[2] - points[1])
    np.testing.assert_allclose(link.ends(points), [points[0], joint, points[3]])
    way = np.diff([points[0], joint, points[3]], axis=0)
    angle = np.arctan2(-way[:, 0], way[:, 1])
    np.testing.assert_allclose(link(points), angle)
    frame = link.frame(points)
    np.testing.assert_allclose(frame.values, np.diff(angle, prepend=0.0))
    np.testing.assert_allclose(frame.variance, 4e-6)  # two milliradians by default
    assert frame.rows.tolist() == [[3, 0, 0, 0], [3, 1, 0, 0]]
    with pytest.raises(InputError, match=r"4 points in the plane, \(x, y\) each, got \(3, 2\)"):
        link.frame(points[:3])
    for noise in (0.0, -1.0, np.nan):
        with pytest.raises(InputError, match="noise of an angle must be positive"):
            LinkAngles(BODY, s, noise)


@pytest.mark.parametrize(
    ("arc", "good"),
    [
        ([0.0, 0.2], True),
        ([0.0009, 0.2], True),
        ([0.0011, 0.2], False),
        ([0.0, 0.1981], True),
        ([0.0, 0.1979], False),
        ([0.0, 0.1, 0.1, 0.2], False),
        ([0.2], False),
        ([[0.0, 0.2]], False),
        ([-0.01, 0.25], True),
    ],
)
def test_points_cover_the_links(arc, good):
    if good:
        made = LinkAngles(BODY, np.array(arc))
        points = np.stack([np.zeros(len(arc)), arc], axis=1)
        end = arc[-1] if abs(arc[-1] - 0.2) < 2e-3 else 0.2  # the last link ends at the tip
        start = max(arc[0], 0.0)
        np.testing.assert_allclose(made.ends(points)[:, 1], [start, 0.1 * end / 0.2, end], atol=1e-12)
        return
    with pytest.raises(InputError, match="cover 0 to 200 mm"):
        LinkAngles(BODY, np.array(arc))


@pytest.mark.parametrize(
    ("arc", "good"),
    [
        ([0.0, 0.2], True),
        ([0.1, 0.2], True),
        ([0.101, 0.2], False),
        ([0.0, 0.1981], True),
        ([0.0, 0.1979], False),
    ],
)
def test_points_cover_the_tips(arc, good):
    if good:
        made = LinkTips(BODY, np.array(arc))
        np.testing.assert_allclose(made.tips(np.stack([np.zeros(2), arc], axis=1))[:, 1], [0.1, 0.2], atol=1e-12)
        np.testing.assert_allclose(made.frame(np.zeros((2, 2))).variance, 9e-8)
        return
    with pytest.raises(InputError, match="cover 100 to 200 mm"):
        LinkTips(BODY, np.array(arc))


@pytest.mark.parametrize("gravity", [0.0, -9.81])
def test_a_rest_shape_is_that_of_the_frames_at_rest(gravity):
    true = BODY.with_(rest_angle=[0.2, -0.3], base_angle=0.1, gravity=[3.0, gravity] if gravity else [0.0, 0.0],
                      stations=[Station("tip", 1, 0.1)])  # fmt: skip
    angle = np.cumsum(true.rest_angle + equilibrium(true)) + 0.1
    tips = 0.1 * np.cumsum(np.stack([-np.sin(angle), np.cos(angle)], axis=1), axis=0)
    frames = np.tile(np.concatenate([[[0.0, 0.0]], tips]), (8, 1, 1))
    frames[:3, 1] = np.nan
    made = calibrated(true.with_(rest_angle=[0.0, 0.0]), np.array([0.0, 0.1, 0.2]), frames)
    np.testing.assert_allclose(made.rest_angle, true.rest_angle, atol=2e-3 if gravity else 1e-9)
    np.testing.assert_allclose(made.link_length, 0.1)
    assert made.stations == ()
    with pytest.raises(InputError, match="at least 5 complete frames, got 4 of 7"):
        calibrated(true, np.array([0.0, 0.1, 0.2]), frames[:7])


def test_rows_are_those_of_links():
    rows = joint_rows(BODY)
    assert needs_joint_rows(BODY, rows, "x") is rows
    for wrong in (rows[:1], rows + 1.0, rows[::-1]):
        with pytest.raises(InputError, match=f"x needs 2 rows, each for the angle .* got {len(wrong)} rows of other"):
            needs_joint_rows(BODY, wrong, "x")
    both = rows_of(BODY, (Station("a", 1, 0.05, 0.01),), angle=True)
    assert both.tolist() == [[1, 1, 0.05, 0.01], [2, 1, 0.05, 0.01], [0, 1, 0, 0]]
    assert rows_of(BODY, (Station("a", 0, 0.05),), position=False, angle=True).tolist() == [[0, 0, 0, 0]]
    deep = BODY.with_(space=True, gravity=[0.0, 0.0, 0.0])
    assert rows_of(deep, (Station("a", 1, 0.05, 0.01, 0.02),)).tolist() == [[k, 1, 0.05, 0.01, 0.02] for k in (1, 2, 4)]
    assert (row_width(BODY), row_width(deep)) == (4, 5)
    turns = rows_of(deep, (Station("a", 1, 0.05, 0.01),), position=False, angle=True)
    assert turns.tolist() == [[k, 1, 0, 0, 0] for k in (5, 6, 7)]
    for link in (-1, 2):
        with pytest.raises(InputError, match="lies on the base"):
            rows_of(BODY, (Station("a", link, 0.0),))


# what a recording shows


@pytest.mark.parametrize(("correlation", "away"), [(0.45, False), (0.55, True), (-0.9, False)])
def test_a_body_bends_away_where_its_tip_follows_the_pressure(correlation, away):
    """Positive torque leads to -x: a correlation above one half is of the wrong sign."""
    rng = np.random.default_rng(3)
    p = np.linspace(0, 1, 400)
    other = rng.normal(size=400)
    other -= other.mean() + (p - p.mean()) * (other @ (p - p.mean())) / ((p - p.mean()) @ (p - p.mean()))
    x = correlation * (p - p.mean()) / p.std() + math.sqrt(1 - correlation**2) * other / other.std()
    place = np.stack([x, np.ones(400)], axis=1)[:, None] * 0.01
    place[5] = np.nan
    ds = make_recording(np.arange(400) / 100, place, station=["link_2"], frame="planar", pressure=1e5 * p)
    assert bends_away(ds, BODY) == away
    assert bends_away(ds, BODY.with_(torque=[-1e-6])) == (correlation < -0.5)
    assert bends_away(ds, BODY.with_(joint_gain=[-1.0, -1.0])) == (correlation < -0.5)
    for change in (ds.assign(pressure=ds["pressure"] * 0 + 5.0), ds.drop_vars(["pressure", "pressure_time"])):
        assert not bends_away(change, BODY)
    if away:
        with pytest.raises(InputError, match="bend to opposite sides"):
            measurement_of(ds, BODY, Noise())


def test_a_dense_curve_has_three_points_for_each_link():
    for count, good in ((6, True), (5, False)):
        place = np.zeros((9, count, 2))
        place[..., 1] = np.linspace(0, 0.2, count)
        place[..., 0] = 0.001 * np.sin(np.arange(9))[:, None] * np.linspace(0, 1, count) ** 2
        ds = make_recording(np.arange(9) / 10, place, frame="planar", arc_length=np.linspace(0, 0.2, count))
        if good:
            assert measurement_of(ds, BODY, Noise()).value.shape == (9, 2)
            longer = BODY.with_(extensions=(Extension(50.0),))
            with pytest.raises(InputError, match="does not show which of its points"):
                measurement_of(ds, longer, Noise())
        else:
            with pytest.raises(InputError, match="a curve of at least 6 points"):
                measurement_of(ds, BODY, Noise())
    space = make_recording(np.arange(9) / 10, np.zeros((9, 2, 3)), frame="spatial")
    with pytest.raises(InputError, match="a planar recording is needed, not the frame 'spatial'"):
        measurement_of(space, BODY, Noise())


def test_a_pressure_is_averaged_as_its_integral_says():
    clock = np.array([0.0, 1.0, 3.0, 4.0])
    values = np.array([0.0, 2.0, 2.0, -2.0])
    integral = np.array([0.0, 1.0, 5.0, 5.0])
    np.testing.assert_allclose(primitive(np.array([0.0, 0.5, 1.0, 2.0, 3.5, 4.0]), clock, values, integral),
                               [0, 0.25, 1, 3, 5.5, 5.0])  # fmt: skip
    at, mean = averaged(clock, values, 1.0)
    assert at.tolist() == [0.0, 0.5, 1.0, 1.5, 2.5, 3.0, 3.5, 4.0]
    np.testing.assert_allclose(mean, [0.0, 1.0, 1.75, 2.0, 2.0, 1.5, 0.0, -2.0])
    fine = np.arange(0, 1.001, 0.1)
    at, _ = averaged(fine, fine, 0.21)
    assert at.tolist() == fine.tolist()  # samples near enough: no times are added
    assert averaged(fine, fine, 0.19)[0].size > fine.size
    assert averaged(clock[:1], values[:1], 1.0)[1].tolist() == [0.0]
    ds = make_recording(np.arange(4.0), np.zeros((4, 1, 2)), frame="planar", pressure=values, pressure_time=clock)
    (source,), model = input_of(ds, BODY.with_(valve=Valve(rise_time=0.1)), None, 1.0)
    assert model.valve == Valve()
    np.testing.assert_allclose(source(np.array([0.5, 1.5])), [1.0, 2.0])
    for window in (-1e-3, np.nan):
        with pytest.raises(InputError, match="pressure_window must be a time"):
            input_of(ds, BODY, None, window)
    with pytest.raises(InputError, match="no measured pressure"):
        input_of(ds.drop_vars(["pressure", "pressure_time"]), BODY, None)
    kept = BODY.with_(valve=Valve(rise_time=0.1))
    assert input_of(ds, kept, source)[1] is kept


# noise


def test_noise_has_the_levels_that_it_names():
    noise = Noise(torque=0.2, pressure=3.0, random_walk=0.4, motion_growth=5.0, initial_angle=0.1, initial_rate=0.3,
                  initial_disturbance=0.7)  # fmt: skip
    own, common, walk, growth = noise.densities(BODY)
    np.testing.assert_allclose(own, 0.04)
    np.testing.assert_allclose(common, [(1e-6 * 3.0) ** 2])
    np.testing.assert_allclose(walk, 0.16)
    assert growth == 5.0
    np.testing.assert_allclose(np.diag(noise.initial(BODY)), [0.01] * 2 + [0.09] * 2 + [0.49] * 2)
    longer = BODY.with_(extensions=(Extension(50.0),))
    np.testing.assert_allclose(scales(BODY), 1.0)
    assert scales(longer)[:2].tolist() == [1.0, 1.0]
    assert scales(longer)[2] == pytest.approx(50.0 * 0.2 / 1.25)
    given = default_noise(BODY)
    assert (given.torque, given.random_walk, given.motion_growth, given.initial_disturbance) == pytest.approx(
        (2e-5 * 1.25, 3e-3 * 1.25, 30.0, 0.0125)
    )
    assert default_noise(BODY, disturbance=False).torque == pytest.approx(8e-4 * 1.25)
    assert Noise().states(BODY) == 4
    for name in ("position", "angle", "torque", "initial_angle", "initial_rate"):
        with pytest.raises(InputError, match=f"noise {name} must be finite and positive"):
            Noise(**{name: 0.0})
    for name in ("pressure", "random_walk", "motion_growth", "initial_disturbance"):
        Noise(**{name: 0.0})
        with pytest.raises(InputError, match=f"noise {name} must be finite and not negative"):
            Noise(**{name: -1e-9})
    with pytest.raises(InputError, match=r"noise stations\[tip\] must be finite and positive"):
        Noise(stations={"tip": 0.0})


def test_bounds_and_whiteness_in_small_numbers():
    assert mean_bounds(np.array([3.0, 4.0]), 0.9) == pytest.approx((2.16735 / 7, 14.06714 / 7), rel=1e-5)  # of a table
    values = np.array([[1.0], [2.0], [np.nan], [3.0], [-1.0], [2.0]])
    correlation, bound = whiteness(values)  # of the pairs 1 2, 3 -1 and -1 2
    assert correlation == pytest.approx((2 - 3 - 2) / (0.5 * (1 + 9 + 1 + 4 + 1 + 4)))
    assert bound == pytest.approx(1.96 / np.sqrt(3))
    assert whiteness(np.zeros((5, 1)))[0] == 0.0
    T = np.array([[1.0, -1.0]])
    P = np.array([[[2.0, 0.5], [0.5, 1.0]], [[1.0, 1.0], [1.0, 1.0]]])
    np.testing.assert_allclose(standard_deviations(T, P), [[np.sqrt(2.0)], [0.0]])


# the observer


def test_the_linear_model_of_the_observer_and_its_stationary_gain():
    body = BODY.with_(gravity=[0.0, -9.81])
    chain, drive = with_shifts(body)
    linear = linearise(body.with_(torque=[1e-6]), 0.0)
    np.testing.assert_allclose(chain[:4, :4], linear.A)
    np.testing.assert_allclose(drive[:4], linear.B / 1e-6)
    assert not chain[4:].any()
    assert not drive[4:].any()
    # a shift of the first joint's rest pulls as both links turned the other way
    plain = with_shifts(BODY)[0]
    np.testing.assert_allclose(plain[2:4, 4:], -linearise(BODY, 0.0).A[2:, :2] @ np.array([[1.0, 0], [1, 1]]))
    design = stationary(body, PERIOD, 2e-3, 0.05, 0.5)
    F = expm(chain * PERIOD)
    sums = np.array([[1.0, 0.0], [1.0, 1.0]])
    Q = np.zeros((6, 6))
    Q[:2, :2], Q[2:4, 2:4], Q[4:, 4:] = 4e-10 * np.eye(2), 0.25 * PERIOD * sums @ sums.T, 0.0025 * PERIOD * np.eye(2)
    R, H = 4e-6 * sums @ sums.T, np.eye(2, 6)
    P = solve_discrete_are(F.T, H.T, Q, R)
    S = H @ P @ H.T + R
    np.testing.assert_allclose(design.precision, np.linalg.inv(S), rtol=1e-6)
    np.testing.assert_allclose(design.gain, P @ H.T @ np.linalg.inv(S), rtol=1e-6)
    np.testing.assert_allclose(design.covariance, P - P @ H.T @ np.linalg.inv(S) @ H @ P, rtol=1e-6, atol=1e-12)
    made = in_torques(body, np.ones((6, 6)))
    np.testing.assert_allclose(np.diag(made), [1, 1, 1, 1, 1.0, 2.25])
    np.testing.assert_allclose(made[0], [1, 1, 1, 1, 1.0, 1.5])
    assert not made.flags.writeable


def test_a_frozen_model_is_stiffer_by_what_its_memory_holds():
    memory = Memory((0.1, 0.2), (1.0, 2.0), (0.3,), (0.01,))
    body = BODY.with_(memory=memory)
    np.testing.assert_allclose(frozen(body).stiffness, 1.6 * BODY.stiffness)
    np.testing.assert_allclose(frozen(body, 0.5).stiffness, 1.3 * BODY.stiffness)
    assert not frozen(body).memory


def test_an_observer_takes_steps_of_a_period_and_pressures_between_frames():
    made = AdaptiveObserver(ARM, PERIOD, time_step=2e-3, late=1, scale_sd=0.3, scale_random_walk=0.1)
    assert (made.pace.parts, made.pace.h, made.pace.largest) == (3, pytest.approx(PERIOD / 3), 0.5)
    assert made.own.factor.tolist() == [1.0, pytest.approx(0.09)]
    assert made.gains.growth == pytest.approx(0.01 * PERIOD)
    assert AdaptiveObserver(ARM, 6e-3, time_step=2e-3).pace.parts == 3
    assert AdaptiveObserver(ARM, 1e-3, time_step=2e-3).pace.parts == 1
    rows, still, variance = joint_rows(ARM), np.zeros(3), np.full(3, 4e-6)
    means = []
    for k, p in enumerate((0.0, 4e4, 8e4, 8e4)):
        made.push_pressure(k * PERIOD, p)
        made.push_frame(k * PERIOD, rows, still, variance)
        means.append(float(made._pressure[0]))
    assert means == [0.0, 0.0, 2e4, 6e4]  # a frame late, and the mean of the two at its ends
    made.push_frame(4 * PERIOD, rows, np.full(3, np.nan), variance)
    assert made.missed == 1
    assert made.fault == ""
    made.push_frame(5 * PERIOD, rows, np.array([0.7, 0.0, 0.0]), variance)
    assert "by more than 0.5 rad" in made.fault
    made.reset()
    assert (made.fault, made.missed, made.scale) == ("", 0, 1.0)
    assert made.state(0.0).time == -math.inf
    np.testing.assert_allclose(made.state(0.0).angle, 0.0)


# the filter


def tip_rows():
    return rows_of(ARM, ARM.points[-1:])


def test_a_filter_predicts_in_equal_steps_and_is_stopped_by_a_model_that_left():
    live = KalmanFilter(ARM, Noise(), time_step=4e-3)
    live.push_pressure(0.0, 5e4)
    live.advance(0.1)
    fine = KalmanFilter(ARM, Noise(), time_step=1e-3)
    fine.push_pressure(0.0, 5e4)
    fine.advance(0.1)
    np.testing.assert_allclose(live.angle, fine.angle, rtol=2e-2)
    coarse = KalmanFilter(ARM, Noise(), time_step=1.0)
    coarse.push_pressure(0.0, 5e4)
    coarse.advance(8e-3)
    twice = KalmanFilter(ARM, Noise(), time_step=4.0000001e-3)  # 8 ms take two steps, not three
    twice.push_pressure(0.0, 5e4)
    twice.advance(8e-3)
    halves = KalmanFilter(ARM, Noise(), time_step=1.0)
    halves.push_pressure(0.0, 5e4)
    halves.advance(4e-3)
    halves.advance(8e-3)
    np.testing.assert_allclose(twice.angle, halves.angle, rtol=1e-9)
    assert np.abs(coarse.angle - halves.angle).max() > 1e-9
    exact = KalmanFilter(ARM, Noise(), time_step=4e-3)
    exact.push_pressure(0.0, 5e4)
    exact.advance(8e-3)
    np.testing.assert_allclose(exact.angle, halves.angle, rtol=1e-9)
    before = live.covariance.copy()
    for time in (0.1, 0.05, 0.1 + 1e-13, math.inf):
        live.advance(time)
    np.testing.assert_array_equal(live.covariance, before)
    assert live.time == 0.1


def test_a_fault_is_a_tip_off_by_half_a_length_or_an_angle_by_half_a_radian():
    for off, said in ((0.49, False), (0.51, True)):
        live = KalmanFilter(ARM, Noise(position=9.0, angle=9.0))
        live.push_frame(0.0, tip_rows(), np.array([0.0, 0.3 * (1 - off)]), np.full(2, 81.0))
        assert bool(live.fault) == said
        live = KalmanFilter(ARM, Noise(position=9.0, angle=9.0))
        live.push_frame(0.0, joint_rows(ARM), np.array([0.0, 0.0, off]), np.full(3, 81.0))
        assert bool(live.fault) == said
        live = KalmanFilter(ARM, Noise(position=9.0, angle=9.0))
        live.push_frame(0.0, np.array([[0.0, 1.0, 0.0, 0.0]]), np.array([-off]), np.full(1, 81.0))
        assert bool(live.fault) == said


def test_frames_are_counted_as_what_became_of_them():
    live = KalmanFilter(ARM, Noise(), latency=0.01, buffer=0.05)
    seen, variance = np.array([0.0, 0.3]), np.full(2, 1e-6)
    for k in range(11):
        live.push_frame(0.02 + 0.01 * k, tip_rows(), seen, variance)
    assert live.time == pytest.approx(0.11)
    assert (live.counts.used, live.counts.late, live.counts.too_late, live.counts.skipped) == (11, 0, 0, 0)
    live.push_frame(0.1, tip_rows(), seen, variance)
    assert (live.counts.used, live.counts.late) == (12, 1)
    live.push_frame(0.03, tip_rows(), seen, variance)
    assert (live.counts.used, live.counts.too_late) == (12, 1)
    live.push_frame(0.2, tip_rows(), np.full(2, np.nan), variance)
    assert live.counts.skipped == 1
    assert live.counts.last_ratio == pytest.approx(0.0, abs=1e-9)
    live.push_pressure(0.0, 1e4)  # too late, and no frame
    assert live.counts.too_late == 1
    for wrong, message in (
        ({"time_step": 0.0}, "time_step must be > 0 s"),
        ({"latency": -1e-3}, "latency and buffer must be >= 0 s, got latency = -0"),
        ({"buffer": -1e-3}, "latency and buffer must be >= 0 s, got latency = 0.0 and buffer = -0"),
    ):
        with pytest.raises(InputError, match=message):
            KalmanFilter(ARM, Noise(), **wrong)
    for rows, values in ((tip_rows(), seen[:1]), (tip_rows()[:, :3], seen)):
        with pytest.raises(InputError, match=r"a frame needs rows \(m, 4\)"):
            live.push_frame(0.3, rows, values, variance[: values.size])
    with pytest.raises(InputError, match="finite time"):
        live.push_frame(np.nan, tip_rows(), seen, variance)


def test_events_in_any_order_end_in_one_state():
    rng = np.random.default_rng(5)
    events = [("p", 0.002, 2e4), ("f", 0.01, None), ("p", 0.013, 5e4), ("f", 0.02, None), ("p", 0.02, 3e4),
              ("f", 0.03, None), ("f", 0.04, None)]  # fmt: skip
    frames = {t: np.array([-1e-3 * k, 0.3]) for k, (_, t, p) in enumerate(events) if p is None}
    found = []
    for order in (range(7), [0, 2, 1, 3, 4, 6, 5], [1, 0, 3, 2, 6, 4, 5], rng.permutation(7)):
        live = KalmanFilter(ARM, Noise(random_walk=0.1), buffer=1.0, time=0.0)
        for k in order:
            kind, time, pressure = events[k]
            if kind == "p":
                live.push_pressure(time, pressure)
            else:
                live.push_frame(time, tip_rows(), frames[time], np.full(2, 1e-6))
        live.advance(0.045)
        assert live.counts.used == 4
        assert live.pressure[0] == 3e4
        found.append(np.concatenate([live.angle, live.rate, live.disturbance, live.covariance.ravel()]))
    for other in found[1:]:
        np.testing.assert_allclose(other, found[0], rtol=1e-4, atol=1e-6)


def test_a_state_has_shifts_of_rest_by_its_disturbance():
    live = KalmanFilter(ARM, Noise(random_walk=0.5, initial_disturbance=1.0))
    for k in range(60):
        live.push_frame(0.01 * k, joint_rows(ARM), np.array([0.1, 0.05, 0.0]), np.full(3, 1e-8))
    state = live.state(0.6)
    np.testing.assert_allclose(state.angle, [0.1, 0.15, 0.15], atol=2e-3)
    np.testing.assert_allclose(state.disturbance, [0.1 * 1.0, 0.05 * 1.5, 0.0], rtol=0.05, atol=1e-3)
    np.testing.assert_allclose(state.rest_shift, state.disturbance / ARM.stiffness)
    assert state.time == 0.6
    assert state.consistent


# recordings


def recorded(frames=40):
    rng = np.random.default_rng(7)
    time = np.arange(frames) / 100
    place = np.tile([0.0, 0.3], (frames, 1, 1)) + 1e-4 * rng.normal(size=(frames, 1, 2))
    place[7] = np.nan
    place[9, 0, 0] = np.nan
    return make_recording(time, place, station=["link_3"], frame="planar", pressure=np.zeros(frames))


def test_an_estimate_counts_its_frames_and_judges_all_but_the_first():
    ds = recorded()
    found = estimate(ds, ARM, noise=Noise(position=1e-4, torque=1e-4), lag=3)
    assert (found.attrs["frames"], found.attrs["frames_skipped"], found.attrs["frames_in_part"]) == (40, 1, 1)
    used = found["rows_used"].values
    assert used.tolist() == [2] * 7 + [0, 2, 1] + [2] * 30
    settled = np.flatnonzero(used > 0)[1:]
    nis = found["normalised_innovation_squared"].values[settled].sum() / used[settled].sum()
    assert found.attrs["nis_ratio"] == pytest.approx(nis)
    low, high = mean_bounds(used[settled])
    assert found.attrs["nis_bounds"] == [low, high]
    correlation, bound = whiteness(found["innovation"].values[settled])
    assert (found.attrs["innovation_correlation"], found.attrs["innovation_correlation_bound"]) == (correlation, bound)
    assert found["smooth_joint_angle"].attrs["long_name"] == "joint angle, 3 frames later"
    assert found["joint_angle_sd"].attrs["long_name"] == "joint angle, standard deviation, filtered"
    assert found.attrs["lag_frames"] == 3
    assert "disturbance" not in found
    assert "disturbance" in estimate(ds, ARM)
    assert "disturbance" not in estimate(ds, ARM, disturbance=False)
    assert estimate(ds.isel(time=slice(0, 6)), ARM, noise=Noise()).sizes["time"] == 6
    assert np.isfinite(found.attrs["log_likelihood"])
    assert estimate(ds.isel(time=slice(0, 3)), ARM, noise=Noise()).sizes["time"] == 3
    with pytest.raises(InputError, match="at least three frames, got 2"):
        estimate(ds.isel(time=slice(0, 2)), ARM, noise=Noise())


def test_a_likelihood_is_that_of_all_frames_but_the_first():
    rng = np.random.default_rng(6)
    score = np.column_stack([[2, 0, 2, 1, 2], rng.uniform(size=(5, 3))])
    out = make_output(5, 6, 2)._replace(score=score, innovation=rng.normal(size=(5, 2)))
    seen = Measurement(np.arange(5.0), tip_rows(), np.zeros((5, 2)), np.ones(2), ("x", "y"), ("a note",))
    found = judged(seen, out, Noise(), ARM, 4)
    assert found["log_likelihood"] == pytest.approx(-0.5 * score[2:, 1:3].sum())
    assert found["nis_ratio"] == pytest.approx(score[2:, 1].sum() / 5)
    assert (found["frames"], found["frames_skipped"], found["frames_in_part"]) == (5, 1, 1)
    assert found["notes"] == "a note"


def test_a_smoother_waits_for_no_frames_at_lag_zero():
    x, P = np.ones((3, 2)), np.tile(np.eye(2), (3, 1, 1))
    out = FilterOutput(x, P, x, P, P, x, np.zeros((3, 4)))
    np.testing.assert_array_equal(smooth(out, 0)[0], x)
    still = np.zeros((3, 2, 2))
    still[:, 0, 0] = 1.0  # a state that is known and does not move
    made, spread = smooth(FilterOutput(x, still, 2 * x, still, still, x, np.zeros((3, 4))), 2)
    np.testing.assert_allclose(made[:, 0], [4.0, 3.0, 2.0], rtol=1e-9)
    np.testing.assert_allclose(made[:, 1], 2.0)
    assert np.isfinite(spread).all()
    room = make_output(5, 4, 3)
    assert [a.shape for a in room] == [(5, 4), (5, 4, 4), (5, 4), (5, 4, 4), (5, 4, 4), (5, 3), (5, 4)]
    assert not any(a.any() for a in room)
    work = make_workspace(BODY, 6, 3)
    assert (work.W.shape, work.H.shape, work.seen.shape, work.G.shape) == ((6, 6), (3, 2), (3,), (4,))
