"""Parameters of the joints' hysteresis: creep (Prony), internal friction (Maxwell-slip) and Bouc-Wen."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Annotated, NamedTuple, cast

import numpy as np

from pliant.equations import symbols
from pliant.errors import InputError
from pliant.model.quantity import MOST_TERMS, Quantity, declaring, fields_per, quantities

PER_DECADE = 2  # branches of a springpot
SLIP_PER_DECADE = 3  # slip elements of Payne's curve


@declaring
@dataclass(frozen=True)
class Memory:
    """Hysteresis of joints and extensible segments: creep, friction and (at joints only) Bouc-Wen branches in parallel
    with each spring. Their stiffnesses are fractions of the stiffness of this spring: K of a joint, EA of a segment.

    Parameters
    ----------
    creep_share, creep_time : tuple of float
        Prony branches: springs of this stiffness (fraction of K), each in series with a dashpot, with this relaxation
        time, s.
    slip_share, slip_angle : tuple of float
        Maxwell-slip elements: springs of this stiffness (fraction of K) which slip when stretched beyond this angle,
        rad.
    boucwen_share : float
        Bouc-Wen branch: torque K share z in addition to K q. In the form alpha K q + (1 - alpha) K z,
        alpha = 1 / (1 + share).
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
        When a number is negative or not finite, paired tuples differ in length, or the Bouc-Wen branch could generate
        energy. It needs ``beta >= |gamma|``, ``beta + gamma > 0`` and an exponent of at least 1.
    """

    creep_share: Annotated[tuple[float, ...], Quantity(
        "1", "stiffness of a creep branch over each joint's", per="branch", sign="not negative", most=1e6,
        lower=0.0, upper=50.0, scale=0.1, start=0.1, log_offset=1.0)] = ()
    creep_time: Annotated[tuple[float, ...], Quantity(
        "s", "relaxation time of a creep branch", per="branch", sign="positive", least=1e-6, most=1e12,
        lower=1e-3, upper=1e4, start=0.3, growth=8.0, log_offset=0.0)] = ()
    slip_share: Annotated[tuple[float, ...], Quantity(
        "1", "stiffness of a slip element over each joint's", per="branch", sign="not negative", most=1e6,
        lower=0.0, upper=50.0, scale=0.1, start=0.1)] = ()
    slip_angle: Annotated[tuple[float, ...], Quantity(
        "rad", "joint rotation at which a slip element slips", per="branch", sign="positive", least=1e-9, most=1e3,
        lower=1e-6, upper=10.0, start=0.01, growth=3.0)] = ()
    boucwen_share: Annotated[float, Quantity(
        "1", "stiffness of the Bouc-Wen branch over each joint's", sign="not negative", most=1e6,
        lower=1e-9, upper=50.0, scale=0.1, start=0.1)] = 0.0
    boucwen_beta: Annotated[float, Quantity(
        "1/rad^n", "Bouc-Wen beta", sign="not negative", most=1e9, lower=1e-6, upper=1e8, start=20.0)] = 50.0
    boucwen_gamma: Annotated[float, Quantity(
        "1/rad^n", "Bouc-Wen gamma, at most beta in size", most=1e9, lower=-1e8, upper=1e8, scale=10.0,
        start=10.0)] = 50.0
    boucwen_exponent: Annotated[float, Quantity(
        "1", "Bouc-Wen exponent n", sign="positive", least=1.0, most=50.0, lower=1.0, upper=10.0, scale=1.0,
        start=1.5)] = 1.0
    axial_creep_share: Annotated[tuple[float, ...], Quantity(
        "1", "stiffness of an axial creep branch over EA", per="branch", sign="not negative", most=1e6,
        lower=0.0, upper=50.0, scale=0.1, start=0.1)] = ()
    axial_creep_time: Annotated[tuple[float, ...], Quantity(
        "s", "relaxation time of an axial creep branch", per="branch", sign="positive", least=1e-6, most=1e12,
        lower=1e-3, upper=1e4, start=0.3, growth=8.0, log_offset=0.0)] = ()
    axial_slip_share: Annotated[tuple[float, ...], Quantity(
        "1", "stiffness of an axial slip element over EA", per="branch", sign="not negative", most=1e6,
        lower=0.0, upper=50.0, scale=0.1, start=0.1)] = ()
    axial_slip_strain: Annotated[tuple[float, ...], Quantity(
        "1", "strain at which an axial slip element slips", per="branch", sign="positive", least=1e-9, most=1e3,
        lower=1e-6, upper=10.0, start=0.003, growth=3.0)] = ()

    def __post_init__(self) -> None:
        declared = quantities(Memory)
        for name in declared:
            object.__setattr__(self, name, checked(name, getattr(self, name)))
        if (most := max(len(getattr(self, name)) for name in fields_per(Memory, "branch"))) > MOST_TERMS:
            raise InputError(
                f"memory (hysteresis) has at most {MOST_TERMS} branches of a kind, got {most}: use fewer creep or slip "
                "branches"
            )
        for first, *further in branches().values():
            for other in further:
                sizes = len(getattr(self, first)), len(getattr(self, other))
                if sizes[0] != sizes[1]:
                    raise InputError(
                        f"memory {first} and {other} must have the same length, got {sizes[0]} and {sizes[1]} numbers"
                    )
        beta, gamma = self.boucwen_beta, self.boucwen_gamma
        if not (beta >= abs(gamma) and beta + gamma > 0):
            raise InputError(
                f"memory boucwen_beta must be at least |boucwen_gamma| and their sum positive, got {beta} and {gamma}: "
                "otherwise the branch could generate energy"
            )
        if self.boucwen_exponent < 1:
            raise InputError(f"memory boucwen_exponent must be at least 1, got {self.boucwen_exponent}")
        for name, quantity in declared.items():
            for number in np.atleast_1d(getattr(self, name)):
                quantity.check_limit("memory", name, number)

    def __bool__(self) -> bool:
        """Return whether there is any branch."""
        return bool(self.creep_share or self.slip_share or self.boucwen_share or self.has_axial)

    @property
    def has_axial(self) -> bool:
        """Return whether the extensible segments have any branch of hysteresis."""
        return bool(self.axial_creep_share or self.axial_slip_share)

    @cached_property
    def axial(self) -> Memory:
        """Return the branches of the segments in the form of those of a joint, with strains in place of angles."""
        return Memory(self.axial_creep_share, self.axial_creep_time, self.axial_slip_share, self.axial_slip_strain)

    @property
    def labels(self) -> tuple[str, ...]:
        """Return the names of one joint's hysteresis states, in the order in which the compiled kernels store them."""
        creep = (f"creep_{j + 1}" for j in range(len(self.creep_share)))
        slip = (f"slip_{j + 1}" for j in range(len(self.slip_share)))
        return (*creep, *slip, *(("boucwen",) if self.boucwen_share else ()))

    @property
    def coordinates(self) -> dict[str, list[str]]:
        """Return the names of the states along each dimension of datasets that belongs to hysteresis; {} if none."""
        joints = {"memory": list(self.labels)} if self else {}
        return joints | ({"axial_memory": list(self.axial.labels)} if self.has_axial else {})

    @property
    def owners(self) -> str:
        """Return what has hysteresis states, in words."""
        return "joint and segment" if self.has_axial else "joint"

    @property
    def instantaneous(self) -> float:
        """Stiffness that all hysteresis branches add before any of them slips or relaxes, divided by the joint's K."""
        return sum(self.creep_share) + sum(self.slip_share) + self.boucwen_share

    def law(self) -> symbols.MemoryLaw:
        """Return the hysteresis parameters as a record of arrays for the compiled kernels: a `MemoryLaw` or, if
        segments have branches, an `AxialMemoryLaw`.
        """
        joints = symbols.MemoryLaw(
            np.array(self.creep_share), np.array(self.creep_time), np.array(self.slip_share), np.array(self.slip_angle),
            boucwen_share=self.boucwen_share, boucwen_beta=self.boucwen_beta, boucwen_gamma=self.boucwen_gamma,
            boucwen_exponent=self.boucwen_exponent,
        )
        if not self.has_axial:
            return joints
        return cast("symbols.MemoryLaw", symbols.AxialMemoryLaw(*joints, *self.axial.law()[:4]))


def branches() -> dict[str, tuple[str, ...]]:
    """Return the fields of each kind of branches by its name, such as {"creep": ("creep_share", "creep_time")}."""
    kinds: dict[str, tuple[str, ...]] = {}
    for name in fields_per(Memory, "branch"):
        kind = name.rpartition("_")[0]
        kinds[kind] = (*kinds.get(kind, ()), name)
    return kinds


class Springpot(NamedTuple):
    """Prony branches that approximate a springpot, as `creep_share` and `creep_time` for `Memory`, and the stiffness of
    a spring to be added to that of the joint.
    """

    creep_share: tuple[float, ...]
    creep_time: tuple[float, ...]  # s
    spring: float  # stiffness over the joint's K


def springpot(
    share: Annotated[float, Quantity("1", "stiffness of the springpot at 1 rad/s over each joint's",
                                     lower=0.0, upper=10.0, scale=0.02, start=0.05)],
    order: Annotated[float, Quantity("1", "order of the springpot: 0 a spring, 1 a dashpot",
                                     lower=0.02, upper=0.9, scale=0.1, start=0.25)],
    low: Annotated[float, Quantity("Hz", "lowest frequency at which the springpot holds, never free",
                                   lower=1e-6, upper=1e6)],
    high: Annotated[float, Quantity("Hz", "highest frequency at which the springpot holds, never free",
                                    lower=1e-6, upper=1e6)],
) -> Springpot:
    """Return Prony branches that approximate a springpot of stiffness ``share (i w / 1 rad/s)^order`` between two
    frequencies [Hz].

    There are two branches a decade, from half a decade below the band to half a decade above it. Their rates w_j are
    evenly spaced by the ratio r on a logarithmic scale, and their shares are ``share sin(pi a) / pi  ln(r) w_j^a`` with
    a the order. One more branch has the first two moments of all faster ones, and acts as a dashpot within the band.
    All slower branches together act as a spring within the band. This spring cannot be distinguished there from the
    joint's own, and is therefore returned separately.

    Parameters
    ----------
    share : float
        Size of the response at 1 rad/s, over the joint's K.
    order : float
        Between 0 (a spring) and 1 (a dashpot).
    low, high : float
        Ends of the band, Hz.

    Raises
    ------
    InputError
        When the band is empty or too wide for the branches of a `Memory`, or order or share is out of range.
    """
    if not (0 < low < high < np.inf and 0 < order < 1 and 0 <= share < np.inf):
        raise InputError(
            "a springpot needs share >= 0, 0 < order < 1 and 0 < low < high in Hz, "
            f"got share {share}, order {order} and {low} to {high} Hz"
        )
    root = 10.0 ** (1.0 / PER_DECADE)
    ends = 2.0 * np.pi * np.array([low / root, high * root])
    width = np.log(ends[1] / ends[0])
    count = int(np.ceil(PER_DECADE * width / np.log(10.0) - 1e-9))
    if count + 1 > MOST_TERMS:
        raise InputError(
            f"a springpot from {low:g} to {high:g} Hz needs {count + 1} branches, but a Memory has at most "
            f"{MOST_TERMS}: choose a narrower band"
        )
    rates = ends[0] * np.exp(width / count * (np.arange(count) + 0.5))
    size = share * np.sin(np.pi * order) / np.pi
    shares = [*(size * width / count * rates**order), size * ends[1] ** order * (2.0 - order) / (1.0 - order) ** 2]
    times = [*(1.0 / rates), (1.0 - order) / ((2.0 - order) * ends[1])]
    spring = float(size * ends[0] ** order / order)
    return Springpot(tuple(map(float, shares)), tuple(map(float, times)), spring)


class Payne(NamedTuple):
    """Slip elements that approximate Payne's curve, as `slip_share` and `slip_angle` for `Memory`, and the stiffness of
    a spring to be added to that of the joint.
    """

    slip_share: tuple[float, ...]
    slip_angle: tuple[float, ...]  # rad
    spring: float  # stiffness over the joint's K


def payne(
    share: Annotated[float, Quantity("1", "extra stiffness of small oscillations over each joint's stiffness",
                                     lower=0.0, upper=1e4, scale=0.5, start=3.0, log_offset=1.0)],
    angle: Annotated[float, Quantity("rad", "oscillation amplitude of a joint that halves the extra stiffness",
                                     lower=1e-6, upper=10.0, start=0.02, log_offset=0.0)],
    exponent: Annotated[float, Quantity("1", "Kraus' m: how steeply the stiffness falls with amplitude, at most 0.5",
                                        lower=0.05, upper=0.5, scale=0.1, start=0.4)],
    low: Annotated[float, Quantity("rad", "smallest amplitude at which Payne's curve holds, never free",
                                   lower=1e-6, upper=10.0)],
    high: Annotated[float, Quantity("rad", "largest amplitude at which Payne's curve holds, never free",
                                    lower=1e-6, upper=10.0)],
) -> Payne:
    """Return slip elements whose stiffness falls with the amplitude A as in Payne's curve, ``share / (1 + (A /
    angle)^(2 exponent))``.

    A is the amplitude of an oscillation, m the exponent. The stiffness times A is the torque of first loading. The
    elements approximate it by a polygon, and by Masing's rule every later branch is the same curve twice as large, so
    that it also determines loops and their loss. Torque and slope are exact at 0 and at three amplitudes a decade from
    `low` to `high`. With v = 1 / (1 + (x / angle)^(2 m)), the elements that slip beyond x have together the stiffness
    ``share v (1 - 2 m + 2 m v)``, and those that slip before it the torque ``share 2 m x v (1 - v)``. The elements
    between two amplitudes are one. Elements that slip beyond the band act as a spring within it. This spring cannot be
    distinguished there from the joint's own, and is therefore returned separately.

    Parameters
    ----------
    share : float
        Stiffness of the smallest oscillations less that of the largest, over the joint's K.
    angle : float
        Amplitude at which half of this stiffness is left, rad.
    exponent : float
        Above 0 and at most 1/2, where the curve is a hyperbola with bounded torque. Above 1/2 the torque would fall.
    low, high : float
        Ends of the band of amplitudes, rad.

    Raises
    ------
    InputError
        When the band is empty or too wide for the elements of a `Memory`, or another number is out of range.

    Source: Kraus (1984), J. Appl. Polym. Sci.: Appl. Polym. Symp. 39, 75; in slip elements after Iwan (1966), J. Appl.
    Mech. 33, 893
    """
    if not (0 < low < high < np.inf and 0 < angle < np.inf and 0 < exponent <= 0.5 and 0 <= share < np.inf):
        raise InputError(
            "Payne's curve needs share >= 0, angle > 0, 0 < exponent <= 0.5 and 0 < low < high in rad, "
            f"got share {share}, angle {angle}, exponent {exponent} and {low} to {high} rad"
        )
    for size in (angle, low, high):
        quantities(Memory)["slip_angle"].check_limit("Payne's curve", "slip_angle", size)
    count = int(np.ceil(SLIP_PER_DECADE * np.log10(high / low) - 1e-9))
    if count + 1 > MOST_TERMS:
        raise InputError(
            f"Payne's curve from {low:g} to {high:g} rad needs {count + 1} slip elements, but a Memory has at most "
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


def checked(name: str, value: float | Sequence[float]) -> float | tuple[float, ...]:
    """Return a hysteresis parameter as a number or, for branches, a tuple of numbers; raise InputError unless it is
    finite and has the declared sign.
    """
    quantity = quantities(Memory)[name]
    row = quantity.per == "branch"
    try:
        a = np.asarray(value, dtype=float)
    except (TypeError, ValueError):
        raise InputError(f"memory {name} must be numbers, got {value!r:.80}") from None
    if a.ndim > row:
        raise InputError(f"memory {name} must be {'a row of numbers' if row else 'one number'}, got {value!r:.80}")
    if not np.isfinite(a).all() or (quantity.sign != "any" and np.any(a < 0)):
        raise InputError(f"memory {name} must be finite and not negative, got {value!r:.80}")
    if row and quantity.sign == "positive" and np.any(a == 0):
        raise InputError(f"memory {name} must be positive, got {value!r:.80}")
    return tuple(float(v) for v in np.atleast_1d(a)) if row else float(a)
