"""The interface of a family of chains: what the rest of the package may ask of a body that moves.

Coordinates x (N,) and rates v (N,) are those of the kernels. Users see joint coordinates q (N,): joint angles from the
rest shape, and behind them the strains of segments that lengthen.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from pliant.model import Model, Station

Array = np.ndarray


class Energy(NamedTuple):
    """Energies of a body, J: numbers at one moment, or arrays (T,)."""

    kinetic: Any
    elastic: Any
    gravity: Any


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

    def __init__(self, model: Model) -> None:
        self.model, self.n, self.size = model, model.n, model.size

    # what the kernels take

    @cached_property
    @abstractmethod
    def body(self) -> Any:
        """Record of the constants of the inertia."""

    @cached_property
    def joints(self) -> Any:
        """Record of springs and dampers."""
        return self.model.joints()

    @abstractmethod
    def workspace(self, kind: type = float) -> Any:
        """Return scratch arrays of a `kind` of numbers for one step."""

    @abstractmethod
    def acceleration(self) -> Any:
        """Return the kernel ``(x, v, torque, body, joints, work, a)`` of the accelerations a (N,)."""

    @abstractmethod
    def acceleration_jacobian(self) -> Any:
        """Return the kernel ``(x, v, torque, body, joints, work, out)`` that fills `equations.symbols.Slopes`."""

    # coordinates

    @cached_property
    @abstractmethod
    def names(self) -> tuple[str, ...]:
        """Names (N,) of the coordinates x."""

    @abstractmethod
    def coordinates(self, q: Array) -> Array:
        """Return coordinates x (N,) of joint coordinates q (N,)."""

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

    # places

    @abstractmethod
    def tips(self, x: Array) -> Array:
        """Return tips of the links (..., n, dimension) in the base frame, m."""

    @abstractmethod
    def stations(self, x: Array, tips: Array | None = None) -> tuple[Array, Array]:
        """Return positions (..., S, dimension) [m] and angles (..., S) [rad] of observed points, `tips` if known."""

    @abstractmethod
    def position_jacobian(self, x: Array, point: Station) -> Array:
        """Return the Jacobian (dimension, N) of a point's position by x at one moment, m/rad."""

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
    def equilibrium(self, torque: Array, tip_force: Array, link_load: Array | None) -> Array:
        """Return joint coordinates q (N,) at rest under torques (N,) [N m], gravity and loads."""

    @abstractmethod
    def linear_parts(self, q: Array) -> tuple[Array, Array]:
        """Return inertia and stiffness (N, N) by joint coordinates at q."""
