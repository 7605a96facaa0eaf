"""The interface `Mechanics` of a family of chains, and the records that it returns.

Coordinates x (N,) and rates v (N,) are those of the kernels. Users see joint coordinates q (N,): joint angles from the
rest shape, followed by the strains of segments that lengthen.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from functools import cached_property
from typing import Any, NamedTuple, Self

import numpy as np

from pliant.model import Model, Station

Array = np.ndarray


class Energy(NamedTuple):
    """Kinetic, elastic and gravitational energy of a body [J], at one moment or as arrays (T,)."""

    kinetic: Any
    elastic: Any
    gravity: Any


class CoordinateKind(NamedTuple):
    """A group of coordinates of one kind, such as joint angles or strains, with its names in datasets."""

    over: str  # dimension of datasets: "joint", "segment"
    noun: str  # name of one coordinate, in messages
    labels: list[Any]  # along that dimension
    rows: slice  # of coordinates, rates and generalised forces (N,)
    names: tuple[str, str, str, str]  # variables: coordinate, rate, disturbance, external force
    units: tuple[str, str, str]  # of coordinate, rate and force
    lever: Array  # (k,) generalised force [N m] of one unit of this force


class Mechanics(ABC):
    """Kinematics, forces and energies of a family of chains. Paper: Eqs. (1)-(5).

    Attributes
    ----------
    model : Model
    dimension : int
        Dimension of the space in which the body moves, 2 or 3.
    n, size : int
        Number of links; number of coordinates, N.
    """

    dimension: int

    def __init__(self, model: Model, body: Any = None, joints: Any = None) -> None:
        self.model, self.n, self.size = model, model.n, model.size
        if body is not None:
            self.__dict__ |= {"body": body, "joints": joints}

    def with_constants(self, body: Any, joints: Any) -> Self:
        """Return the same chain with other records of constants, which may be complex (for derivatives)."""
        return type(self)(self.model, body, joints)

    # arguments of the kernels

    @cached_property
    @abstractmethod
    def body(self) -> Any:
        """Record of the constants of the inertia, as the kernels take it."""

    @cached_property
    @abstractmethod
    def joints(self) -> Any:
        """Record of springs and dampers, as the kernels take it."""

    @abstractmethod
    def workspace(self, kind: type = float) -> Any:
        """Return the scratch arrays of one step, for numbers of the type `kind` (float or complex)."""

    @abstractmethod
    def slopes(self) -> Any:
        """Return the arrays for the Jacobian of a step: J (3N, 2N), or a record with the field J.

        J has one row for each coordinate, rate and torque, and further rows for tendons.
        """

    @abstractmethod
    def observed(self) -> tuple[Any, Any]:
        """Return the arguments of the observation kernels: constants of the chain, and scratch for the links' pose."""

    def parts(self) -> tuple[Any, Any, Any]:
        """Return body, joints and a workspace: the arguments of a kernel besides coordinates, rates and torque."""
        return self.body, self.joints, self.workspace()

    @abstractmethod
    def acceleration(self) -> Any:
        """Return the kernel ``(x, v, torque, body, joints, work, a)`` which writes the accelerations a (N,)."""

    @abstractmethod
    def acceleration_jacobian(self) -> Any:
        """Return the kernel ``(x, v, torque, body, joints, work, out)`` which fills a `equations.symbols.Slopes`."""

    @property
    @abstractmethod
    def sizes(self) -> tuple[int, ...]:
        """Sizes for which kernels are compiled: links, segments that lengthen, and in space turns and tendons."""

    # coordinates

    @cached_property
    @abstractmethod
    def names(self) -> tuple[str, ...]:
        """Names (N,) of the coordinates x."""

    @cached_property
    @abstractmethod
    def rate_names(self) -> tuple[str, ...]:
        """Names (N,) of the rates v."""

    @cached_property
    @abstractmethod
    def joint_names(self) -> tuple[str, ...]:
        """Names (N,) of the joint coordinates q."""

    @cached_property
    @abstractmethod
    def kinds(self) -> tuple[CoordinateKind, ...]:
        """The kinds of coordinates, in the order of their rows."""

    @property
    def labels(self) -> dict[str, list[Any]]:
        """Labels along each dimension of datasets that belongs to coordinates, such as "joint"."""
        return {kind.over: kind.labels for kind in self.kinds}

    @property
    def counted(self) -> str:
        """The number of coordinates of each kind, in words: "5 joint angles and 1 strain"."""
        counts = ((len(kind.labels), kind.noun) for kind in self.kinds)
        return " and ".join(f"{count} {noun}{'s' * (count > 1)}" for count, noun in counts)

    @property
    def lengthens(self) -> bool:
        """Whether the body has segments that lengthen."""
        return bool(self.model.extensions)

    @property
    def lever(self) -> Array:
        """Generalised force (N,) [N m] of a unit torque or force on each coordinate, as datasets store forces."""
        lever = np.empty(self.size)
        for kind in self.kinds:
            lever[kind.rows] = kind.lever
        return lever

    def gathered(self, data: Any, which: int) -> Array:
        """Return one variable of a dataset for all coordinates (T, N); `which` selects it among the kinds' `names`."""
        columns = [(kind.rows, np.asarray(data[kind.names[which]])) for kind in self.kinds]
        values = np.empty((len(columns[0][1]), self.size))
        for rows, column in columns:
            values[:, rows] = column
        return values

    def variables(self, x: Array, v: Array) -> dict[str, tuple[tuple[str, ...], Array]]:
        """Return coordinates x and rates v (T, N) of a motion as dataset variables: {name: (dimensions, values)}."""
        q, dq = self.joint_coordinates(x), self.joint_rates(v)
        named = ((kind, value, k) for kind in self.kinds for k, value in enumerate((q, dq)))
        found: dict[str, tuple[tuple[str, ...], Array]] = {
            kind.names[k]: (("time", kind.over), value[:, kind.rows]) for kind, value, k in named
        }
        if self.lengthens:
            gained = x[:, self.size - len(self.model.extensions) :] * self.model.segment_length
            found["extension"] = (("time", "segment"), gained)
        return found

    def strain_kind(self, first: int) -> tuple[CoordinateKind, ...]:
        """Return the kind of the strains, whose rows begin at `first`, in a tuple; () where nothing lengthens."""
        kind = CoordinateKind(
            "segment", "strain", [e.name for e in self.model.extensions], slice(first, self.size),
            ("axial_strain", "axial_strain_rate", "axial_disturbance", "external_axial_force"), ("1", "1/s", "N"),
            self.model.segment_length,
        )
        return (kind,) if self.lengthens else ()

    @abstractmethod
    def coordinates(self, q: Array) -> Array:
        """Return the coordinates x (..., N) for joint coordinates q (..., N)."""

    @abstractmethod
    def joint_coordinates(self, x: Array) -> Array:
        """Return the joint coordinates q (..., N) for coordinates x (..., N)."""

    @abstractmethod
    def joint_angles(self, x: Array) -> Array:
        """Return the joint angles [rad] from the rest shape for coordinates x, which may include strains."""

    @abstractmethod
    def rates(self, dq: Array) -> Array:
        """Return the rates v (..., N) for rates dq (..., N) of the joint coordinates."""

    @abstractmethod
    def joint_rates(self, v: Array) -> Array:
        """Return the rates dq (..., N) of the joint coordinates for rates v (..., N)."""

    @cached_property
    @abstractmethod
    def to_joints(self) -> Array:
        """Constant matrix dq/dx (N, N)."""

    @cached_property
    @abstractmethod
    def from_joints(self) -> Array:
        """Constant matrix dx/dq (N, N)."""

    @cached_property
    @abstractmethod
    def stuck_stiffness(self) -> Array:
        """Stiffness (N,) [N m/rad] which hysteresis adds to the springs, while none of its elements slips or creeps."""

    @property
    @abstractmethod
    def remembering(self) -> int:
        """Number m of coordinates with hysteresis states: the first m, which are those of the joints."""

    @abstractmethod
    def held(self) -> Any:
        """Return the scratch arrays for steps of a chain with hysteresis states."""

    # positions

    @cached_property
    @abstractmethod
    def length(self) -> Array:
        """Unstretched lengths (n + 1,) [m] of the part before the first joint and of the links."""

    @abstractmethod
    def stretches(self, x: Array) -> Array:
        """Return the stretch (..., n + 1) of the part before the first joint and of each link."""

    @abstractmethod
    def link_frames(self, x: Array) -> Array:
        """Return the axes of base and links as columns (..., n + 1, dimension, dimension), the last along the link."""

    @abstractmethod
    def turning_moments(self, x: Array, arm: Array, force: Array) -> Array:
        """Return the moments (T, P, K, turns) [N m] about the joint axes of forces at points.

        `force` is (T, P, dimension, K) [N].

        `arm` (T, P, n, dimension) [m] leads from each joint to each point, and is 0 for joints that do not move the
        point.
        """

    @abstractmethod
    def directions(self, x: Array) -> Array:
        """Return the unit vectors (..., n + 1, dimension) along base and links, in the kernels' frame."""

    @abstractmethod
    def tips(self, x: Array) -> Array:
        """Return the tips of the links (..., n, dimension) [m] in the base frame."""

    @abstractmethod
    def nodes(self, x: Array) -> Array:
        """Return origin, first joint and all link tips (..., n + 2, dimension) [m] in the base frame."""

    @abstractmethod
    def stations(self, x: Array, tips: Array | None = None) -> tuple[Array, Array]:
        """Return positions (..., S, dimension) [m] and angles (..., S) [rad] of the observed points.

        `tips` saves computing the link tips if they are known.
        """

    @abstractmethod
    def position_jacobian(self, x: Array, point: Station) -> Array:
        """Return the derivative (dimension, N) [m/rad] of the position of a point by x (N,)."""

    @abstractmethod
    def beside_links(self, x: Array, points: Array, lengths: Any = None) -> Array:
        """Return coordinates (P, n + 1, 3) [m] of points (P, dimension) along, across and aside of base and links.

        `lengths` may replace `length`, `base_length` and `share` of the links, also by complex values.
        """

    @abstractmethod
    def tip_jacobian(self, x: Array, v: Array) -> tuple[Array, Array]:
        """Return the Jacobians (K, dimension, N) of the last tip by x (K, N), and their rates at rates v (K, N)."""

    # forces and energies

    @abstractmethod
    def inertia(self, x: Array) -> Array:
        """Return the inertia matrix M (N, N) in the coordinates x (N,)."""

    @abstractmethod
    def energy(self, x: Array, v: Array) -> Energy:
        """Return the energies [J] at x and v (N,), or along a motion (T, N) as arrays (T,)."""

    @abstractmethod
    def no_loads(self) -> Array:
        """Return zero loads of the links, in the shape that the kernels take."""

    @abstractmethod
    def link_loads(self, points: list[Station], forces: Array) -> Array:
        """Return the loads (T, ...) [N m] of the links under forces (T, P, dimension) [N] at `points`."""

    @abstractmethod
    def load_forces(self, x: Array, load: Array) -> Array:
        """Return the generalised forces (N,) [N m] of loads of the links at x (N,), which may be complex."""

    @abstractmethod
    def load_stiffness(self, x: Array, load: Array) -> Array:
        """Return the derivative (N, N) of `load_forces` by x."""

    @abstractmethod
    def static_forces(self, x: Array, torque: Array) -> Array:
        """Return the net force (N,) [N m] of inputs, springs and gravity at rest at x (N,): zero in equilibrium.

        `torque` (N,) are the inputs. x may be complex.
        """

    @abstractmethod
    def static_slope(self, x: Array, load: Array | None = None, torque: Array | None = None) -> Array:
        """Return the derivative (N, N) of `static_forces` by x, plus that of `load_forces` if there is a load.

        The matrix is symmetric.

        `torque` are the inputs, which matter only if their forces depend on x. None means 0.
        """

    @abstractmethod
    def equilibrium(self, torque: Array, tip_force: Array, link_load: Array | None) -> Array:
        """Return the joint coordinates q (N,) in equilibrium under torques (N,) [N m], gravity and loads."""

    @abstractmethod
    def linear_parts(self, q: Array) -> tuple[Array, Array]:
        """Return inertia and stiffness (N, N) in joint coordinates, linearised at q (N,)."""
