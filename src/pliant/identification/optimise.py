"""The optimiser of a fit: least squares with exact derivatives, from one start or from several."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import numpy as np

from pliant.identification.problem import Problem

if TYPE_CHECKING:  # an optimiser is imported when one runs
    from scipy.optimize import OptimizeResult

Array = np.ndarray
ROBUST_FROM = 0.01  # of the travel: beyond, a robust loss bounds the pull of a residual
ROBUST_SIGMAS = 3.0  # the same in standard deviations of the noise
SHARES = ("creep_share", "payne_share")
# beginnings of names
BY_FACTORS = ("stiffness", "axial_stiffness", "line_stiffness", "creep_time", "axial_creep_time", "payne_angle")
FAR_BOUND = 7.0  # of a logarithm: a factor of a thousand from the start
SAME = 1e-4  # of the least cost: what a start may lie above it, and its way down to it change, to be on that way


class SameMinimumError(Exception):
    """A start runs into a minimum that another one has found."""


def solve_all(
    problem: Problem, starts: Sequence[Array], loss: str, max_evaluations: int, progress: Callable[[str], None] | None,
) -> OptimizeResult:
    """The best of what `solve` finds from several starts; one that runs into the best so far goes no further.

    Its `agreeing` counts the other starts that lead to the same minimum.
    """
    best: OptimizeResult | None = None
    agreeing = 0
    for k, x0 in enumerate(starts, 1):
        try:
            end = solve(problem, x0, loss, max_evaluations, found=best)
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
) -> OptimizeResult:
    """Least squares from x0, with exact derivatives.

    The optimiser sees moves from x0 in sizes of the parameters, so that its first step is of one size at most: where
    a start shows little of a parameter, a step scaled by the derivatives would leave all that is physical. Of some it
    sees moves of their logarithm: `shifts`.

    Raises
    ------
    SameMinimumError
        When the way leads into the minimum `found` before, by sums of squares.
    """
    from scipy.optimize import least_squares

    residual, jacobian = condensed(problem) if loss == "linear" else (problem.residual, problem.jacobian)
    costs: dict[bytes, float] = {}
    shift = shifts(problem)
    logs = np.isfinite(shift)
    lower, start, upper = (np.where(logs, np.log(np.where(logs, x + shift, 1.0)), x) for x in (
        problem.bounds[0], x0, problem.bounds[1]))  # fmt: skip
    if not shares(problem):  # a bound stretches the first step by the root of its distance, which a valley needs alone
        lower = np.where(logs & (start - lower > FAR_BOUND), -np.inf, lower)
        upper = np.where(logs & (upper - start > FAR_BOUND), np.inf, upper)

    def x_of(move: Array) -> Array:
        y = start + move
        return np.where(logs, np.clip(np.exp(np.where(logs, y, 0.0)) - shift, *problem.bounds), y)

    def at(move: Array) -> Array:
        r = residual(x_of(move))
        costs[move.tobytes()] = 0.5 * float(np.sum(r * r))
        return r

    def slopes(move: Array) -> Array:
        x = x_of(move)
        if found is not None and loss == "linear" and runs_into(found, x, costs[move.tobytes()]):
            raise SameMinimumError
        return jacobian(x) * np.where(logs, x + shift, 1.0)

    best = least_squares(
        at, np.zeros_like(x0), slopes, bounds=(lower - start, upper - start), loss=loss,
        f_scale=ROBUST_SIGMAS if problem.weighting == "noise" else ROBUST_FROM * problem.unit,
        max_nfev=max_evaluations, xtol=1e-9, ftol=1e-9, gtol=1e-10,
    )
    x = x_of(best.x)
    best.jac = best.jac / np.where(logs, x + shift, 1.0)
    best.x = np.clip(x, *problem.bounds)
    return best


def shifts(problem: Problem) -> Array:
    """Return the offset of each free parameter before its logarithm is fitted, in its scale; NaN for those fitted as
    they are.

    In space a step as long as a stiffness itself would soften the spring to nothing, and the body then moves as no
    recording does. Beside creep, fast motion shows K (1 + share) alone, and beside Payne's curve small swings do: K and
    share lie in a valley that bends, and is straight in log K and log (1 + share).
    """
    kinds = [p.name.rpartition(".")[2] for p in problem.free]
    shift = np.full(len(kinds), np.nan)
    if problem.model.space is None and not shares(problem):
        return shift
    for k, kind in enumerate(kinds):
        if kind.startswith(SHARES):
            shift[k] = 1.0 / problem.scale[k]
        elif kind.startswith(BY_FACTORS):
            shift[k] = 0.0
    return shift


def shares(problem: Problem) -> bool:
    """Whether creep or Payne's curve takes a free share of the stiffness."""
    return any(p.name.rpartition(".")[2].startswith(SHARES) for p in problem.free)


def runs_into(found: OptimizeResult, x: Array, cost: float) -> bool:
    """Whether x of this `cost` lies in the bowl about a minimum: little above it, as its own curvature says."""
    away = found.jac @ (x - found.x)
    return bool(cost < (1.0 + SAME) * found.cost and 0.5 * float(np.sum(away * away)) < SAME * found.cost)


def condensed(problem: Problem) -> tuple[Callable[[Array], Array], Callable[[Array], Array]]:
    """Residual and Jacobian, turned by one rotation so that all but P + 1 rows vanish: less for the optimiser to do.

    With [r J] = Q R, the first column of R is the length of r and zeros below it, wherever r points: sums of squares,
    gradient and singular values are those of r and J.
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
