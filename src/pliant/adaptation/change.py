"""Whether the body of an arm changed: a fit whose body is free, against the same fits of the earlier recordings.

A model that lacks something finds another body in each recording, and a mounting that is free takes up a part of what
it lacks. Both show in the recordings of the earlier day when they are fitted one at a time as the new day is.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from pliant.adaptation.posterior import Posterior, joints_of
from pliant.adaptation.result import FAR
from pliant.failures import FAILED
from pliant.identification.experiment import Experiment
from pliant.identification.fit import FitResult
from pliant.identification.identifiability import join_words
from pliant.shapes import Float

Array = np.ndarray
SUSPECT = 2.0  # standard deviations, from which a change is compared with the earlier recordings
MOST_EARLIER = 6  # recordings that are fitted for this comparison
RELEASED = 0.5  # of a parameter's size: standard deviation of a parameter of the body that is released
OTHERWISE = 0.3  # of a parameter's size: standard deviation of one that changed, and of each of another arm
ODDS = 0.05  # prior odds of another arm, and of each change of an arm in which more than two parameters changed
FEW = 2  # parameters that may change in any arm, however few its body has


class Change(NamedTuple):
    """A change of the body: the value (SI) of a parameter `before` and `after`, and by how many standard deviations of
    the difference it changed. The name "stiffness" may stand for that of every joint; both values are then factors.
    """

    name: str
    unit: str
    before: float
    after: float
    deviations: float

    @property
    def sentence(self) -> str:
        """Return the change as a phrase, such as "stiffness 0.5 to 0.4 N m/rad (-12 sd)"."""
        unit = "" if self.unit == "1" else f" {self.unit}"
        return f"{self.name} {self.before:.4g} to {self.after:.4g}{unit} ({self.deviations:+.0f} sd)"


class BodyChange(NamedTuple):
    """What a fit with a free body says about it.

    Attributes
    ----------
    names : tuple of str
        Parameters that changed; "stiffness" for that of every joint.
    another : str
        Why the arm is another one; '' if it is not.
    compared : int
        Number of earlier recordings with which the change was compared; -1 if nothing called for it.
    changes : tuple of Change
        By how much they changed, as the fit with a free body shows it beyond the earlier recordings.
    refuted : tuple of str
        Parameters that changed in that fit, but not according to the rest of the day.
    """

    names: tuple[str, ...] = ()
    another: str = ""
    compared: int = -1
    changes: tuple[Change, ...] = ()
    refuted: tuple[str, ...] = ()

    @property
    def sentence(self) -> str:
        """Return what was compared, and what changed, as a sentence."""
        alike = "" if self.compared < 0 else f", compared with {self.compared} earlier recordings fitted alike"
        return f"a fit with a free body{alike}: {join_words(self.names) if self.names else 'no parameter'} changed"

    @property
    def caution(self) -> str:
        """Return a sentence that says so if a change could not be compared with earlier recordings; '' otherwise."""
        return "" if self.compared else (" It could not be compared with earlier recordings: errors of the model's "
                                         "form may look like a change.")  # fmt: skip


def sizes_of(posterior: Posterior) -> dict[str, float]:
    """Return the size (SI) of each parameter of the body, by name: its value, at least its typical scale."""
    return {p.name: max(abs(p.value or 0.0), p.scale) for p in posterior.parameters}


def freed(posterior: Posterior) -> dict[str, float]:
    """Return the variances (SI) that free all parameters of the body from their prior, by name."""
    sizes = sizes_of(posterior)
    return {name: (RELEASED * sizes[name]) ** 2 for name in posterior.body.names}


def body_change(
    posterior: Posterior, day: FitResult, earlier: Callable[[], Sequence[Experiment]],
    fit_alike: Callable[[Experiment], FitResult],
) -> BodyChange:
    """Return which parameters of the body changed.

    Parameters
    ----------
    posterior : Posterior
        What earlier fits say about the body.
    day : FitResult
        The new day, fitted with a free body.
    earlier : callable
        Returns recordings of the earlier fit. It is called only if a parameter seems to have changed.
    fit_alike : callable
        Fits one of them as the day was.
    """
    names = posterior.body.names
    move, doubt = move_of(posterior, day), posterior.prior.covariance + covariance_of(names, day)
    directions = directions_of(posterior)
    if not stepwise(move, doubt, directions, SUSPECT):
        return BodyChange()
    moves = []
    for exp in spaced(earlier(), MOST_EARLIER):
        try:
            moves.append(move_of(posterior, fit_alike(exp)))
        except FAILED:  # such as a recording whose first seconds hold no motion
            continue
    if moves:
        shift, scatter = shift_and_scatter(np.array(moves))
        move, doubt = move - shift, doubt + scatter
        changed = stepwise(move, doubt, directions, FAR)
    else:
        far = np.abs(move) > FAR * np.sqrt(np.diag(doubt))
        changed = tuple(n for n, f in zip(names, far, strict=True) if f)
    if not changed:
        return BodyChange(compared=len(moves))
    another = why_another(move, doubt, changed, posterior)
    return BodyChange(changed, another, len(moves), changes_of(posterior, changed, move, doubt))


def why_another(move: Array, covariance: Array, changed: Sequence[str], posterior: Posterior) -> str:
    """Return why a move (P,) with the given covariance (P, P) is that of another arm, although the named directions
    explain most of it; '' if it is not.

    In another arm more than two changed, and the odds favour it although each named change has the prior odds `ODDS`;
    or the others, taken together, explain as much as one must to be named, and the odds favour an arm whose parameters
    all differ.
    """
    directions = directions_of(posterior)
    named = [directions[n] for n in changed]
    odds = odds_of_another(move, covariance, named, posterior)
    if len(changed) > FEW and odds > len(changed) * np.log(ODDS):
        return f"in a fit whose body is free, too many parameters changed for one cause ({join_words(changed)})"
    left = explained(list(np.eye(len(move))), move, covariance) - explained(named, move, covariance)
    if left <= FAR**2 or odds <= 0.0:
        return ""
    return f"in a fit whose body is free, {join_words(changed)} and, taken together, the other parameters changed"


def odds_of_another(move: Array, covariance: Array, changed: Sequence[Array], posterior: Posterior) -> float:
    """Return the logarithm of the odds of another arm to an arm in which only the directions `changed` (P,) did.

    The move (P,) has the given covariance (P, P) about 0 if nothing changed. Each part that changed adds `OTHERWISE` of
    the size of its parameters, another arm `OTHERWISE` of the size of every parameter. The evidence of each is the
    density of the move: many free parameters cost as much as they promise and do not explain. Parameters without a
    size, at 0 and without a typical scale, promise nothing and are left out.
    """
    sizes = np.array([sizes_of(posterior)[n] for n in posterior.body.names])
    sized = np.flatnonzero(sizes)
    some = sum((np.outer(u, u) for u in (sizes * (c != 0.0) for c in changed)), np.zeros_like(covariance))
    evidence = [log_density(move[sized], (covariance + OTHERWISE**2 * more)[np.ix_(sized, sized)])
                for more in (np.diag(sizes**2), some)]  # fmt: skip
    return evidence[0] - evidence[1] + float(np.log(ODDS))


def log_density(value: Array, covariance: Array) -> float:
    """Return the logarithm of the Gaussian density of a value (P,) with mean 0, but for a constant."""
    size = np.sqrt(np.diag(covariance))
    root = np.linalg.cholesky(covariance / np.outer(size, size))
    white = np.linalg.solve(root, value / size)
    return float(-0.5 * white @ white - np.log(np.diag(root)).sum() - np.log(size).sum())


def changes_of(posterior: Posterior, changed: Sequence[str], move: Array, covariance: Array) -> tuple[Change, ...]:
    """Return by how much the named directions changed: the generalised least-squares fit of a move (P,) with the given
    covariance (P, P).
    """
    if not changed:
        return ()
    directions, means = directions_of(posterior), posterior.body.means
    units = {p.name: p.unit for p in posterior.parameters}
    size = np.sqrt(np.diag(covariance))
    A = np.stack([directions[n] for n in changed], axis=1) / size[:, None]
    W = np.linalg.inv(covariance / np.outer(size, size))
    spread = np.linalg.pinv(A.T @ W @ A, rcond=1e-9, hermitian=True)
    changes = []
    for k, (name, part) in enumerate(zip(changed, spread @ A.T @ W @ (move / size), strict=True)):
        deviations = float(part / np.sqrt(spread[k, k]))
        before = means.get(name, 1.0)
        after = before + float(part) * (abs(before) or 1.0)
        changes.append(Change(name if name in means else f"{name} of every joint, as a factor,", units.get(name, "1"),
                              before, after, deviations))  # fmt: skip
    return tuple(changes)


def spaced(recordings: Sequence[Experiment], most: int) -> list[Experiment]:
    """Return at most `most` recordings, evenly spaced."""
    if len(recordings) <= most:
        return list(recordings)
    return [recordings[int(k)] for k in np.linspace(0, len(recordings) - 1, most)]


def move_of(posterior: Posterior, result: FitResult) -> Array:
    """Return how far a fit moved the P parameters of the body (P,), SI."""
    return np.array([result.values[n] for n in posterior.body.names]) - posterior.body.mean


def covariance_of(names: Sequence[str], result: FitResult) -> Array:
    """Return the covariance (P, P) of P parameters of a fit, errors of the model's form included, SI; 0 if unknown."""
    covariance = result.covariance
    if covariance is None:
        return np.zeros((len(names), len(names)))
    index = [covariance.names.index(n) for n in names]
    return np.asarray(covariance.total[np.ix_(index, index)])


def shift_and_scatter(moves: Float[Array, "K P"]) -> tuple[Array, Array]:
    """Return the mean (P,) of the moves in K earlier recordings, and the covariance (P, P) of another recording's move
    about it. A single recording shows no scatter; its whole move then counts as such.
    """
    count, mean = len(moves), moves.mean(axis=0)
    if count == 1:
        return mean, np.outer(mean, mean)
    away = moves - mean
    return mean, (1.0 + 1.0 / count) * away.T @ away / (count - 1)


def directions_of(posterior: Posterior) -> dict[str, Array]:
    """Return the changes (P,) of the body's parameters among which a change is sought, by name: each parameter alone,
    and the stiffness of all joints together.
    """
    names = posterior.body.names
    sizes = np.where(posterior.body.mean == 0.0, 1.0, np.abs(posterior.body.mean))
    directions = dict(zip(names, np.diag(sizes), strict=True))
    joints = [n for n in joints_of(posterior.model) if n in names]
    if len(joints) > 1:
        directions["stiffness"] = np.sum([directions[n] for n in joints], axis=0)
    return directions


def stepwise(move: Array, covariance: Array, directions: Mapping[str, Array], least: float) -> tuple[str, ...]:
    """Return the names of the fewest directions (P,) that explain a move (P,) with the given covariance (P, P).

    The direction that explains most is added as long as it explains more than `least` standard deviations. Then each is
    dropped without which the others explain as much.
    """
    def worth(names: Sequence[str]) -> float:
        return explained([directions[n] for n in names], move, covariance)

    chosen: list[str] = []
    while len(chosen) < len(move):
        gains = {n: worth([*chosen, n]) - worth(chosen) for n in directions if n not in chosen}
        best = max(gains, key=gains.__getitem__)
        if gains[best] <= least**2:
            break
        chosen.append(best)
    for name in tuple(chosen):
        others = [n for n in chosen if n != name]
        if worth(chosen) - worth(others) <= least**2:
            chosen = others
    return tuple(chosen)


def explained(directions: Sequence[Array], move: Array, covariance: Array) -> float:
    """Return how much of the squared deviation of a move (P,) with the given covariance (P, P) directions (P,) explain.

    Directions A explain b' (A' W A)^-1 b with b = A' W move and the inverse covariance W: the fall of the generalised
    sum of squares of what is left of the move.
    """
    if not len(directions):
        return 0.0
    size = np.sqrt(np.diag(covariance))
    W = np.linalg.inv(covariance / np.outer(size, size))
    A = np.stack([u / size / np.linalg.norm(u / size) for u in directions], axis=1)
    b = A.T @ W @ (move / size)
    return float(b @ np.linalg.lstsq(A.T @ W @ A, b, rcond=1e-9)[0])


def released_names(posterior: Posterior, changed: Sequence[str]) -> tuple[str, ...]:
    """Return the parameters of the body whose change the names stand for: of "stiffness" those of all joints, where
    each joint has its own.
    """
    names = posterior.body.names
    every = [n for n in joints_of(posterior.model) if n in names] if "stiffness" in changed else []
    return tuple(n for n in names if n in changed or n in every)
