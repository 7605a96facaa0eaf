"""The model: a planar chain of rigid links with springs, dampers and a pressure torque at its joints."""

from __future__ import annotations

import operator
from dataclasses import dataclass, field, fields, replace
from math import inf, isfinite
from typing import Any, NamedTuple

import numpy as np

from pliant.display import Card, Shown
from pliant.equations import inertia, section
from pliant.equations.symbols import Body, Joints
from pliant.errors import InputError
from pliant.model.limits import LIMITS, MOST_LINKS, MOST_STATIONS, MOST_TERMS, check_limit
from pliant.model.memory import Memory
from pliant.model.summary import model_card
from pliant.model.valve import Valve

Array = np.ndarray
PER_LINK = ("link_length", "link_mass", "stiffness", "damping", "rest_angle", "joint_gain", "stiffening")
ARRAYS = (*PER_LINK, "torque", "gravity")
LIGHTEST = LIMITS["link_mass"].least
POSITIVE = ("link_length", "stiffness", "swell_time", "inflation_time")
NOT_NEGATIVE = ("link_mass", "damping", "tip_mass", "base_length", "swell_share", "inflation_limit")
OF_ANY_SIGN = ("rest_angle", "joint_gain", "stiffening", "torque", "gravity", "base_angle")
SCALARS = (
    "tip_mass", "base_length", "base_angle", "swell_share", "swell_time", "inflation_limit", "inflation_time"
)


class Station(NamedTuple):
    """A point fixed to the body whose motion is observed: a marker, a link's tip, a spot of a fibre.

    Parameters
    ----------
    name : str
    link : int
        Index of the link that carries it, 0 the first; -1: the clamped base.
    along, across : float, m
        From the link's joint along the link, and to its left, towards positive bending.
    """

    name: str
    link: int  # index of the link that carries it, 0 the first; -1: the clamped base
    along: float  # m, from the link's joint along the link (on the base: from the origin along the tangent)
    across: float = 0.0  # m, to the left of the link, towards positive bending


@dataclass(frozen=True, repr=False)
class Model(Shown):
    """Parameters of the reduced-order model, all SI; Eqs. (1)-(5) of the paper say what they do.

    Parameters
    ----------
    link_length, rest_angle, link_mass, stiffness, damping : array (n,)
        Length [m] and mass [kg] of each link, rest angle [rad], stiffness [N m/rad] and damping [N m s/rad] of the
        joint before it. A number stands for n equal ones, n being the longest of these arrays.
    torque : array (k,)
        Torque law tau = torque[0] p + torque[1] p^2 + ..., N m/Pa^i, p gauge. The paper's is (A d,).
    joint_gain : array (n,)
        Share of the torque law that each joint feels; 1 by virtual work.
    stiffening : array (n,)
        s of springs K q (1 + s q), 1/rad: negative where a joint softens with its angle. The paper's is 0.  # D15
    mass_at : {"rod", "tip"}
        A link is a uniform rod, or all its mass sits at its tip (the paper's frames taken literally).
    tip_mass : float
        Cap or load at the tip of the last link, kg.
    base_length, base_angle : float
        Rigid part between the origin and the first joint, m, and its angle from +y, rad.
    gravity : array (2,)
        Gravity in the base frame, m/s^2.
    bend_sign : {1, -1}
        Positive angles turn about +z (tip towards -x) for 1; the x axis is mirrored for -1.  # D4
    valve : Valve
    memory : Memory
        Creep, friction and Bouc-Wen at the joints; none by default.
    swell_share, swell_time : float
        A chamber that swells: this share of what the law adds beyond torque[0] p grows with a pressure that lags by
        swell_time, s. See `pliant.equations.section.swollen_torque`; share 0: at once.
    inflation_limit, inflation_time : float
        A chamber whose wall gives way: the pressure [Pa] towards which it grows without end, shear modulus times wall
        over radius of a thin neo-Hookean tube, and the time [s] that its rubber takes at low pressure. The torque
        grows with the cube of the stretch; see `pliant.equations.section.inflated_interval`. Limit 0: a rigid wall.
    stations : tuple of Station
        Observed points; the link tips when empty.
    source : dict
        Where each number comes from, by name.

    Raises
    ------
    InputError
        When a parameter is missing, not finite or not physical.
    """

    link_length: Array
    link_mass: Array
    stiffness: Array
    damping: Array
    torque: Array
    rest_angle: Array = field(default_factory=lambda: np.zeros(1))
    joint_gain: Array = field(default_factory=lambda: np.ones(1))
    stiffening: Array = field(default_factory=lambda: np.zeros(1))
    mass_at: str = "rod"
    tip_mass: float = 0.0
    base_length: float = 0.0
    base_angle: float = 0.0
    gravity: Array = field(default_factory=lambda: np.zeros(2))
    bend_sign: int = 1
    valve: Valve = field(default_factory=Valve)
    memory: Memory = field(default_factory=Memory)
    swell_share: float = 0.0
    swell_time: float = 1.0
    inflation_limit: float = 0.0
    inflation_time: float = 0.1
    stations: tuple[Station, ...] = ()
    name: str = "model"
    source: dict[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        arrays = {name: numbers(name, getattr(self, name)) for name in ARRAYS}
        n = max(arrays[name].size for name in PER_LINK)
        for name in PER_LINK:
            if n == 0 or arrays[name].size not in (1, n):
                raise InputError(f"model {name} must be one number or {n} (one for each link), got {arrays[name].size}")
            arrays[name] = np.repeat(arrays[name], n // arrays[name].size)
        for name, a in arrays.items():
            a.setflags(write=False)  # a model never changes under its user
            object.__setattr__(self, name, a)
        for name in SCALARS:
            value = numbers(name, getattr(self, name))
            if value.size != 1:
                raise InputError(f"model {name} must be one number, got {value.size}")
            object.__setattr__(self, name, float(value[0]))
        object.__setattr__(self, "stations", tuple(station_of(s) for s in self.stations))
        object.__setattr__(self, "source", dict(self.source))
        check_physical(self)
        object.__setattr__(self, "bend_sign", int(self.bend_sign))

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Model):
            return NotImplemented
        pairs = ((getattr(self, f.name), getattr(other, f.name)) for f in fields(self))
        return all(np.array_equal(a, b) if isinstance(a, np.ndarray) else a == b for a, b in pairs)

    __hash__ = None  # type: ignore[assignment]

    def card(self) -> Card:
        """The body in numbers that one can check at a glance."""
        return model_card(self)

    @property
    def n(self) -> int:
        """Number of links."""
        return self.link_length.size

    @property
    def length(self) -> float:
        """Length from the origin to the last tip along the chain, m."""
        return float(self.base_length + self.link_length.sum())

    @property
    def mass(self) -> float:
        """Moving mass, tip mass included, kg."""
        return float(self.link_mass.sum() + self.tip_mass)

    @property
    def points(self) -> tuple[Station, ...]:
        """The observed points: `stations`, or the link tips named link_1 ... link_n."""
        tips = (Station(f"link_{i + 1}", i, float(length)) for i, length in enumerate(self.link_length))
        return self.stations or tuple(tips)

    @property
    def first_joint(self) -> Array:
        """Position of the first joint (2,), m, before `bend_sign` is applied."""
        return self.base_length * np.array([-np.sin(self.base_angle), np.cos(self.base_angle)])

    def torque_at(self, pressure: Any) -> Any:
        """Torque of the law at rest at gauge `pressure` [Pa], N m; any shape. Infinite where the wall gives way."""
        torque = section.torque(np.asarray(pressure, dtype=float), self.torque)
        return torque * section.lever_growth(self.inflation_at(pressure)) if self.inflation_limit else torque

    def inflation_at(self, pressure: Any) -> Any:
        """Fourth power of the chamber's hoop stretch at rest at gauge `pressure` [Pa]: 1 for a rigid wall."""
        p = np.asarray(pressure, dtype=float)
        if not self.inflation_limit:
            return np.ones_like(p)
        left = 1.0 - p / self.inflation_limit
        return np.where(left > 0.0, 1.0 / np.where(left > 0.0, left, 1.0), np.inf)

    def with_(self, **changes: Any) -> Model:
        """A copy with some parameters changed, checked again."""
        return replace(self, **changes)

    def body(self) -> Body:
        """Constants of the inertia for the kernels."""
        rod = self.mass_at == "rod"
        centre = self.link_length * (0.5 if rod else 1.0)
        rotary = self.link_mass * self.link_length**2 / 12.0 * rod
        B = np.empty((self.n, self.n))
        h = np.empty(self.n)
        inertia.body_constants(self.link_length, self.link_mass, centre, self.tip_mass, B, h)
        return Body(B, rotary, h, float(self.gravity[0] * self.bend_sign), float(self.gravity[1]))

    def joints(self) -> Joints:
        """Springs, dampers and drive for the kernels."""
        return Joints(
            self.rest_angle, self.stiffness, self.damping, self.joint_gain, self.stiffness * self.stiffening,
            self.rest_angle,
        )


def numbers(name: str, value: Any) -> Array:
    """`value` as a new row of numbers."""
    try:
        a = np.atleast_1d(np.array(value, dtype=float))
    except (TypeError, ValueError):
        raise InputError(f"model {name} must be numbers, got {value!r:.80}") from None
    if a.ndim != 1:
        raise InputError(f"model {name} must be one number or one row of numbers, got shape {a.shape}")
    return a


def station_of(entry: Any) -> Station:
    """`entry` as a station with a name, an integer link and two lengths."""
    try:
        name, link, along, across = Station(*entry)
        return Station(str(name), operator.index(link), float(along), float(across))
    except (TypeError, ValueError):
        raise InputError(f"a station is (name, link, along, across), m, link an integer; got {entry!r:.70}") from None


def check_physical(model: Model) -> None:
    """Raise InputError when a parameter of `model` is not finite or not physical; a fit asks thousands of times."""
    for name in (*POSITIVE, *NOT_NEGATIVE, *OF_ANY_SIGN):
        value = getattr(model, name)
        least, most = (value.min(initial=inf), value.max(initial=-inf)) if name in ARRAYS else (value, value)
        if not (-inf < least and most < inf):  # not a number compares false
            raise InputError(f"model {name} must be finite, got {value}")
        if least <= 0 and name in POSITIVE:
            raise InputError(f"model {name} must be positive, got {value}")
        if least < 0 and name in NOT_NEGATIVE:
            raise InputError(f"model {name} must not be negative, got {value}")
        if least < LIMITS[name].least or max(most, -least) > LIMITS[name].most:
            check_limit("model", name, least)
            check_limit("model", name, most)
    check_limit("model", "link_mass", model.link_mass.min(initial=1.0, where=model.link_mass > 0))
    check_stations(model)
    choices = (  # sentences are filled in for what is wrong alone
        (model.mass_at in ("rod", "tip"), "mass_at must be 'rod' or 'tip', got {0.mass_at!r}"),
        (model.bend_sign in (1, -1), "bend_sign must be 1 or -1, got {0.bend_sign!r}"),
        (model.gravity.size == 2, "gravity must be two numbers (x, y in the base frame), got {0.gravity.size}"),
        (model.swell_share <= 1, "swell_share must be at most 1, the whole of it, got {0.swell_share}"),
        (model.n <= MOST_LINKS, f"must have at most {MOST_LINKS} links, got {{0.n}}"),
        (model.torque.size <= MOST_TERMS, f"torque must have at most {MOST_TERMS} numbers, got {{0.torque.size}}"),
        (model.torque.size > 0, "torque must have at least one coefficient (N m/Pa); the paper's is A d"),
        (model.link_mass[:-1].min(initial=inf) > 0 and model.link_mass[-1] + model.tip_mass >= LIGHTEST,
         "link_mass must be positive for every link, got {0.link_mass}"),
    )
    for good, sentence in choices:
        if not good:
            raise InputError(f"model {sentence.format(model)}")


def check_stations(model: Model) -> None:
    """Raise InputError when an observed point does not sit on the body, or is called like another."""
    names = [s.name for s in model.stations]
    if len(names) > MOST_STATIONS:
        raise InputError(f"model must have at most {MOST_STATIONS} stations, got {len(names)}")
    if len(set(names)) < len(names):
        raise InputError(f"model station names must differ from each other, got {', '.join(names):.200}")
    for station in model.stations:
        if not (-1 <= station.link < model.n and isfinite(station.along) and isfinite(station.across)):
            raise InputError(
                f"model station {station.name!r} must sit on a link 0..{model.n - 1} or the base (-1), got {station}"
            )
        check_limit("model", "station along", station.along)
        check_limit("model", "station across", station.across)
