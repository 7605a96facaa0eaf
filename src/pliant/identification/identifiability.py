"""Identifiability before a fit: which parameters the recordings do not determine, and which recording would."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from pliant.display import Card, Shown
from pliant.errors import PliantError
from pliant.identification.drives import findings_of_chambers
from pliant.identification.experiment import Experiment
from pliant.identification.initial_guess import prepare
from pliant.identification.names import path_of
from pliant.identification.parameters import Parameter, kind_of, shared_name, values_of
from pliant.identification.part_parameters import RATIOS
from pliant.identification.prediction import fit_step
from pliant.identification.problem import Problem
from pliant.identification.uncertainty import HIDDEN, Covariance
from pliant.model import Model
from pliant.shapes import Float

Array = np.ndarray
WEAK = 0.5  # expected standard error, in sizes of the parameter, above which a direction is weak
UNSURE = 0.1  # standard error of a common scale, relative to it, from which a fit names it
TAKES_PART = 0.03  # of the largest entry of a direction
FIX_FIRST = (  # what a user most likely knows, or can do without
    "mass", "valve_dead_time", "gain", "tip_mass", "base_x", "base_y", "along", "across", "gravity_angle", "rest_angle",
    "base_angle", "torque_3", "torque_2", "valve_fall_time", "valve_rise_time", "torque_1", "start", "damping",
    "stiffness",
)
RECORD = (  # parameters of a direction, and the recording that would show it
    ({"mass"}, "a known load at the tip"),
    ({"torque_1", "torque_2"}, "another pressure level"), ({"torque_1", "torque_3"}, "another pressure level"),
    ({"valve_fall_time"}, "the fall of the pressure"), ({"valve_rise_time"}, "the rise of the pressure"),
    ({"valve_dead_time"}, "the pressure itself"), ({"gravity_angle"}, "another orientation of the base"),
    ({"damping"}, "a free decay"), ({"twist_ratio"}, "a known force beside the axis"),
    ({"stiffness_ratio"}, "bending about both axes"),
)


@dataclass(frozen=True)
class Direction:
    """A combination of parameters that the recordings determine badly (kind "weak") or not at all ("null").

    Attributes
    ----------
    names : tuple of str
    change : tuple of float
        Relative change of each parameter along the direction; the largest entry is 1.
    kind : {"null", "weak"}
    sentence, cure : str
        What the recordings do not determine, and what to fix or record.
    """

    names: tuple[str, ...]
    change: tuple[float, ...]
    kind: str
    sentence: str
    cure: str


@dataclass(frozen=True, repr=False)
class Identifiability(Shown):
    """Result of `identifiability`: how well the recordings determine each free parameter.

    Attributes
    ----------
    names : tuple of str
        Names of the free parameters.
    expected_std : tuple of float or None
        Standard errors to expect from the noise alone, SI; None where the recordings do not determine the parameter.
    information : array (P,)
        Eigenvalues of the Fisher information scaled to unit diagonal, in falling order; all 1 for independent
        parameters.
    directions : tuple of Direction
        Undetermined combinations, "null" before "weak".
    """

    names: tuple[str, ...]
    expected_std: tuple[float | None, ...]
    information: Float[Array, "P P"]
    directions: tuple[Direction, ...]

    @property
    def identifiable(self) -> bool:
        """Return whether the recordings determine every combination of the free parameters."""
        return not any(d.kind == "null" for d in self.directions)

    def card(self) -> Card:
        """Return a display card: table of expected standard errors, and the combinations that are not determined."""
        std = ["not shown" if s is None else f"{s:.2g}" for s in self.expected_std]
        rows = [[n, s, kind_of(n).unit] for n, s in zip(self.names, std, strict=True)]
        title = "Every free parameter is determined" if self.identifiable else "Not every free parameter is determined"
        lines = [f"{d.sentence}: {d.cure}." for d in self.directions]
        return Card(title, lines, ["parameter", "std. error to expect", "unit"], rows)

    def __str__(self) -> str:
        if not self.directions:
            return f"The recordings show every one of {', '.join(self.names)}."
        return "\n".join(f"{d.sentence}: {d.cure}." for d in self.directions)


def identifiability(
    experiments: Sequence[Experiment], model: Model, parameters: Sequence[Parameter | str], *,
    time_step: float | None = None,
) -> Identifiability:
    """Return how well recordings determine each free parameter, from exact derivatives of the motion at the start
    values.

    Parameters
    ----------
    experiments, model, parameters, time_step
        As in `fit`; `time_step` in s.

    Returns
    -------
    Identifiability

    Raises
    ------
    InputError
        As `fit`.
    SimulationError
        When the start values cannot be simulated.
    """
    model, filled = prepare(experiments, model, parameters)
    time_step = time_step or fit_step(model, values_of(filled), experiments)
    return examine(Problem(list(experiments), model, filled, time_step, "noise"))


def examine(problem: Problem) -> Identifiability:
    """Return the identifiability of a fit's parameters at their start values.
    A poor result is confirmed at a second point.

    At some start values, such as a torque of zero, every derivative vanishes, although a fit can move away from them.
    """
    info = information(problem, problem.start)
    if info.identifiable:
        return info
    try:
        away = 0.05 * np.cos(1.0 + np.arange(len(info.names)))
        beside = problem.start + away * np.maximum(np.abs(problem.start), 1.0)
        again = information(problem, np.clip(beside, *problem.bounds))
    except PliantError:
        return info
    return again if again.identifiable else min(info, again, key=lambda i: sum(d.kind == "null" for d in i.directions))


def in_chambers(problem: Problem, found: Direction) -> Direction:
    """Return the undetermined parameter combination `found`. If it involves a chamber that was never driven, or
    chambers that were never driven separately, the returned combination states this reason and a remedy for it.
    """
    findings = findings_of_chambers(found.names, problem.model, problem.experiments)
    if not findings:
        return found
    cure = f"record one of them driven alone, or fix {found.names[0]}"
    return replace(found, sentence=f"{findings} ({found.sentence})", cure=cure)


def information(problem: Problem, x: Array) -> Identifiability:
    """Return which parameter combinations are determined badly or not at all, judged by the Fisher information of the
    recordings and priors at the scaled parameters x (P,).
    """
    J = np.concatenate([problem.data_jacobian(x), problem.size * problem.known[0]])
    sizes = problem_sizes(problem, x)
    relative = J * (sizes / problem.scale)
    length = np.linalg.norm(relative, axis=0)
    bright = length > 1e-12 * max(float(length.max()), 1e-300)
    norm = length[bright]
    triangle = np.linalg.qr(relative[:, bright] / norm, mode="r")
    _, s, vt = np.linalg.svd(np.concatenate([triangle, np.zeros((norm.size - len(triangle), norm.size))]))
    blind = s <= HIDDEN * s.max(initial=1e-300)
    names = tuple(p.name for p in problem.free)
    basis = np.zeros((np.count_nonzero(blind), length.size))
    basis[:, bright] = vt[blind] / norm
    basis = simplest(np.concatenate([np.eye(length.size)[~bright], basis]))
    noise = 1.0 if problem.weighting == "noise" else problem.size
    inverse = (vt[~blind].T / s[~blind] ** 2) @ vt[~blind] * noise**2
    expected = np.zeros(length.size)
    expected[bright] = np.sqrt(np.diag(inverse)) / norm
    hidden = np.asarray((np.abs(basis) > 1e-6).any(axis=0))
    directions = [direction(names, v, "null") for v in basis]
    weak = (expected > WEAK) & ~hidden
    if weak.any():
        weakest = np.zeros(length.size)
        weakest[bright] = vt[~blind][-1] / norm
        directions.append(weak_direction(names, weakest, expected, weak))
    std = tuple(None if h else float(e * z) for h, e, z in zip(hidden, expected, sizes, strict=True))
    said = tuple(in_chambers(problem, d) for d in directions)
    return Identifiability(names, std, np.append(s**2, np.zeros(np.count_nonzero(~bright))), said)


def problem_sizes(problem: Problem, x: Array) -> Array:
    """Return the size (P,) [SI] by which to scale each free parameter: its absolute value, or a typical one if it may
    be 0.
    """
    value = np.abs(x * problem.scale)
    return np.where(is_factor(problem) & (value > 0), value, problem.scale)


def is_factor(problem: Problem) -> Array:
    """Return for each of P free parameters whether its error is judged relative to its value, as for a stiffness, and
    not to a typical size, as for an angle.
    """
    return np.array([kind_of(p.name).scale in (0.0, 1.0) or shared_name(p.name) in RATIOS for p in problem.free])


def simplest(basis: Array) -> Array:
    """Return another basis (R, P), with few nonzero entries, of the space spanned by the R rows of `basis` (R, P), by
    Gauss-Jordan elimination. Each row combines P parameters.
    """
    rows = basis / np.abs(basis).max(axis=1, keepdims=True) if basis.size else basis
    taken: list[int] = []
    for k in range(len(rows)):
        left = np.abs(rows[k:]).copy()
        left[:, taken] = 0.0
        best, pivot = (int(i) for i in np.unravel_index(int(np.argmax(left)), left.shape))
        rows[[k, k + best]] = rows[[k + best, k]]
        rows[k] /= rows[k, pivot]
        for other in range(len(rows)):
            if other != k:
                rows[other] -= rows[other, pivot] * rows[k]
        taken.append(pivot)
    rows = np.where(np.abs(rows) < 1e-3 * np.abs(rows).max(axis=1, keepdims=True, initial=1e-300), 0.0, rows)
    return rows / np.abs(rows).max(axis=1, keepdims=True, initial=1e-300)


def direction(names: tuple[str, ...], v: Array, kind: str) -> Direction:
    """Return the combination `v` (P,) of P parameters as a `Direction`, with a sentence on the parameters that take
    part and on how to separate them.
    """
    part = np.flatnonzero(np.abs(v) > TAKES_PART)
    mine, change = tuple(names[i] for i in part), v[part]
    listed = join_words(mine)
    if len(mine) == 1:
        twist = ": twist is not excited" if shared_name(mine[0]) == "twist_ratio" else ""
        sentence = f"the recordings do not show {listed}{twist}"
    elif np.allclose(change, change[0], rtol=0.05):
        sentence = f"{listed} share one scale, of which the recordings show only ratios"
    elif len(mine) == 2 and np.isclose(change[0], -change[1], rtol=0.05):
        sentence = f"{listed} act as one product, whose factors the recordings do not tell apart"
    else:
        sentence = f"{listed} make up for each other, and the recordings do not tell them apart"
    return Direction(mine, tuple(float(c) for c in change), kind, sentence, cure(mine))


def weak_direction(names: tuple[str, ...], v: Array, expected: Array, weak: Array) -> Direction:
    """Return the least certain parameter combination with a sentence on the standard errors to expect."""
    v = v / np.abs(v).max()
    part = np.flatnonzero((np.abs(v) > 0.3) | weak)
    mine = tuple(names[i] for i in part)
    shares = ", ".join(f"{names[i]} to {100 * expected[i]:.0f} %" for i in np.flatnonzero(weak))
    return Direction(
        mine, tuple(float(c) for c in v[part]), "weak", f"the recordings show {shares} of its size at best", cure(mine)
    )


def combinations(problem: Problem, x: Array, found: Covariance) -> list[str]:
    """Return sentences on fitted parameters that are badly determined and on those that can compensate for them.

    The covariance of the fit includes model error, which `identifiability` before a fit does not.
    """
    sizes = problem_sizes(problem, x)
    C = found.total / np.outer(sizes, sizes)
    judged = ~found.hidden & is_factor(problem)
    rel = np.where(judged, np.sqrt(np.maximum(np.diag(C), 0.0)), 0.0)
    prior = np.array([p.prior_std or np.inf for p in problem.free]) / sizes
    names = found.names
    findings = [
        f"{names[i]} is set by its prior; the recordings add little." for i in np.flatnonzero(rel > 0.8 * prior)
    ]
    worst = int(np.argmax(rel))
    if rel[worst] <= WEAK:
        return findings + common_scale(problem, x, found)
    alone = np.sqrt(np.maximum(np.diag(C) - C[:, worst] ** 2 / C[worst, worst], 0.0))
    others = [i for i in np.flatnonzero((rel > 0.1) & (alone < 0.8 * rel)) if i != worst]
    weak = f"{names[worst]} is weakly determined (standard error {100 * rel[worst]:.0f} %)"
    if not others:
        return [*findings, f"{weak}: {cure((names[worst],))}."]
    move = 10 * C[:, worst] / C[worst, worst]
    along = join_words([f"{names[i]} {abs(move[i]):.1f} % {'higher' if move[i] > 0 else 'lower'}" for i in others])
    gain = join_words([f"{names[i]} from {100 * rel[i]:.0f} to {100 * alone[i]:.0f} %" for i in others])
    listed = (*(names[i] for i in others), names[worst])
    return [*findings, (
        f"{join_words(listed)} make up for each other: {names[worst]} 10 % higher with {along} follows the recordings "
        f"as well. {weak}; if it were held constant, other errors would fall: {gain}."
    )]


def common_scale(problem: Problem, x: Array, found: Covariance) -> list[str]:
    """Return a sentence if stiffnesses and gains are known as ratios much better than in size; [] otherwise.

    Without weight or a known force, only the inertia of the body shows the size of all forces. Delays and friction that
    a model lacks look like inertia, so that the error of their common scale may exceed its standard error.
    """
    if problem.model.gravity.any() or any(e.forces for e in problem.experiments):
        return []
    paths = [path_of(p.name) for p in problem.free]
    scaled = ["" if p.quantity.per == "power" and p.number > 1 else p.quantity.scales for p in paths]
    value = x * problem.scale
    part = [i for i, what in enumerate(scaled) if what and not found.hidden[i] and value[i] != 0.0]
    if {scaled[i] for i in part} != {"springs", "inputs"}:
        return []
    C = found.total[np.ix_(part, part)] / np.outer(value[part], value[part])
    pairs = np.diag(C)[:, None] + np.diag(C) - 2.0 * C  # variances of ratios
    scale, ratios = float(np.sqrt(C.mean())), float(np.sqrt(pairs.sum() / (len(part) * (len(part) - 1))))
    if scale < UNSURE or ratios > 0.5 * scale:
        return []
    listed = join_words([found.names[i] for i in part])
    return [(
        f"{listed} are known as ratios, to {100 * ratios:.2g} %; their common scale only to {100 * scale:.0f} %, from "
        "inertia. Delays or friction that the model lacks falsify it. Add a recording under gravity or with a known "
        "force."
    )]


def cure(names: tuple[str, ...]) -> str:
    """Return as text which parameter to fix, or which recording to add, so that `names` can be distinguished."""
    stems = {shared_name(n): n for n in names}
    tail = {n: shared_name(n).rpartition(".")[2] for n in names}
    order = sorted(names, key=lambda n: FIX_FIRST.index(tail[n]) if tail[n] in FIX_FIRST else len(FIX_FIRST))
    fix = f"fix {order[0]}" if len(names) == 1 else f"fix {order[0]} or {order[1]}, or give a prior"
    record = next((what for group, what in RECORD if group <= set(stems)), "")
    return f"{fix}, or record {record}" if record else fix


def join_words(names: Sequence[Any]) -> str:
    """Return the names joined as an English list: "a, b and c"."""
    return str(names[0]) if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"
