"""Screens and left-out errors of linear problems, against explicit fits; of small chains, against refits."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from pliant.identification import Experiment, Parameter
from pliant.identification.residuals import Observations
from pliant.identification.starts import AtPose, AtRest
from pliant.selection.criterion import (
    FEWEST_BLOCKS,
    MOST_BLOCKS,
    RECORDINGS,
    Parts,
    criterion,
    left_out,
    noise_of,
    parts_of,
)
from pliant.selection.fitted import FittedModel, percent_of
from pliant.selection.screen import condensed, joined, within
from pliant.selection.search import at_bounds
from pliant.selection.terms import Term, creep

SMALL = 1e-4  # size of the parameters in units of their typical size, so that the weak prior does not count


def linear(rng: np.random.Generator, frames: int = 60, free: int = 4) -> tuple[Any, np.ndarray, np.ndarray]:
    """A linear least-squares problem y = A x at its optimum."""
    A, y = rng.normal(size=(frames, free)) / SMALL, rng.normal(size=frames)
    x = np.linalg.lstsq(A, y, rcond=None)[0]
    part = SimpleNamespace(seen=np.ones((frames, 1, 1), bool))
    problem = SimpleNamespace(parted=lambda r: [(part, r)], size=0.0, all_known=(np.zeros((0, free)), np.zeros(0)),
                              free=[SimpleNamespace(name=f"p{k}") for k in range(free)])  # fmt: skip
    return FittedModel(problem, x, A @ x - y, A), A, y


def test_left_out_parts_are_predicted_as_by_a_fit_without_them(rng):
    fit, A, y = linear(rng)
    groups = np.repeat(np.arange(6), 10)
    predicted = left_out(fit.linear, groups, noise_of(fit))
    for group in range(6):
        mine = groups == group
        x = np.linalg.lstsq(A[~mine], y[~mine], rcond=None)[0]
        np.testing.assert_allclose(predicted[mine], A[mine] @ x - y[mine], atol=1e-5)


def test_a_prior_counts_when_a_part_is_left_out(rng):
    fit, A, y = linear(rng)
    rows = np.eye(4)[:1] * 3.0 / SMALL
    whole, aim = np.vstack([A, rows]), np.append(y, 0.6)
    x = np.linalg.lstsq(whole, aim, rcond=None)[0]
    fit.problem.size, fit.problem.all_known = 1.0, (rows, np.array([0.6]))
    held = FittedModel(fit.problem, x, A @ x - y, A)
    mine = np.arange(60) < 20
    rest = np.append(~mine, True)
    without = np.linalg.lstsq(whole[rest], aim[rest], rcond=None)[0]
    predicted = left_out(held.linear, mine.astype(int), noise_of(held))
    np.testing.assert_allclose(predicted[mine], A[mine] @ without - y[mine], atol=1e-5)


def test_a_screen_predicts_the_cost_of_a_linear_fit_with_further_columns(rng):
    fit, A, y = linear(rng)
    more = rng.normal(size=(60, 2))
    both = np.column_stack([A, more])
    x = np.linalg.lstsq(both, y, rcond=None)[0]
    child, moves = joined(fit.linear, (), more)
    assert child.cost == pytest.approx(0.5 * np.sum((both @ x - y) ** 2), rel=1e-10)
    np.testing.assert_allclose(moves, x[4:], rtol=1e-8)
    fewer = np.column_stack([A[:, 1:], more])
    end = np.linalg.lstsq(fewer, y - A[:, 0] * fit.x[0], rcond=None)[0]
    child, moves = joined(fit.linear, (0,), more)
    assert child.cost == pytest.approx(0.5 * np.sum((fewer @ end + A[:, 0] * fit.x[0] - y) ** 2), rel=1e-10)


def test_a_screen_keeps_the_priors_of_the_parent(rng):
    """A column like that of a parameter with a tight prior must not undo the prior."""
    fit, A, y = linear(rng)
    rows = np.eye(4)[:1] * 30.0 / SMALL
    whole, aim = np.vstack([A, rows]), np.append(y, 5.0)
    x = np.linalg.lstsq(whole, aim, rcond=None)[0]
    fit.problem.size, fit.problem.all_known = 1.0, (rows, np.array([5.0]))
    held, more = FittedModel(fit.problem, x, A @ x - y, A), rng.normal(size=(60, 1))
    both = np.column_stack([whole, np.append(more, 0.0)])
    end = np.linalg.lstsq(both, aim, rcond=None)[0]
    child, moves = joined(held.linear, (), more)
    assert child.cost == pytest.approx(0.5 * np.sum((both @ end - aim) ** 2), rel=1e-8)
    np.testing.assert_allclose(moves, end[4:], rtol=1e-6)


def test_rows_rotated_into_few_give_the_same_screen(rng):
    fit = linear(rng)[0]
    more, parts = rng.normal(size=(60, 2)), Parts(np.repeat(np.arange(3), 20), whole=False)
    few = condensed(fit.linear, more, parts)
    assert few.parts.groups.size == 3 * 7
    whole, moves = joined(fit.linear, (), more)
    small, same = joined(few.linear, (), few.columns)
    np.testing.assert_allclose(same, moves, rtol=1e-9)
    assert small.cost == pytest.approx(whole.cost, rel=1e-10)
    noise, problem = noise_of(fit), SimpleNamespace(observed=[1])
    score = criterion(problem, left_out(whole, parts.groups, noise), parts)
    assert criterion(problem, left_out(small, few.parts.groups, noise), few.parts) == pytest.approx(score, rel=1e-9)


def test_a_term_that_ends_at_a_bound_is_named():
    soft = Term("softening", "springs that soften", (Parameter("stiffening", 0.0),), {"stiffening": 0.0})
    free = [Parameter("stiffening", -1.0), Parameter("damping", 0.1)]
    fit = SimpleNamespace(problem=SimpleNamespace(free=free), values={"stiffening": free[0].lower, "damping": 0.1})
    assert at_bounds(fit, soft) == ["stiffening"]
    fit.values["stiffening"] = -1.0
    assert at_bounds(fit, soft) == []


def test_a_time_as_long_as_the_recordings_stands_for_longer_ones():
    long = creep("creep", "creep_share_1", "creep_time_1", (0.1, 0.7, 5.0), 120.0)
    assert [row["creep_time_1"] for row in long.grid] == [0.1, 0.7, 5.0, 120.0]
    share, time = (p.with_(value=p.upper) for p in long.adds)
    assert time.upper == 120.0
    problem = SimpleNamespace(free=[share, time])
    fit = SimpleNamespace(problem=problem, values={p.name: p.value for p in (share, time)})
    assert at_bounds(fit, long) == ["creep_share_1"]
    short = creep("creep", "creep_share_1", "creep_time_1", (0.1, 0.7, 5.0), 9.0)
    assert [row["creep_time_1"] for row in short.grid] == [0.1, 0.7, 9.0]
    brief = creep("creep", "creep_share_1", "creep_time_1", (0.1, 0.7, 5.0), 0.05)
    assert [(row["creep_time_1"], brief.adds[1].value, brief.adds[1].upper) for row in brief.grid] == [(0.05,) * 3]
    assert short.limits == brief.limits == ("creep_time_1",)


def test_a_recording_beyond_the_others_does_not_outweigh_them():
    moves = SimpleNamespace(motion=np.inf)
    problem, parts = SimpleNamespace(observed=[moves] * 4), Parts(np.repeat(np.arange(4), 5), whole=True)
    errors = np.repeat([1.0, 1.0, 1.0, 1000.0], 5)
    better = np.repeat([0.5, 0.5, 0.5, 1100.0], 5)
    assert criterion(problem, better, parts) < 0.5 * criterion(problem, errors, parts)
    blocks = parts._replace(whole=False)
    assert criterion(problem, better, blocks) > criterion(problem, errors, blocks)


def test_a_recording_that_no_model_predicts_has_no_say():
    """Of errors above its motion it does not matter how far above; below, it counts as every other recording."""
    problem = SimpleNamespace(observed=[SimpleNamespace(motion=500.0)] * 4)  # 10 in each of five residuals
    parts = Parts(np.repeat(np.arange(4), 5), whole=True)
    far = np.repeat([1.0, 1.0, 1.0, 100.0], 5)
    nearer, worse = np.repeat([1.0, 1.0, 1.0, 20.0], 5), np.repeat([1.1, 1.1, 1.0, 20.0], 5)
    assert criterion(problem, nearer, parts) == criterion(problem, far, parts)
    assert criterion(problem, worse, parts) > criterion(problem, far, parts)
    assert criterion(problem, np.repeat([1.0, 1.0, 1.0, 5.0], 5), parts) < criterion(problem, far, parts)
    assert criterion(problem, 100 * worse, parts) > criterion(problem, 100 * nearer, parts), "where all are far off"


@pytest.mark.parametrize("space", [False, True])
def test_the_motion_is_the_error_of_a_body_that_stands_still(rng, space):
    size = 3 if space else 2
    noise = 1e-3 * rng.normal(size=(30, 1, size))
    path = noise + np.sin(np.arange(30) / 8)[:, None, None]
    path[3] = np.nan
    one = Observations(Experiment("x", np.arange(30) / 10, path, ("tip",), "step", level=1e4), "travel")
    still = np.broadcast_to(np.nanmean(path, axis=0), path.shape)
    rows = np.concatenate([still, np.zeros((30, 1, 3 - size))], axis=2)
    assert one.motion == pytest.approx(float(np.sum(one.residual(rows) ** 2)))
    held = Experiment("h", np.arange(30) / 10, 1.0 + noise, ("tip",), "step", level=1e4)
    assert np.isinf(Observations(held, "travel").motion), "a pose is no motion: its error always counts"


@pytest.mark.parametrize(("lower", "upper", "begin", "end", "part"), [
    (-np.inf, np.inf, 0.0, 5.0, 1.0), (0.0, 1.0, 0.5, 2.5, 0.25), (0.0, 1.0, 0.0, -1.0, 0.0),
    (1e-9, np.inf, 1.0, 13.0, 1 / 6), (1e-9, np.inf, 1.0, -1.0, 1 / 3),
])  # fmt: skip
def test_a_proposal_stays_within_bounds(lower, upper, begin, end, part):
    assert within(SimpleNamespace(lower=lower, upper=upper), begin, end) == pytest.approx(part)


def observed(name: str, frames: int) -> Any:
    exp = SimpleNamespace(name=name, time=np.arange(frames) / 10.0, stations=("tip",), without_positions=False,
                          travel=0.05, start=AtRest(), poses=False)  # fmt: skip
    rows = np.repeat(np.arange(frames), 2)
    channel = np.tile([0, 1], frames)
    return SimpleNamespace(exp=exp, rows=rows, station=0 * rows, channel=channel, count=rows.size, planar=True,
                           flat_weight=np.full(rows.size, 20.0), seen=np.ones((frames, 1, 2), bool),
                           is_compared=np.ones(rows.size, bool))  # fmt: skip


@pytest.mark.parametrize("recordings", [1, RECORDINGS - 1, RECORDINGS])
def test_few_recordings_are_left_out_by_blocks_and_several_whole(rng, recordings):
    parts = [observed(f"r{k}", 80) for k in range(recordings)]
    slow = np.repeat(np.sin(np.arange(80) / 5.0), 2)
    residual = np.tile(slow, recordings) + 0.01 * rng.normal(size=160 * recordings)
    problem = SimpleNamespace(observed=parts, parted=lambda r: list(zip(parts, np.split(r, recordings), strict=True)))
    groups, whole = parts_of(FittedModel(problem, np.zeros(0), residual, np.zeros((residual.size, 0))))
    assert whole == (recordings >= RECORDINGS)
    each = groups.reshape(recordings, 160)
    if recordings >= RECORDINGS:
        assert (each == np.arange(recordings)[:, None]).all()
        return
    for row in each:
        assert FEWEST_BLOCKS <= np.unique(row).size <= MOST_BLOCKS
        assert (np.diff(row) >= 0).all()
    assert np.unique(groups).size == sum(np.unique(row).size for row in each)


@pytest.mark.parametrize("starts", [[AtRest()] * 4, [AtRest()] * 3 + [AtPose()]])
def test_recordings_whose_level_comes_from_before_are_left_out_by_blocks(rng, starts):
    observed_parts = [observed(f"r{k}", 80) for k in range(4)]
    for part, start in zip(observed_parts, starts, strict=True):
        part.exp.start = start
    residual = rng.normal(size=640)
    problem = SimpleNamespace(observed=observed_parts,
                              parted=lambda r: list(zip(observed_parts, np.split(r, 4), strict=True)))  # fmt: skip
    parts = parts_of(FittedModel(problem, np.zeros(0), residual, np.zeros((640, 0))))
    assert parts.whole == (starts[-1].from_rest is True)
    assert (np.unique(parts.groups).size == 4) == parts.whole


def test_percent_of_is_the_distance_in_parts_of_the_peak():
    part = observed("r", 10)
    residual = np.tile([3.0, 4.0], 10) * 20.0 * 0.05 / 100  # 3 and 4 % of the peak displacement
    assert percent_of(part, residual) == pytest.approx(5.0)


def test_experiments_have_what_the_criterion_reads():
    path = np.random.default_rng(3).normal(size=(30, 1, 2))
    exp = Experiment("x", np.arange(30) / 10, path, ("tip",), "step", level=1e4)
    assert (exp.travel > 0, exp.without_positions, exp.stations) == (True, False, ("tip",))
