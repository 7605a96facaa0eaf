"""The inputs of an actuator (pressure chambers and tendons), and the joint torques and axial forces that they cause."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from pliant.equations import symbols
from pliant.equations.laws import POLYNOMIAL
from pliant.errors import InputError
from pliant.model.actuation_input import ActuationInput
from pliant.model.chamber import Chamber
from pliant.model.checks import check_names
from pliant.shapes import Float
from pliant.text import listed

Array = np.ndarray
LEAST = 1e-30  # N, less pretension of the second tendon of a pair, so that one of the two is taut


@dataclass(frozen=True)
class Actuation:
    """All inputs of an actuator, pressure chambers or tendons: their names, kinds and units, and the joint torques that
    they cause.

    `joints` is the number of joints.

    A model has it as `model.actuation`. A body with a single input is the case C = 1.

    Where segments lengthen, the torques (n + S,) have further entries for their strains: axial force times the
    segment's length, N m.

    Attributes
    ----------
    inputs : tuple of ActuationInput
        The law of each input, in the order of the input values.
    joints : int
    segment_length : tuple of float
        Lengths of the segments that lengthen, m.
    segment_joints : tuple of tuple of int
        Indices, from 0, of the joints that lie in each of these segments.
    turns : int
        Coordinates of each joint: 1 in a plane, 2 or 3 in space.
    """

    inputs: tuple[ActuationInput, ...]
    joints: int
    segment_length: tuple[float, ...] = ()
    segment_joints: tuple[tuple[int, ...], ...] = ()
    turns: int = 1

    @property
    def count(self) -> int:
        """Number C of inputs: chambers, tendons and tendon pairs."""
        return len(self.inputs)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the C inputs, in the order of the input values."""
        return tuple(c.name for c in self.inputs)

    @property
    def kinds(self) -> tuple[str, ...]:
        """Kind of each of the C inputs: "pressure" (gauge), "tension", "displacement" or "angle"."""
        return tuple(c.kind for c in self.inputs)

    @property
    def units(self) -> tuple[str, ...]:
        """SI unit of each of the C inputs, such as "Pa"."""
        return tuple(c.unit for c in self.inputs)

    @property
    def listing(self) -> str:
        """Names of the C inputs as one text, separated by commas; of many, the first ones and their number."""
        return listed(self.names)

    @property
    def variable(self) -> str:
        """Name of the variable that holds the inputs in datasets: "pressure" if all are pressures, else "actuation"."""
        return "pressure" if set(self.kinds) <= {"pressure"} else "actuation"

    @property
    def wanted(self) -> str:
        """Text that states how many values the inputs need, and of which units."""
        if self.variable == "pressure":
            return f"{self.count} pressure(s) in Pa, one for each chamber ({self.listing})"
        named = (f"{name} [{unit}]" for name, unit in zip(self.names, self.units, strict=True))
        return f"{self.count} value(s), one for each input ({listed(named)})"

    def labels(self, quantity: str) -> list[str]:
        """Return the column name of a quantity for each input in tables and files, such as ``pressure_left``.

        ``{kind}`` in `quantity` stands for the kind of the input. For a single input the name is just ``pressure``.
        """
        parts = [quantity.format(kind=kind) for kind in self.kinds]
        return parts if self.count == 1 else [f"{part}_{name}" for part, name in zip(parts, self.names, strict=True)]

    @cached_property
    def gain(self) -> Float[Array, "C N"]:
        """Gains (C, N) of C inputs at N coordinates: the torque at each coordinate for a torque of 1 N m of each
        chamber, or a tension of 1 N of each tendon.

        The coordinates are joint angles, then twists and strains. The column of a strain is the axial force over the
        torque [1/m] times the segment's length [m].
        """
        joints = np.stack([np.broadcast_to(c.joint_gain, (self.joints,)) for c in self.inputs])
        if self.turns > 1:
            across = np.stack([np.broadcast_to(c.cross_gain, (self.joints,)) for c in self.inputs])
            lever = [np.broadcast_to(c.distance(), self.joints) for c in self.inputs]
            bent = (np.stack(lever)[..., None] * np.stack([joints, across], axis=-1)).reshape(self.count, -1)
            joints = np.pad(bent, ((0, 0), (0, (self.turns - 2) * self.joints)))
        if not self.segment_length:
            return joints
        axial = np.stack([c.axial_gains(self.joints, self.segment_joints) for c in self.inputs])
        return np.hstack([joints, axial * self.segment_length])

    @cached_property
    def tendons(self) -> tuple[int, ...]:
        """Indices of those inputs that pull a tendon or a pair of tendons."""
        return tuple(i for i, c in enumerate(self.inputs) if c.signs)

    @cached_property
    def _cords(self) -> list[tuple[int, Any, float]]:
        """Index and input of each tendon, and its sign: -1 for the second of a pair, which is let out, else 1."""
        return [(i, c, sign) for i, c in enumerate(self.inputs) for sign in c.signs]

    @cached_property
    def levers(self) -> Float[Array, "R N"]:
        """Lever arm (R, N) [m] of each of R tendons at each of the N coordinates of the chain. At the joints, the two
        tendons of a pair have opposite signs.
        """
        levers = np.reshape([self.gain[i] for i, *_ in self._cords], (-1, self.gain.shape[1]))
        levers[:, : self.turns * self.joints] *= np.reshape([sign for *_, sign in self._cords], (-1, 1))
        return levers

    @cached_property
    def chords(self) -> Float[Array, "R n"]:
        """Coefficient (R, n) [m^2] by which the path of each of R tendons is shorter for the square of the bend at each
        of n joints, over the length that the joint bends: the path follows chords between guides.
        """
        rows = [c.spacing**2 / 24.0 * np.hypot(c.joint_gain, c.cross_gain) for _, c, _ in self._cords]
        return np.reshape([np.broadcast_to(row, self.joints) for row in rows], (-1, self.joints))

    @cached_property
    def tendon_constants(self) -> tuple[Float[Array, " R"], ...]:
        """Stiffness [N/m], pretension [N], friction coefficient, slip rate [m/s] and entry friction [N] of the R
        tendons, as five arrays (R,).
        """
        k, T0, *friction = np.reshape([c.constants() for _, c, _ in self._cords], (-1, 5)).T.copy()
        T0 += [0.5 * sign * c.imbalance - (LEAST if sign < 0.0 else 0.0) for _, c, sign in self._cords]
        return k, T0, *friction

    @property
    def tendons_rub(self) -> bool:
        """Whether any tendon has friction, along its path or at its entry."""
        _, _, path, _, entry = self.tendon_constants
        return bool(path.any() or entry.any())

    @cached_property
    def columns(self) -> Float[Array, "C N+R"]:
        """Gains (C, N + R) of C inputs as the compiled kernels take them: first at the N coordinates of the chain, then
        at R tendons.

        The first N columns are those of `gain`, but 0 for inputs that pull tendons. The last R columns are 1 for a
        tendon of the input, -1 for the second one of a pair, and else 0.
        """
        if not self.tendons:
            return self.gain
        gain, drawn = np.array(self.gain), np.zeros((self.count, len(self._cords)))
        gain[list(self.tendons)] = 0.0
        for r, (i, _, sign) in enumerate(self._cords):
            drawn[i, r] = sign
        return np.hstack([gain, drawn])

    @property
    def remembers(self) -> bool:
        """Whether a chamber has slow states: lagged pressure or wall stretch."""
        return any(c.remembers for c in self.inputs)

    @property
    def polynomial(self) -> bool:
        """Whether the torque laws of all chambers are polynomials of the pressure."""
        return all(c.law == POLYNOMIAL for c in self.inputs)

    def kernel(self) -> symbols.ActuationConstants:
        """Return the constants of all inputs as a record for the compiled kernels."""
        longest = max(c.torque.size for c in self.inputs)
        law = np.stack([np.pad(c.torque, (0, longest - c.torque.size)) for c in self.inputs])
        return symbols.ActuationConstants(law, np.array(self.columns), np.array([c.kernel()[1:] for c in self.inputs]))

    def pressures(self, value: Any) -> Float[Array, " C"]:
        """Return `value` as an array (C,) with one value in SI units for each of C inputs. A single number is enough
        for a single input, and a single 0 sets any number of inputs to 0.

        Raises
        ------
        InputError
            When the number of pressures is not that of the inputs.
        """
        p = np.array(value, dtype=float, ndmin=1)  # a copy, since the caller may change the array
        if p.shape == (1,) and p[0] == 0.0:
            return np.zeros(self.count)
        if p.shape != (self.count,):
            raise InputError(f"expected {self.wanted}, got shape {p.shape}")
        return p

    def torques_over(self, pressure: Any) -> Float[Array, "T C"]:
        """Return the static torque [N m] of each chamber and the commanded force [N] of each tendon (T, C) for input
        values (T, C) in SI units at T instants; (T,) is enough for a single input.

        Raises
        ------
        InputError
            When the number of columns is not the number of inputs.
        """
        p = np.asarray(pressure, dtype=float)
        p = p[:, None] if p.ndim == 1 else p
        if p.ndim != 2 or p.shape[1] != self.count:
            word = "pressures" if self.variable == "pressure" else "inputs"
            raise InputError(f"expected {word} (T, {self.count}): {self.wanted}, got shape {p.shape}")
        return np.stack([np.asarray(c.torque_at(p[:, k])) for k, c in enumerate(self.inputs)], axis=1)

    def joint_torques_over(self, pressure: Any) -> Float[Array, "T N+R"]:
        """Return the static torques at the N coordinates of the chain [N m], followed by the commanded forces of R
        tendons [N], as the compiled kernels take them, for input values (T, C) in SI units at T instants.

        They are infinite or NaN where a hyperelastic wall has no equilibrium.
        """
        return np.asarray(self.torques_over(pressure) @ self.columns)

    def torques(self, pressure: Any) -> Float[Array, " C"]:
        """Return the static torque [N m] of each chamber and the commanded force [N] of each tendon as an array (C,).
        `pressure` (C,) has the values of the C inputs in SI units.
        """
        return self.torques_over(self.pressures(pressure)[None])[0]

    def joint_torques(self, pressure: Any) -> Float[Array, " N+R"]:
        """Return the row (N + R,) of `joint_torques_over` for the values `pressure` (C,) of the C inputs."""
        return self.joint_torques_over(self.pressures(pressure)[None])[0]

    def no_rest(self, pressure: Any) -> str:
        """Return a message about the first chamber whose hyperelastic wall has no equilibrium at its pressure; '' if
        all have one. `pressure` (C,) has the values of the C inputs in SI units.
        """
        said = (c.no_rest(p) for c, p in zip(self.inputs, self.pressures(pressure), strict=True))
        return next(filter(None, said), "")

    def rest_state(self, pressure: Any) -> Float[Array, "C 2"]:
        """Return the slow states of C chambers in equilibrium at the pressures `pressure` (C,) [Pa]. Each row of the
        array (C, 2) holds the lagged pressure [Pa] and the fourth power of the wall's hoop stretch.
        """
        return np.stack([c.rest_state(p) for c, p in zip(self.inputs, self.pressures(pressure), strict=True)])


def chambers_of(values: dict[str, Any], given: Sequence[ActuationInput]) -> tuple[ActuationInput, ...]:
    """Return the chambers of a model as a tuple: those in `given` or, if it is empty, one with the parameters `values`.

    Raises
    ------
    InputError
        When both are given, or neither.
    """
    if given and values:
        raise InputError(
            "give either chambers or the parameters of a single chamber, not both: leave out "
            f"{', '.join(sorted(values))}"
        )
    if given:
        inputs = tuple(given)
        if not all(isinstance(c, ActuationInput) for c in inputs):
            raise InputError(f"chambers must be Chamber objects, got {given!r:.80}")
        check_names("chambers", [c.name for c in inputs])
        return inputs
    if "torque" not in values:
        raise InputError("a model needs a torque law: give torque = (A d,) [N m/Pa], or chambers")
    return (Chamber(**values),)
