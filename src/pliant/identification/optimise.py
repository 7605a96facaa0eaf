"""Optimiser of a fit: nonlinear least squares with exact derivatives, from one or several start points."""

from __future__ import annotations

import time as clock
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import numpy as np

from pliant.identification.parameters import kind_of
from pliant.identification.problem import Problem

if TYPE_CHECKING:  # an optimiser is imported when one runs
    from scipy.optimize import OptimizeResult

Array = np.ndarray
ROBUST_FROM = 0.01  # of the peak displacement: residual above which a robust loss limits its weight
ROBUST_SIGMAS = 3.0  # the same in standard deviations of the noise
ON_BOUND = 1e-9  # in scales: distance from a bound that counts as none
FAR_BOUND = 7.0  # in a logarithm: bounds a factor of a thousand from the start are dropped
SAME = 1e-4  # of the least cost: tolerance within which a start is taken to reach the same minimum


class SameMinimumError(Exception):
    """Raised during an optimisation that is about to reach a minimum which is known from an earlier start."""


class LateError(Exception):
    """Raised during an optimisation whose time is over."""


def solve_all(
    problem: Problem, starts: Sequence[Array], loss: str, max_evaluations: int, progress: Callable[[str], None] | None,
    tolerance: float = 1e-9,
) -> OptimizeResult:
    """Minimise from several start points and return the best optimum.
    A run that approaches a known minimum is stopped early.

    The attribute `agreeing` of the result counts the other starts that lead to the same minimum.
    """
    best: OptimizeResult | None = None
    agreeing = 0
    for k, x0 in enumerate(starts, 1):
        try:
            end = solve(problem, x0, loss, max_evaluations, found=best, tolerance=tolerance)
            said = f"cost {end.cost:.4g}"
            if best is not None and abs(end.cost - best.cost) < SAME * best.cost:
                agreeing += 1
            elif best is None or end.cost < best.cost:
                agreeing = 0
            best = end if best is None or end.cost < best.cost else best
        except SameMinimumError:
            agreeing, said = agreeing + 1, "a minimum found before"
        if progress:
            progress(f"start {k} of {len(starts)}: {said} after {problem.evaluations} sets")
    if best is not None:
        best.agreeing = agreeing
    return best


def solve(
    problem: Problem, x0: Array, loss: str, max_evaluations: int, found: OptimizeResult | None = None,
    tolerance: float = 1e-9, deadline: float = np.inf,
) -> OptimizeResult:
    """Minimise the residuals of a least-squares problem from scaled start parameters x0 (P,), with exact derivatives.

    The unknowns are the changes from x0 in units of the parameters' typical sizes, so that the first step is at most of
    that size. A step scaled by the derivatives would be far too long for a parameter to which a start is insensitive.
    Some parameters are fitted by their logarithm; see `shifts`.

    After the `deadline`, a value of `time.monotonic`, the iterations stop at the best iterate; the status is then 0, as
    after the largest number of evaluations.

    Raises
    ------
    SameMinimumError
        When the iterates approach the minimum `found` by an earlier start, with the linear loss.
    """
    from scipy.optimize import OptimizeResult, least_squares

    residual, jacobian = condensed(problem) if loss == "linear" else (problem.residual, problem.jacobian)
    costs: dict[bytes, float] = {}
    shift = shifts(problem)
    logs = np.isfinite(shift)
    lower, start, upper = in_logarithms(problem, x0, shift)

    def x_of(move: Array) -> Array:
        y = start + move
        return np.where(logs, np.clip(np.exp(np.where(logs, y, 0.0)) - shift, *problem.bounds), y)

    def at(move: Array) -> Array:
        r = residual(x_of(move))
        costs[move.tobytes()] = 0.5 * float(np.sum(r * r))
        return r

    def slopes(move: Array) -> Array:
        x = x_of(move)
        if clock.monotonic() > deadline:
            raise LateError
        if found is not None and loss == "linear" and runs_into(found, x, costs[move.tobytes()]):
            raise SameMinimumError
        return rates(x)

    def rates(x: Array) -> Array:
        return jacobian(x) * np.where(logs, x + shift, 1.0)

    try:
        best = least_squares(at, np.zeros_like(x0), slopes, bounds=(lower - start, upper - start), loss=loss,
                             f_scale=outlying(problem), max_nfev=max_evaluations, xtol=tolerance, ftol=tolerance,
                             gtol=1e-10)  # fmt: skip
    except LateError:
        move = np.frombuffer(min(costs, key=lambda move: costs[move]))
        best = OptimizeResult(x=move, cost=costs[move.tobytes()], jac=rates(x_of(move)), status=0,
                              message="the time was over")  # fmt: skip
    x = x_of(best.x)
    best.jac = best.jac / np.where(logs, x + shift, 1.0)
    best.x = on_bounds(x, problem.bounds)
    return best


def on_bounds(x: Array, bounds: tuple[Array, Array]) -> Array:
    """Return parameters x (P,) with those on a bound that lie a little inside it, as the search ends where it runs into
    one.
    """
    for bound in bounds:
        x = np.where(np.abs(x - bound) < ON_BOUND, bound, x)
    return np.asarray(np.clip(x, *bounds))


def outlying(problem: Problem) -> float:
    """Return the weighted residual above which a robust loss limits its weight."""
    return ROBUST_SIGMAS if problem.weighting == "noise" else ROBUST_FROM * problem.unit


def in_logarithms(problem: Problem, x0: Array, shift: Array) -> tuple[Array, Array, Array]:
    """Return lower bounds, start values and upper bounds of the free parameters as they are fitted: the logarithm of
    those whose `shift` is a number, the others as they are.
    """
    logs = np.isfinite(shift)
    lower, start, upper = (np.where(logs, np.log(np.where(logs, x + shift, 1.0)), x) for x in (
        problem.bounds[0], x0, problem.bounds[1]))  # fmt: skip
    if not shares(problem):  # a bound stretches the first step by the root of its distance, which a valley needs alone
        lower = np.where(logs & (start - lower > FAR_BOUND), -np.inf, lower)
        upper = np.where(logs & (upper - start > FAR_BOUND), np.inf, upper)
    return lower, start, upper


def shifts(problem: Problem) -> Array:
    """Return the offset added to each free parameter before its logarithm is fitted; NaN where no logarithm is used.

    In space, a step as long as a stiffness itself could reduce it to zero. With creep, fast motion determines
    K (1 + share) alone; with Payne's curve, small oscillations do. The valley of K and share is curved, and becomes
    straight in log K and log (1 + share).
    """
    if problem.model.space is None and not shares(problem):
        return np.full(len(problem.free), np.nan)
    offsets = np.array([kind_of(p.name).log_offset for p in problem.free], dtype=float)
    return np.asarray(offsets / problem.scale)


def shares(problem: Problem) -> bool:
    """Return whether any free parameter states the stiffness of creep or of Payne's curve as a fraction of the joints'
    stiffness.
    """
    return any(kind_of(p.name).log_offset for p in problem.free)


def runs_into(found: OptimizeResult, x: Array, cost: float) -> bool:
    """Return whether parameters x with this `cost` will converge to the known minimum `found`, judged by the curvature
    there.
    """
    away = found.jac @ (x - found.x)
    return bool(cost < (1.0 + SAME) * found.cost and 0.5 * float(np.sum(away * away)) < SAME * found.cost)


def condensed(problem: Problem) -> tuple[Callable[[Array], Array], Callable[[Array], Array]]:
    """Return residual and Jacobian functions for the optimiser that give only P + 1 rows for P free parameters. An
    orthogonal transformation makes all other rows zero.

    With [r J] = Q R, the first column of R is the norm of r followed by zeros. Sum of squares, gradient and singular
    values are those of r and J.
    """
    rows = len(problem.free) + 1
    latest: dict[bytes, Array] = {}

    def residual(x: Array) -> Array:
        r = problem.residual(x)
        latest.clear()
        latest[x.tobytes()] = r
        return np.asarray(np.sqrt(np.sum(r * r)) * np.eye(1, rows)[0])  # no BLAS: its threads cost more than they do

    def jacobian(x: Array) -> Array:
        r = latest.get(x.tobytes())
        whole = np.column_stack([problem.residual(x) if r is None else r, problem.jacobian(x)])
        R = np.zeros((rows, rows))
        triangle = np.linalg.qr(whole, mode="r")
        R[: len(triangle)] = triangle
        return np.asarray(R[:, 1:] * np.where(np.arange(rows) == 0, np.copysign(1.0, R[0, 0]), 1.0)[:, None])

    return residual, jacobian
