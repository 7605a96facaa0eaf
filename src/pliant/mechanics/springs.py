"""Joint springs as arrays: torque, stiffness, angle under a given torque, and the largest torque of a softening spring.

The law is `equations.elastic.spring_torque`, with the terms of `equations.spring_terms`. This module adds its
inverse and its limits.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import cached_property
from typing import Any

import numpy as np

from pliant.equations import inertia
from pliant.equations.elastic import TERMS, spring_slope, spring_torque
from pliant.equations.spring_terms import SPRING_BOUND, SPRING_TERMS
from pliant.errors import SimulationError
from pliant.model import Extension, Model
from pliant.model.extension import CURVES

Array = np.ndarray
EVERY = slice(None)  # joint


class Springs:
    """Nonlinear springs of n joints. Further array axes are the samples of a batch.

    Attributes
    ----------
    K : array (n, ...)
        Stiffness at rest, N m/rad.
    terms : array (terms, n, ...)
        Coefficients of the nonlinear terms over K, 1/rad, 1/rad^2 ...
    bound : array (n, ...)
        Largest change of the slope by the first of these terms, over K; 0: no bound.
    """

    def __init__(self, K: Array, terms: Array, bound: Array | None = None) -> None:
        self.K, self.terms, self.bound = K, terms, np.zeros_like(K) if bound is None else bound

    @cached_property
    def hardening(self) -> Array:
        """Coefficients (terms + 1, n, ...) of the nonlinear terms of n springs, one row each: K2 [N m/rad^2], K3 [N
        m/rad^3], and R [1/rad^2], which bounds the change of stiffness by K2.

        `symbols.Joints` uses the same coefficients.
        """
        with np.errstate(divide="ignore"):
            inverse = np.where(self.bound > 0, 1.0 / self.bound, 0.0)
        scale = (4.0 / 3.0 * self.terms[0] * inverse) ** 2
        return np.concatenate([self.K * self.terms, scale[None]])

    @property
    def powers(self) -> Array:
        """Coefficients (terms + 1, n, ...) of the torque K q + K2 q^2 + K3 q^3 of n springs whose softening has no
        bound, one row each: K [N m/rad], K2 [N m/rad^2], K3 [N m/rad^3].
        """
        return np.concatenate([self.K[None], self.K * self.terms])

    def torque(self, q: Array) -> Array:
        """Return the torques [N m] of the springs at joint angles q (n, ...) [rad]."""
        return np.asarray(spring_torque(EVERY, self, q, q))

    def slope(self, q: Array) -> Array:
        """Return the stiffness d(torque)/d(angle) [N m/rad] of the springs at joint angles q (n, ...) [rad]."""
        return np.asarray(spring_slope(EVERY, self, q))

    def towards(self, sign: Array) -> Springs:
        """Return copies of these springs with stiffness 1, mirrored where `sign` (n, ...) is negative, so that a caller
        need consider positive angles alone.
        """
        turned = np.stack([term * sign**k for k, term in enumerate(self.terms, 1)])
        return Springs(np.ones_like(self.K), turned, self.bound)

    def turn(self) -> Array:
        """Return the smallest positive angles [rad] at which the springs lose their stiffness, infinite where they
        never do.
        """
        s, a, *later = self.terms  # roots of 1 + 2 s q + 3 a q^2
        if any(term.any() for term in later):
            return self.turn_of_all_terms()
        inside = s * s - 3.0 * a
        inverse = np.where(inside > 0, np.sqrt(np.maximum(inside, 0.0)) - s, 0.0)
        with np.errstate(divide="ignore"):
            free = np.where(inverse > 0, 1.0 / inverse, np.inf)
            high = np.where(a < 0, np.sqrt(2.0 / np.maximum(-3.0 * a, 1e-300)), 0.0)  # a takes all of a slope below 2
        if self.bound.any():
            low, _ = bisected(np.zeros_like(high), high, lambda q: self.slope(q) > 0)
            free = np.where(self.bound > 0, np.where(a < 0, low, np.inf), free)
        return free

    def turn_of_all_terms(self) -> Array:
        """Return the same angles as `turn`, for any number of terms, by the roots of polynomials.

        Where the first term is bounded, the root lies between those of the least and of the largest slope within the
        bound. Of 257 angles there, the first without stiffness is refined by bisection.
        """
        rows = np.stack([(k + 2.0) * term for k, term in enumerate(self.terms)])
        free = positive_roots(rows).min(axis=-1)
        if not self.bound.any():
            return free
        rows[0] = 0.0
        least = positive_roots(rows / (1.0 - np.where(self.terms[0] < 0, self.bound, 0.0)))
        most = positive_roots(rows / (1.0 + np.where(self.terms[0] > 0, self.bound, 0.0))).min(axis=-1)
        low, last = least.min(axis=-1), np.where(np.isfinite(least), least, 0.0).max(axis=-1)
        high = np.where(np.isfinite(most), most * (1.0 + 1e-9), last)
        low = np.where(np.isfinite(low), low, 0.0)
        angles = np.linspace(low, high, 257)
        lost = np.array([self.slope(q) <= 0 for q in angles])
        first = np.maximum(lost.argmax(axis=0), 1)[None]
        low, high = (np.take_along_axis(angles, k, axis=0)[0] for k in (first - 1, first))
        low, _ = bisected(low, high, lambda q: self.slope(q) > 0)
        return np.where(self.bound > 0, np.where(lost.any(axis=0), low, np.inf), free)

    def most(self, torque: Array) -> Array:
        """Return the largest torque [N m] that each spring can hold in the direction of `torque` (n, ...), as an
        absolute value.
        """
        unit = self.towards(np.sign(torque))
        turn = unit.turn()
        finite_turn = np.where(np.isfinite(turn), turn, 0.0)
        return np.asarray(self.K * np.where(np.isfinite(turn), unit.torque(finite_turn), np.inf))

    def bend(self, torque: Array) -> Array:
        """Return the angles [rad] at which the springs balance `torque` [N m], on the branch that starts at angle 0;
        NaN where they cannot.
        """
        x = np.asarray(torque / self.K)
        if not x.any():  # as before a recording's first pulse, in every evaluation of a fit
            return x
        if not self.terms[1:].any() and not self.bound.any():
            root = 1.0 + 4.0 * self.terms[0] * x
            with np.errstate(invalid="ignore"):
                return np.where(root > 0, x * (2.0 / (1.0 + np.sqrt(root))), np.nan)
        size, unit = np.abs(x), self.towards(np.sign(x))
        turn = unit.turn()
        low, high = np.zeros_like(x), np.minimum(turn, size)
        while (short := (unit.torque(high) < size) & (high < turn)).any():
            high = np.where(short, np.minimum(turn, 2.0 * high), high)
        reaches = unit.torque(high) >= size
        low, high = bisected(low, high, lambda q: unit.torque(q) < size)
        return np.where(reaches, np.sign(x) * 0.5 * (low + high), np.nan)


def bisected(low: Array, high: Array, below: Callable[[Array], Array]) -> tuple[Array, Array]:
    """Return the bounds `low` and `high` (n, ...) [rad] after 60 bisections. `below` tells for which angles between
    them the angle sought is larger.
    """
    for _ in range(60):
        middle = 0.5 * (low + high)
        larger = below(middle)
        low, high = np.where(larger, middle, low), np.where(larger, high, middle)
    return low, high


def positive_roots(rows: Array) -> Array:
    """Return the positive roots q (..., m) of the polynomials 1 + rows[0] q + ... + rows[m - 1] q^m, for coefficients
    `rows` (m, ...); infinite in place of other roots.

    1 / q are the eigenvalues of the companion matrix of the reversed polynomial, which stays monic where high
    coefficients are 0.
    """
    m = len(rows)
    companion = np.zeros((*rows.shape[1:], m, m))
    companion[..., 0, :] = -np.moveaxis(rows, 0, -1)
    companion[..., np.arange(1, m), np.arange(m - 1)] = 1.0
    inverse = np.linalg.eigvals(companion)
    real = (np.abs(inverse.imag) <= 1e-7 * np.abs(inverse)) & (inverse.real > 0)
    q = np.where(real, 1.0 / np.where(real, inverse.real, 1.0), 0.0)
    terms = np.moveaxis(rows, 0, -1)[..., None, :] * q[..., None] ** np.arange(1, m + 1)
    is_root = np.abs(1.0 + terms.sum(axis=-1)) <= 1e-6 * (1.0 + np.abs(terms).sum(axis=-1))
    return np.where(real & is_root, q, np.inf)


def springs_of(source: Model | Mapping[str, Any]) -> Springs:
    """Return the joint springs of a model, or of a mapping {field: array} with samples along further axes."""
    values = vars(source) if isinstance(source, Model) else source
    K = values["stiffness"]
    terms = np.reshape([values[name] for name in SPRING_TERMS], (TERMS, *np.shape(K)))
    return Springs(K, terms, np.asarray(values[SPRING_BOUND]))


def stiffer_springs(model: Model, factor: Any) -> dict[str, Array]:
    """Return the spring fields of a model with linear stiffness multiplied by `factor` (n,) and nonlinear torques
    unchanged.
    """
    terms = {name: getattr(model, name) / factor for name in SPRING_TERMS}
    bound = getattr(model, SPRING_BOUND) / factor
    return {"stiffness": model.stiffness * factor, **terms, SPRING_BOUND: bound}


def stiffer_segments(model: Model, factor: float) -> tuple[Extension, ...]:
    """Return the segments that lengthen with axial stiffness multiplied by `factor` and nonlinear forces unchanged."""
    terms = [{f: v / factor for f in CURVES if (v := getattr(e, f)) is not None} for e in model.extensions]
    return tuple(replace(e, stiffness=factor * e.stiffness, **t) for e, t in zip(model.extensions, terms, strict=True))


def angle_under(model: Model, torque: Array) -> Array:
    """Return the joint angles (n,) [rad] at which the springs alone balance `torque` (n,) [N m], on the branch that
    starts at angle 0.

    Raises
    ------
    SimulationError
        When a softening spring cannot hold its torque.
    """
    springs = springs_of(model)
    q = springs.bend(torque)
    if not np.isfinite(q).all():
        i = int(np.argmin(np.isfinite(q)))
        raise SimulationError(
            f"the spring of joint {i + 1}, which softens with its angle, holds at most "
            f"{np.copysign(springs.most(torque)[i], torque[i]):.4g} N m, but its torque is {torque[i]:.4g} N m: lower "
            "the pressure, use a stiffening closer to 0, or bound it (stiffening_bound)"
        )
    return q


def axial_springs_of(model: Model) -> Springs:
    """Return the axial springs of the segments that lengthen. Their stiffness is EA L [N m], a segment's axial
    stiffness EA times its length L, because strains take the place of angles.
    """
    segments = model.extensions
    terms = np.reshape([[getattr(e, name) or 0.0 for e in segments] for name in SPRING_TERMS], (TERMS, len(segments)))
    stiffness = np.array([e.stiffness for e in segments]) * model.segment_length
    return Springs(stiffness, terms, np.array([e.stiffening_bound or 0.0 for e in segments]))


def strain_under(model: Model, force: Array) -> Array:
    """Return the strains (S,) at which the axial springs of S segments alone balance `force` (S,) [N m], the axial
    force on each segment times its length.

    Raises
    ------
    SimulationError
        When a softening spring cannot hold it.
    """
    axial = axial_springs_of(model)
    strain = axial.bend(force)
    if not np.isfinite(strain).all():
        s = int(np.argmin(np.isfinite(strain)))
        length = model.segment_length[s]
        raise SimulationError(
            f"the axial spring of segment {model.extensions[s].name!r}, which softens with its strain, holds at most "
            f"{axial.most(force)[s] / length:.4g} N, but its force is {abs(force[s]) / length:.4g} N: lower the "
            "pressure, use a stiffening closer to 0, or bound it (stiffening_bound)"
        )
    return strain


def softened(model: Model, q: Array, least: float = 0.0) -> str:
    """Return a message on the first spring whose stiffness at the angles q (n,) [rad] is at most `least` times K, or ''
    if there is none.
    """
    lost = np.flatnonzero(springs_of(model).slope(q) <= least * model.stiffness)
    if not lost.size:
        return ""
    i = int(lost[0])
    sizes = [(getattr(model, name)[i], term.unit) for name, term in SPRING_TERMS.items()]
    described = " and ".join(f"{size:.4g} {unit}" for k, (size, unit) in enumerate(sizes) if size or not k)
    return (
        f"the spring of joint {i + 1} has lost its stiffness at {q[i]:.4g} rad, beyond the range of the stiffening of "
        f"{described}: lower the pressure, or use a stiffening closer to 0"
    )


def softened_segment(model: Model, strain: Array, least: float = 0.0) -> str:
    """Return a message on the first segment whose axial stiffness at the strains `strain` (S,) is at most `least` times
    EA, or '' if there is none.
    """
    axial = axial_springs_of(model)
    lost = np.flatnonzero(axial.slope(strain) <= least * axial.K)
    if not lost.size:
        return ""
    segment = model.extensions[int(lost[0])]
    return (
        f"the axial spring of segment {segment.name!r} has softened to nothing at a strain of "
        f"{strain[int(lost[0])]:.4g}, beyond what its stiffening describes: lower the pressure or the size of the "
        "stiffening"
    )


def small_motions(
    constants: tuple[Array, Array, Array], gravity: Array, springs: Springs, q: Array, phi: Array,
) -> tuple[Array, Array]:
    """Return the inertia and stiffness matrices (N, n, n), in joint angles, of N planar chains of n links for small
    motions about given shapes.

    Parameters
    ----------
    constants : arrays (n, n, N), (n, N), (n, N)
        The results of `model.inertia.inertia_constants`.
    gravity : array (2, N)
        Gravity in the base frame, m/s^2.
    q, phi : array (n, N)
        Joint angles and absolute link angles, rad.
    """
    B, rotary, h = constants
    c, s = np.cos(phi), np.sin(phi)
    X, M = np.empty_like(B), np.empty_like(B)
    inertia.inertia_absolute(c, s, B, rotary, X)
    inertia.to_joint_angles(X, M)
    n = len(q)
    tail = np.cumsum((h * (gravity[1] * c - gravity[0] * s))[::-1], axis=0)[::-1]
    stiffness = springs.slope(q) * np.eye(n)[..., None] + tail[np.maximum.outer(np.arange(n), np.arange(n))]
    return np.moveaxis(M, -1, 0), np.moveaxis(stiffness, -1, 0)
