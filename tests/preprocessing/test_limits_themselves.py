"""What counts at a limit itself, with numbers that a computer holds exactly; and errors of clocks by their formula."""

from __future__ import annotations

import numpy as np
import pytest

from pliant.errors import InputError
from pliant.preprocessing import sync as sync_module
from pliant.preprocessing.align import align
from pliant.preprocessing.lag_model import (
    FIRST,
    Fitted,
    LagFrame,
    TimeSeries,
    body_course,
    edge_time,
    first_component,
    fit_lag,
    holes,
)
from pliant.preprocessing.plausibility import Case, body, pressure, shape
from pliant.preprocessing.sync import check_fit, doubts, offsets
from pliant.recording import make_recording

TIME = np.arange(0.0, 8.0, 0.0078125)


def series(values, time):
    values = np.asarray(values, float)
    both = values[:, None] if values.ndim == 1 else values
    return TimeSeries(np.asarray(time, float), both, np.ones(len(time)))


def fitted(**changes):
    ones = {"explained": 1.0, "share": 1.0, "inside": 1.0, "after_motion": False}
    return Fitted(**(dict.fromkeys(Fitted._fields, 0.0) | ones | changes))


# plausibility


def test_limits_of_plausible_numbers_are_plausible_or_not():
    for step, said in ((1.0, False), (1.25, True)):
        assert bool(pressure.time_unit(Case(make_recording(np.arange(5) * step, np.zeros((5, 1, 3)))))) == said
    for highest, said in ((1000.0, False), (999.0, True), (2e6, False), (2.001e6, True), (0.0, False)):
        log = make_recording(pressure=[0.0, highest, 0.0], pressure_time=np.arange(3.0))
        assert bool(pressure.unit(Case(log))) == said
    for size, said in ((10.0, True), (9.5, False), (0.005, True), (0.0051, False)):
        place = np.zeros((2, 2, 3))
        place[:, 1, 1] = size
        assert bool(shape.length_unit(Case(make_recording([0.0, 1.0], place)))) == said
        assert bool(body.length(Case(length=size))) == said
    for down, said in (((-9.9,), False), ((-9.91,), True), ((0.0, -9.7), False), ((0.0, -9.69), True)):
        assert bool(body.gravity(Case(gravity=(0.0, *down)))) == said
    place = np.zeros((2, 2, 2))
    place[:, 1, 1] = 1.0
    aligned = make_recording([0.0, 1.0], place, frame="planar", arc_length=[0.0, 1.0])
    for length, said in ((0.7, False), (0.69, True), (5.0, False), (5.01, True)):
        assert bool(body.length(Case(aligned=aligned, length=length))) == said
    assert body.reach(Case(aligned=aligned)) == 1.0
    assert body.reach(Case(aligned=aligned.drop_vars("arc_length"))) == 1.0


@pytest.mark.parametrize(("length", "wide"), [(0.25, 0.15), (0.5, 0.3)])
def test_a_silicone_body_is_six_tenths_as_wide_as_long_at_most(length, wide):
    """The mass of a cylinder of 1100 kg/m3."""
    for part, said in ((0.99, False), (1.01, True)):
        mass = 1100.0 * np.pi * (part * wide) ** 2 / 4 * length
        assert bool(found := body.mass(Case(length=length, mass=mass))) == said
        assert (f"{1e3 * part * wide:.3g} mm wide" in found) == said
    for density, said in ((199.0, True), (201.0, False), (7990.0, False), (8010.0, True)):
        mass = density * np.pi * wide**2 / 4 * length
        found = body.mass(Case(length=length, mass=mass, diameter=wide))
        assert (f"is a density of {density:.3g} kg/m3" in found) == said


def test_a_pressure_begins_with_the_median_of_five_samples():
    values = np.append([9e4, 9e4, 9e4, 2e5, 2e5, 2e5], np.full(400, 2e5))
    assert pressure.ends(values)[0] == 9e4
    assert pressure.ends(values[1:])[0] == 2e5


# the search for an offset


def test_an_offset_at_the_limits():
    check_fit(fitted(explained=0.5), None, None)
    check_fit(fitted(), fitted(delay=2.0, share=0.75), None)
    check_fit(fitted(explained=0.5), fitted(delay=2.0, explained=0.25), None)
    with pytest.raises(InputError, match="equally well"):
        check_fit(fitted(explained=0.5), fitted(delay=2.0, explained=0.26), None)
    even = series(np.zeros(99), np.arange(99) / 64)
    assert doubts(fitted(uncertainty=0.02, inside=0.98), even) == []
    half = offsets(np.array([10.0, 20.0]), np.array([1.0, 3.0]), None)  # half of two seconds overlaps
    assert half[0] == pytest.approx(10.0 - 3.0 + 1.0)
    assert half[-1] == pytest.approx(20.0 - 1.0 - 1.0, abs=0.0201)


def test_a_hole_is_longer_than_its_limits():
    clock_of = np.append(np.arange(9) / 32, 8 / 32 + 6 / 32 + np.arange(9) / 32)
    assert holes(clock_of) == []
    assert holes(np.append(np.arange(9) / 32, 8 / 32 + 7 / 32 + np.arange(9) / 32)) == [(0.25, 0.46875)]


def test_an_edge_is_seen_where_a_seventh_of_the_range_passes():
    """A ramp over all of a log of eight seconds: the least window in which 15 % of it pass is two seconds long."""
    assert edge_time(series(TIME / TIME[-1], TIME)) == pytest.approx(TIME[-1])
    for seconds in (0.125, 0.3, 0.6, 1.3, 3.0, 6.0):
        ramp = np.clip((TIME - 1.0) / seconds, 0.0, 1.0)
        assert edge_time(series(ramp, TIME)) == pytest.approx(seconds, rel=0.02)



def test_the_columns_that_are_seen_most_make_the_common_course():
    course = np.sin(np.arange(40.0))
    values = np.outer(course, [1.0, 2.0, 3.0, 4.0])
    for k, first in enumerate((40, 30, 20, 9)):
        values[first:, k] = np.nan
    found, seen = first_component(values)
    assert seen.sum() == 30  # those seen in 40 and 30 frames
    assert np.abs(np.corrcoef(found[:30], course[:30])[0, 1]) == pytest.approx(1.0)
    assert np.std(found[:30]) == pytest.approx(np.std(course[:30]) * np.sqrt(5.0))
    angle = np.outer(np.sin(np.arange(40.0)), [0.1, 0.2])
    angle[10:, 1] = np.nan
    both = body_course(make_recording(np.arange(40.0), angle=angle, frame="planar"))
    assert both.weight.sum() in (10, 40)
    angle[9:, 1] = np.nan  # too few samples: that station does not count
    one = body_course(make_recording(np.arange(40.0), angle=angle, frame="planar"))
    assert one.weight.sum() == 40
    assert np.std(one.values) == pytest.approx(np.std(angle[:, 0]))


@pytest.mark.parametrize(
    ("clock_step", "body_step", "seconds", "step"),
    [(0.01, 0.02, 2.0, 0.005), (0.002, 0.02, 2.0, 0.002), (0.02, 0.002, 2.0, 0.002), (0.0005, 0.02, 2.0, 0.001),
     (0.002, 0.02, 100.0, 0.0025)],
)  # fmt: skip
def test_the_grid_of_a_response_is_as_fine_as_the_clocks(clock_step, body_step, seconds, step):
    clock_of, time = np.arange(0.0, seconds, clock_step), np.arange(0.0, 2.0, body_step)
    log = series(np.stack([np.sin(clock_of)] * 2, axis=1), clock_of)
    frame = LagFrame(series(np.cos(time), time), log, 0.0, drift=False)
    assert frame.step == pytest.approx(step, rel=1e-3)
    assert frame.grid[-1] == pytest.approx(clock_of[-1], abs=1.01 * step)
    assert frame.grid[-1] > clock_of[-1] - 1e-9
    np.testing.assert_allclose(np.diff(frame.grid), frame.step)


@pytest.mark.parametrize("drift", [False, True])
def test_errors_of_an_offset_are_those_of_residuals_alike_within_half_a_second(drift):
    """The plain formula s^2 / (J' J), or that of sums over blocks, whichever is larger; here by sums one by one."""
    rng = np.random.default_rng(3)
    time = np.arange(0.3, 7.7, 0.01)
    log = series(np.stack([np.sin(TIME)] * 2, axis=1), TIME)
    frame = LagFrame(series(np.cos(time), time), log, 0.0, drift=drift)
    count, size = frame.at.size, 4 if drift else 3
    slope = rng.normal(size=(count, size)) * [1.0, 5.0, 0.2, 3.0][:size]
    frame.residual = lambda x: slope @ x
    for residual in (rng.normal(size=count), np.repeat(rng.normal(size=count // 50 + 1), 50)[:count]):
        bread = np.linalg.inv(slope.T @ slope)
        plain = (residual**2).sum() / (count - size) * bread
        meat = np.zeros((size, size))
        for block in range(17):
            inside = (frame.at >= 0.5 * block) & (frame.at < 0.5 * (block + 1))
            total = (slope[inside] * residual[inside, None]).sum(axis=0)
            meat += np.outer(total, total)
        expected = np.sqrt(np.maximum(np.diag(plain), np.diag(bread @ meat @ bread)))
        np.testing.assert_allclose(frame.standard_errors(np.full(size, 0.1), residual), expected, rtol=1e-6)


@pytest.mark.parametrize(("first", "up"), [(0.29, False), (0.31, True)])
def test_a_fit_adds_the_hysteresis_and_sees_a_pressure_that_is_up(monkeypatch, first, up):
    """Three hundredths of the time of an edge of 0.4 s; the pressure begins three tenths of its range up."""
    monkeypatch.setattr(LagFrame, "standard_errors", lambda self, x, residual: np.full(x.size, 0.009))
    ramp = np.clip((TIME - 2.0) / 0.4, 0.0, 1.0) - np.clip((TIME - 5.0) / 0.4, 0.0, 1.0)
    ramp[:FIRST] = first
    log = series(np.stack([ramp, ramp], axis=1), TIME)
    found = fit_lag(series(np.roll(ramp, 4), TIME), log, 0.03, starts=((8.0, 0.7),), evaluations=3)
    assert found.uncertainty == pytest.approx(np.hypot(0.009, 0.03 * edge_time(log)))
    assert found.after_motion == up
    assert (found.drift, found.drift_uncertainty) == (0.0, np.inf)
    drifting = fit_lag(series(np.roll(ramp, 4), TIME), log, 0.03, starts=((8.0, 0.7),), evaluations=3, drift=True)
    assert drifting.drift_uncertainty == 0.009
    short = series(ramp[:29], TIME[:29])
    nothing = Fitted(0.03, np.inf, 0.0, np.inf, 0.0, 0.0, np.nan, np.nan, 0.0, after_motion=False)
    np.testing.assert_equal(fit_lag(short, log, 0.03), nothing)
    still = series(np.where(TIME > 6.0, 1.0, 0.0), TIME)  # it moves behind the end of the log only
    begin = series(log.values[TIME < 5.0], TIME[TIME < 5.0])
    np.testing.assert_equal(fit_lag(still, begin, 0.03), nothing)



def clocks():
    wave = np.sin(TIME)
    return make_recording(TIME, angle=wave[:, None], frame="planar", pressure=wave)


def test_a_drift_is_looked_for_on_request_alone(monkeypatch):
    monkeypatch.setattr(sync_module, "two_best", lambda body, pressure, delays: (fitted(delay=0.25), None))
    monkeypatch.setattr(sync_module, "fit_lag", None)
    found = sync_module.sync(clocks())
    assert (found.delay_s, found.drift, found.drift_uncertainty, found.warnings) == (0.25, 0.0, 0.0, ())


def test_the_four_best_offsets_apart_from_each_other_are_fitted(monkeypatch):
    """Scores on a grid of a quarter of a second; within two times the least distance of rivals one is enough."""
    monkeypatch.setattr(sync_module, "APART_S", 0.25)
    delays = np.arange(-16, 17) / 4
    scores = np.zeros(33)
    heights = {-3.0: 0.5, -2.5: 0.4, -2.75: 0.45, 0.0: 0.9, 0.25: 0.8, 1.0: 0.7, 2.0: 0.6, 3.5: 0.3}
    for delay, score in heights.items():
        scores[delays == delay] = score
    fits = {0.0: 0.5, 1.0: 0.875, 2.0: 0.25, -3.0: 0.75}
    monkeypatch.setattr(sync_module, "coarse_scores", lambda *_: scores.copy())
    monkeypatch.setattr(sync_module, "polished", lambda body, pressure, one: one)
    asked = []

    def fit(body, pressure, guess, **options):
        asked.append(guess)
        return fitted(delay=moved.get(guess, guess), share=fits[guess])

    monkeypatch.setattr(sync_module, "fit_lag", fit)
    moved = {}
    best, rival = sync_module.two_best(None, None, delays)
    assert asked == [0.0, 1.0, 2.0, -3.0]
    assert (best.delay, rival.delay) == (1.0, -3.0)
    moved = {-3.0: 0.75, 0.0: 1.25, 2.0: 1.5}  # a quarter of a second from the best is the same offset
    best, rival = sync_module.two_best(None, None, delays)
    assert (best.delay, rival.delay) == (1.0, 1.5)
    moved = {-3.0: 0.75, 0.0: 1.25, 2.0: 1.25}
    assert sync_module.two_best(None, None, delays)[1] is None
    scores[:] = 0.0
    with pytest.raises(InputError, match="no offset correlates pressure and motion"):
        sync_module.two_best(None, None, delays)


@pytest.mark.parametrize(("off", "whole"), [(0.0, True), (0.9e-3, True), (1.2e-3, False)])
def test_counts_are_whole_to_a_thousandth(off, whole):
    assert pressure.whole_counts(1e3 * np.array([3.0, 4.0, 5.0, 7.0, 9.0 + off])) == whole


def test_the_rest_of_a_body_has_both_its_ends():
    """The way to the tip at rest is the mean of two frames, one of which points aside."""
    place = np.zeros((100, 3, 3))
    place[..., 1] = [0.0, 0.05, 0.1]
    place[50, 2] = [0.1, 0.0, 0.0]
    place[70:, 2, 0] = 0.02
    for rest, degrees in (((0.5, 0.51), 45.0), ((0.49, 0.5), 45.0), ((0.49, 0.51), np.degrees(np.arctan2(0.1, 0.2)))):
        ds = make_recording(np.arange(100) / 100, place)
        aligned = align(ds, tangent="+y", plane="+z", rest=rest)
        assert shape.tilt(Case(ds, aligned=aligned)) == pytest.approx(degrees, abs=1e-6)
