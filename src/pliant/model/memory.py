"""Hysteresis of the joints: creep, internal friction, Bouc-Wen."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import NamedTuple, cast

import numpy as np

from pliant.equations import symbols
from pliant.errors import InputError
from pliant.model.limits import MOST_TERMS, check_limit

PER_DECADE = 2  # branches of a springpot
SLIP_PER_DECADE = 3  # slip elements of Payne's curve
PAIRS = (("creep_share", "creep_time"), ("slip_share", "slip_angle"),
         ("axial_creep_share", "axial_creep_time"), ("axial_slip_share", "axial_slip_strain"))  # fmt: skip


@dataclass(frozen=True)
class Memory:
    """Branches beside the spring of every joint and segment that lengthens, their stiffness in parts of its own.

    Parameters
    ----------
    creep_share, creep_time : tuple of float
        Prony branches: a spring of this share behind a dashpot that relaxes it within this time, s.
    slip_share, slip_angle : tuple of float
        Maxwell-slip elements: a spring of this share that slips where it is stretched by more than this angle, rad.
    boucwen_share : float
        Bouc-Wen branch: K share z beside K q. Written as alpha K q + (1 - alpha) K z, alpha = 1 / (1 + share).
    boucwen_beta, boucwen_gamma, boucwen_exponent : float
        ``dz = dq - (beta |dq| |z|^{n-1} z + gamma dq |z|^n)``, A = 1; beta and gamma in 1/rad^n, n the exponent. The
        size of z stays below ``(beta + gamma)^{-1/n}``.
    axial_creep_share, axial_creep_time : tuple of float
        Prony branches beside the axial spring of every segment that lengthens, in parts of its EA, and times, s.
    axial_slip_share, axial_slip_strain : tuple of float
        Maxwell-slip elements of the same, which slip where they are stretched by more than this strain.

    Raises
    ------
    InputError
        When a number is not finite, negative or missing its partner, or the Bouc-Wen branch could give energy away
        that it was never given: it must hold ``beta >= |gamma|``, ``beta + gamma > 0`` and an exponent of at least 1.
    """

    creep_share: tuple[float, ...] = ()
    creep_time: tuple[float, ...] = ()
    slip_share: tuple[float, ...] = ()
    slip_angle: tuple[float, ...] = ()
    boucwen_share: float = 0.0
    boucwen_beta: float = 50.0
    boucwen_gamma: float = 50.0
    boucwen_exponent: float = 1.0
    axial_creep_share: tuple[float, ...] = ()
    axial_creep_time: tuple[float, ...] = ()
    axial_slip_share: tuple[float, ...] = ()
    axial_slip_strain: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            row = field.type.startswith("tuple")
            object.__setattr__(self, field.name, checked(field.name, value, row))
        if (most := max(len(getattr(self, shares)) for shares, _ in PAIRS)) > MOST_TERMS:
            raise InputError(f"memory has at most {MOST_TERMS} branches of a kind, got {most}")
        for shares, others in PAIRS:
            row, other = getattr(self, shares), getattr(self, others)
            if len(row) != len(other):
                raise InputError(f"memory {shares} and {others} go in pairs, got {len(row)} and {len(other)} numbers")
            if min(other, default=1.0) == 0:
                raise InputError(f"memory {others} must be positive, got {other}")
        beta, gamma = self.boucwen_beta, self.boucwen_gamma
        if not (beta >= abs(gamma) and beta + gamma > 0):
            raise InputError(
                f"memory boucwen_beta must be at least |boucwen_gamma| and their sum positive, got {beta} and {gamma}: "
                "otherwise the branch gives away energy that it was never given"
            )
        if self.boucwen_exponent < 1:
            raise InputError(f"memory boucwen_exponent must be at least 1, got {self.boucwen_exponent}")
        for field in fields(self):
            value = getattr(self, field.name)
            for number in value if isinstance(value, tuple) else (value,):
                check_limit("memory", field.name, number)

    def __bool__(self) -> bool:
        """Whether there is any branch."""
        return bool(self.creep_share or self.slip_share or self.boucwen_share or self.has_axial)

    @property
    def has_axial(self) -> bool:
        """Whether the segments that lengthen have any branch."""
        return bool(self.axial_creep_share or self.axial_slip_share)

    @property
    def axial(self) -> Memory:
        """The branches of the segments that lengthen, as those of a joint are given: strains in the place of angles."""
        return Memory(self.axial_creep_share, self.axial_creep_time, self.axial_slip_share, self.axial_slip_strain)

    @property
    def labels(self) -> tuple[str, ...]:
        """Return the names of one joint's hysteresis states, in the order in which the compiled kernels store them."""
        creep = (f"creep_{j + 1}" for j in range(len(self.creep_share)))
        slip = (f"slip_{j + 1}" for j in range(len(self.slip_share)))
        return (*creep, *slip, *(("boucwen",) if self.boucwen_share else ()))

    @property
    def instantaneous(self) -> float:
        """Stiffness of all branches together before any of them slips, in parts of the joint's own."""
        return sum(self.creep_share) + sum(self.slip_share) + self.boucwen_share

    def law(self) -> symbols.MemoryLaw:
        """The same numbers for the kernels; an `AxialMemoryLaw`, with more fields, where segments have branches."""
        joints = symbols.MemoryLaw(
            np.array(self.creep_share), np.array(self.creep_time), np.array(self.slip_share), np.array(self.slip_angle),
            boucwen_share=self.boucwen_share, boucwen_beta=self.boucwen_beta, boucwen_gamma=self.boucwen_gamma,
            boucwen_exponent=self.boucwen_exponent,
        )
        if not self.has_axial:
            return joints
        return cast("symbols.MemoryLaw", symbols.AxialMemoryLaw(*joints, *self.axial.law()[:4]))


class Springpot(NamedTuple):
    """A springpot laid out in branches: shares and times for `Memory`, and the spring that closes its slow end."""

    creep_share: tuple[float, ...]
    creep_time: tuple[float, ...]  # s
    spring: float  # in parts of the joint's own stiffness


def springpot(share: float, order: float, low: float, high: float) -> Springpot:
    """Prony branches whose sum is ``share (i w / 1 rad/s)^order`` over a band, in parts of the joint's stiffness.

    Two branches a decade, from half a decade below the band to half a decade above it, rates w_j evenly spaced by r on
    a logarithmic scale: ``share sin(pi a) / pi  ln(r) w_j^a``, a the order. What lies above them is one more branch
    with the first two moments of all faster ones, a dashpot within the band. What lies below them is a spring: within
    the band it cannot be distinguished from the joint's own, so it is handed back and not laid out.

    Parameters
    ----------
    share : float
        Size of the response at 1 rad/s.
    order : float
        Between 0 (a spring) and 1 (a dashpot).
    low, high : float
        Ends of the band, Hz.

    Raises
    ------
    InputError
        When the band is none, or too wide for the branches that a memory has, or order or share make no sense.
    """
    if not (0 < low < high < np.inf and 0 < order < 1 and 0 <= share < np.inf):
        raise InputError(
            "a springpot needs a share that is not negative, an order between 0 and 1 and a band of rising positive "
            f"frequencies in Hz, got share {share}, order {order} and {low} to {high} Hz"
        )
    root = 10.0 ** (1.0 / PER_DECADE)
    ends = 2.0 * np.pi * np.array([low / root, high * root])
    width = np.log(ends[1] / ends[0])
    count = int(np.ceil(PER_DECADE * width / np.log(10.0) - 1e-9))
    if count + 1 > MOST_TERMS:
        raise InputError(
            f"a springpot from {low:g} to {high:g} Hz takes {count + 1} branches, a memory has at most {MOST_TERMS}: "
            "choose a narrower band"
        )
    rates = ends[0] * np.exp(width / count * (np.arange(count) + 0.5))
    size = share * np.sin(np.pi * order) / np.pi
    shares = [*(size * width / count * rates**order), size * ends[1] ** order * (2.0 - order) / (1.0 - order) ** 2]
    times = [*(1.0 / rates), (1.0 - order) / ((2.0 - order) * ends[1])]
    spring = float(size * ends[0] ** order / order)
    return Springpot(tuple(map(float, shares)), tuple(map(float, times)), spring)


class Payne(NamedTuple):
    """Payne's curve laid out in slip elements: shares and angles for `Memory`, and the spring that never slips."""

    slip_share: tuple[float, ...]
    slip_angle: tuple[float, ...]  # rad
    spring: float  # in parts of the joint's own stiffness


def payne(share: float, angle: float, exponent: float, low: float, high: float) -> Payne:
    """Slip elements that swings of amplitude A see as a stiffness ``share / (1 + (A / angle)^(2 m))``, m the exponent.

    Times A that is the torque of first loading. The elements make a polygon of it, and by Masing's rule every later
    branch is the same curve twice as large, so that it rules loops and their loss too. Torque and slope agree at 0 and
    at three amplitudes a decade from `low` to `high`. With v = 1 / (1 + (x / angle)^(2 m)), elements that slip beyond x
    are together as stiff as ``share v (1 - 2 m + 2 m v)``, those that slip before hold the torque ``share 2 m x v
    (1 - v)``; those between two amplitudes are one. What slips beyond the band is a spring: within it that cannot be
    distinguished from the joint's own, so it is handed back and not laid out.

    Parameters
    ----------
    share : float
        Stiffness of the smallest swings less that of the largest, in parts of the joint's own.
    angle : float
        Amplitude at which half of it is left, rad.
    exponent : float
        Above 0 and at most 1/2, a hyperbola whose torque is bounded; beyond it the torque would fall.
    low, high : float
        Ends of the band of amplitudes, rad.

    Raises
    ------
    InputError
        When the band is none, or too wide for the elements that a memory has, or another number makes no sense.

    Source: Kraus (1984), J. Appl. Polym. Sci.: Appl. Polym. Symp. 39, 75; in slip elements after Iwan (1966), J. Appl.
    Mech. 33, 893
    """
    if not (0 < low < high < np.inf and 0 < angle < np.inf and 0 < exponent <= 0.5 and 0 <= share < np.inf):
        raise InputError(
            "Payne's curve needs a share that is not negative, a positive angle, an exponent above 0 and at most 0.5 "
            f"and a band of rising positive angles in rad, got share {share}, angle {angle}, exponent {exponent} and "
            f"{low} to {high} rad"
        )
    for size in (angle, low, high):
        check_limit("Payne's curve", "slip_angle", size)
    count = int(np.ceil(SLIP_PER_DECADE * np.log10(high / low) - 1e-9))
    if count + 1 > MOST_TERMS:
        raise InputError(
            f"Payne's curve from {low:g} to {high:g} rad takes {count + 1} slip elements, a memory has at most "
            f"{MOST_TERMS}: choose a narrower band"
        )
    x = low * (high / low) ** (np.arange(count + 1) / count)
    rise, power = (x / angle) ** (2.0 * exponent), 2.0 * exponent
    left = 1.0 / (1.0 + rise)
    before = np.append(1.0, left[:-1])
    parts = np.diff(rise, prepend=0.0) * left * before * (1.0 - power + power * (left + before))
    angles = power * np.diff(x * rise * left**2, prepend=0.0) / parts
    spring = share * left[-1] * (1.0 - power + power * left[-1])
    return Payne(tuple(map(float, share * parts)), tuple(map(float, angles)), float(spring))


def checked(name: str, value: float | Sequence[float], row: bool) -> float | tuple[float, ...]:
    """`value` as one number or a tuple of numbers, finite, and but for gamma not negative."""
    try:
        a = np.asarray(value, dtype=float)
    except (TypeError, ValueError):
        raise InputError(f"memory {name} must be numbers, got {value!r:.80}") from None
    if a.ndim > row:
        raise InputError(f"memory {name} must be {'a row of numbers' if row else 'one number'}, got {value!r:.80}")
    if not np.isfinite(a).all() or (name != "boucwen_gamma" and np.any(a < 0)):
        raise InputError(f"memory {name} must be finite and not negative, got {value!r:.80}")
    return tuple(float(v) for v in np.atleast_1d(a)) if row else float(a)
