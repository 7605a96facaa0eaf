"""The interface `Mechanics` for kinematics, forces and energies of a chain of links.

Coordinates x (N,) and rates v (N,) are those of the kernels. Users see joint coordinates q (N,): joint angles from the
rest shape, followed by the strains of segments that lengthen.
"""

from __future__ import annotations

from abc import abstractmethod
from functools import cached_property, partial
from typing import Any, ClassVar, Self

import numpy as np

from pliant.compiler.trace import BOUNDED, CURVED, REMEMBERS
from pliant.equations.symbols import Past, Sight, StepSlopes
from pliant.mechanics.complex_slopes import complex_slopes
from pliant.mechanics.naming import Naming
from pliant.mechanics.reaction import BaseTwist
from pliant.mechanics.records import Energy
from pliant.model import Model, Station
from pliant.shapes import Float, Inexact

Array = np.ndarray


class Mechanics(Naming):
    """Kinematics, forces and energies of a chain of n links with N coordinates, in the plane or in space. Paper: Eqs.
    (1)-(5).

    Attributes
    ----------
    model : Model
    dimension : int
        Dimension of the space in which the body moves, 2 or 3.
    base_tangent : array (3,)
        Direction of the base frame's tangent, +y in the plane and +z in space.
    outputs : dict of str to int
        Names of the three outputs of the tip that controllers use, with their kinds of rows of `observation.KINDS`.
    row_width : int
        Number of columns that define a measured quantity.
    n, size : int
        Number of links; number of coordinates, N.
    """

    dimension: int
    base_tangent: Array
    outputs: ClassVar[dict[str, int]]
    row_width: int

    def __init__(self, model: Model, body: Any = None, joints: Any = None) -> None:
        self.model, self.n, self.size = model, model.n, model.size
        if body is not None:
            self.__dict__ |= {"body": body, "joints": joints}

    def with_constants(self, body: Any, joints: Any) -> Self:
        """Return the same chain with other constants of inertia (`body`) and of springs and dampers (`joints`), real or
        complex.
        """
        return type(self)(self.model, body, joints)

    # arguments of the kernels

    @cached_property
    @abstractmethod
    def body(self) -> Any:
        """Constants of the links' inertia, as a record for the compiled kernels."""

    @cached_property
    @abstractmethod
    def joints(self) -> Any:
        """Constants of the joints' springs and dampers, as a record for the compiled kernels."""

    @abstractmethod
    def workspace(self, kind: type = float) -> Any:
        """Return new scratch arrays for one time step of this chain, of the number type `kind` (float or complex)."""

    def slopes(self) -> StepSlopes:
        """Return new arrays for `linearised.step_jacobian`, compiled, with the Jacobian J (3N + R, 2N) of a time step.

        J has one row for each of N coordinates, rates and torques, and for the inputs of R tendons.
        """
        from pliant.compiler.duals import duals  # loads the compiler

        work, still = self.workspace(), np.zeros(self.size)
        J = np.zeros((2 * self.size + len(work.tau), 2 * self.size))
        return StepSlopes(J, duals(still), duals(still), type(work)(*map(duals, work)))

    def sight(self, of: Any = None) -> Sight:
        """Return new scratch arrays for `observation.observe_rows`; `of` converts floats (default: to dual numbers)."""
        if of is None:
            from pliant.compiler.duals import duals as of  # loads the compiler
        links = self.placed_links()
        links = of(links) if isinstance(links, np.ndarray) else type(links)(*map(of, links))
        shapes = (3, 2, 3, (3, 3), (3, 3))
        return Sight(of(np.zeros(self.size)), links, *(of(np.full(shape, np.nan)) for shape in shapes))

    @property
    @abstractmethod
    def shape_constants(self) -> dict[str, Any]:
        """Parameters that only chains of this kind have, in SI units, by their names in exported code."""

    @property
    @abstractmethod
    def observed(self) -> Any:
        """Geometric constants of the chain, as the measurement kernels take them."""

    @abstractmethod
    def placed_links(self) -> Any:
        """Return new scratch arrays for the poses that `observation.place_links` writes."""

    def parts(self) -> tuple[Any, Any, Any]:
        """Return the constants of inertia and of springs, and new scratch arrays, as the kernels take them."""
        return self.body, self.joints, self.workspace()

    @abstractmethod
    def acceleration(self) -> Any:
        """Return the kernel ``(x, v, torque, body, joints, work, a)``, which writes the accelerations a (N,)."""

    @property
    @abstractmethod
    def simd(self) -> str:
        """Name of the kernels that simulate several such chains in a SIMD vector: "plane", "space", or "" if none."""

    def acceleration_jacobian(self) -> Any:
        """Return the function ``(x, v, torque, body, joints, work, out)``, which writes the accelerations and their
        derivatives by x, v to `out`.

        `out` is a `equations.symbols.Slopes`. By default, the derivatives are complex steps.
        """
        return partial(complex_slopes, self.acceleration())

    @property
    @abstractmethod
    def sizes(self) -> tuple[int, ...]:
        """Sizes for which kernels are compiled: links, extensible segments and, in space, joint angles and tendons."""

    # coordinates

    def variables(self, x: Float[Array, "T N"], v: Float[Array, "T N"]) -> dict[str, tuple[tuple[str, ...], Array]]:
        """Return a motion as dataset variables {name: (dimensions, values)}, from coordinates x and rates v (T, N) over
        T instants.
        """
        q, dq = self.joint_coordinates(x), self.joint_rates(v)
        named = ((kind, value, k) for kind in self.kinds for k, value in enumerate((q, dq)))
        table: dict[str, tuple[tuple[str, ...], Array]] = {
            kind.names[k]: (("time", kind.over), value[:, kind.rows]) for kind, value, k in named
        }
        if self.lengthens:
            gained = x[:, self.size - len(self.model.extensions) :] * self.model.segment_length
            table["extension"] = (("time", "segment"), gained)
        return table

    @cached_property
    def laws(self) -> int:
        """Laws beyond linear springs and dampers, as the sum that `choose.twin` takes: nonlinear springs of segments,
        their hysteresis, springs whose softening is bounded.
        """
        curved = any(e.curved for e in self.model.extensions)
        bounded = self.model.stiffening_bound.any() or any(e.stiffening_bound for e in self.model.extensions)
        return CURVED * curved + REMEMBERS * self.model.memory.has_axial + BOUNDED * bool(bounded)

    @abstractmethod
    def coordinates(self, q: Float[Array, "... N"]) -> Float[Array, "... N"]:
        """Return the coordinates x (..., N) of the compiled kernels for joint coordinates q (..., N): joint angles
        [rad], then strains.
        """

    @abstractmethod
    def joint_coordinates(self, x: Float[Array, "... N"]) -> Float[Array, "... N"]:
        """Return the joint coordinates q (..., N), joint angles [rad] then strains, for the kernels' coordinates x
        (..., N).
        """

    @abstractmethod
    def joint_angles(self, x: Float[Array, "... N"]) -> Float[Array, "... n"]:
        """Return the joint angles [rad], measured from the rest shape, for the kernels' coordinates x (..., N). In
        space they are the sizes of swings.
        """

    @abstractmethod
    def rates(self, dq: Float[Array, "... N"]) -> Float[Array, "... N"]:
        """Return the rates v (..., N) of the kernels' coordinates for the rates dq (..., N) of joint angles and
        strains.
        """

    @abstractmethod
    def joint_rates(self, v: Float[Array, "... N"]) -> Float[Array, "... N"]:
        """Return the rates dq (..., N) of joint angles and strains for the rates v (..., N) of the kernels'
        coordinates.
        """

    @cached_property
    @abstractmethod
    def to_joints(self) -> Float[Array, "N N"]:
        """Constant matrix dq/dx (N, N), which maps rates of the kernels' coordinates to rates of joint angles and
        strains.
        """

    @cached_property
    @abstractmethod
    def from_joints(self) -> Float[Array, "N N"]:
        """Constant matrix dx/dq (N, N), which maps rates of joint angles and strains to rates of the kernels'
        coordinates.
        """

    @cached_property
    @abstractmethod
    def stuck_stiffness(self) -> Float[Array, " N"]:
        """Stiffness (N,) [N m/rad] that hysteresis adds at each coordinate for fast small motions, without slip or
        creep.
        """

    @property
    @abstractmethod
    def remembering(self) -> int:
        """Number of the first coordinates that have hysteresis states: joint angles, strains if segments have them."""

    @property
    def memory_shape(self) -> tuple[int, int]:
        """Numbers of coordinates with hysteresis and of states of each, (0, 0) for a body without hysteresis."""
        memory = self.model.memory
        columns = max(len(memory.labels), len(memory.axial.labels)) + (not memory.boucwen_share)
        return (self.remembering, columns) if memory else (0, 0)

    @abstractmethod
    def held(self) -> Any:
        """Return new scratch arrays for time steps of a chain whose joints have hysteresis states."""

    def past(self, states: Array) -> tuple[Past, ...]:
        """Return the hysteresis argument of time steps, (law, states, scratch arrays); () for no hysteresis."""
        return (Past(self.model.memory.law(), states, self.held()),) if self.model.memory else ()

    @property
    @abstractmethod
    def rest_turns(self) -> Float[Array, "n+1 3"]:
        """Rotation vectors (n + 1, 3) [rad] of the base part and of each joint in the rest shape."""

    @abstractmethod
    def total_bend(self, q: Float[Array, " N"]) -> float:
        """Return the absolute value [rad] of the sum of the joint angles in q (N,); in space, the norm of the sums
        about x and y.
        """

    @abstractmethod
    def with_rest_shape(self, q: Float[Array, " N"], tips: Float[Array, "n d"]) -> Model:
        """Return the model with another shape at rest, such that its n link tips are at `tips` (n, 2 or 3) [m] at the
        joint coordinates q (N,).
        """

    # positions

    @cached_property
    @abstractmethod
    def length(self) -> Float[Array, " n+1"]:
        """Unstretched lengths (n + 1,) [m] of the rigid part before the first joint and of the n links."""

    @abstractmethod
    def stretches(self, x: Float[Array, "... N"]) -> Float[Array, "... n+1"]:
        """Return the stretch ratios (..., n + 1) of the part before the first joint and of the n links, at coordinates
        x (..., N).
        """

    @abstractmethod
    def link_frames(self, x: Float[Array, "... N"]) -> Float[Array, "... n+1 d d"]:
        """Return the axes of the base part and the n links as columns of matrices (..., n + 1, d, d) in d = 2 or 3
        dimensions.
        """

    @abstractmethod
    def turning_moments(
        self, x: Float[Array, "T N"], arm: Float[Array, "T P n d"], force: Float[Array, "T P d K"],
    ) -> Float[Array, "T P K J"]:
        """Return the moments [N m] about all joint axes of K forces at each of P points, at T instants: an array (T, P,
        K, joint axes).

        `force` is (T, P, dimension, K) [N].

        `arm` (T, P, n, dimension) [m] leads from each joint to each point, and is 0 for joints that do not move the
        point.
        """

    @abstractmethod
    def directions(self, x: Float[Array, "... N"]) -> Float[Array, "... n+1 d"]:
        """Return the unit vectors (..., n + 1, 2 or 3) along base part and links, at coordinates x (..., N)."""

    @abstractmethod
    def tips(self, x: Float[Array, "... N"]) -> Float[Array, "... n d"]:
        """Return the tip positions of the n links (..., n, 2 or 3) [m] in the base frame, at coordinates x (..., N)."""

    @abstractmethod
    def nodes(self, x: Float[Array, "... N"]) -> Float[Array, "... n+2 d"]:
        """Return the positions (..., n + 2, 2 or 3) [m] of origin, first joint and n link tips, in the base frame."""

    @abstractmethod
    def stations(
        self, x: Float[Array, "... N"], tips: Float[Array, "... n d"] | None = None,
    ) -> tuple[Float[Array, "... S d"], Float[Array, "... S"]]:
        """Return positions (..., S, 2 or 3) [m] and angles (..., S) [rad] of the S observed points, at coordinates x
        (..., N).

        `tips` saves computing the link tips if they are known.
        """

    @abstractmethod
    def position_jacobian(self, x: Float[Array, " N"], point: Station) -> Float[Array, "d N"]:
        """Return the derivatives (2 or 3, N) [m/rad] of a point's position by the N coordinates, at x (N,)."""

    def points_and_slopes(self, x: Float[Array, " N"], work: Any = None) -> tuple[Array, Array]:  # noqa: ARG002
        """Return positions (S, d) [m] and Jacobians (S, d, N) of the model's S points at the coordinates x (N,). A
        `workspace` of the caller's, `work`, is written over.
        """
        slopes = [self.position_jacobian(x, point) for point in self.model.points]
        return self.stations(x)[0], np.stack(slopes)

    @abstractmethod
    def beside_links(
        self, x: Float[Array, " N"], points: Float[Array, "P d"], lengths: Any = None,
    ) -> Float[Array, "P n+1 3"]:
        """Return the positions of P points relative to the base part and each of n links (P, n + 1, 3) [m]: along,
        across and aside.

        `lengths` may replace `length`, `base_length` and `share` of the links, also by complex values.
        """

    @abstractmethod
    def tip_jacobian(
        self, x: Float[Array, "K N"], v: Float[Array, "K N"],
    ) -> tuple[Float[Array, "K d N"], Float[Array, "K d N"]]:
        """Return the derivatives (K, 2 or 3, N) of the tip position with respect to the N coordinates at K states, and
        the rates of change of these derivatives at the rates v (K, N).
        """

    # forces and energies

    @abstractmethod
    def lateral_force(
        self, frame: Float[Array, "d d"], tangent: Float[Array, " d"], force: Float[Array, " d"],
        covariance: Float[Array, "d d"],
    ) -> tuple[float, float, Float[Array, " d"]]:
        """Return the part of a force across a link [N], its standard deviation [N], and a unit vector (d,) across the
        body's curve, whose unit `tangent` is (d,).

        Force (d,) and covariance (d, d) refer to the axes of the link, the columns of `frame`, the last one along it.
        """

    @abstractmethod
    def inertia(self, x: Float[Array, " N"]) -> Float[Array, "N N"]:
        """Return the inertia matrix M (N, N) of the kernels' coordinates, at x (N,)."""

    @abstractmethod
    def energy(self, x: Float[Array, "... N"], v: Float[Array, "... N"]) -> Energy:
        """Return kinetic, elastic and gravitational energy [J] at coordinates x and rates v (N,), or at T instants (T,
        N) as arrays (T,).
        """

    @abstractmethod
    def no_loads(self) -> Array:
        """Return an array of zeros for external loads on the links, in the shape that the kernels take."""

    @abstractmethod
    def link_inertias(self) -> tuple[Array, Array, Array, Array | None]:
        """Return mass [kg], centre of mass [m], lateral and axial moment of inertia [kg m^2] of the links, each (n,).
        The values of the last link include the tip mass and its inertia.

        The centre is measured from the joint; the moments are about the centre of mass. In a plane the axial moments
        are None.
        """

    @abstractmethod
    def offset(self, point: Station) -> Float[Array, " 3"]:
        """Return the position (3,) [m] of an observed point in the frame of its link."""

    @abstractmethod
    def link_loads(self, points: list[Station], forces: Float[Array, "T P d"]) -> Array:
        """Return the loads on the links [N m] as the kernels take them, for forces (T, P, 2 or 3) [N] at P points over
        T instants.

        A point force (dimension,) acts at each of the `points`.
        """

    @abstractmethod
    def uniform_loads(self, field: Float[Array, "T d"]) -> Array:
        """Return the loads on the links [N m] of a uniform field (T, 2 or 3) [m/s^2], like gravity, at T instants."""

    @abstractmethod
    def with_own_base(self) -> Self:
        """Return the same chain with arrays of its own for the spin of its base, which kernels may write to."""

    @abstractmethod
    def base_weight(self, base: BaseTwist) -> Float[Array, "T d"]:
        """Return gravity less the acceleration that the base gives to all links (T, 2 or 3) [m/s^2], in its axes."""

    @abstractmethod
    def reaction(
        self, x: Float[Array, "T N"], v: Float[Array, "T N"], a: Float[Array, "T N"], base: BaseTwist,
    ) -> tuple[Float[Array, "T d"], Float[Array, "T m"]]:
        """Return the force (T, 2 or 3) [N] and the moment (T, 1 or 3) [N m] about the origin that the moving base
        exerts on the body, in the axes of the base. Rates v and accelerations a are relative to the base.
        """

    @abstractmethod
    def load_forces(self, x: Inexact[Array, " N"], load: Array) -> Inexact[Array, " N"]:
        """Return the generalized forces (N,) [N m] of external loads on the links, at real or complex coordinates x
        (N,).
        """

    @abstractmethod
    def load_stiffness(self, x: Float[Array, " N"], load: Array) -> Float[Array, "N N"]:
        """Return the derivative (N, N) of the generalized forces of external loads, see `load_forces`, by the
        coordinates x (N,).
        """

    @abstractmethod
    def static_forces(self, x: Inexact[Array, " N"], torque: Inexact[Array, " N+R"]) -> Inexact[Array, " N"]:
        """Return the net generalized force (N,) [N m] of inputs, springs and gravity on the chain at rest at
        coordinates x (N,).

        `torque` (N + R,) are the inputs, as of `Actuation.joint_torques`. Both may be complex.
        """

    @abstractmethod
    def static_slope(
        self, x: Float[Array, " N"], load: Array | None = None, torque: Float[Array, " N+R"] | None = None,
    ) -> Float[Array, "N N"]:
        """Return the derivative (N, N) of the net generalized force on the chain at rest with respect to the
        coordinates x (N,).

        It is the derivative of `static_forces`, plus that of `load_forces` if there is a load, and symmetric.

        `torque` are the inputs, which matter only if their forces depend on x. None means 0.
        """

    @abstractmethod
    def equilibrium(
        self, torque: Float[Array, " N+R"], tip_force: Float[Array, " d"], link_load: Array | None,
    ) -> Float[Array, " N"]:
        """Return the static joint coordinates q (N,), angles [rad] then strains, under inputs (N + R,) as of
        `Actuation.joint_torques`, gravity and external loads.
        """

    @abstractmethod
    def linear_parts(
        self, q: Float[Array, " N"], torque: Float[Array, " N+R"] | None = None,
    ) -> tuple[Float[Array, "N N"], Float[Array, "N N"]]:
        """Return the inertia and stiffness matrices (N, N) in joint coordinates, linearised about the shape q (N,).

        `torque` are the inputs, which matter only for tendons: a slack tendon has no stiffness. None means 0.
        """
