"""Convert rod parameters to the arrays of the discrete rod: material fields, lumped masses and the cap."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from pliant.testbed.memory import slip_thresholds

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from pliant.testbed.rod.parameters import ChamberParameters, RodParameters

CAP_EDGE = 0.01  # m, length of the edge that carries the rigid cap
CAP_STIFFNESS = 2.0e4  # N, EA of that edge at least: the cap does not stretch with the body
FEATURES = 64  # cosines of a random field
CONTACT_LENGTH = 0.005  # m of body over which an obstacle's stiffness is spread


class RodBody(NamedTuple):
    """Arrays of a discrete rod with E edges, B bending vertices and V = E + 1 nodes (SI units)."""

    rest_length: NDArray[np.float64]  # (E,) m
    axial: NDArray[np.float64]  # (E,) N
    weight: NDArray[np.float64]  # (B,) m, length of body that belongs to a vertex
    stiffness: NDArray[np.float64]  # (B,) N m2
    rest_curvature: NDArray[np.float64]  # (B,) 1/m
    gain: NDArray[np.float64]  # (C, B) N m/Pa, of each chamber
    gain_slope: NDArray[np.float64]  # (C,) m
    thrust: NDArray[np.float64]  # (C, E) m2, tension per pressure that each chamber takes off each edge
    loss_time: float  # s
    fibre_height: NDArray[np.float64]  # (F,) m; empty: linear
    fibre_share: NDArray[np.float64]  # (F,) 1/m2, so that the initial slope is 1
    locking: float
    prony_share: NDArray[np.float64]  # (P,)
    prony_time: NDArray[np.float64]  # (P,) s
    slip_stiffness: NDArray[np.float64]  # (B, J) N m2
    slip_limit: NDArray[np.float64]  # (B, J) N m
    mass: NDArray[np.float64]  # (V,) kg, without the cap
    cap_mass: NDArray[np.float64]  # (4, 4) kg, on the last two nodes
    cap_weight: NDArray[np.float64]  # (4,) N
    gravity: NDArray[np.float64]  # (2,) m/s2
    contact_share: NDArray[np.float64]  # (V,)
    half_width: float  # m
    tube_resistance: float  # Pa s/m3
    pushed: int  # node that a load's force acts on


def random_field(s: NDArray[np.float64], length: float, scale: float, seed: list[int]) -> NDArray[np.float64]:
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


def material_fields(p: RodParameters, s: NDArray[np.float64]) -> dict[str, NDArray[np.float64]]:
    """Return EI [N m2], moment per pressure [N m/Pa] and rest curvature [1/m] at the arc lengths `s` [m], in a dict."""
    ends = p.end_stiffening * (np.exp(-s / p.end_length) + np.exp(-(p.length - s) / p.end_length))
    noise = [random_field(s, p.length, p.correlation_length, [p.seed, k]) for k in range(3)]
    return {
        "stiffness": p.bending_stiffness * np.exp(p.stiffness_variation * noise[0]) * (1.0 + ends),
        "gain": p.chamber_area * p.chamber_height * p.gain * np.exp(p.gain_variation * noise[1]) / (1.0 + ends),
        "rest_curvature": p.rest_curvature + p.rest_variation * noise[2],
    }


def chamber_gains(p: RodParameters, gain: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the bending moment per pressure (C, B) [N m/Pa] of each chamber at each bending vertex.

    A vertex represents half an element on each side. A chamber that covers only part of this length acts with the
    covered fraction.
    """
    edge = np.arange(p.elements + 1) / p.elements
    middle = 0.5 * (edge[1:] + edge[:-1])
    low, high = np.append(0.0, middle), np.append(middle, 1.0)
    return np.array([c.gain * covered(c, low, high)[: gain.size] * gain for c in p.chambers])


def chamber_thrusts(p: RodParameters, edges: int) -> NDArray[np.float64]:
    """Return the axial force per pressure (C, E) [m2] of each chamber on each edge, scaled by the covered fraction."""
    end = np.arange(p.elements + 1) / p.elements
    out = np.zeros((len(p.chambers), edges))
    out[:, : p.elements] = [c.push * p.chamber_area * covered(c, end[:-1], end[1:]) for c in p.chambers]
    return out


def covered(
    chamber: ChamberParameters, low: NDArray[np.float64], high: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the fraction of each interval from `low` to `high` that the chamber covers.

    The interval ends are fractions of the body's length.
    """
    inside = np.minimum(high, chamber.stop) - np.maximum(low, chamber.start)
    return np.maximum(inside, 0.0) / (high - low)


def section_fibres(p: RodParameters) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return heights [m] and weights of the section's fibres at Gauss points, scaled to unit initial stiffness."""
    if p.linear:
        return np.empty(0), np.empty(0)
    node, share = np.polynomial.legendre.leggauss(6)
    height = p.section_height * node if p.two_sided else 0.5 * p.section_height * (1.0 + node)
    return height, share / (4.0 * np.sum(share * height**2))


def cap_terms(p: RodParameters) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return mass matrix (4, 4) [kg] and weight (4,) [N] of the rigid curved cap, on the two nodes of its edge.

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


def node_position(p: RodParameters) -> NDArray[np.float64]:
    """Return the arc lengths (V,) [m] of the nodes at rest.

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
