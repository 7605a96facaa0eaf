"""Parameters that only a chain in space has, such as stiffness ratios, radius and base tilt."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from math import pi
from typing import Annotated, Any

import numpy as np

from pliant.errors import InputError
from pliant.model.checks import EqualByFields, one_number
from pliant.model.quantity import Quantity, declaring, quantities, scalars

Array = np.ndarray
LEAST_AXIAL = 1e-12  # of the mass times the square of the length; below, rounding hides the inertia about the axis


@declaring
@dataclass(frozen=True, eq=False)
class Space(EqualByFields):
    """Parameters that make a model a chain in space, whose joints bend in two directions and may twist. SI units.

    A chain in space has its base at the origin and its base tangent along +z. The joint before each link turns by a
    rotation vector (a, b, 0) in the cross-section, then by a twist c about the link. The planar chain is the case
    b = c = 0: its x axis is the y axis here, its y axis the z axis.

    Parameters
    ----------
    stiffness_ratio : float
        Bending stiffness about the y axis of the cross-section over that about its x axis, which is the model's
        `stiffness`; the dampers have the same ratio. 1: the same in all directions.
    twist_ratio : float
        Torsional stiffness over bending stiffness (GJ / EI; 1 / (1 + nu) of a round section). 0: the chain does not
        twist.
    rest_turn : array (n, 3)
        Rest shape: the fixed rotation before each joint, as a rotation vector [rad] in the frame of the link before.
        One row applies to all joints.
    base_tilt : array (3,)
        Rotation vector of the clamped base about the axes of the base frame, rad. Two numbers are those about x and y.
    radius : float
        Radius of the cross-section, m, for the rotary inertia of the links. 0: thin rods, which cannot twist.

    Raises
    ------
    InputError
        When a number is not finite or not physical.
    """

    stiffness_ratio: Annotated[float, Quantity(
        "1", "bending stiffness about y over that about x, in space", sign="positive", most=1e4,
        lower=1e-2, upper=1e2, scale=0.1, log_offset=0.0)] = 1.0
    twist_ratio: Annotated[float, Quantity(
        "1", "torsional over bending stiffness, in space", sign="not negative", most=1e4,
        lower=1e-3, upper=1e2, scale=0.1)] = 0.0
    rest_turn: Annotated[Array, Quantity(
        "rad", "rest turn of one joint about an axis of its link, in space", per="axis and joint",
        lower=-3.1, upper=3.1, scale=0.05)] = field(default_factory=lambda: np.zeros((1, 3)))
    base_tilt: Annotated[Array, Quantity(
        "rad", "rotation of the base about an axis of the base frame, in space", per="axis",
        lower=-3.2, upper=3.2, scale=0.05)] = field(default_factory=lambda: np.zeros(3))
    radius: Annotated[float, Quantity(
        "m", "radius of the cross-section, for its rotary inertia", sign="not negative", most=1e2,
        fitted=False)] = 0.0

    def __post_init__(self) -> None:
        for name in scalars(Space):
            object.__setattr__(self, name, one_number(f"space {name}", getattr(self, name)))
        if np.size(self.base_tilt) == 2:
            object.__setattr__(self, "base_tilt", [*self.base_tilt, 0.0])
        for name, shape in (("rest_turn", (-1, 3)), ("base_tilt", (3,))):
            object.__setattr__(self, name, rows_of(name, getattr(self, name), shape))
        for name in scalars(Space):
            quantity, value = quantities(Space)[name], getattr(self, name)
            if not 0 <= value < quantity.most or (value == 0 and quantity.sign == "positive"):
                unit = "" if quantity.unit == "1" else f" {quantity.unit}"
                raise InputError(f"{name} of space must be 0 to {quantity.most:g}{unit}, got {value}")
        if self.twist_ratio and not self.radius:
            raise InputError(
                "space: a chain that twists needs a radius [m], because a thin rod has no inertia about its axis: set "
                "radius"
            )
        if np.linalg.norm(self.rest_turn, axis=1).max() >= pi:
            raise InputError("space rest_turn must turn each joint by less than pi rad: use more links")

    @property
    def turns(self) -> int:
        """Number of angles of each joint: 2 swing angles, and a third one if the chain twists."""
        return 3 if self.twist_ratio else 2

    def rest_of(self, n: int) -> Array:
        """Return the rotation vectors (n, 3) [rad] that describe the rest shape at each of n joints."""
        return np.array(np.broadcast_to(self.rest_turn, (n, 3)))


def rows_of(name: str, value: Any, shape: tuple[int, ...]) -> Array:
    """Return a parameter of `Space` as a finite, read-only array of the given `shape`, in which -1 means any length."""
    try:
        a = np.array(value, dtype=float)
        a = a.reshape(shape) if a.size else a
    except (TypeError, ValueError):
        raise InputError(f"space {name} must be numbers of shape {shape}, got {value!r:.80}") from None
    if not a.size or not np.isfinite(a).all():
        raise InputError(f"space {name} must be finite numbers, got {value!r:.80}")
    a.setflags(write=False)
    return a


def space_of(value: Any) -> Space | None:
    """Return `value` as a `Space` or None. A mapping gives its parameters, True means the defaults, False means None.

    Raises
    ------
    InputError
        When `value` is none of these.
    """
    if value is None or value is False:
        return None
    if isinstance(value, Space):
        return value
    if value is True:
        return Space()
    if isinstance(value, Mapping):
        known = [f.name for f in fields(Space)]
        if unknown := sorted(set(value) - set(known)):
            raise InputError(f"space has no parameter {unknown[0]!r}: it takes {', '.join(known)}")
        return Space(**value)
    raise InputError(f"model space must be a Space, a table of its parameters, or None, got {value!r:.60}")


def require_planar(model: Any, what: str) -> None:
    """Raise InputError if a model is a chain in space. `what` names the function that needs a planar one."""
    if model.space is not None:
        raise InputError(
            f"{what} needs a planar chain, but {model.name!r} is in space: use simulate, Stepper, equilibrium, modes, "
            "linearise, fit, predict, simulate_batch, KalmanFilter or estimate, which accept it"
        )


def check_space(model: Any) -> None:
    """Raise InputError if a planar model has a parameter that only chains in space have, or a chain in space a
    parameter that only planar models have.
    """
    size = 2 if model.space is None else 3
    if model.gravity.size != size:
        axes = "x, y" if size == 2 else "x, y, z"
        raise InputError(f"model gravity must be {size} numbers ({axes} in the base frame), got {model.gravity.size}")
    if model.space is None:
        if tendon := next((c.name for c in model.chambers if c.signs), ""):
            raise InputError(f"tendon {tendon!r} needs a model in space: set space = Space()")
        if across := next((c.name for c in model.chambers if c.cross_gain.any()), ""):
            raise InputError(f"chamber {across!r} has a cross_gain, which needs a model in space: set space = Space()")
        return
    if len(model.space.rest_turn) not in (1, model.n):
        raise InputError(
            f"space rest_turn must have one row or {model.n}, got {len(model.space.rest_turn)}: give one row for each "
            "joint"
        )
    check_twist(model)
    planar = {"rest_angle": model.rest_angle.any(), "base_angle": model.base_angle,
              "mass_at": model.mass_at == "tip"}  # fmt: skip
    remedy = {"rest_angle": "set rest_turn of its space", "base_angle": "set base_tilt of its space"}
    for name, value in planar.items():
        if value:
            raise InputError(f"a chain in space has no {name}: {remedy.get(name, 'leave it out')}")


def check_twist(model: Any) -> None:
    """Raise InputError if the last link of a chain that twists has no inertia about its axis beside that of the body:
    a tip mass is a point on the axis.
    """
    space = model.space
    if not space.twist_ratio:
        return
    axial = 0.5 * float(model.link_mass[-1]) * space.radius**2
    if axial < LEAST_AXIAL * model.mass * model.length**2:
        raise InputError(
            f"the last link of a chain that twists has a moment of inertia of {axial:.3g} kg m^2 about its axis (mass "
            f"{float(model.link_mass[-1]):g} kg, radius {space.radius:g} m), too little for its motion to be computed: "
            "give it a mass and the body a radius, or set twist_ratio to 0"
        )
