"""Conversion of a model to rigid bodies joined by hinges and slides, in the plane or in space, for MJCF and URDF.

In a plane a joint is one hinge about z. In space, a bending rotation vector becomes a hinge about x and one about y,
and a twist becomes a hinge about z. Two successive hinges equal the rotation vector except for a twist of half the
product of their angles. In the second and third of every four joints the order of the hinges is reversed, so that these
twists cancel along the body.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import NamedTuple

import numpy as np

from pliant.errors import SimulationError
from pliant.mechanics import Mechanics, PlanarChain, SpatialChain, mechanics_of
from pliant.mechanics.springs import springs_of
from pliant.model import Model, Station
from pliant.simulation.state import equilibrium, first_alone, typical_pressure

Array = np.ndarray
TINY = 1e-12  # kg m^2, inertia of a mass that is a point in pliant
LIGHT = 1e-9  # kg, mass of a body that has none in pliant
FIRST = 1e-4  # mass at the first joint, in parts of the first link's, where all mass is at the link tips
ON = 1e-9  # distance, in parts of the link's length, within which a point is on a body
DIRECTIONS = 37  # of a bend, over half a turn
STEP, ROUNDS = 1e-6, 20  # rad, for differences of energies; iterations for the rest of a chain of hinges
BEND = 0.5  # rad, bend of the whole body at which hinges are compared with rotation vectors


class Hinge(NamedTuple):
    """One hinge of a joint: axis, spring and damper. Its angle is 0 in the rest shape."""

    name: str
    axis: Array  # (3,)
    row: int  # index of the model's coordinate
    link: int
    springs: Array  # (k,) coefficients of the torque K q + K2 q^2 + ..., N m/rad, N m/rad^2, ...
    stiffness: float  # N m/rad, the first coefficient
    damping: float  # N m s/rad


class Slide(NamedTuple):
    """A point mass that slides along a link when the link lengthens."""

    name: str
    place: float  # m, from the joint of the link, unstretched
    step: float  # m, from the body that carries it, unstretched
    growth: Array  # (S,) m, of the step for a unit of each strain
    mass: float  # kg


class RigidLink(NamedTuple):
    """One rigid link: its pose in the frame of the previous link, its hinges, mass and inertia."""

    place: Array  # (3,) m
    turn: Array  # (3,) rotation vector of the rest shape, rad
    hinges: tuple[Hinge, ...]  # in the order from the base
    mass: float  # kg
    centre: float  # m, centre of mass, from the joint along the link
    across: float  # kg m^2, moment of inertia about the centre of mass, across the link
    along: float | None  # kg m^2, about the link's axis; None in a plane
    length: float  # m
    slides: tuple[Slide, ...] = ()  # each carries the next, the last one the next link; none where it does not lengthen


class RigidChain(NamedTuple):
    """An actuator as a chain of rigid links on a base part, with gravity."""

    tangent: Array  # (3,) direction of a link in its own frame
    base_turn: Array  # (3,) rotation vector of the base part before the first joint, rad
    base_length: float  # m
    links: tuple[RigidLink, ...]
    gravity: Array  # (3,) m/s^2
    base_slides: tuple[Slide, ...] = ()

    @property
    def slides(self) -> tuple[Slide, ...]:
        """All slides of the chain, from base to tip."""
        return (*self.base_slides, *(slide for link in self.links for slide in link.slides))

    @property
    def growth(self) -> Array:
        """Displacements (K, S) [m] of the chain's K slides for a unit strain of each of its S extensible segments."""
        return np.array([slide.growth for slide in self.slides])

    @property
    def strain_of_slides(self) -> Array:
        """Matrix (S, K) [1/m] that gives the S segment strains from the displacements [m] of the K slides, as weighted
        means.
        """
        growth = self.growth
        weight = growth.T / growth.sum(axis=1)
        return np.asarray(np.linalg.solve(weight @ growth, weight))

    def start(self, i: int) -> Array:
        """Return the position (3,) [m] of joint i in the frame of the body that carries it."""
        slides = self.links[i - 1].slides if i else self.base_slides
        return np.zeros(3) if slides else self.links[i].place

    @property
    def hinges(self) -> tuple[Hinge, ...]:
        """All hinges of the chain, from base to tip."""
        return tuple(hinge for link in self.links for hinge in link.hinges)


def rigid_chain(model: Model) -> RigidChain:
    """Return the rigid bodies, hinges and slides that represent a model."""
    turns, tangent = mechanics_of(model).rest_turns, mechanics_of(model).base_tangent
    masses, centre, across, along = mechanics_of(model).link_inertias()
    hinges = HINGES[type(mechanics_of(model))](model)
    starts = [model.base_length, *model.link_length[:-1]]
    links = tuple(
        RigidLink(
            starts[i] * tangent, turns[i + 1], tuple(h for h in hinges if h.link == i), float(masses[i]),
            float(centre[i]), max(float(across[i]), TINY), along if along is None else max(float(along[i]), TINY),
            float(model.link_length[i]),
        )
        for i in range(model.n)
    )
    chain = RigidChain(tangent, turns[0], model.base_length, links, np.resize([*model.gravity, 0.0], 3))
    return lengthening(model, chain) if mechanics_of(model).lengthens else chain


def lengthening(model: Model, chain: RigidChain) -> RigidChain:
    """Return the chain with slides on its extensible links, and one at the end of an extensible base. Most of an
    extensible link's mass is moved to its slides. The rest stays at its joint.
    """
    share, links = model.stretch_share, []
    for i, link in enumerate(chain.links):
        rod, cap = float(model.link_mass[i]), model.tip_mass * (i + 1 == model.n)
        parts = [("middle", 0.5, rod * 2.0 / 3.0), ("end", 0.5, rod / 6.0 + cap)]
        if model.mass_at == "tip":
            parts = [("end", 1.0, rod + cap)]
        slides, distance = [], 0.0
        for name, part, mass in parts if share[i + 1].any() else ():
            distance += part * link.length
            step = part * link.length
            slides.append(Slide(f"link_{i + 1}_{name}", distance, step, step * share[i + 1], max(mass, LIGHT)))
        moved = link
        if slides:
            at_joint = rod / 6.0 if model.mass_at == "rod" else FIRST * rod if i == 0 else LIGHT
            turning = model.tip_inertia * (i + 1 == model.n) if link.along is None else 0.5 * link.along
            across = max(turning, TINY)
            moved = link._replace(mass=at_joint, centre=0.0, across=across, slides=tuple(slides))
        links.append(moved)
    length = model.base_length
    base = (Slide("base_end", length, length, length * share[0], LIGHT),) if share[0].any() else ()
    return chain._replace(links=tuple(links), base_slides=base)


def carrier_of(model: Model, chain: RigidChain, point: Station) -> tuple[str, Array, Slide | None]:
    """Return the name of the body that carries an observed point, the point's position (3,) [m] in the frame of this
    body, and the slide that must be added for the point, or None.

    A point at the joint of a link that lengthens, in its middle or at its end moves with a body that is there; any
    other gets a slide of its own, which the body at the joint carries.
    """
    body, position = f"link_{point.link + 1}" if point.link >= 0 else "base", mechanics_of(model).offset(point)
    slides = chain.base_slides if point.link < 0 else chain.links[point.link].slides
    aside = position - point.along * chain.tangent
    if not slides or abs(point.along) <= ON * slides[-1].place:
        return body, position, None
    for slide in slides:
        if abs(point.along - slide.place) <= ON * slide.place:
            return slide.name, aside, None
    growth = point.along * model.stretch_share[point.link + 1]
    return body, aside, Slide(f"point_{point.name}", point.along, point.along, growth, LIGHT)


def planar_hinges(model: Model) -> list[Hinge]:
    """Return the hinges of all joints of a planar model, from base to tip."""
    chain, powers = mechanics_of(model), springs_of(model).powers
    return [hinge(chain, i, 2, i)._replace(springs=np.trim_zeros(powers[:, i], "b")) for i in range(model.n)]


def spatial_hinges(model: Model) -> list[Hinge]:
    """Return the hinges of all joints of a model in space, from base to tip.

    Each joint has a hinge about x, then y; in the second and third of every four joints y comes before x.
    """
    chain, n = SpatialChain(model), model.n
    rows = []
    for i in range(n):
        rows += [hinge(chain, 2 * i + axis, axis, i) for axis in ((1, 0) if i % 4 in (1, 2) else (0, 1))]
        rows += [hinge(chain, 2 * n + i, 2, i)] if chain.space.turns == 3 else []
    return rows


HINGES: dict[type[Mechanics], Callable[[Model], list[Hinge]]] = {
    PlanarChain: planar_hinges, SpatialChain: spatial_hinges,
}


def hinge(chain: Mechanics, row: int, axis: int, link: int) -> Hinge:
    """Return a hinge with a linear spring, whose angle is the joint coordinate with the index `row`. It turns about the
    axis 0, 1 or 2 (x, y or z).
    """
    K, D = float(chain.joints.K[row]), float(chain.joints.D[row])
    return Hinge(chain.joint_names[row], np.eye(3)[axis], row, link, np.array([K]), K, D)


def moments(chain: RigidChain, link: RigidLink, size: float) -> Array:
    """Return the moments of inertia (3,) [kg m^2] of a link about the x, y and z axes of its frame.

    In a plane, the moment along the link is that of a rod of radius `size` [m].
    """
    along = max(min(0.5 * link.mass * size**2, 2.0 * link.across), TINY) if link.along is None else link.along
    return np.where(chain.tangent > 0, along, link.across)


def points_by_hinges(chain: RigidChain, x: Array, along: Sequence[float]) -> list[Array]:
    """Return a point (3,) [m] on each link of a chain of hinges, at the distance `along` [m] from its joint. The angles
    of the hinges are `x` (N,) [rad], in the order of the model's N joint coordinates.
    """
    from scipy.spatial.transform import Rotation

    turn, position, points = Rotation.from_rotvec(chain.base_turn), np.zeros(3), []
    for link, distance in zip(chain.links, along, strict=True):
        position = position + turn.apply(link.place)
        turn = turn * Rotation.from_rotvec(link.turn)
        for hinge in link.hinges:
            turn = turn * Rotation.from_rotvec(x[hinge.row] * hinge.axis)
        points.append(np.asarray(position + turn.apply(distance * chain.tangent)))
    return points


def tip_by_hinges(chain: RigidChain, x: Array) -> Array:
    """Return the tip position (3,) [m] of a chain of hinges with the angles `x` (N,) [rad]."""
    return points_by_hinges(chain, x, [link.length for link in chain.links])[-1]


def hinge_difference(model: Model) -> float:
    """Return the largest distance [m] between the tips of a model and of its chain of hinges at rest, when the body is
    bent by half a radian: evenly in any direction, at equal joint coordinates, and by each input alone, under gravity.
    """
    chain, hinges = mechanics_of(model), rigid_chain(model)
    swings = 2 * model.n
    each = [np.append(evenly(model.n, a), np.zeros(model.size - swings)) for a in np.linspace(0.0, np.pi, DIRECTIONS)]
    pairs = [(x, x) for x in each] + [(-x, -x) for x in each]
    for c in range(model.actuation.count):
        level = first_alone(model, typical_pressure(model, c), c)
        with suppress(SimulationError):
            x = equilibrium(model, level)
            x[model.size - len(model.extensions) :] = 0.0  # the hinges are compared, not the slides
            pairs.append((x, rest_of_hinges(model, hinges, x, model.actuation.joint_torques(level))))
    return max(float(np.linalg.norm(tip_by_hinges(hinges, other) - chain.tips(x)[-1])) for x, other in pairs)


def evenly(n: int, direction: float) -> Array:
    """Return the swing angles (2 n,) [rad] of n joints that bend evenly by half a radian in total, about the axis at
    the angle `direction` [rad] from x towards y.
    """
    return np.tile(BEND / n * np.array([np.cos(direction), np.sin(direction)]), n)


def rest_of_hinges(model: Model, hinges: RigidChain, x: Array, torque: Array) -> Array:
    """Return the joint coordinates (N,) at which the chain of hinges rests under the inputs `torque` (N + R,). The body
    rests at x (N,).

    Springs and inputs give the same torques in both chains, the weight does not. By Newton's method with the slope of
    the body's forces.
    """
    if mechanics_of(model).lengthens or not model.gravity.any():
        return x
    chain, moved = mechanics_of(model), x.copy()
    steps = STEP * np.eye(model.size)
    for _ in range(ROUNDS):
        still = np.zeros(model.size)
        lifted = [
            [by_hinges(hinges, moved + s) - float(chain.energy(moved + s, still).gravity) for s in (step, -step)]
            for step in steps
        ]
        left = chain.static_forces(moved, torque) - np.array([(up - down) / (2.0 * STEP) for up, down in lifted])
        moved = moved - np.linalg.solve(chain.static_slope(moved, torque=torque), left)
    return moved


def by_hinges(chain: RigidChain, x: Array) -> float:
    """Return the potential energy [J] of the weight of a chain of hinges at the joint coordinates x (N,)."""
    centres = points_by_hinges(chain, x, [link.centre for link in chain.links])
    return -sum(link.mass * float(chain.gravity @ centre) for link, centre in zip(chain.links, centres, strict=True))
