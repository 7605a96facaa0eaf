"""Steady inputs that hold outputs, such as the tip position, at given values, and equilibria over all pressures."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from pliant.equations.symbols import Sight
from pliant.errors import InputError, SimulationError
from pliant.estimation.offline import frame_of
from pliant.estimation.symbols import FilterFrame
from pliant.linear.linearisation import LinearModel, linearise
from pliant.mechanics import mechanics_of
from pliant.model import Model, fixed_length
from pliant.simulation import state
from pliant.units import in_words

Array = np.ndarray
REACHED = 2e-4  # m, error below which an output counts as reached
LEAST = 1e-9  # weight of the pressures, so that the lowest ones are chosen where the outputs leave them free
ROUNDS = 40


class Rest(NamedTuple):
    """A static equilibrium under given pressures, with its linearisation and the output values."""

    pressure: Array  # (C,) Pa
    linear: LinearModel  # linearisation about the equilibrium
    value: Array  # (m,) outputs, m and rad
    row: Array  # (m, N) derivatives of the outputs by the states
    gain: Array  # (m, C) static derivatives of the outputs by the pressures, per Pa


def output_values(model: Model, angle: Array, outputs: tuple[str, ...]) -> Array:
    """Return the values (..., m) of m named outputs, among tip_x, tip_y, tip_z [m] and angle_sum [rad], at N model
    coordinates `angle` (..., N).
    """
    tip = mechanics_of(model).tips(angle)[..., -1, :]
    values = np.concatenate([tip, angle[..., model.n - 1 : model.n]], axis=-1)  # the angle is one in a plane only
    return values[..., which_outputs(model, outputs)]


def which_outputs(model: Model, outputs: tuple[str, ...]) -> list[int]:
    """Return the indices of the named outputs among those of a model; raise InputError for an unknown name."""
    known = list(mechanics_of(model).outputs)
    if strange := [name for name in outputs if name not in known]:
        raise InputError(f"unknown output {strange[0]!r}: use one or more of {', '.join(known)}")
    return [known.index(name) for name in outputs]


def tip_geometry(model: Model, outputs: tuple[str, ...]) -> tuple[FilterFrame, Sight]:
    """Return the arguments `frame` and `sight` of `observation.outputs` for the named outputs of the tip: one row for
    each output, and scratch arrays.
    """
    chain = mechanics_of(model)
    kinds = list(chain.outputs.values())
    tip = (model.n - 1, float(model.link_length[-1]), 0.0, 0.0)
    rows = np.array([(kinds[k], *tip) for k in which_outputs(model, outputs)])[:, : chain.row_width]
    none = np.zeros(len(outputs))
    return frame_of(model, rows, none, none), chain.sight(np.array)


def output_rates(model: Model, x: Array, v: Array, outputs: tuple[str, ...]) -> tuple[Array, Array, Array]:
    """Return, at K states with N coordinates `x` (K, N) and rates `v` (K, N), the derivatives of m outputs with respect
    to `x`, the rates of the outputs, and the derivatives of these rates with respect to `x`.

    Returns
    -------
    row : array (K, m, N)
        Derivatives of the outputs by x, which equal those of their rates by v.
    speed : array (K, m)
        Rates of the outputs, per second.
    row_speed : array (K, m, N)
        Derivatives of the rates by x.
    """
    rows, moved = np.zeros((2, len(x), 3, model.size))
    chain, which = mechanics_of(model), which_outputs(model, outputs)
    axes = chain.dimension
    rows[:, :axes], moved[:, :axes] = chain.tip_jacobian(x, v)
    if axes == 2:
        rows[:, 2, model.n - 1] = 1.0
    return rows[:, which], (rows[:, which] @ v[:, :, None])[..., 0], moved[:, which]


def output_weights(model: Model, outputs: tuple[str, ...]) -> Array:
    """Return the factors (m,) that convert m outputs to lengths [m]: 1 for positions, the
    actuator's length for angles.
    """
    return np.array([model.length if name == "angle_sum" else 1.0 for name in outputs])


def rest_under(model: Model, pressure: Array, outputs: tuple[str, ...]) -> Rest:
    """Return the static equilibrium of the model under pressures (C,) [Pa] in C chambers, with its linearisation and
    outputs.
    """
    linear = linearise(model, pressure)
    row = np.array([linear.row(name) for name in outputs])
    return Rest(
        pressure, linear, output_values(model, linear.position, outputs), row,
        -row @ np.linalg.solve(linear.A, linear.B),
    )


def steady_inputs(model: Model, outputs: tuple[str, ...], wanted: Array, highest: Array, start: Array) -> Rest:
    """Return the equilibrium whose m outputs are closest to `wanted` (m,), with the pressures of C chambers between 0
    and `highest` (C,) [Pa].

    Parameters
    ----------
    model : Model
        Model without hysteresis, or with it frozen.
    outputs : tuple of str
        Names among tip_x, tip_y [m] and angle_sum [rad], the angle of the last link; in space tip_x, tip_y, tip_z.
    wanted : array (m,)
        Target values of the outputs, in the model's frame.
    highest, start : array (C,)
        Highest pressures, and initial guess of the search [Pa]. Other initial guesses are tried if it fails.

    Raises
    ------
    InputError
        When the error is above 0.2 mm for all pressures, where an angle is multiplied by the body's length.
    """
    weight = output_weights(model, outputs)
    begins = [start, 0.5 * highest, *(0.5 * np.diag(highest)), *(highest - 0.5 * np.diag(highest))]
    rests = []
    for begin in begins:
        rest = nearest(model, outputs, wanted, highest, begin)
        far = float(np.linalg.norm(weight * (rest.value - wanted)))
        if far <= REACHED:
            return rest
        rests.append((far, rest))
    far, rest = min(rests, key=lambda pair: pair[0])
    still = output_values(model, mechanics_of(model).coordinates(state.equilibrium(model, 0.0)), outputs)
    said = ", ".join(f"{n} {v:.4g}" for n, v in zip(outputs, wanted - still, strict=True))
    best = ", ".join(f"{n} {v:.4g}" for n, v in zip(outputs, rest.value - still, strict=True))
    raise InputError(
        f"a change of {said} (m, rad) from rest is out of reach of the chambers: choose one near the closest that the "
        f"model reaches, {best}, under {written(model, rest.pressure)}"
    )


def written(model: Model, values: Array) -> str:
    """Return the values (C,) of a model's C inputs as text, in the units that plots use, such as "12.5 kPa"."""
    units = model.actuation.units
    if len(set(units)) == 1:
        return in_words(values, units[0])
    return ", ".join(in_words(v, unit) for v, unit in zip(values, units, strict=True))


def nearest(model: Model, outputs: tuple[str, ...], wanted: Array, highest: Array, start: Array) -> Rest:
    """Return the equilibrium whose m outputs are closest to `wanted` (m,). Gauss-Newton steps search for it from the
    pressures `start` (C,) [Pa] of C chambers.
    """
    weight, rest = output_weights(model, outputs), rest_under(model, np.clip(start, 0.0, highest), outputs)
    for _ in range(ROUNDS):
        G, error = weight[:, None] * rest.gain * highest, weight * (wanted - rest.value)
        x = rest.pressure / highest
        H = G.T @ G
        H += LEAST * np.trace(H) * np.eye(x.size)
        move = bounded_least_squares(H, G.T @ (error + G @ x), x, 1.0) - x
        far, length = float(np.linalg.norm(error)), 1.0
        while length > 1e-3:
            try:
                ahead = rest_under(model, highest * np.clip(x + length * move, 0.0, 1.0), outputs)
            except SimulationError:
                length *= 0.5
                continue
            if np.linalg.norm(weight * (wanted - ahead.value)) <= far * (1 + 1e-9):
                rest = ahead
                break
            length *= 0.5
        if length <= 1e-3 or length * np.abs(move).max() < 1e-6:
            break
    return rest


def bounded_least_squares(H: Array, b: Array, start: Array, highest: float) -> Array:
    """Return the F unknowns x (F,) that minimise 1/2 x^T H x - b^T x between 0 and `highest`, by projected Newton
    steps.

    H (F, F) must be positive definite; `start` (F,) is the initial guess.

    Source: Bertsekas, SIAM J. Control Optim. 20(2), 1982
    """
    x = np.clip(start, 0.0, highest)
    for _ in range(60):
        slope = H @ x - b
        free = ~(((x <= 0.0) & (slope > 0)) | ((x >= highest) & (slope < 0)))
        if not free.any() or np.abs(slope[free]).max() <= 1e-9 * np.abs(b).max():
            break
        move = np.zeros_like(x)
        move[free] = -np.linalg.solve(H[np.ix_(free, free)], slope[free])
        length = 1.0
        while length > 1e-4:
            step = np.clip(x + length * move, 0.0, highest) - x
            if slope @ step + 0.5 * step @ H @ step < 0.0:
                break
            length *= 0.5
        if (np.abs(step) <= 1e-6 * highest).all():
            return x + step
        x = x + step
    return x


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
