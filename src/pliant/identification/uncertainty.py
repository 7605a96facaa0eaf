"""Covariance of fitted parameters, for white and for correlated residuals."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from pliant.identification.clusters import at_least, clusters_of, error_of_form, given
from pliant.identification.problem import Problem
from pliant.identification.residuals import autocorrelations, correlated_frames
from pliant.plain import record_of

Array = np.ndarray
HIDDEN = 1e-6  # singular value over the largest, below which the data do not determine a direction
COLOURED = 1.5  # correlation length in frames, below which residuals count as white
FEWEST = 3  # recordings
POOLED = 4.0  # recordings by which the scatter of all parameters together counts in that of each


class Covariance(NamedTuple):
    """Covariance of the free parameters of a fit, with the correlation of the residuals that was assumed."""

    names: tuple[str, ...]
    matrix: Array  # (P, P) SI, with the correlation of the residuals taken into account
    white: Array  # (P, P) SI, as if the residuals were white
    hidden: Array  # (P,) of bool: whether the data do not determine the parameter
    correlated: float  # s, correlation time of the residuals; 0 if they count as white
    effective: float  # effective number of independent observed values
    source: str = "sandwich"  # or block bootstrap
    between: Array | None = None  # (P, P) SI, scatter between recordings beyond noise; None for fewer than three
    clusters: str = ""  # between what the scatter counts in `matrix`: recordings, or blocks of one; '' for noise alone
    form: Array | None = None  # (P, P) SI, errors of the model's form, which recordings have in common

    @classmethod
    def from_dict(cls, content: Mapping[str, Any]) -> Covariance:
        """Return the covariance from its fields as plain values, such as those of a file.

        Raises
        ------
        ValueError
            When a matrix does not have one finite number for each pair of parameters.
        """
        covariance = record_of(cls, content)
        size = len(covariance.names)
        for field, array in covariance._asdict().items():
            shape = (size,) if field == "hidden" else (size, size)
            if isinstance(array, np.ndarray) and (array.shape != shape or not np.isfinite(array.astype(float)).all()):
                raise ValueError(f"the covariance lacks numbers of its {size} parameters in {field!r}")
        return covariance

    @property
    def std(self) -> list[float | None]:
        """Return the standard errors (SI) that another fit of the same model would show, from noise and from the
        scatter between recordings; None for a parameter that the data do not determine.
        """
        return self.visible(self.matrix)

    @property
    def doubt(self) -> list[float | None]:
        """Return the standard errors (SI) of the fitted parameters as values of the real body, errors of the model's
        form included; None for one that the data do not determine.
        """
        return self.visible(self.total)

    @property
    def total(self) -> Array:
        """Return the covariance (P, P) of the parameters as values of the real body, SI."""
        return self.matrix if self.form is None else self.matrix + self.form

    def visible(self, matrix: Array) -> list[float | None]:
        """Return the square roots of the diagonal of a matrix (P, P), None for parameters that are hidden."""
        std = np.sqrt(np.maximum(np.diag(matrix), 0.0))
        return [None if h else float(v) for h, v in zip(self.hidden, std, strict=True)]

    @property
    def note(self) -> str:
        """Return a sentence on where the standard errors come from, and what part of them is error of the model."""
        if all(self.hidden):
            return ""
        scatter = f"the scatter between {self.clusters}, at least noise" if self.clusters else "noise alone"
        if self.form is None:
            return f"Standard errors come from {scatter}."
        visible = ~np.asarray(self.hidden, dtype=bool)
        form, rest = np.diag(self.form)[visible], np.diag(self.matrix)[visible]
        part = 100 * float(np.median(form / np.maximum(form + rest, 1e-300)))
        return (f"Standard errors come from {scatter}, and from errors of the model's form: {part:.0f} % of the "
                "variance of a typical parameter.")  # fmt: skip

    @property
    def correlation(self) -> Array:
        """Return the correlation matrix (P, P) of the parameters' errors."""
        std = np.sqrt(np.maximum(np.diag(self.matrix), 1e-300))
        return self.matrix / np.outer(std, std)


def covariance(problem: Problem, x: Array, *, robust: bool = False) -> Covariance:
    """Return the covariance of the free parameters at the optimum x (P,). It takes into account that residuals are
    correlated in time.

    White residuals: (J'J)^-1 J' S J (J'J)^-1 with S the variance of each experiment's residuals, with `robust` from
    their median absolute value. Coloured ones: J'SJ is replaced by the sum of J_t' R_ts J_s over frames t, s as far
    apart as the residuals are correlated. R_ts is the residuals' autocovariance, or r_t r_s' itself with falling
    (Bartlett) weights, whichever gives the larger uncertainty. The first is steadier in short recordings, the second
    suits residuals that are large during motion.

    The covariance is never below that of the scatter between recordings, or between blocks of the only one. Errors of
    the model's form are a matrix of their own: predictions by the same model share them, the real body does not.

    Source: Newey and West, Econometrica 55 (1987), 703, the sandwich estimator.
    """
    J, r = problem.data_jacobian(x), problem.data_residual(x)
    length = np.linalg.norm(J, axis=0)
    dark = length <= 1e-12 * max(length.max(), 1e-300)
    norm = np.where(dark, 1.0, length)
    scaled = J / norm
    known = problem.size * problem.known[0] / norm
    _, s, vt = np.linalg.svd(np.linalg.qr(np.concatenate([scaled, known]), mode="r"))
    visible = s > HIDDEN * s[0]
    inverse = (vt[visible].T / s[visible] ** 2) @ vt[visible]
    hidden = (dark & ~known.any(axis=0)) | ((vt[~visible] ** 2).sum(axis=0) > 1e-6)
    freedom = r.size / max(r.size - x.size, 1)
    flat = problem.size**2 * known.T @ known
    dense = flat.copy()
    widths, effective = [], 0.0
    for (o, part), (_, mine) in zip(problem.parted(r), problem.parted(scaled), strict=True):
        size = np.median(np.abs(part)) / 0.6745 if robust else np.sqrt(np.mean(part**2))
        lacking = max(1.0, problem.least_error / max(float(size), 1e-300)) ** 2 if problem.least_error else 1.0
        flat += lacking * size**2 * mine.T @ mine
        frames = correlated_frames(o, part)
        lacking *= problem.frames_of_error(o, part) / frames if problem.least_error else 1.0
        effective += part.size / frames
        widths.append(frames * float(np.median(np.diff(o.exp.time))) if frames > COLOURED else 0.0)
        if frames > COLOURED:
            pair = (along_frames(o, mine, part, frames), along_channels(o, mine, part))
            dense += lacking * max(pair, key=lambda middle: float(np.trace(inverse @ middle @ inverse)))
        else:
            dense += lacking * size**2 * mine.T @ mine
    scale = np.outer(problem.scale / norm, problem.scale / norm) * freedom
    names = tuple(p.name for p in problem.free)
    noise, white = (inverse @ middle @ inverse for middle in (dense, flat))
    parts = [(o, part, mine) for (o, part), (_, mine) in zip(problem.parted(r), problem.parted(scaled), strict=True)]
    scores = np.stack([mine.T @ part for _, part, mine in parts])
    between = scatter_between(scores, inverse, freedom * within_recordings(parts, inverse))
    clusters = clusters_of(problem, x, r)
    scatter = clusters.sandwich(scaled, r, inverse)
    return Covariance(
        names, scale * (noise if scatter is None else at_least(noise, scatter)), scale * white, hidden, max(widths),
        effective, between=None if between is None else between * scale / freedom, clusters=clusters.words,
        form=scale * given(error_of_form(parts, inverse), known / problem.size),
    )


def within_recordings(parts: Sequence[tuple[Any, Array, Array]], inverse: Array) -> Array:
    """Return the covariance (P, P) of P parameters from what residuals show within each recording: from the residuals
    that would be left if each recording had parameters of its own.

    `parts` holds for each recording its observations, residuals (N,) and Jacobian (N, P).
    """
    middle = np.zeros_like(inverse)
    for o, part, mine in parts:
        remainder = part - mine @ np.linalg.lstsq(mine, part, rcond=HIDDEN)[0]
        size = float(remainder @ remainder) / max(remainder.size - len(inverse), 1)
        middle += correlated_frames(o, remainder) * size * mine.T @ mine
    return np.asarray(inverse @ middle @ inverse)


def information_criterion(mean_square: float, numbers: float, free: int) -> float:
    """Return Bayes' information criterion of a fit with `free` parameters, from the mean square of its residuals and
    the effective number of independent observed values.
    """
    return float(numbers * np.log(max(mean_square, 1e-300)) + free * np.log(numbers))


def along_channels(observed: Any, J: Array, residual: Array) -> Array:
    """Return the sum (P, P) of J_t' R_ts J_s over pairs of frames t, s, from which the standard errors of P parameters
    follow. J is the Jacobian, and R the autocovariance of the residuals, estimated from all channels together.
    """
    dense = np.zeros((*observed.seen.shape, J.shape[1]))
    dense[observed.rows, observed.station, observed.channel] = J
    total = J.T @ J
    for lag, rho in enumerate(autocorrelations(observed, residual), 1):
        product = np.tensordot(dense[lag:], dense[:-lag], axes=((0, 1, 2), (0, 1, 2)))
        total += rho * (product + product.T)
    return np.asarray(total * float(np.mean(residual**2)))


def along_frames(observed: Any, J: Array, residual: Array, frames: float) -> Array:
    """Return the sum (P, P), over pairs of frames, of products of the two frames' gradients of the cost with respect to
    P parameters. The weight of a pair falls with its distance in time, to zero beyond two correlation lengths. The
    standard errors follow from this sum.
    """
    score = np.zeros((observed.seen.shape[0], J.shape[1]))
    np.add.at(score, observed.rows, J * residual[:, None])
    width = int(min(np.ceil(2 * frames), observed.seen.shape[0] // 4))
    total = score.T @ score
    for lag in range(1, width + 1):
        product = score[lag:].T @ score[:-lag]
        total += (1 - lag / (width + 1)) * (product + product.T)
    return total


def scatter_between(scores: Array, inverse: Array, noise: Array) -> Array | None:
    """Return the covariance (P, P) of P parameters between recordings, beyond what noise explains; None for fewer than
    three recordings.

    The sandwich formula gives the covariance of the mean of K recordings from their scores J_k' r_k. Its ratio to the
    variance that noise explains is pooled between parameters, since few recordings determine it, and lessened by its
    own standard deviation under noise alone. The variance between recordings is K times the excess of the mean.

    Parameters
    ----------
    scores : array (K, P)
        J_k' r_k of each of K recordings, with the Jacobian J_k and the residuals r_k.
    inverse : array (P, P)
        Inverse of J' J of all recordings and priors.
    noise : array (P, P)
        Covariance of the parameters from correlated noise.
    """
    count = len(scores)
    if count < FEWEST:
        return None
    shares = ((scores - scores.mean(axis=0)) @ inverse) ** 2
    variance, explained = shares.sum(axis=0) * count / (count - 1), np.diag(noise)
    ratio = np.divide(variance, explained, out=np.ones_like(variance), where=explained > 0)
    pooled = ((count - 1) * ratio + POOLED * ratio.mean()) / (count - 1 + POOLED)
    excess = np.sqrt(np.maximum(pooled - 1.0 - np.sqrt(2.0 / (count - 1 + POOLED)), 0.0))
    return np.asarray(count * np.outer(excess, excess) * noise)
