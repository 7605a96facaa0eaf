"""The rod model of a soft bending actuator: its parameters, and the arrays of the discrete rod made from them."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import NamedTuple

import numpy as np

from pliant.errors import InputError

Array = np.ndarray
CAP_EDGE = 0.01  # m, length of the edge that carries the rigid cap
CAP_STIFFNESS = 2.0e4  # N, EA of that edge at least: the cap does not stretch with the body
FEATURES = 64  # cosines of a random field
CONTACT_LENGTH = 0.005  # m of body over which an obstacle's stiffness is spread
ACTUATORS = {"a": 1, "b": 2, "c": 3}  # name -> seed of everything that differs between specimens
SPREAD = {  # standard deviation of the logarithm of each parameter over specimens
    "mass": 0.02, "bending_stiffness": 0.07, "rest_curvature": 0.15, "gain": 0.05, "loss_time": 0.1, "slip_share": 0.2,
    "cap_mass": 0.1, "locking": 0.3,
}


@dataclass(frozen=True)
class ChamberParameters:
    """One pressure chamber: the part of the body that it covers, from `start` to `stop` (fractions of the length), and
    the factors that scale its bending moment (`gain`) and its axial force (`push`).

    The moment per pressure is `gain` times that of `RodParameters`. With a negative gain the chamber lies on the other
    side of the inextensible layer and bends the body the other way; its lever arm grows as the body bends that way. The
    axial force per pressure is `push` times the chamber's area: with 0 the body carries it, with 1 all of it lengthens
    the body.
    """

    name: str = "chamber"
    start: float = 0.0
    stop: float = 1.0
    gain: float = 1.0
    push: float = 0.0

    def __post_init__(self) -> None:
        """Raise InputError for impossible parameters of a chamber."""
        if not 0.0 <= self.start < self.stop <= 1.0:
            raise InputError(f"chamber {self.name!r} must cover a part of the body, 0 <= start < stop <= 1, "
                             f"got {self.start} to {self.stop}")
        if not np.isfinite(self.gain) or self.gain == 0.0:
            raise InputError(f"the gain of chamber {self.name!r} must be finite and not 0, got {self.gain}")
        if not (np.isfinite(self.push) and self.push >= 0.0):
            raise InputError(f"the push of chamber {self.name!r} must be finite and >= 0, got {self.push}")


PLAIN = (ChamberParameters(),)  # one chamber along the whole body
CHAMBERS = {
    "two_segment": (ChamberParameters("near", 0.0, 0.5), ChamberParameters("far", 0.5, 1.0, gain=0.85)),
    "antagonistic": (ChamberParameters("left"), ChamberParameters("right", gain=-0.85)),
    "lengthening": (ChamberParameters("left", push=1.0), ChamberParameters("right", gain=-0.85, push=1.0)),
}


@dataclass(frozen=True)
class RodParameters:
    """Parameters of a planar soft bending actuator: SI units, gauge pressure, positive bending about +z.

    Values are means along the body; `*_variation` is the standard deviation of a smooth random field relative to
    the mean (absolute, in 1/m, for the rest curvature). `seed` determines all random fields.

    The section is a stack of fibres from the inextensible base (height 0) to `section_height`, of
    ``mu (lam - lam^-3)`` each (``linear=True`` for ``M = EI kappa``); `locking` > 0 makes it stiffen as
    Gent's law does. The pressure's moment is ``p A d G (1 + gain_slope kappa)``, the derivative of a chamber
    volume. Hysteresis comes from Prony branches (fractions `prony_share` of EI, times `prony_time`)
    and from `slip_elements` Maxwell-slip elements at each vertex (in sum the fraction `slip_share` of EI), whose
    thresholds follow a Weibull law. With `two_sided` the fibres lie on both sides of the inextensible layer, from
    `-section_height` on.
    """

    seed: int = 0
    length: float = 0.17  # m
    mass: float = 0.069  # kg, of the bending part
    elements: int = 100
    bending_stiffness: float = 0.0335  # N m2
    stiffness_variation: float = 0.15
    rest_curvature: float = 3.1  # 1/m
    rest_variation: float = 1.6  # 1/m
    correlation_length: float = 0.022  # m
    end_stiffening: float = 0.35  # relative rise of EI and fall of the gain at both ends
    end_length: float = 0.008  # m
    chamber_area: float = 1.5708e-4  # m2, semicircle of radius 10 mm
    chamber_height: float = 4.2441e-3  # m, centroid above the flat face
    gain: float = 1.85  # moment over p A d: the base layer lies below the flat face
    gain_variation: float = 0.13
    gain_slope: float = 0.004  # m, the bladder bulges as it bends
    section_height: float = 0.014  # m
    locking: float = 0.25  # 1 / limit of the invariant
    linear: bool = False
    axial_stiffness: float = 2.0e4  # N, EA; so much of it that the middle layer does not stretch
    loss_time: float = 0.0036  # s, Kelvin-Voigt
    prony_share: tuple[float, ...] = (0.06, 0.05, 0.06)
    prony_time: tuple[float, ...] = (0.05, 0.6, 8.0)  # s
    slip_share: float = 0.10
    slip_elements: int = 15
    slip_scale: float = 4.0  # 1/m
    slip_shape: float = 1.4
    cap_mass: float = 0.006  # kg; 0 leaves the tip free
    cap_length: float = 0.03  # m along its arc
    cap_curvature: float = 50.0  # 1/m, above the body's operating range
    half_width: float = 0.005  # m, from the centreline to the surface that touches
    gravity: tuple[float, float] = (0.0, 0.0)  # m/s2 in the plane of bending
    tube_resistance: float = 2.0e7  # Pa s/m3, between the regulated supply and the chamber
    pushed_node: int = 0  # that the force of a load acts on; 0: the last
    two_sided: bool = False  # a section that is alike on both sides of the inextensible layer
    chambers: tuple[ChamberParameters, ...] = PLAIN

    def __post_init__(self) -> None:
        """Raise InputError for impossible parameters of a rod."""
        positive = ("length", "mass", "bending_stiffness", "axial_stiffness", "correlation_length",
                    "end_length", "slip_scale", "slip_shape", "cap_length")  # fmt: skip
        free = {"gravity", "rest_curvature", "gain_slope", "cap_curvature"}
        for field in fields(self):
            if field.name == "chambers":
                continue
            value = np.asarray(getattr(self, field.name), dtype=float)
            if not np.all(np.isfinite(value)):
                raise InputError(f"rod parameter {field.name} must be finite, got {getattr(self, field.name)}")
            if field.name in positive and value <= 0:
                raise InputError(f"rod parameter {field.name} must be > 0, got {value}")
            if field.name not in free and np.any(value < 0):
                raise InputError(f"rod parameter {field.name} must be >= 0, got {getattr(self, field.name)}")
        if self.pushed_node > self.elements + 1:
            raise InputError(f"pushed_node must be at most {self.elements + 1}, got {self.pushed_node}")
        if self.elements < 4:
            raise InputError(f"a rod needs at least 4 elements, got {self.elements}")
        if len(self.prony_share) != len(self.prony_time) or min(self.prony_time, default=1.0) <= 0:
            raise InputError("every Prony branch needs a fraction in prony_share and a time > 0 in prony_time")
        if not self.chambers or len({c.name for c in self.chambers}) != len(self.chambers):
            raise InputError(f"a rod needs at least one chamber, with different names, got {self.chambers}")

    def uniform(self, **changes: object) -> RodParameters:
        """Return a uniform linear rod without hysteresis, damping and cap, to compare with closed-form solutions."""
        plain = {"stiffness_variation": 0.0, "gain_variation": 0.0, "rest_variation": 0.0, "rest_curvature": 0.0,
                 "end_stiffening": 0.0, "linear": True, "gain_slope": 0.0, "loss_time": 0.0, "prony_share": (),
                 "prony_time": (), "slip_share": 0.0, "slip_elements": 0, "cap_mass": 0.0, "gain": 1.0,
                 "tube_resistance": 0.0}  # fmt: skip
        return replace(self, **(plain | changes))  # type: ignore[arg-type]


def actuator(name: str = "a") -> RodParameters:
    """Return the parameters of a named actuator: "a", "b" or "c" with one chamber; "two_segment", "antagonistic" or
    "lengthening" with two.

    For one chamber, means and random fields are drawn from the seed that belongs to the name. "two_segment" is actuator
    "a" with a chamber in each half. "antagonistic" is straight at rest, with a chamber along each side of the
    inextensible layer. "lengthening" is the same with a layer that stretches.

    Raises
    ------
    InputError
        For an unknown name.
    """
    if name in CHAMBERS:
        sides = {} if name == "two_segment" else {"two_sided": True, "rest_curvature": 0.0}
        soft = {"axial_stiffness": 200.0} if name == "lengthening" else {}
        return replace(actuator("a"), chambers=CHAMBERS[name], **sides, **soft)  # type: ignore[arg-type]
    if name not in ACTUATORS:
        raise InputError(f"unknown actuator {name!r}: use one of {', '.join((*ACTUATORS, *CHAMBERS))}")
    seed = ACTUATORS[name]
    draw = np.random.default_rng([seed, 2018]).standard_normal(8)
    base = RodParameters()
    drawn = {
        name: getattr(base, name) * float(np.exp(spread * part))
        for (name, spread), part in zip(SPREAD.items(), draw, strict=True)
    }
    return replace(base, seed=seed, **drawn)


class RodBody(NamedTuple):
    """Properties of the E edges, B bending vertices and V = E + 1 nodes of a discrete rod, as arrays (SI units)."""

    rest_length: Array  # (E,) m
    axial: Array  # (E,) N
    weight: Array  # (B,) m, length of body that belongs to a vertex
    stiffness: Array  # (B,) N m2
    rest_curvature: Array  # (B,) 1/m
    gain: Array  # (C, B) N m/Pa, of each chamber
    gain_slope: Array  # (C,) m
    thrust: Array  # (C, E) m2, tension per pressure that each chamber takes off each edge
    loss_time: float  # s
    fibre_height: Array  # (F,) m; empty: linear
    fibre_share: Array  # (F,) 1/m2, so that the initial slope is 1
    locking: float
    prony_share: Array  # (P,)
    prony_time: Array  # (P,) s
    slip_stiffness: Array  # (B, J) N m2
    slip_limit: Array  # (B, J) N m
    mass: Array  # (V,) kg, without the cap
    cap_mass: Array  # (4, 4) kg, on the last two nodes
    cap_weight: Array  # (4,) N
    gravity: Array  # (2,) m/s2
    contact_share: Array  # (V,)
    half_width: float  # m
    tube_resistance: float  # Pa s/m3
    pushed: int  # node that a load's force acts on


def random_field(s: Array, length: float, scale: float, seed: list[int]) -> Array:
    """Return a smooth random function at the arc lengths `s` [m], with zero mean and unit standard deviation.

    It is a sum of cosines and does not depend on the number of elements. `scale` is its correlation length [m].
    """
    rng = np.random.default_rng(seed)
    wave = rng.standard_normal(FEATURES) / scale
    phase = rng.uniform(0.0, 2.0 * np.pi, FEATURES)
    fine = np.linspace(0.0, length, 401)
    reference = np.cos(np.outer(fine, wave) + phase).sum(axis=1)
    values = np.cos(np.outer(s, wave) + phase).sum(axis=1)
    return np.asarray((values - reference.mean()) / reference.std())


def material_fields(p: RodParameters, s: Array) -> dict[str, Array]:
    """Return EI [N m2], moment per pressure [N m/Pa] and rest curvature [1/m] at the arc lengths `s` [m], in a dict."""
    ends = p.end_stiffening * (np.exp(-s / p.end_length) + np.exp(-(p.length - s) / p.end_length))
    noise = [random_field(s, p.length, p.correlation_length, [p.seed, k]) for k in range(3)]
    return {
        "stiffness": p.bending_stiffness * np.exp(p.stiffness_variation * noise[0]) * (1.0 + ends),
        "gain": p.chamber_area * p.chamber_height * p.gain * np.exp(p.gain_variation * noise[1]) / (1.0 + ends),
        "rest_curvature": p.rest_curvature + p.rest_variation * noise[2],
    }


def chamber_gains(p: RodParameters, gain: Array) -> Array:
    """Return the bending moment per pressure (C, B) [N m/Pa] of each of C chambers at each of B bending vertices.

    A vertex represents half an element on each side. A chamber that covers only part of this length acts with the
    covered fraction.
    """
    edge = np.arange(p.elements + 1) / p.elements
    middle = 0.5 * (edge[1:] + edge[:-1])
    low, high = np.append(0.0, middle), np.append(middle, 1.0)
    return np.array([c.gain * covered(c, low, high)[: gain.size] * gain for c in p.chambers])


def chamber_thrusts(p: RodParameters, edges: int) -> Array:
    """Return the axial force per pressure (C, E) [m2] of each of C chambers on each of E edges. It is scaled by the
    fraction of the edge's length that the chamber covers.
    """
    end = np.arange(p.elements + 1) / p.elements
    out = np.zeros((len(p.chambers), edges))
    out[:, : p.elements] = [c.push * p.chamber_area * covered(c, end[:-1], end[1:]) for c in p.chambers]
    return out


def covered(chamber: ChamberParameters, low: Array, high: Array) -> Array:
    """Return the fraction of each interval from `low` to `high` that the chamber covers.

    The interval ends are fractions of the body's length.
    """
    inside = np.minimum(high, chamber.stop) - np.maximum(low, chamber.start)
    return np.maximum(inside, 0.0) / (high - low)


def section_fibres(p: RodParameters) -> tuple[Array, Array]:
    """Return heights [m] and weights of Gauss points over the cross-section's height. The weights are scaled so that
    the initial bending stiffness is 1.
    """
    if p.linear:
        return np.empty(0), np.empty(0)
    node, share = np.polynomial.legendre.leggauss(6)
    height = p.section_height * node if p.two_sided else 0.5 * p.section_height * (1.0 + node)
    return height, share / (4.0 * np.sum(share * height**2))


def cap_terms(p: RodParameters) -> tuple[Array, Array]:
    """Return the mass matrix (4, 4) [kg] and the weight (4,) [N] of the rigid curved cap, for the coordinates x and y
    of the two nodes of its edge.

    A point of the cap is ``x_N + a e + b S e`` with the edge ``e`` and ``S`` a quarter turn, which is linear in both
    nodes.
    """
    node, share = np.polynomial.legendre.leggauss(12)
    arc = 0.5 * p.cap_length * (1.0 + node)
    turn = p.cap_curvature * arc
    along = np.sinc(turn / np.pi) * arc / CAP_EDGE
    across = np.sinc(turn / (2.0 * np.pi)) * np.sin(turn / 2.0) * arc / CAP_EDGE
    mass, weight = np.zeros((4, 4)), np.zeros(4)
    for a, b, w in zip(along, across, 0.5 * share * p.cap_mass, strict=True):
        edge = np.array([[a, -b], [b, a]])
        shape = np.hstack([np.eye(2) - edge, edge])
        mass += w * shape.T @ shape
        weight += w * shape.T @ np.asarray(p.gravity)
    return mass, weight


def node_position(p: RodParameters) -> Array:
    """Return the arc lengths (V,) [m] of the rod's V nodes at rest.

    If there is a cap, the last node is the far end of the cap's edge.
    """
    s = np.linspace(0.0, p.length, p.elements + 1)
    return np.append(s, p.length + CAP_EDGE) if p.cap_mass > 0 else s


def build_body(p: RodParameters) -> RodBody:
    """Discretise the rod into `p.elements` equal edges, plus one edge for the cap if there is one."""
    s = node_position(p)
    capped = p.cap_mass > 0
    step = p.length / p.elements
    vertices = s[:-1]
    weight = np.full(vertices.size, step)
    weight[0] = 0.5 * step
    if capped:
        weight[-1] = 0.5 * step
    fields = material_fields(p, vertices)
    slip_stiffness = np.outer(fields["stiffness"], np.full(p.slip_elements, p.slip_share / max(p.slip_elements, 1)))
    thresholds = slip_thresholds(vertices.size, p.slip_elements, scale=p.slip_scale, shape=p.slip_shape, seed=p.seed)
    mass = np.full(s.size, p.mass / p.elements)
    mass[0] *= 0.5
    mass[p.elements] *= 0.5
    mass[p.elements + 1 :] = 0.0
    cap_mass, cap_weight = cap_terms(p)
    height, share = section_fibres(p)
    axial = np.full(s.size - 1, p.axial_stiffness)
    axial[p.elements :] = max(p.axial_stiffness, CAP_STIFFNESS)
    touch = mass / p.mass * p.length / CONTACT_LENGTH
    if capped:
        touch[p.elements] += 1.0  # the cap's rim
    return RodBody(
        rest_length=np.diff(s), axial=axial, weight=weight,
        stiffness=fields["stiffness"], rest_curvature=fields["rest_curvature"], gain=chamber_gains(p, fields["gain"]),
        gain_slope=p.gain_slope * np.sign([c.gain for c in p.chambers]), thrust=chamber_thrusts(p, s.size - 1),
        loss_time=p.loss_time,
        fibre_height=height, fibre_share=share, locking=p.locking, prony_share=np.array(p.prony_share, dtype=float),
        prony_time=np.array(p.prony_time, dtype=float), slip_stiffness=slip_stiffness,
        slip_limit=slip_stiffness * thresholds, mass=mass, cap_mass=cap_mass, cap_weight=cap_weight,
        gravity=np.array(p.gravity, dtype=float), contact_share=touch, half_width=p.half_width,
        tube_resistance=p.tube_resistance, pushed=p.pushed_node or s.size - 1,
    )  # fmt: skip


def prony_decay(time: Array, dt: float) -> Array:
    """Return the coefficients (P, 3) for the exact update of P viscoelastic branches over a time step `dt` [s]. A
    branch with the input u and the state xi obeys ``xi' = (u - xi) / time``.

    The input `u` varies linearly from u0 to u1 over the step.

    Parameters
    ----------
    time : (P,) array, s
    dt : float, s

    Returns
    -------
    (P, 3) array
        ``xi1 = c0 xi0 + c1 u0 + c2 u1``.
    """
    x = dt / time
    keep = np.exp(-x)
    mean = -np.expm1(-x) / x
    return np.column_stack([keep, mean - keep, 1.0 - mean])


def slip_thresholds(vertices: int, elements: int, *, scale: float, shape: float, seed: int) -> Array:
    """Return the curvature changes [1/m] at which the slip elements of each vertex yield, drawn at random from a
    Weibull distribution.

    The draws are stratified: element j of every vertex lies in the j-th of `elements` equal parts of the distribution.
    The whole body then shows a continuous spectrum of thresholds.

    Returns
    -------
    (vertices, elements) array
    """
    rng = np.random.default_rng([seed, 15])
    level = (np.arange(elements) + rng.uniform(0.02, 0.98, (vertices, elements))) / max(elements, 1)
    return np.asarray(scale * (-np.log1p(-level)) ** (1.0 / shape))
