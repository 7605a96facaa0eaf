"""Obstacles in the plane, as rows of numbers for the compiled time loop."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pliant.errors import InputError

Array = np.ndarray
RIGID = 4.0e3  # N/m per 5 mm of touching body: the silicone yields before the post
SLIP_SPEED = 1.0e-3  # m/s, below which friction is viscous


@dataclass(frozen=True)
class Circle:
    """A round post; a low `stiffness` makes it a soft spring."""

    centre: tuple[float, float]  # m
    radius: float  # m
    stiffness: float = RIGID  # N/m per 5 mm of body
    friction: float = 0.3

    def row(self) -> list[float]:
        """Return seven numbers that describe the post to the compiled time loop: kind, geometry (3), stiffness,
        friction, slip speed.
        """
        return [0.0, *self.centre, self.radius, self.stiffness, self.friction, SLIP_SPEED]


@dataclass(frozen=True)
class Wall:
    """A solid half-plane ``normal . x <= offset``."""

    normal: tuple[float, float]
    offset: float  # m
    stiffness: float = RIGID
    friction: float = 0.3

    def row(self) -> list[float]:
        """Return seven numbers that describe the wall to the compiled time loop: kind, geometry (3), stiffness,
        friction, slip speed.
        """
        return [1.0, *self.normal, self.offset, self.stiffness, self.friction, SLIP_SPEED]


def obstacle_rows(obstacles: Sequence[Circle | Wall]) -> Array:
    """Return an (O, 7) array of O obstacles. A row holds kind, geometry (3 numbers), stiffness, friction coefficient
    and slip speed.

    Raises
    ------
    InputError
        When a normal is not of unit length or a radius or stiffness is not positive.
    """
    for item in obstacles:
        if isinstance(item, Wall) and abs(float(np.hypot(*item.normal)) - 1.0) > 1e-9:
            raise InputError(f"a wall's normal must have unit length, got {item.normal}")
        if item.stiffness <= 0 or item.friction < 0 or (isinstance(item, Circle) and item.radius <= 0):
            raise InputError(f"an obstacle needs radius and stiffness > 0 and friction >= 0, got {item}")
    return np.array([item.row() for item in obstacles], dtype=float).reshape(-1, 7)
