"""Doubt of fitted parameters beyond noise: their scatter between recordings, and errors of the model's form.

Errors of the model's form are common to all recordings. No scatter shows the part of them that the parameters take up,
but what is left of them in the residuals is coherent: the same at several stations and directions.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from pliant.errors import PliantError
from pliant.identification.parameters import apply
from pliant.identification.problem import Problem
from pliant.identification.residuals import Observations, correlated_frames, noise_ratio
from pliant.simulation import modes

Array = np.ndarray
FEWEST_BLOCKS = 4
TIME_CONSTANTS = 10.0  # length of a block, in the body's slowest time constants
CORRELATION_TIMES = 3.0  # length of a block at least, in correlation times of the residual
COLOURED_NOISE = 1.5  # standard deviations of white noise that residuals of coloured noise may have
UNSEEN = 0.5  # coherence of a single channel or of a few poses: that of other bodies
FEWEST_FRAMES = 5  # that show a correlation between channels
# Independent values that an error of the model's form counts as, however many frames show it; set with
# benchmarks/strangers.py parameters
INDEPENDENT = 3.0


class Clusters(NamedTuple):
    """Parts of the recordings between which parameters are compared."""

    rows: tuple[Array, ...]  # indices of the residuals of each part
    words: str  # what the parts are; '' if there are too few

    def sandwich(self, J: Array, residual: Array, inverse: Array) -> Array | None:
        """Return the covariance (P, P) of P parameters from the scatter of the parts' gradients J_k' r_k, with the
        small-sample factor K / (K - 1) of K parts; None for fewer than two.

        `inverse` is (J'J)^-1 of all recordings and priors. Source: Liang and Zeger, Biometrika 73 (1986), 13.
        """
        count = len(self.rows)
        if count < 2:
            return None
        scores = np.stack([J[rows].T @ residual[rows] for rows in self.rows])
        return np.asarray(count / (count - 1) * inverse @ (scores.T @ scores) @ inverse)


def clusters_of(problem: Problem, x: Array, residual: Array) -> Clusters:
    """Return the parts of the training recordings: each recording, or blocks of the only one, at least four, of ten of
    the body's slowest time constants each.
    """
    parts = problem.parted(np.arange(residual.size))
    if len(parts) > 1:
        return Clusters(tuple(rows for _, rows in parts), f"{len(parts)} recordings")
    ((observed, rows),) = parts
    time = observed.exp.time
    step = float(np.median(np.diff(time))) if time.size > 1 else 0.0
    length = max(TIME_CONSTANTS * slowest(problem, x, observed),
                 CORRELATION_TIMES * step * correlated_frames(observed, residual))  # fmt: skip
    count = int(np.ptp(time) / length) if length > 0 else 0
    if count < FEWEST_BLOCKS or observed.exp.poses:
        return Clusters((), "")
    edges = np.linspace(time[0], time[-1], count + 1)[1:-1]
    block = np.searchsorted(edges, time[observed.rows])
    blocks = [rows[block == k] for k in range(count)]
    return Clusters(tuple(b for b in blocks if b.size), f"{count} blocks of {np.ptp(time) / count:.2g} s")


def slowest(problem: Problem, x: Array, observed: Observations) -> float:
    """Return the slowest time constant [s] of the body's modes at the scaled parameters x (P,); inf if it has none."""
    try:
        frequency, ratio = modes(apply(problem.model, for_body(problem, x, observed.exp.name)))[:2]
    except PliantError:
        return np.inf
    omega, ratio = 2.0 * np.pi * np.asarray(frequency), np.asarray(ratio)
    over = np.sqrt(np.maximum(ratio**2 - 1.0, 0.0))
    return float(np.max(1.0 / np.maximum(omega * (ratio - over), 1e-12)))


def for_body(problem: Problem, x: Array, recording: str) -> dict[str, Any]:
    """Return the values of the parameters that belong to no recording."""
    return {n: v for n, v in problem.values(x).items() if not n.startswith(f"{recording}.")}


def at_least(noise: Array, scatter: Array) -> Array:
    """Return the smallest covariance (P, P) that is below neither of two: along each principal direction of `scatter`
    against `noise`, the larger variance.
    """
    value, turn = np.linalg.eigh(noise)
    value = np.maximum(value, 1e-14 * max(float(value[-1]), 1e-300))
    root, inverse = turn * np.sqrt(value), turn / np.sqrt(value)
    ratio, axes = np.linalg.eigh(inverse.T @ scatter @ inverse)
    half = root @ axes
    return np.asarray((half * np.maximum(ratio, 1.0)) @ half.T)


def error_of_form(parts: Sequence[tuple[Observations, Array, Array]], inverse: Array) -> Array:
    """Return the covariance (P, P) of P parameters due to errors of the model's form, from the coherent part of the
    residuals.

    A fit takes up a part of such an error and leaves the rest in the residuals. With few independent patterns, both
    parts are of one size. All recordings take up the same.

    Parameters
    ----------
    parts : sequence of (Observations, residual (N,), Jacobian (N, P))
        One for each recording.
    inverse : array (P, P)
        Inverse of J'J of all recordings and priors.
    """
    total = np.zeros_like(inverse)
    for observed, residual, J in parts:
        energy = coherent_energy(observed, residual)
        value, turn = np.linalg.eigh(J.T @ J)
        total += np.sqrt(energy) * (turn * np.sqrt(np.maximum(value, 0.0))) @ turn.T
    return np.asarray(inverse @ (total @ total) @ inverse / INDEPENDENT)


def given(form: Array, known: Array) -> Array:
    """Return the covariance (P, P) `form` of parameters of which R combinations `known` (R, P) have priors of unit
    variance: no prior is left with less certainty than it states.
    """
    gain = form @ known.T
    return np.asarray(form - gain @ np.linalg.solve(np.eye(len(known)) + known @ gain, gain.T))


def coherent_energy(observed: Observations, residual: Array) -> float:
    """Return the part of a residual's sum of squares that noise does not explain and that the channels share.

    The residual (N,) is that of one recording; `coherence` gives the fraction that its channels share.
    """
    energy = float(residual @ residual)
    if energy <= 0.0:
        return 0.0
    excess = 1.0
    if not observed.exp.poses:  # noise of settled poses is not seen from row to row
        with np.errstate(divide="ignore", invalid="ignore"):
            ratio = noise_ratio(observed, residual)
        excess = max(1.0 - (COLOURED_NOISE / ratio) ** 2, 0.0) if np.isfinite(ratio) else 1.0
    return energy * excess * coherence(observed, residual)


def coherence(observed: Observations, residual: Array) -> float:
    """Return the mean squared correlation between the channels of a residual (N,), weighted by their energies, above
    that of independent white channels; `UNSEEN` where a single channel or a few frames do not show it.
    """
    table = np.zeros(observed.seen.shape)
    table[observed.seen] = residual
    table = table.reshape(table.shape[0], -1)
    table = table[:, table.any(axis=0)]
    frames, channels = table.shape
    if channels < 2 or frames < FEWEST_FRAMES:
        return UNSEEN
    shared = (table.T @ table) ** 2
    apart = ~np.eye(channels, dtype=bool)
    power = np.sqrt(np.diag(shared))
    mean = float(shared[apart].sum() / np.outer(power, power)[apart].sum())
    return float(np.clip((mean - 1.0 / frames) / max(1.0 - 1.0 / frames, 1e-9), 0.0, 1.0))
