"""The interface of a family of chains: what the rest of the package may ask of a body that moves.

Coordinates x (N,) and rates v (N,) are those of the kernels. Users see joint coordinates q (N,): joint angles from the
rest shape, and behind them the strains of segments that lengthen.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from functools import cached_property
from typing import Any, NamedTuple, Self

import numpy as np

from pliant.model import Model, Station

Array = np.ndarray


class Energy(NamedTuple):
    """Energies of a body, J: numbers at one moment, or arrays (T,)."""

    kinetic: Any
    elastic: Any
    gravity: Any


class CoordinateKind(NamedTuple):
    """Coordinates of one kind, and how datasets name them: the turns of the joints, the strains of segments."""

    over: str  # dimension of datasets: "joint", "segment"
    noun: str  # one of them, in messages
    labels: list[Any]  # along that dimension
    rows: slice  # of coordinates, rates and generalised forces (N,)
    names: tuple[str, str, str, str]  # variables: coordinate, rate, disturbance, external force
    units: tuple[str, str, str]  # of coordinate, rate and force
    lever: Array  # (k,) generalised force [N m] of one such force


class Mechanics(ABC):
    """A family of chains. Paper: Eqs. (1)-(5).

    Attributes
    ----------
    model : Model
    dimension : int
        Of the space that the body moves in, 2 or 3.
    n, size : int
        Number of links; number of coordinates, N.
    """

    dimension: int

    def __init__(self, model: Model, body: Any = None, joints: Any = None) -> None:
        self.model, self.n, self.size = model, model.n, model.size
        if body is not None:
            self.__dict__ |= {"body": body, "joints": joints}

    def with_constants(self, body: Any, joints: Any) -> Self:
        """Return the same chain with other constants, complex ones among them: a base that turned, a derivative."""
        return type(self)(self.model, body, joints)

    # what the kernels take

    @cached_property
    @abstractmethod
    def body(self) -> Any:
        """Record of the constants of the inertia."""

    @cached_property
    @abstractmethod
    def joints(self) -> Any:
        """Record of springs and dampers."""

    @abstractmethod
    def workspace(self, kind: type = float) -> Any:
        """Return scratch arrays of a `kind` of numbers for one step."""

    @abstractmethod
    def slopes(self) -> Any:
        """Return what the kernels of a step's Jacobian write: J (3N, 2N), or a record that holds it as J.

        Behind the rows of coordinates, rates and torques may be those of tendons.
        """

    @abstractmethod
    def observed(self) -> tuple[Any, Any]:
        """Return what kernels see points by: constants of the chain, and scratch for the pose of its links."""

    def parts(self) -> tuple[Any, Any, Any]:
        """Return body, joints and a workspace: what a kernel takes beside coordinates, rates and torque."""
        return self.body, self.joints, self.workspace()

    @abstractmethod
    def acceleration(self) -> Any:
        """Return the kernel ``(x, v, torque, body, joints, work, a)`` of the accelerations a (N,)."""

    @abstractmethod
    def acceleration_jacobian(self) -> Any:
        """Return the kernel ``(x, v, torque, body, joints, work, out)`` that fills `equations.symbols.Slopes`."""

    @property
    @abstractmethod
    def sizes(self) -> tuple[int, ...]:
        """Return the sizes for which kernels are compiled: links, segments that lengthen; in space turns of each joint,
        and tendons.
        """

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
        """Labels of the dimensions of datasets that coordinates have."""
        return {kind.over: kind.labels for kind in self.kinds}

    @property
    def counted(self) -> str:
        """Return the number of coordinates of each kind, in words."""
        counts = ((len(kind.labels), kind.noun) for kind in self.kinds)
        return " and ".join(f"{count} {noun}{'s' * (count > 1)}" for count, noun in counts)

    @property
    def lengthens(self) -> bool:
        """Whether the body's length changes: what looks for angles alone does not hold it."""
        return bool(self.model.extensions)

    @property
    def lever(self) -> Array:
        """Generalised force (N,) [N m] of a torque or force of one at each coordinate, as datasets hold them."""
        lever = np.empty(self.size)
        for kind in self.kinds:
            lever[kind.rows] = kind.lever
        return lever

    def gathered(self, data: Any, which: int) -> Array:
        """Return a variable of all kinds of coordinates in a dataset, side by side (T, N): the one of those `names`."""
        columns = [(kind.rows, np.asarray(data[kind.names[which]])) for kind in self.kinds]
        values = np.empty((len(columns[0][1]), self.size))
        for rows, column in columns:
            values[:, rows] = column
        return values

    def variables(self, x: Array, v: Array) -> dict[str, tuple[tuple[str, ...], Array]]:
        """Return coordinates and rates of a motion (T, N), (T, N) as variables of a dataset: dimensions and values."""
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
        """Return the kind of the strains, which stand from row `first` on; none where nothing lengthens."""
        kind = CoordinateKind(
            "segment", "strain", [e.name for e in self.model.extensions], slice(first, self.size),
            ("axial_strain", "axial_strain_rate", "axial_disturbance", "external_axial_force"), ("1", "1/s", "N"),
            self.model.segment_length,
        )
        return (kind,) if self.lengthens else ()

    @abstractmethod
    def coordinates(self, q: Array) -> Array:
        """Return coordinates x (..., N) of joint coordinates q (..., N)."""

    @abstractmethod
    def joint_coordinates(self, x: Array) -> Array:
        """Return joint coordinates q (..., N) of coordinates x (..., N)."""

    @abstractmethod
    def joint_angles(self, x: Array) -> Array:
        """Return joint angles from the rest shape of coordinates x, with or without what stands behind them, rad."""

    @abstractmethod
    def rates(self, dq: Array) -> Array:
        """Return rates v (..., N) of rates dq (..., N) of the joint coordinates."""

    @abstractmethod
    def joint_rates(self, v: Array) -> Array:
        """Return rates dq (..., N) of the joint coordinates, of rates v (..., N)."""

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
        """Stiffness (N,) that hysteresis adds to the springs by joint coordinates before its branches move, N m/rad."""

    @property
    @abstractmethod
    def remembering(self) -> int:
        """Number m of coordinates, the first ones, that have hysteresis states: those of the joints."""

    @abstractmethod
    def held(self) -> Any:
        """Return scratch arrays for the steps of a chain with hysteresis states."""

    # places

    @cached_property
    @abstractmethod
    def length(self) -> Array:
        """Lengths (n + 1,) of the part before the first joint and of the links, unstretched, m."""

    @abstractmethod
    def stretches(self, x: Array) -> Array:
        """Return the stretch (..., n + 1) of each of them."""

    @abstractmethod
    def link_frames(self, x: Array) -> Array:
        """Return axes (..., n + 1, dimension, dimension) of base and links as columns: across, and along the last."""

    @abstractmethod
    def turning_moments(self, x: Array, arm: Array, force: Array) -> Array:
        """Return moments (T, P, K, turns) [N m] by the joints' turns of forces (T, P, dimension, K) at points, N.

        `arm` (T, P, n, dimension) leads from each joint to each point, m; 0 for joints that do not carry it.
        """

    @abstractmethod
    def directions(self, x: Array) -> Array:
        """Return unit vectors (..., n + 1, dimension) along each of them, in the kernels' frame."""

    @abstractmethod
    def tips(self, x: Array) -> Array:
        """Return tips of the links (..., n, dimension) in the base frame, m."""

    @abstractmethod
    def nodes(self, x: Array) -> Array:
        """Return the origin of the base, the first joint and all tips (..., n + 2, dimension), in the base frame, m."""

    @abstractmethod
    def stations(self, x: Array, tips: Array | None = None) -> tuple[Array, Array]:
        """Return positions (..., S, dimension) [m] and angles (..., S) [rad] of observed points, `tips` if known."""

    @abstractmethod
    def position_jacobian(self, x: Array, point: Station) -> Array:
        """Return the Jacobian (dimension, N) of a point's position by x at one moment, m/rad."""

    def points_and_slopes(self, x: Array) -> tuple[Array, Array]:
        """Return positions (S, dimension) [m] and Jacobians (S, dimension, N) of the model's points at one moment."""
        slopes = [self.position_jacobian(x, point) for point in self.model.points]
        return self.stations(x)[0], np.stack(slopes)

    @abstractmethod
    def beside_links(self, x: Array, points: Array, lengths: Any = None) -> Array:
        """Return coordinates along, across and aside (P, n + 1, 3) each link of points (P, dimension), m, base first.

        `lengths` may bring `length`, `base_length` and `share` of the links, complex ones among them.
        """

    @abstractmethod
    def tip_jacobian(self, x: Array, v: Array) -> tuple[Array, Array]:
        """Return the Jacobians (K, dimension, N) of the last tip by x (K, N), and their rates at rates v (K, N)."""

    # forces and energies

    @abstractmethod
    def inertia(self, x: Array) -> Array:
        """Return M (N, N) by x."""

    @abstractmethod
    def energy(self, x: Array, v: Array) -> Energy:
        """Return energies at x, v (N,), or (T,) along a motion (T, N)."""

    @abstractmethod
    def no_loads(self) -> Array:
        """Return the loads of the links where no force pulls, in the shape that kernels take."""

    @abstractmethod
    def link_loads(self, points: list[Station], forces: Array) -> Array:
        """Return what each link carries (T, ...) of forces (T, P, dimension) [N] at points, N m, for the kernels."""

    @abstractmethod
    def load_forces(self, x: Array, load: Array) -> Array:
        """Return generalised forces (N,) by x of loads of the links, also of complex x, N m."""

    @abstractmethod
    def load_stiffness(self, x: Array, load: Array) -> Array:
        """Return the slope (N, N) of `load_forces` by x."""

    @abstractmethod
    def static_forces(self, x: Array, torque: Array) -> Array:
        """Return what inputs (N,), springs and weight do to x at rest, also of complex x: zero in equilibrium."""

    @abstractmethod
    def static_slope(self, x: Array, load: Array | None = None, torque: Array | None = None) -> Array:
        """Return the slope (N, N) by x of `static_forces`, and of `load_forces` where there is a load; symmetric.

        `torque` is that of the inputs, where what they pull depends on x: 0 without.
        """

    @abstractmethod
    def equilibrium(self, torque: Array, tip_force: Array, link_load: Array | None) -> Array:
        """Return joint coordinates q (N,) at rest under torques (N,) [N m], gravity and loads."""

    @abstractmethod
    def linear_parts(self, q: Array) -> tuple[Array, Array]:
        """Return inertia and stiffness (N, N) by joint coordinates at q."""
