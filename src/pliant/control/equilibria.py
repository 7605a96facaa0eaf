"""Static equilibria of a planar model at increasing pressures, and the pressure that holds a given tip displacement."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pliant.errors import InputError
from pliant.mechanics import mechanics_of
from pliant.model import Model, fixed_length
from pliant.simulation import state

Array = np.ndarray
POINTS = 41
ROUNDING = 1e-12  # m


@dataclass(frozen=True)
class Equilibria:
    """Static equilibria of a planar model at increasing pressures: link angles, tip position and direction of the tip's
    path.

    Attributes
    ----------
    pressure : array (G,)
        Pressures [Pa], from 0 to the highest allowed.
    angle : array (G, n)
        Absolute link angles [rad].
    tip : array (G, 2)
        Tip positions [m] in the model's frame.
    travel : array (G,)
        Length of the tip's path through the equilibria, from pressure 0 on [m].
    direction : array (G, 2)
        Unit tangent of the tip's path, towards more pressure.
    """

    pressure: Array
    angle: Array
    tip: Array
    travel: Array
    direction: Array

    @property
    def reach(self) -> float:
        """Displacement [m] of the tip from its unpressurised position at the highest pressure."""
        return float(self.displacement[-1])

    @property
    def displacement(self) -> Array:
        """Distance (G,) [m] of the tip from its unpressurised position, at each of G pressures."""
        return np.linalg.norm(self.tip - self.tip[0], axis=1)

    def pressure_for(self, displacement: float) -> float:
        """Return the pressure [Pa] at which the tip is `displacement` [m] away from its unpressurised position in
        equilibrium.

        Raises
        ------
        InputError
            When no pressure up to the highest allowed moves the tip that far.
        """
        far = self.displacement
        rising = int(np.argmax(far)) + 1
        if not (np.isfinite(displacement) and -ROUNDING <= displacement <= far[rising - 1]):
            raise InputError(
                f"a tip displacement of {displacement * 1e3:.4g} mm is out of reach: up to "
                f"{self.pressure[-1] * 1e-3:.4g} kPa the model's tip moves 0 ... {far[rising - 1] * 1e3:.4g} mm; "
                "choose a displacement in this range"
            )
        return float(np.interp(displacement, far[:rising], self.pressure[:rising]))

    def moved(self, displacement: Array) -> Array:
        """Return the displacement vectors (K, 2) [m] of the tip from its unpressurised position, for K distances
        `displacement` [m] from that position.
        """
        return np.array([self.at(self.pressure_for(float(d)))[1] for d in displacement]) - self.tip[0]

    def at(self, pressure: float) -> tuple[Array, Array, Array]:
        """Return link angles (n,) [rad], tip position (2,) [m] and unit direction of the tip's path (2,) in equilibrium
        at `pressure` [Pa].
        """
        p = float(np.clip(pressure, self.pressure[0], self.pressure[-1]))
        k = min(int(np.searchsorted(self.pressure, p, side="right")) - 1, self.pressure.size - 2)
        share = (p - self.pressure[k]) / (self.pressure[k + 1] - self.pressure[k])
        rows = (self.angle, self.tip, self.direction)
        angle, tip, way = ((1 - share) * r[k] + share * r[k + 1] for r in rows)
        return angle, tip, way


def equilibria(model: Model, highest: float, points: int = POINTS) -> Equilibria:
    """Return the static equilibria of `model`, with one chamber, at `points` pressures from 0 to `highest` [Pa].

    Raises
    ------
    InputError
        When the highest pressure is not positive, or more pressure does not bend the model further.
    """
    if not (np.isfinite(highest) and highest > 0):
        raise InputError(f"the highest pressure must be positive, in Pa, got {highest}")
    fixed_length(model)
    pressure = np.linspace(0.0, highest, points)
    angle = np.array([mechanics_of(model).coordinates(state.equilibrium(model, p)) for p in pressure])
    tip = mechanics_of(model).tips(angle)[:, -1]
    piece = np.linalg.norm(np.diff(tip, axis=0), axis=1)
    if not np.all(np.diff(angle[:, -1]) > 0) or not np.all(piece > 0):
        raise InputError(
            "the model does not bend further with every increase of the pressure up to the highest pressure: lower the "
            "highest pressure"
        )
    direction = np.gradient(tip, pressure, axis=0)
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    return Equilibria(pressure, angle, tip, np.concatenate([[0.0], np.cumsum(piece)]), direction)
