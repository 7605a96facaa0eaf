"""Clocks of pressure and motion: every limit of the search, and the second-order body against its closed forms."""

from __future__ import annotations

import numpy as np
import pytest

from pliant.errors import InputError
from pliant.preprocessing.lag_model import (
    Fitted,
    LagFrame,
    TimeSeries,
    body_course,
    edge_time,
    first_component,
    fit_lag,
    holes,
    pressure_course,
    second_order,
)
from pliant.preprocessing.quality import Quality, _clock, _standing, quality, spanned
from pliant.preprocessing.sync import (
    Delay,
    check_fit,
    coarse_scores,
    doubts,
    offsets,
    polished,
    shift_pressure,
    sync,
    two_best,
)
from pliant.recording import make_recording
from pliant.recording.lost import listed

TIME = np.arange(0.0, 8.0, 0.01)


def series(values, time=TIME, weight=None):
    values = np.asarray(values, float)
    both = values[:, None] if values.ndim == 1 else values
    return TimeSeries(time, both, np.ones(len(time)) if weight is None else weight)


def fitted(**changes):
    return Fitted(
        **{
            "delay": 0.1,
            "uncertainty": 0.001,
            "drift": 0.0,
            "drift_uncertainty": 1.0,
            "explained": 0.9,
            "share": 0.9,
            "frequency": 3.0,
            "damping": 0.1,
            "inside": 1.0,
            "after_motion": False,
            **changes,
        }
    )


# the response


@pytest.mark.parametrize(("hertz", "ratio"), [(2.0, 0.1), (5.0, 0.7), (1.0, 2.0)])
def test_the_response_of_second_order_is_that_of_the_trapezoidal_rule(hertz, ratio):
    """Unit gain at rest; at a frequency f that of the body at tan(pi f h) / (pi h)."""
    step = 2e-3
    b, a = second_order(hertz, ratio, step)
    assert b.sum() / a.sum() == pytest.approx(1.0)
    assert a[0] == 1.0
    for f in (0.3, 2.0, 11.0):
        z = np.exp(-2j * np.pi * f * step)
        found = np.polyval(b[::-1], z) / np.polyval(a[::-1], z)
        s = 2j * np.tan(np.pi * f * step) / step
        w = 2 * np.pi * hertz
        assert found == pytest.approx(w**2 / (s**2 + 2 * ratio * w * s + w**2))


def test_the_columns_of_a_response_are_pressure_square_and_their_slow_shares():
    pressure = np.where(TIME > 1.0, 1.0, 0.0)
    body = series(np.where(TIME > 1.0, 0.02, 0.0))
    frame = LagFrame(body, series(np.stack([pressure, 0.5 * pressure], axis=1)), 0.0, drift=False)
    assert frame.columns.shape[1] == 2
    np.testing.assert_allclose(frame.columns[:, 1], frame.columns[:, 0] ** 2)
    assert frame.step == pytest.approx(5e-3)
    basis = frame.response(np.array([0.0, np.log(8.0), np.log(0.7)]))
    assert basis.shape == (frame.keep.sum(), 5)
    late = frame.at > 2.5
    np.testing.assert_allclose(basis[late, 0], 0.5, atol=1e-4)
    slow = 0.5 * (1 - np.exp(-(frame.at[late] - 1.02)))  # towards it within a second
    np.testing.assert_allclose(basis[late, 2], slow, atol=4e-3)
    np.testing.assert_allclose(basis[:, 4], 1.0)
    np.testing.assert_allclose(np.mean(frame.y), 0.0, atol=1e-12)
    np.testing.assert_allclose(np.std(frame.y), 1.0)
    shifted = frame.response(np.array([0.25, np.log(8.0), np.log(0.7)]))
    early = (frame.at > 1.6) & (frame.at < 7.5)
    np.testing.assert_allclose(shifted[early, 0], np.interp(frame.at[early] - 0.25, frame.at, basis[:, 0]), atol=1e-6)
    slipped = LagFrame(body, series(np.stack([pressure, pressure], 1)), 0.0, drift=True)
    at = slipped.at - 0.01 * (slipped.at - slipped.middle)
    moved = slipped.response(np.array([0.0, np.log(8.0), np.log(0.7), 0.01]))[:, 0]
    still = slipped.response(np.array([0.0, np.log(8.0), np.log(0.7), 0.0]))[:, 0]
    np.testing.assert_allclose(moved[10:-10], np.interp(at, slipped.at, still)[10:-10], atol=2e-2)
    assert slipped.middle == pytest.approx(TIME.mean())


def test_motion_counts_where_the_log_was_and_had_settled():
    clock = np.concatenate([np.arange(1.0, 3.0, 0.01), np.arange(4.0, 6.0, 0.01)])
    pressure = np.sin(clock)
    weight = np.ones(len(TIME))
    weight[300:310] = 0.0
    frame = LagFrame(
        series(np.sin(TIME), weight=weight), series(np.stack([pressure, pressure], 1), clock), 0.5, drift=False
    )
    at = TIME - 0.5
    kept = (at > 1.05) & (at <= clock[-1]) & ~((at > 2.99) & (at < 4.5)) & (weight > 0)
    inner = np.abs(at - 1.05) > 1e-6
    np.testing.assert_array_equal(frame.keep[inner], kept[inner])
    np.testing.assert_array_equal(frame.inside, (at >= 1.0) & (at <= clock[-1]))
    y, whole = np.sin(TIME[kept]), np.sin(TIME[weight > 0])
    share = ((y - y.mean()) ** 2).sum() / ((whole - whole.mean()) ** 2).sum()
    assert frame.share == pytest.approx(share, rel=1e-2)


@pytest.mark.parametrize(
    ("step", "gap", "hole"),
    [
        (0.01, 0.101, True),
        (0.01, 0.099, False),
        (0.05, 0.305, True),
        (0.05, 0.295, False),
    ],
)
def test_a_hole_is_six_steps_long_and_a_tenth_of_a_second(step, gap, hole):
    clock = np.append(np.arange(50) * step, 49 * step + gap + np.arange(50) * step)
    assert holes(clock) == ([(pytest.approx(49 * step), pytest.approx(49 * step + gap))] if hole else [])


@pytest.mark.parametrize(("rise", "found"), [(0.1, 0.1), (0.02, 0.02), (0.9, 0.9), (4.0, 4.0)])
def test_an_edge_takes_the_time_of_its_range(rise, found):
    ramp = np.clip((TIME - 1.0) / rise, 0, 1)
    assert edge_time(series(ramp)) == pytest.approx(found, rel=0.03)
    assert edge_time(series(0.14 * (TIME > 1) + 1e-9 * TIME + 0.86 * (TIME == 5.0))) < 0.05


def test_the_common_course_of_stations_and_of_chambers():
    course = np.sin(3 * TIME)
    place = course[:, None, None] * np.array([[0.0, 0.0], [0.01, 0.02]]) + np.array([1.0, 2.0])
    place[50, 1, 0] += 0.5  # a spike carries no weight
    place[60, 1] = np.nan
    ds = make_recording(TIME, place, frame="planar", pressure=1e4 * np.clip(course, 0, 1))
    found = body_course(ds)
    assert np.flatnonzero(found.weight == 0).tolist() == [50, 60]
    scaled = found.values[:, 0] / np.ptp(found.values[:, 0])
    np.testing.assert_allclose(np.abs(np.corrcoef(scaled, course)[0, 1]), 1.0, atol=1e-4)
    assert np.std(found.values) == pytest.approx(np.std(course) * np.hypot(0.01, 0.02), rel=1e-2)
    two = np.stack([np.clip(course, 0, 1), np.full(len(TIME), 3.0), 0.5 + 0 * TIME + 0.25 * (TIME > 2)], axis=1)
    two[5:8] = np.nan
    log = make_recording(pressure=1e5 * two, pressure_time=TIME, chamber=["a", "still", "b"])
    made = pressure_course(log)
    assert made.values.shape[1] == 3  # the main course and the two that change
    np.testing.assert_allclose(made.values[:, 1].max(), 1.0)
    np.testing.assert_allclose(np.ptp(made.values[:, 2]), 0.25, rtol=1e-4)
    assert np.isfinite(made.values).all()
    for values, said in (
        (np.zeros((20, 0)), "at least 10 samples of motion"),
        (np.full((20, 2), np.nan), "at least 10 samples"),
        (np.where(np.arange(20)[:, None] < 9, 1.0, np.full((20, 2), np.nan)), "every station is seen"),
    ):
        with pytest.raises(InputError, match=said):
            first_component(values)
    few = make_recording(pressure=np.arange(9.0), pressure_time=np.arange(9.0))
    with pytest.raises(InputError, match="at least 10 samples of pressure"):
        pressure_course(few)
    pressure_course(make_recording(pressure=np.arange(10.0), pressure_time=np.arange(10.0)))
    some = np.outer(np.sin(np.arange(40.0)), [1.0, 2.0, 3.0])
    some[12:, 2] = np.nan  # seen in three tenths of the frames: all stations still count
    assert first_component(some)[1].sum() == 12
    some[11:, 2] = np.nan
    assert first_component(some)[1].sum() == 40


def test_a_lag_is_found_with_the_body_that_makes_it():
    from scipy.signal import lfilter

    fine = np.arange(0.0, 8.0, 1e-3)
    pressure = ((fine > 1) & (fine < 2.5)) | ((fine > 4) & (fine < 5))
    b, a = second_order(3.0, 0.15, 1e-3)
    moved = np.interp(TIME - 0.12, fine, lfilter(b, a, 2.0 * pressure))
    log = series(np.stack([pressure[::4]] * 2, axis=1).astype(float), fine[::4])
    found = fit_lag(series(moved), log, 0.1)
    assert found.delay == pytest.approx(0.12, abs=2e-3)
    assert found.frequency == pytest.approx(3.0, rel=0.02)
    assert found.damping == pytest.approx(0.15, rel=0.05)
    assert found.explained > 0.999
    assert found.share == pytest.approx(found.explained * LagFrame(series(moved), log, 0.1, drift=False).share)
    assert (found.drift, found.drift_uncertainty, found.after_motion) == (0.0, np.inf, False)
    assert found.uncertainty >= 0.03 * edge_time(log)
    assert found.inside == pytest.approx(np.mean((TIME - 0.1 >= 0) & (fine[::4][-1] >= TIME - 0.1)))
    drifting = fit_lag(
        series(np.interp(TIME * 0.999 - 0.12, fine, lfilter(b, a, 2.0 * pressure))), log, 0.1, drift=True
    )
    assert drifting.drift == pytest.approx(1e-3, abs=6e-4)
    up = series(np.stack([1.0 - pressure[::4]] * 2, axis=1), fine[::4])
    assert fit_lag(series(-moved), up, 0.1).after_motion
    nothing = fit_lag(series(TIME[:29], TIME[:29]), log, 0.0)
    assert (nothing.explained, nothing.uncertainty, nothing.delay) == (0.0, np.inf, 0.0)


# the search


def test_offsets_overlap_by_half_of_the_shorter_record():
    found = offsets(np.arange(0, 10.01, 0.1), np.arange(2.0, 6.01, 0.1), None)
    assert (found[0], found[-1]) == (pytest.approx(0 - 6 + 2), pytest.approx(10 - 2 - 2, abs=0.021))
    np.testing.assert_allclose(np.diff(found), 0.02)
    near = offsets(TIME, TIME, 0.3)
    assert (near[0], near[-1]) == (-0.3, pytest.approx(0.3, abs=0.021))
    for wrong in (0.0, -1.0, np.inf, np.nan):
        with pytest.raises(InputError, match="largest_s must be a positive number"):
            offsets(TIME, TIME, wrong)


@pytest.mark.parametrize("shift", [-0.5, 0.0, 0.74])
def test_scores_are_squared_correlations_where_both_were_recorded(shift):
    rng = np.random.default_rng(4)
    base = np.convolve(rng.normal(size=900), np.ones(10) / 10, "same")
    grid = np.arange(0, 18.0, 0.02)
    y = base[200:600]
    body, clock = series(y, np.arange(400) * 0.02), grid[:900] - 4.0 + shift
    log = series(base, clock)
    delays = np.arange(-3.0, 3.001, 0.02)
    scores = coarse_scores(body, log, delays)
    best = delays[scores.argmax()]
    assert best == pytest.approx(-shift, abs=0.011)
    assert scores.max() == pytest.approx(1.0, abs=1e-3)
    k = int(np.argmin(np.abs(delays - (1.0 - shift))))
    there = np.interp(np.arange(400) * 0.02 - delays[k], clock, base)
    assert scores[k] == pytest.approx(np.corrcoef(y, there)[0, 1] ** 2, abs=2e-2)
    short = coarse_scores(
        series(y[:100], np.arange(100) * 0.02), series(y, np.arange(400) * 0.02), np.array([1.0, 9.0, -40.0])
    )
    overlap = np.corrcoef(y[:50], y[:100][50:])[0, 1] ** 2 * np.sqrt(50 / 100)
    assert short[0] == pytest.approx(overlap, abs=0.05)
    assert short[1] == short[2] == 0.0


@pytest.mark.parametrize(
    ("changes", "rival", "largest", "said"),
    [
        ({"explained": 0.51}, None, None, None),
        ({"explained": 0.49}, None, None, "explain the motion .at best 49 %."),
        ({"explained": -0.2}, None, None, "at best 0 %"),
        ({"delay": 0.97}, None, 1.0, None),
        ({"delay": 0.99}, None, 1.0, "end of the search range, 0.99 s: increase largest_s"),
        ({"delay": -0.99}, None, 1.0, "end of the search"),
        ({}, {"share": 0.6, "explained": 0.9}, None, None),
        ({}, {"share": 0.7, "explained": 0.86}, None, "explain the motion equally well"),
        ({}, {"share": 0.7, "explained": 0.84}, None, None),
        ({}, {"share": 0.67, "explained": 0.9}, None, None),
        ({}, {"share": 0.68, "explained": 0.9}, None, "of 0.1 s and of 2 s"),
    ],
)
def test_an_offset_explains_the_motion_and_has_no_rival(changes, rival, largest, said):
    other = None if rival is None else fitted(delay=2.0, **rival)
    if said is None:
        check_fit(fitted(**changes), other, largest)
        return
    with pytest.raises(InputError, match=said):
        check_fit(fitted(**changes), other, largest)


def test_doubts_of_an_offset_have_their_numbers():
    even = series(np.zeros(800))
    assert doubts(fitted(uncertainty=0.019, inside=0.981), even) == []
    assert doubts(fitted(uncertainty=0.021), even)[0].startswith("WARNING: the offset is uncertain by 21 ms")
    assert doubts(fitted(inside=0.979), even) == ["the pressure log covers 98 % of the shape's frames"]
    assert "the pressure is already high when its log begins" in doubts(fitted(after_motion=True), even)[0]
    clock = np.concatenate([np.arange(0, 1, 0.01), np.arange(1.5, 2, 0.01), np.arange(3.0, 4, 0.01)])
    (line,) = doubts(fitted(), series(np.zeros(len(clock)), clock))
    assert line.startswith("the pressure log has 2 gap(s), the longest 1.01 s at 1.99 s of its clock")
    found = Delay(0.0123, 0.0045, 2e-4, 3e-5, 0.9876, 3.0, 0.1, ("a", "b"))
    moved = "the pressure's clock is moved by +12.3 +- 4.5 ms, a drift of +200 +- 30 ppm"
    assert found.summary() == f"{moved}, estimated from pressure and motion (98.8 % of the motion explained). a. b"
    assert "drift" not in Delay(0.0123, 0.0045, 0.0, 0.0, 0.9876, 3.0, 0.1).summary()
    assert found.card().title == found.summary()
    assert polished(even, even, fitted(frequency=np.nan)).delay == 0.1
    with pytest.raises(InputError, match="no offset correlates"):
        two_best(series(np.sin(TIME)), series(np.stack([np.sin(TIME)] * 2, 1), TIME + 500.0), np.array([0.0]))


def test_a_clock_is_moved_and_says_so():
    ds = make_recording(TIME, np.zeros((800, 1, 2)), frame="planar", pressure=TIME, pressure_time=TIME)
    moved = shift_pressure(ds, 0.25, 1e-3)
    np.testing.assert_allclose(moved["pressure_time"], TIME * 1.001 + 0.25)
    assert "clock of the pressure moved by +250.00 ms and its rate by +1000 ppm" in moved.attrs["history"]
    assert "rate" not in shift_pressure(ds, 0.25).attrs["history"].split("moved")[1]
    for wrong in ((np.nan, 0.0), (0.0, np.inf)):
        with pytest.raises(InputError, match=r"delay_s \(in seconds\) and drift must be finite"):
            shift_pressure(ds, *wrong)
    with pytest.raises(InputError, match="lacks one of them"):
        sync(ds.drop_vars("position"))


# quality


def test_a_clock_of_frames_and_its_gaps():
    time = np.array([0.0, 1.0, 2.0, 3.19, 4.0, 5.0, 6.0, 8.49, 9.49, 12.0])
    found = _clock(time)
    assert found["frames"] == 10
    assert found["duration_s"] == 12.0
    assert found["rate_hz"] == 1.0
    assert found["irregular_steps"] == 2
    assert found["gaps"] == ((9.49, pytest.approx(2.51)),)
    assert _clock(np.array([0.0, 1.0, 2.0, 3.21]))["irregular_steps"] == 1
    assert _clock(np.array([3.0])) == {"frames": 1, "duration_s": 0.0}
    assert spanned(2.0, 50.0) == ", 2.00 s at 50 Hz"
    assert spanned(2.0, np.nan) == ""


def test_what_stands_moves_by_three_hundredths_of_the_largest_or_by_its_noise():
    names = list("abcd")
    assert _standing(names, np.array([1.0, 0.029, 0.031, 0.5]), np.zeros(4)) == ("b",)
    noise = np.array([0.0, 0.0, 0.0, 0.5 / (3 * np.sqrt(3))])
    assert _standing(names, np.array([1.0, 0.9, 0.9, 0.499]), noise) == ("d",)
    assert _standing(names, np.array([1.0, 0.9, 0.9, 0.501]), noise) == ()
    assert listed({f"s{k}": 4 for k in range(7)}) == "4 in each of 7 stations"
    assert listed({f"s{k}": 4 for k in range(6)}) == ", ".join(f"s{k} 4" for k in range(6))
    assert listed({f"s{k}": k for k in range(1, 9)}).endswith("s3 3 and 2 more")


def test_a_summary_says_what_is_in_a_recording():
    values = {"frames": 100, "stations": 3, "duration_s": 2.0, "rate_hz": 50.0}
    q = Quality(
        **values,
        travel_m={"a": 0.01, "b": 0.0305, "c": np.nan},
        noise_m={"a": 1e-5, "b": 3e-5, "c": np.nan},
        out_of_plane_share=0.0123,
        pressure_kpa={"p": (0.0, 45.678)},
        input_range={"t": (1.0, 2.5, "N")},
    )
    assert q.summary().splitlines() == [
        "100 frames of 3 station(s), 2.00 s at 50 Hz",
        "largest displacement from the median 30.5 mm, noise 0.02 mm (median station)",
        "out of the plane of bending: 1.2 % of the motion",
        "pressure p: 0 to 45.7 kPa",
        "input t: 1 to 2.5 N",
        "no faults were found",
    ]
    log = Quality(
        pressure_samples=30, duration_s=1.0, rate_hz=30.0, pressure_kpa={"a": (0, 1), "b": (0, 2)}, findings=("x",)
    )
    lines = log.summary().splitlines()
    assert lines[0] == "log of 30 pressure samples of 2 chambers, 1.00 s at 30 Hz"
    assert lines[-1] == "! x"
    both = Quality(**values, pressure_samples=7, pressure_duration_s=3.0, pressure_rate_hz=10.0)
    assert both.summary().splitlines()[1] == "pressure with its own times: 7 samples, 3.00 s at 10 Hz"
    assert Quality(input_range={"t": (0, 1, "N")}).summary().splitlines()[0] == "log of 1 inputs, without a shape"
    turns = Quality(**values, travel_deg={"a": 12.0}, noise_deg={"a": 0.5})
    assert "largest rotation from the median 12 degrees, noise 0.5 degrees (median station)" in turns.summary()
    assert log.card().title == lines[0]


@pytest.mark.parametrize(("amount", "hardly"), [(0.0019, True), (0.0021, False)])
def test_a_body_moves_by_a_hundredth_of_its_extent(amount, hardly):
    place = np.zeros((100, 2, 2))
    place[:, 1, 1] = 0.2
    place[60:80, 1, 0] = amount
    found = quality(make_recording(TIME[:100], place, frame="planar"))
    assert any("hardly moves" in line for line in found.findings) == hardly
    three = np.zeros((100, 4, 2)) + np.array([[0, 0], [0, 0.1], [0, 0.2], [0, 0.3]])
    three += 1e-5 * np.random.default_rng(1).normal(size=three.shape)
    three[50:, 1:3] += 0.02  # half of the stations is no jump of the whole
    assert quality(make_recording(TIME[:100], three, frame="planar")).frame_jumps_s == ()
    three[50:, 3] += 0.02
    assert quality(make_recording(TIME[:100], three, frame="planar")).frame_jumps_s == (0.5,)
    lost = make_recording(
        TIME[:100], place, frame="planar", pressure=np.where(np.arange(100) < 3, np.nan, 1e4 * TIME[:100])
    )
    assert "3 samples of pressure are missing" in quality(lost).findings
