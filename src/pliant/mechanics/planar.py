"""Mechanics of chains in a plane, whose coordinates are n absolute link angles and S strains of segments that lengthen.

Statics and geometry are the same code for any S, also 0. A body that lengthens uses the compiled kernels of
`equations.extension`, others those of `equations.motion`, which are faster.
"""

from __future__ import annotations

from functools import cached_property
from typing import Any, ClassVar

import numpy as np

from pliant.compiler.choose import twin
from pliant.compiler.trace import CURVED, REMEMBERS, planar_workspace, spring_rows
from pliant.equations import chain, energy, extension, inertia, motion
from pliant.equations.elastic import LEAST_STRETCH, spring_slope, spring_torque
from pliant.equations.observation import ALONG_X, ALONG_Y, ANGLE
from pliant.equations.symbols import (
    Body,
    ExtensibleBody,
    ExtensibleHeld,
    ExtensibleJoints,
    ExtensibleWorkspace,
    Held,
    Joints,
    ObservedChain,
    Workspace,
)
from pliant.errors import SimulationError
from pliant.mechanics import springs
from pliant.mechanics.contract import Mechanics
from pliant.mechanics.lengths import check_lengths
from pliant.mechanics.naming import PlanarNaming
from pliant.mechanics.reaction import BaseTwist, planar_reaction, point_carried
from pliant.mechanics.records import Energy, LinkFrames, link_coordinates
from pliant.mechanics.rest import loaded_rest
from pliant.model import Model, Station, fixed_length
from pliant.model.extensible import extensible_inertia
from pliant.model.inertia import inertia_constants
from pliant.numerics.curve import tangents

Array = np.ndarray


class PlanarChain(PlanarNaming, Mechanics):
    """Kinematics, forces and energies of a chain of n rigid links in a plane, with S >= 0 segments that lengthen.

    Attributes
    ----------
    segments : int
        Number S of segments that lengthen.
    length : array (n + 1,)
        Unstretched lengths of the rigid part before the first joint and of the links, m.
    stretch_share : array (n + 1, S)
        Fraction of each of these that lies in each segment.
    """

    dimension, row_width = 2, 4
    base_tangent = np.array([0.0, 1.0, 0.0])
    outputs: ClassVar = {"tip_x": ALONG_X, "tip_y": ALONG_Y, "angle_sum": ANGLE}

    @cached_property
    def segments(self) -> int:
        """Number S of segments that lengthen."""
        return self.size - self.n

    @cached_property
    def length(self) -> Array:
        """Unstretched lengths (n + 1,) [m] of the rigid part before the first joint and of the n links."""
        return np.append(self.model.base_length, self.model.link_length)

    @cached_property
    def stretch_share(self) -> Array:
        """Fraction (n + 1, S) of the base part and of each of n links that lies in each of S extensible segments."""
        return np.array(self.model.stretch_share)

    # arguments of the kernels

    @property
    def shape_constants(self) -> dict[str, Any]:
        return {"rest_angle": self.model.rest_angle, "base_angle": self.model.base_angle}

    @cached_property
    def body(self) -> Any:
        model = self.model
        gx, gy = (float(g) for g in model.gravity)
        if not self.segments:
            rod = model.mass_at == "rod"
            links = model.link_length, model.link_mass, model.tip_mass
            return Body(*inertia_constants(*links, rod=rod, tip_inertia=model.tip_inertia), gx, gy)
        B, h = extensible_inertia(model)
        return ExtensibleBody(B, self.length, h, self.stretch_share, gx, gy, model.tip_inertia)

    @cached_property
    def joints(self) -> Joints | ExtensibleJoints:
        model = self.model
        axial = np.reshape([(e.stiffness, e.damping) for e in model.extensions], (-1, 2)).T * model.segment_length
        K, D = np.append(model.stiffness, axial[0]), np.append(model.damping, axial[1])
        rows = spring_rows(self.laws)
        hardening = springs.springs_of(model).hardening[:rows]
        # copies: kernels are compiled anew for each mixture of arrays that may and may not be written to
        values = model.base_angle, np.array(model.rest_angle), K, D
        if not self.segments:
            return Joints(*values, hardening, np.array(model.rest_angle))
        if self.laws & CURVED:
            hardening = np.concatenate([hardening, springs.axial_springs_of(model).hardening[:rows]], axis=1)
        moved = np.zeros(self.segments if self.laws & REMEMBERS else 0)
        return ExtensibleJoints(*values, hardening, np.array(model.rest_angle), moved)

    def workspace(self, kind: type = float) -> Workspace | ExtensibleWorkspace:
        return planar_workspace(self.n, self.segments, kind)

    @cached_property
    def observed(self) -> ObservedChain:
        model = self.model
        return ObservedChain(model.base_length, np.array(model.link_length), np.array(model.stretch_share))

    def placed_links(self) -> Array:
        return np.zeros((5, self.n + 1))

    def acceleration(self) -> Any:
        return twin(extension.acceleration if self.segments else motion.acceleration)

    @property
    def simd(self) -> str:
        return "" if self.segments or self.model.memory else "plane"

    def acceleration_jacobian(self) -> Any:
        return super().acceleration_jacobian() if self.segments else twin(motion.acceleration_jacobian)

    @property
    def sizes(self) -> tuple[int, ...]:
        laws = (1, 0, self.laws) if self.laws else ()
        return self.n, self.segments, *laws

    # coordinates

    def coordinates(self, q: Array) -> Array:
        x = np.array(q, dtype=float)
        turns = x.T[: self.n]
        chain.absolute_angles(turns.copy(), self.model.rest_angle, self.model.base_angle, turns)
        return x

    def joint_coordinates(self, x: Array) -> Array:
        angles = self.joint_angles(x)
        return np.concatenate([angles, x[..., self.n :]], axis=-1) if self.segments else angles

    def joint_angles(self, x: Array) -> Array:
        return np.diff(x[..., : self.n], axis=-1, prepend=self.joints.base_angle) - self.joints.theta0

    def rates(self, dq: Array) -> Array:
        return np.concatenate([np.cumsum(dq[..., : self.n], axis=-1), dq[..., self.n :]], axis=-1)

    def joint_rates(self, v: Array) -> Array:
        turns = np.diff(v[..., : self.n], axis=-1, prepend=0.0)
        return np.concatenate([turns, v[..., self.n :]], axis=-1) if self.segments else turns

    @cached_property
    def to_joints(self) -> Array:
        R = np.eye(self.size)
        R[np.arange(1, self.n), np.arange(self.n - 1)] = -1.0
        return R

    @cached_property
    def from_joints(self) -> Array:
        T = np.eye(self.size)
        T[: self.n, : self.n] = np.tri(self.n)
        return T

    @cached_property
    def stuck_stiffness(self) -> Array:
        K, n, memory = self.joints.K, self.n, self.model.memory
        return np.append(K[:n] * memory.instantaneous, K[n:] * memory.axial.instantaneous)

    @property
    def remembering(self) -> int:
        return self.size if self.model.memory.has_axial else self.n

    def held(self) -> Held | ExtensibleHeld:
        joints = self.joints
        if isinstance(joints, ExtensibleJoints) and joints.rest.size:
            shapes = {"theta0": self.n, "rest": self.segments}
            arrays = {f: np.zeros(shapes.get(f, self.size)) for f in ExtensibleHeld._fields if f != "springs"}
            elastic_joints = joints._replace(theta0=arrays["theta0"], K=arrays["K"], rest=arrays["rest"])
            return ExtensibleHeld(springs=elastic_joints, **arrays)
        size = {name: self.size if name in ("phi", "w") else self.n for name in Held._fields if name != "springs"}
        rows = {name: np.zeros(length) for name, length in size.items()}
        rows |= {"K": joints.K.copy(), "theta0": joints.theta0.copy()}
        plain: Any = joints  # of a body that lengthens, with its `rest` empty
        return Held(springs=plain._replace(theta0=rows["theta0"], K=rows["K"]), **rows)

    def total_bend(self, q: Array) -> float:
        return float(abs(q.sum()))

    def with_rest_shape(self, q: Array, tips: Array) -> Model:
        joint = (1.0 + self.stretch_share[0] @ q[self.n :]) * self.model.first_joint
        across = np.diff(tips, axis=0, prepend=joint[None])
        angle = np.unwrap(np.arctan2(-across[:, 0], across[:, 1]))
        return self.model.with_(rest_angle=np.diff(angle, prepend=self.model.base_angle) - q[: self.n])

    # positions

    def stretches(self, x: Array) -> Array:
        """Return the stretch ratios (..., n + 1) of the part before the first joint and of the n links, at coordinates
        x (..., N).

        Raises
        ------
        InputError
            When `x` has angles only, and the body has segments that lengthen.
        """
        if x.shape[-1] != self.size:
            fixed_length(self.model)  # raises: angles alone do not describe this body
        return np.asarray(1.0 + x[..., self.n : self.size] @ self.stretch_share.T)

    def directions(self, x: Array) -> Array:
        """Return the unit vectors e = (-sin, cos) (..., n + 1, 2) along the base part and the n links, at coordinates x
        (..., N).
        """
        return tangents(self.angles(x))

    def link_frames(self, x: Array) -> Array:
        ahead = self.directions(x)
        left = np.stack([-ahead[..., 1], ahead[..., 0]], axis=-1)
        return np.stack([left, ahead], axis=-1)

    def turning_moments(self, x: Array, arm: Array, force: Array) -> Array:  # noqa: ARG002  of the interface
        arm, force = arm[:, :, None], np.swapaxes(force, 2, 3)[:, :, :, None]
        return np.asarray(arm[..., 0] * force[..., 1] - arm[..., 1] * force[..., 0])

    def angles(self, x: Array) -> Array:
        """Return the absolute angles (..., n + 1) [rad] of the base part and the n links, at coordinates x (..., N)."""
        base = np.full((*x.shape[:-1], 1), self.joints.base_angle)
        return np.concatenate([base, x[..., : self.n]], axis=-1)

    def tips(self, x: Array) -> Array:
        stretch = self.stretches(x)
        first, length = self.model.first_joint * stretch[..., :1], self.model.link_length * stretch[..., 1:]
        phi = x[..., : self.n]
        across = -np.cumsum(length * np.sin(phi), axis=-1) + first[..., :1]
        along = np.cumsum(length * np.cos(phi), axis=-1) + first[..., 1:]
        return np.stack([across, along], axis=-1)

    def nodes(self, x: Array) -> Array:
        first = self.stretches(x)[..., :1, None] * self.model.first_joint
        return np.concatenate([np.zeros_like(first), first, self.tips(x)], axis=-2)

    def stations(self, x: Array, tips: Array | None = None) -> tuple[Array, Array]:
        tips = self.tips(x) if tips is None else tips
        stretch = self.stretches(x)
        first = stretch[..., :1, None] * self.model.first_joint
        joints = np.concatenate([np.zeros_like(first), first, tips[..., :-1, :]], axis=-2)
        carrier, along, across = np.array([(p.link + 1, p.along, p.across) for p in self.model.points]).T
        carrier = carrier.astype(int)
        along, a = along * stretch[..., carrier], self.angles(x)[..., carrier]
        px = joints[..., carrier, 0] - along * np.sin(a) - across * np.cos(a)
        py = joints[..., carrier, 1] + along * np.cos(a) - across * np.sin(a)
        return np.stack([px, py], axis=-1), a

    def position_jacobian(self, x: Array, point: Station) -> Array:
        ahead, stretch = self.directions(x), self.stretches(x)
        k, rows = point.link + 1, np.arange(self.n + 1)
        reach = np.where(rows < k, self.length, point.along * (rows == k))
        side = np.stack([-ahead[:, 1], ahead[:, 0]], axis=-1)  # n = (-cos, -sin)
        turned = (reach * stretch)[:, None] * side - (point.across * (rows == k))[:, None] * ahead
        grown = self.stretch_share.T @ (reach[:, None] * ahead)
        return np.asarray(np.concatenate([turned[1:], grown]).T)

    def beside_links(self, x: Array, points: Array, lengths: Any = None) -> Array:
        length, base_length, share = self.model.link_length, self.model.base_length, self.model.stretch_share
        if lengths is not None:
            length, base_length, share = lengths.length, lengths.base_length, lengths.share
        chain = LinkFrames(x, length, base_length, self.joints.base_angle, share)
        along, across = link_coordinates(chain, points)
        return np.stack([along, across, 0.0 * along], axis=-1)

    def tip_jacobian(self, x: Array, v: Array) -> tuple[Array, Array]:
        n, part, ahead = self.n, self.length[:, None] * self.stretch_share, self.directions(x)
        turn = np.concatenate([np.zeros((len(v), 1)), v[:, :n]], axis=1)
        stretch, growth = self.length * self.stretches(x), v[:, n:] @ part.T
        along = np.swapaxes(ahead, 1, 2)  # (K, 2, n + 1) of each link
        across = np.stack([-ahead[..., 1], ahead[..., 0]], axis=1)
        turned = across * growth[:, None] - along * (stretch * turn)[:, None]
        rows = np.concatenate([(across * stretch[:, None])[:, :, 1:], along @ part], axis=2)
        return rows, np.concatenate([turned[:, :, 1:], (across * turn[:, None]) @ part], axis=2)

    # forces and energies

    def lateral_force(
        self, frame: Array, tangent: Array, force: Array, covariance: Array,  # noqa: ARG002  of the interface
    ) -> tuple[float, float, Array]:
        return float(force[0]), float(np.sqrt(covariance[0, 0])), np.array([-tangent[1], tangent[0]])

    def inertia(self, x: Array) -> Array:
        M = np.zeros((self.size, self.size))
        if not self.segments:
            inertia.inertia_absolute(np.cos(x), np.sin(x), self.body.B, self.body.I, M)
            return M
        work = self.workspace()
        extension.place(x, 0.0 * x, 0.0, self.body, self.joints, work)
        extension.inertia(self.body, work, M)
        return np.asarray(M + np.tril(M, -1).T)

    def energy(self, x: Array, v: Array) -> Energy:
        x, v, body, joints = x.T, v.T, self.body, self.joints
        elastic = energy.elastic_energy(x, joints)
        if not self.segments:
            c, s = np.cos(x), np.sin(x)
            return Energy(energy.kinetic_energy(c, s, v, body), elastic, energy.gravity_energy(c, s, body))
        work = ExtensibleWorkspace(*(np.zeros((*a.shape, *x.shape[1:])) for a in self.workspace()))
        parts = (x, v, body, joints, work)
        return Energy(extension.kinetic_energy(*parts), elastic, extension.gravity_energy(*parts))

    def no_loads(self) -> Array:
        return np.zeros((self.n + 1, 4) if self.segments else (self.n, 2))

    def link_inertias(self) -> tuple[Array, Array, Array, Array | None]:
        model, rod = self.model, self.model.mass_at == "rod"
        m, l = np.array(model.link_mass), model.link_length
        middle = 0.5 * l if rod else np.array(l)
        cap = np.append(np.zeros(model.n - 1), model.tip_mass)
        centre = (m * middle + cap * l) / (m + cap)
        across = m * l**2 / 12.0 * rod + m * (middle - centre) ** 2 + cap * (l - centre) ** 2
        across[-1] += model.tip_inertia
        return m + cap, centre, across, None

    def offset(self, point: Station) -> Array:
        return np.array([-point.across, point.along, 0.0])

    def link_loads(self, points: list[Station], forces: Array) -> Array:
        total = np.zeros((len(forces), *self.no_loads().shape))
        links = np.arange(-1 if self.segments else 0, self.n)
        length = self.length[-links.size :]
        for f, point in enumerate(points):
            carrying, pull = links == point.link, forces[:, f, None]
            along = pull * np.where(carrying, point.along, length * (links < point.link))[:, None]
            across = pull[..., ::-1] * [1.0, -1.0] * (point.across * carrying)[:, None]
            total += np.concatenate([along, across], axis=-1) if self.segments else along + across
        return total

    @property
    def rest_turns(self) -> Array:
        return np.outer([self.model.base_angle, *self.model.rest_angle], [0.0, 0.0, 1.0])

    def with_own_base(self) -> PlanarChain:
        return self.with_constants(self.body, self.joints._replace(spin=np.zeros(2)))

    def base_weight(self, base: BaseTwist) -> Array:
        arm = np.broadcast_to(point_carried(self), base.gravity.shape)
        turned = np.stack([-arm[:, 1], arm[:, 0]], axis=1) * base.turning[:, None] - arm * (base.rate**2)[:, None]
        return np.asarray(base.gravity - base.acceleration - turned)

    def reaction(self, x: Array, v: Array, a: Array, base: BaseTwist) -> tuple[Array, Array]:
        return planar_reaction(self, x, v, a, base)

    def uniform_loads(self, field: Array) -> Array:
        load = self.body.h[:, None] * field[:, None]
        return np.pad(load, ((0, 0), (0, 0), (0, self.no_loads().shape[1] - 2)))

    def weight(self) -> Array:
        """Return gravity as loads on the links [N m], in the same shape as external loads (`no_loads`)."""
        return np.asarray(self.uniform_loads(np.array([[self.body.gx, self.body.gy]]))[0])

    def load_forces(self, x: Array, load: Array) -> Array:
        if not self.segments:
            return np.asarray(-(load[:, 0] * np.cos(x) + load[:, 1] * np.sin(x)))
        return pull_of(x, load, self.body.share, self.joints.base_angle)

    def load_stiffness(self, x: Array, load: Array) -> Array:
        if not self.segments:
            return np.diag(load[:, 0] * np.sin(x) - load[:, 1] * np.cos(x))
        n, share = self.n, self.body.share
        c, s, whole = stretched_loads(x, load, share, self.joints.base_angle)
        slope = np.zeros((x.size, x.size))
        slope[np.arange(n), np.arange(n)] = (whole[:, 0] * s - whole[:, 1] * c)[1:]
        slope[:n, n:] = (share * -(load[:, 0] * c + load[:, 1] * s)[:, None])[1:]
        slope[n:, :n] = slope[:n, n:].T
        return slope

    def static_forces(self, x: Array, torque: Array) -> Array:
        check_lengths(self, x=x, torque=torque)
        spring, _ = self._springs(self.joint_coordinates(x))
        return (torque - spring) @ self.to_joints + self.load_forces(x, self.weight())

    def static_slope(self, x: Array, load: Array | None = None, torque: Array | None = None) -> Array:  # noqa: ARG002
        _, tangent = self._springs(self.joint_coordinates(x))
        load = self.weight() if load is None else self.weight() + load
        return self.load_stiffness(x, load) - self.to_joints.T @ np.diag(tangent) @ self.to_joints

    def equilibrium(self, torque: Array, tip_force: Array, link_load: Array | None) -> Array:
        check_lengths(self, torque=torque)
        n, joints, T = self.n, self.joints, self.from_joints
        q = springs.angle_under(self.model, torque[:n])
        q = np.append(q, springs.strain_under(self.model, torque[n:])) if self.segments else q
        load = self.weight() if link_load is None else self.weight() + link_load
        load[:, :2] += np.outer(self.length[-len(load) :], tip_force)
        if load.any():
            unloaded = self.coordinates(np.zeros(self.size))

            def residual(q: Array, share: float) -> tuple[Array, Array]:
                x = T @ q + unloaded
                pull, slope = self.load_forces(x, share * load), self.load_stiffness(x, share * load)
                spring, tangent = self._springs(q)
                return torque - spring + T.T @ pull, np.diag(tangent) - T.T @ slope @ T

            q = loaded_rest(residual, q, float(np.abs(joints.K).max()))
        if (1.0 + self.stretch_share @ q[n:] <= LEAST_STRETCH).any():
            raise SimulationError(
                "an extensible segment is compressed to nothing by its load: raise its stiffness, or lower the load"
            )
        return q

    def _springs(self, q: Array) -> tuple[Array, Array]:
        """Return torques and slopes (N,) of all springs in joint coordinates."""
        joints, curved = self.joints, self.joints.hardening.shape[1]
        bent, curved_rows = q[:curved], slice(0, curved)
        torque, slope = spring_torque(curved_rows, joints, bent, bent), spring_slope(curved_rows, joints, bent)
        return np.append(torque, joints.K[curved:] * q[curved:]), np.append(slope, joints.K[curved:])

    def linear_parts(self, q: Array, torque: Array | None = None) -> tuple[Array, Array]:  # noqa: ARG002
        x, T = self.coordinates(q), self.from_joints
        stiffness = self._springs(q)[1] + self.stuck_stiffness
        slope = self.load_stiffness(x, self.weight())
        return T.T @ self.inertia(x) @ T, np.diag(stiffness) - T.T @ slope @ T


def pull_of(x: Array, load: Array, share: Array, base_angle: Any) -> Array:
    """Return the generalized forces (n + S,) [N m] of external loads on n links with S strains. Row 0 of `load` (n + 1,
    4) [N m] is the part before the first joint. Columns 0 and 1 are due to the forces' distance along the link, columns
    2 and 3 to that across it.

    A load keeps its direction when the body turns: its potential is -sum_k (st_k L_k + R_k) . e(phi_k).
    """
    c, s, whole = stretched_loads(x, load, share, base_angle)
    turning = -(whole[:, 0] * c + whole[:, 1] * s)
    return np.concatenate([turning[1:], share.T @ (load[:, 1] * c - load[:, 0] * s)])


def stretched_loads(x: Array, load: Array, share: Array, base_angle: Any) -> tuple[Array, Array, Array]:
    """Return cosines and sines (n + 1,) of the angles of base part and links at x, and the loads (n + 1, 2) [N m] on
    these parts: the first two columns of `load` (n + 1, 4) times the part's stretch, plus the last two.
    """
    n = x.size - share.shape[1]
    angle = np.append(base_angle, x[:n])
    whole = (1.0 + share @ x[n:])[:, None] * load[:, :2] + load[:, 2:]
    return np.cos(angle), np.sin(angle), whole
