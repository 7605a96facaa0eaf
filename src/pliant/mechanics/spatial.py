"""Mechanics of chains in space, whose coordinates are two swing angles of each joint, optional twist angles, and
strains.

The coordinates x (N,) are (a_1, b_1 ... a_n, b_n), then the twists [rad].

Strains (S,) of segments that lengthen follow.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property, lru_cache
from typing import Any, ClassVar

import numpy as np

from pliant.compiler.choose import MOST_TURNS, twin
from pliant.compiler.trace import CURVED, FRICTION, TURNS, spatial_workspace, spring_rows
from pliant.equations import spatial, spatial_points, spatial_springs, tendon
from pliant.equations.elastic import LEAST_STRETCH
from pliant.equations.observation import ALONG_X, ALONG_Y, ALONG_Z
from pliant.equations.poses import ROUNDS, settle
from pliant.equations.symbols import SpatialBody, SpatialHeld, SpatialJoints, SpatialWorkspace
from pliant.errors import SimulationError
from pliant.mechanics import springs
from pliant.mechanics.complex_slopes import TINY, of_kind
from pliant.mechanics.contract import Mechanics
from pliant.mechanics.lengths import check_lengths, input_length
from pliant.mechanics.naming import SpatialNaming
from pliant.mechanics.reaction import BaseTwist, spatial_reaction
from pliant.mechanics.records import Energy
from pliant.mechanics.rest import BUCKLES, GROWING, settling
from pliant.model import Model, Station
from pliant.model.extensible import tied_joints

Array = np.ndarray


class SpatialChain(SpatialNaming, Mechanics):
    """Kinematics, forces and energies of a chain of n rigid links in space, with S >= 0 segments that lengthen.

    The base tangent is +z.

    Its coordinates x equal its joint coordinates: the `turns` angles of the joints, then the strains.
    """

    dimension, row_width = 3, 5
    base_tangent = np.array([0.0, 0.0, 1.0])
    outputs: ClassVar = {"tip_x": ALONG_X, "tip_y": ALONG_Y, "tip_z": ALONG_Z}

    @cached_property
    def turns(self) -> int:
        """Number of joint angles: 2 n for n joints that swing in two directions, 3 n if they also twist."""
        return self.size - len(self.model.extensions)

    @cached_property
    def length(self) -> Array:
        """Unstretched lengths (n + 1,) [m] of the rigid part before the first joint and of the n links."""
        return np.append(self.model.base_length, self.model.link_length)

    # arguments of the kernels

    @property
    def shape_constants(self) -> dict[str, Any]:
        space = self.space
        twist = {"twist_ratio": space.twist_ratio} if space.turns == 3 else {}
        return {"rest_turn": space.rest_of(self.n), "base_tilt": space.base_tilt, "radius": space.radius,
                "stiffness_ratio": space.stiffness_ratio, "tied": self.joints.tied, **twist}  # fmt: skip

    @cached_property
    def body(self) -> SpatialBody:
        model, space = self.model, self.space
        gx, gy, gz = (float(g) for g in model.gravity)
        rest = np.array([rotation(v) for v in space.rest_of(self.n)])
        base = rotation(space.base_tilt)
        tendons = model.actuation.levers, self._chords(), *model.actuation.tendon_constants, self._beyond()
        behind = *tendons, np.array(model.stretch_share), np.zeros((2 if model.moving_base else 0, 3))
        return SpatialBody(self.length, *self.link_inertias(), rest, base, gx, gy, gz, *behind)

    def _chords(self) -> Array:
        """Return the coefficients (R, N) [m] of squares of the coordinates in the paths of R tendons between guides."""
        if not (chords := self.model.actuation.chords).any():
            return np.zeros((len(chords), self.size))
        at = np.cumsum(self.length)[:-1]
        ends = 0.5 * (at[1:] + at[:-1]) if self.model.base_length else at[1:]
        bent = np.diff([0.0, *ends, self.length.sum()])  # length that each joint bends
        rows = [self.each_coordinate(row, row, 0.0 * row) for row in self.model.actuation.chords / bent]
        return np.pad(np.reshape(rows, (-1, self.turns)), ((0, 0), (0, self.size - self.turns)))

    def _beyond(self) -> Array:
        """Return the fraction (N, n + 1) of each coordinate's path length that lies beyond the entry into the body,
        which is all of it, and beyond the middle of each joint's arc.

        The path length of an angle lies evenly along its joint's arc, that of a strain along its segment.
        """
        along = self.length[:, None] * self.model.stretch_share
        strains = np.cumsum(along[::-1], axis=0)[-2::-1] / along.sum(axis=0)
        return np.concatenate([beyond_joints(self.n, self.space.turns), np.insert(strains.T, 0, 1.0, axis=1)])

    @cached_property
    def joints(self) -> SpatialJoints:
        law, ratio, twist = springs.springs_of(self.model), self.space.stiffness_ratio, self.space.twist_ratio
        rows = spring_rows(self.laws)
        axial = np.reshape([(e.stiffness, e.damping) for e in self.model.extensions], (-1, 2)).T
        pairs = zip((self.model.stiffness, self.model.damping), axial * self.model.segment_length, strict=True)
        K, D = (np.append(self.each_coordinate(v, ratio * v, twist * v), strains) for v, strains in pairs)
        terms = np.array([self.each_coordinate(row, 0.0 * row, 0.0 * row) for row in law.hardening[:rows]])
        tied = np.zeros((self.n, 0))
        if self.laws & CURVED:
            terms = np.concatenate([terms, springs.axial_springs_of(self.model).hardening[:rows]], axis=1)
            tied = tied_joints(self.model)
        return SpatialJoints(0.0, np.zeros(self.size), K, D, terms, np.zeros(self.n), np.zeros((0, 3)), tied)

    def each_coordinate(self, x: Array, y: Array, twist: Array) -> Array:
        """Return one array of values in the order of the joint angles, from values (n,) for swings about x, for swings
        about y, and for twists.
        """
        values = np.stack([x, y], axis=-1).ravel()
        return np.append(values, twist) if self.space.turns == 3 else values

    def workspace(self, kind: type = float) -> SpatialWorkspace:
        _, segments, turns, tendons, _ = self.sizes
        return spatial_workspace(self.n, turns, segments, tendons, kind)

    @property
    def observed(self) -> SpatialBody:
        return self.body

    def placed_links(self) -> SpatialWorkspace:
        return self.workspace()

    def acceleration(self) -> Any:
        return twin(tendon.accelerate)

    @property
    def simd(self) -> str:
        iterated = self.model.memory or self.model.moving_base or self.model.actuation.tendons
        return "" if iterated or self.size > MOST_TURNS else "space"

    @property
    def sizes(self) -> tuple[int, ...]:
        laws = self.laws + TURNS * self.model.moving_base + FRICTION * bool(self.model.memory)
        return self.n, len(self.model.extensions), self.space.turns, len(self.model.actuation.levers), laws

    def coordinates(self, q: Array) -> Array:
        return np.array(q, dtype=float)

    def joint_coordinates(self, x: Array) -> Array:
        return x

    def joint_angles(self, x: Array) -> Array:
        """Return the sizes (..., n) [rad] of the joints' swings, by which their springs soften or stiffen, at
        coordinates x (..., N).

        `spatial_springs.swing_size` does the same in a time step.
        """
        a, b = x[..., 0 : 2 * self.n : 2], x[..., 1 : 2 * self.n : 2]
        return np.hypot(a, np.sqrt(self.space.stiffness_ratio) * b)

    def rates(self, dq: Array) -> Array:
        return np.array(dq, dtype=float)

    def joint_rates(self, v: Array) -> Array:
        return v

    @cached_property
    def to_joints(self) -> Array:
        return np.eye(self.size)

    @cached_property
    def from_joints(self) -> Array:
        return np.eye(self.size)

    @cached_property
    def stuck_stiffness(self) -> Array:
        K, turns, memory = self.joints.K, self.turns, self.model.memory
        return np.append(K[:turns] * memory.instantaneous, K[turns:] * memory.axial.instantaneous)

    @property
    def remembering(self) -> int:
        return self.size if self.model.memory.has_axial else self.turns

    def held(self) -> SpatialHeld:
        size, m = self.size, self.remembering
        line = np.zeros((m, 3))
        springs = self.joints._replace(theta0=np.zeros(size), line=line)
        return SpatialHeld(np.zeros(size), np.zeros(size), np.zeros(m), line, springs)

    def total_bend(self, q: Array) -> float:
        return float(np.linalg.norm(q[: 2 * self.n].reshape(-1, 2).sum(axis=0)))

    def with_rest_shape(self, q: Array, tips: Array) -> Model:
        """Return the model with other rest rotations, such that its n link tips are at `tips` (n, 3) [m] at the joint
        coordinates q (N,). Each changes as little as possible, because tips do not show twist.
        """
        from scipy.spatial.transform import Rotation

        R, turns = self.posed(q).R, self.space.rest_of(self.n)
        whole = R[0]
        for k, direction in enumerate(np.diff(tips, axis=0, prepend=self.nodes(q)[None, 1])):
            turn = R[k].T @ R[k + 1]  # the rest turn, and the joint's turn behind it
            before, after = turn[:, 2], whole.T @ (direction / np.linalg.norm(direction))
            axis = np.cross(before, after)
            size = float(np.linalg.norm(axis))
            more = rotation(axis * (np.arctan2(size, before @ after) / size if size else 0.0))
            turns[k] = Rotation.from_matrix(more @ rotation(turns[k])).as_rotvec()
            whole = whole @ more @ turn
        return self.model.with_(space=replace(self.space, rest_turn=turns))

    # positions

    def posed(self, x: Array) -> SpatialWorkspace:
        """Return scratch arrays with the positions and orientations of the links at the coordinates x (..., N). The
        leading axes of x come last in these arrays.

        x may be complex.
        """
        work = self._scratch(x)
        spatial.pose_links(np.moveaxis(x, -1, 0), self.body, work)
        return work

    def _scratch(self, x: Array) -> SpatialWorkspace:
        """Return scratch arrays for coordinates x (..., N), with the leading axes of x last."""
        moments = x.shape[:-1]
        return SpatialWorkspace(*(np.zeros((*a.shape, *moments), dtype=x.dtype) for a in self.workspace()))

    def stretches(self, x: Array) -> Array:
        return np.asarray(1.0 + x[..., self.turns :] @ self.body.share.T)

    def link_frames(self, x: Array) -> Array:
        return from_back(self.posed(x).R, 3)

    def turning_moments(self, x: Array, arm: Array, force: Array) -> Array:
        """Return the moments [N m] about all joint axes of K forces at each of P points, at T instants: an array (T, P,
        K, joint axes).

        `Mechanics.turning_moments` describes the arguments.

        Each is s . (a x f), with the axis s of a turn and the arm a from its joint.
        """
        axes, n = from_back(self.posed(x).S, 2), self.n
        joint = np.append(np.repeat(np.arange(n), 2), np.tile(np.arange(n), self.turns // n - 2))
        moment = np.cross(arm[:, :, None], np.swapaxes(force, 2, 3)[:, :, :, None])  # (T, P, K, n, 3)
        return np.einsum("tia,tpkia->tpki", axes, moment[:, :, :, joint])

    def directions(self, x: Array) -> Array:
        return self.link_frames(x)[..., 2]

    def tips(self, x: Array) -> Array:
        return self.nodes(x)[..., 2:, :]

    def nodes(self, x: Array) -> Array:
        work = self.posed(x)
        last = work.r[-1] + work.length[-1] * work.R[-1, :, 2]
        return from_back(np.concatenate([work.r, last[None]]), 2)

    def stations(self, x: Array, tips: Array | None = None) -> tuple[Array, Array]:  # noqa: ARG002  of the interface
        """Return positions (..., S, 3) [m] of the S observed points, and angles (..., S) [rad] of
        their links from +z.
        """
        work, points = self.posed(x), self.model.points
        position = np.zeros((len(points), 3, *x.shape[:-1]), dtype=x.dtype)
        for point, coordinates in zip(points, position, strict=True):
            spatial_points.point_position(point.link, point.aside, point.across, point.along, work, coordinates)
        z = work.R[[point.link + 1 for point in points], :, 2]
        return from_back(position, 2), from_back(np.arctan2(np.hypot(z[:, 0], z[:, 1]), z[:, 2]), 1)

    def position_jacobian(self, x: Array, point: Station) -> Array:
        work, moments = self.posed(x), x.shape[:-1]
        position, J = np.zeros((3, *moments), dtype=x.dtype), np.zeros((3, self.size, *moments), dtype=x.dtype)
        spatial_points.point_position(point.link, point.aside, point.across, point.along, work, position)
        spatial_points.point_slope(point.link, point.along, position, self.body, work, J)
        return from_back(J, 2)

    def points_and_slopes(self, x: Array, work: Any = None) -> tuple[Array, Array]:
        points = self.model.points
        positions, slope = np.zeros((len(points), 3)), np.zeros((len(points), 3, self.size))
        offset = np.array([(p.aside, p.across, p.along) for p in points], dtype=float)
        link = np.array([p.link for p in points])
        work = self.workspace() if work is None else work
        twin(spatial_points.place_points)(x, link, offset, self.body, work, positions, slope)
        return positions, slope

    def beside_links(self, x: Array, points: Array, lengths: Any = None) -> Array:  # noqa: ARG002  of the interface
        work = self.posed(x)
        inner = np.einsum("kji,pkj->pki", work.R, points[:, None] - work.r)
        return np.stack([inner[..., 2] / work.stretch, -inner[..., 1], inner[..., 0]], axis=-1)

    def tip_jacobian(self, x: Array, v: Array) -> tuple[Array, Array]:
        rows = self.position_jacobian(x + 1j * TINY * v, Station("", self.n - 1, float(self.length[-1])))
        return rows.real, rows.imag / TINY

    # forces and energies

    def lateral_force(
        self, frame: Array, tangent: Array, force: Array, covariance: Array,
    ) -> tuple[float, float, Array]:
        size = float(np.linalg.norm(force[:2]))
        towards = force[:2] / max(size, 1e-300)
        across = frame[:, :2] @ force[:2]
        across -= (across @ tangent) * tangent
        deviation = float(np.sqrt(towards @ covariance[:2, :2] @ towards))
        return size, deviation, across / max(float(np.linalg.norm(across)), 1e-300)

    def inertia(self, x: Array) -> Array:
        work, M = self.posed(x), np.zeros((self.size, self.size))
        spatial.inertia(0.0, self.body, work, M)
        return np.asarray(M + np.tril(M, -1).T)

    def energy(self, x: Array, v: Array) -> Energy:
        work, x, v = self._scratch(x), x.T, v.T
        return Energy(
            spatial_points.kinetic_energy(x, v, self.body, work), spatial_springs.elastic_energy(x, self.joints),
            spatial_points.gravity_energy(x, self.body, work),
        )

    def no_loads(self) -> Array:
        return np.zeros((self.n + 1, 3, 5))

    def link_inertias(self) -> tuple[Array, Array, Array, Array]:
        """Return mass [kg], centre of mass [m], lateral and axial moment of inertia [kg m^2] of n uniform round rods,
        each (n,).

        The values of the last link include the tip mass and its inertia, those of a flat disc, whose thickness does
        not grow with the link.
        """
        model, radius, length, mass = self.model, self.space.radius, self.model.link_length, self.model.link_mass
        centre, lateral, axial = 0.5 * length, mass * (length**2 / 12.0 + radius**2 / 4.0), 0.5 * mass * radius**2
        rod, total = mass[-1], mass[-1] + model.tip_mass
        lateral[-1] += rod * model.tip_mass / total * (length[-1] - centre[-1]) ** 2
        centre[-1] = (rod * centre[-1] + model.tip_mass * length[-1]) / total
        lateral[-1] += model.tip_inertia
        axial[-1] += 2.0 * model.tip_inertia
        return np.append(mass[:-1], total), centre, lateral, axial

    def offset(self, point: Station) -> Array:
        return np.array([point.aside, -point.across, point.along])

    def link_loads(self, points: list[Station], forces: Array) -> Array:
        total = np.zeros((len(forces), *self.no_loads().shape))
        for f, p in enumerate(points):
            total[:, p.link + 1] += forces[:, f, :, None] * np.append(self.offset(p), [1.0, 0.0])
        return total

    def uniform_loads(self, field: Array) -> Array:
        total = np.zeros((len(field), *self.no_loads().shape))
        weight = self.body.mass[:, None] * field[:, None]
        total[:, 1:, :, 2], total[:, 1:, :, 3] = self.body.centre[:, None] * weight, weight
        return total

    @property
    def rest_turns(self) -> Array:
        return np.concatenate([[self.space.base_tilt], self.space.rest_of(self.n)])

    def with_own_base(self) -> SpatialChain:
        return self.with_constants(self.body._replace(spin=np.zeros((2, 3))), self.joints)

    def base_weight(self, base: BaseTwist) -> Array:
        return base.gravity - base.acceleration

    def reaction(self, x: Array, v: Array, a: Array, base: BaseTwist) -> tuple[Array, Array]:
        return spatial_reaction(self, x, v, a, base)

    def load_forces(self, x: Array, load: Array) -> Array:
        kind = np.result_type(x, load, self.body.base, self.body.rest, self.length)
        forces = np.zeros(self.size, dtype=kind)
        work = SpatialWorkspace(*(np.zeros(a.shape, dtype=kind) for a in self.workspace()))
        spatial.pose_links(x, self.body, work)
        spatial_points.add_pose_loads(load, self.body, work, forces)
        return forces

    def load_stiffness(self, x: Array, load: Array) -> Array:
        return self._slope(lambda moved: self.load_forces(moved, load), x)

    def static_forces(self, x: Array, torque: Array) -> Array:
        check_lengths(self, x=x, torque=torque)
        body, joints, pose, inputs = (of_kind(value, complex) for value in (self.body, self.joints, x, torque))
        found = settling(0, self.size, torque.size, self.no_loads())._replace(at=pose, last=pose)
        twin(settle)(inputs, body, joints, self.workspace(complex), found, found.K[0], 0)  # the kernel of `equilibrium`
        real = not any(np.iscomplexobj(value) for value in (x, torque, *self.body, *self.joints))
        return found.push.real if real else found.push

    def static_slope(self, x: Array, load: Array | None = None, torque: Array | None = None) -> Array:
        still = np.zeros(input_length(self)) if torque is None else torque
        slope = self._slope(lambda moved: self.static_forces(moved, still), x)
        return slope if load is None else slope + self.load_stiffness(x, load)

    def _slope(self, forces: Any, x: Array) -> Array:
        """Return the derivative (N, N) of generalised forces by x, by complex steps.

        It is symmetric, because the forces have a potential.
        """
        rows = np.array([forces(x + 1j * TINY * row).imag / TINY for row in np.eye(self.size)])
        return 0.5 * (rows + rows.T)

    def equilibrium(self, torque: Array, tip_force: Array, link_load: Array | None) -> Array:
        check_lengths(self, torque=torque)
        load = self.no_loads() if link_load is None else np.array(link_load)
        load[-1] += np.outer(tip_force, [0.0, 0.0, self.length[-1], 1.0, 0.0])
        settled = settling(0, self.size, torque.size, load)
        body, joints = (of_kind(record, complex) for record in (self.body, self.joints))
        body = body._replace(friction=0.0 * body.friction, entry_friction=0.0 * body.entry_friction)  # nothing moved
        work, stable = self.workspace(complex), 0.0
        full = of_kind(torque, complex)
        settled.load[:] = load
        twin(settle)(full, body, joints, work, settled, settled.K[0], 0)  # the net force on the unloaded shape
        for share in GROWING if settled.push.any() else GROWING[-1:]:  # without force, the unloaded shape is in balance
            settled.load[:] = share * load
            part = body._replace(gx=share * body.gx, gy=share * body.gy, gz=share * body.gz)
            stable = twin(settle)(of_kind(share * torque, complex), part, joints, work, settled, settled.K[0], ROUNDS)
        q = settled.at.real.copy()
        if not stable > 0.0:
            raise SimulationError(BUCKLES)
        if (self.stretches(q) <= LEAST_STRETCH).any():
            raise SimulationError(
                "an extensible segment is compressed to nothing by its load: raise its stiffness, or lower the load"
            )
        return q

    def linear_parts(self, q: Array, torque: Array | None = None) -> tuple[Array, Array]:
        return self.inertia(q), np.diag(self.stuck_stiffness) - self.static_slope(q, torque=torque)


def rotation(vector: Any) -> Array:
    """Return the rotation matrix (3, 3) of a rotation vector (3,) [rad]."""
    return known_rotation(tuple(np.array(vector, dtype=float).tolist())).copy()


@lru_cache(64)
def beyond_joints(n: int, turns: int) -> Array:
    """Return the rows (turns n, n + 1) of `SpatialChain._beyond` for the angles of n joints."""
    swings = np.tril(np.ones((n, n)), -1) + 0.5 * np.eye(n)
    arcs = np.concatenate([np.repeat(swings, 2, axis=0), *[swings] * (turns - 2)])
    return np.hstack([np.ones((turns * n, 1)), arcs])


@lru_cache(1024)
def known_rotation(vector: tuple[float, ...]) -> Array:
    """Return the rotation matrix (3, 3) of a rotation vector [rad]; bodies of a batch share those of their rest
    shape.
    """
    from scipy.spatial.transform import Rotation

    return np.asarray(Rotation.from_rotvec(np.array(vector)).as_matrix())


def from_back(a: Array, axes: int) -> Array:
    """Return an array whose first `axes` axes are moved to the end."""
    return np.moveaxis(a, range(axes), range(-axes, 0))
