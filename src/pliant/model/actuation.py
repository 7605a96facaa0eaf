"""The inputs of a body: what turns them into joint torques and axial forces."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from pliant.equations import chamber, symbols
from pliant.equations.laws import POLYNOMIAL
from pliant.errors import InputError
from pliant.model.chamber import Chamber
from pliant.model.tendon import Tendon

Array = np.ndarray
LEAST = 1e-300  # N, less pretension of the second of a pair: without any, one of the two is taut


@dataclass(frozen=True)
class Actuation:
    """All inputs of a body of `joints` joints: values (C,) and their slow states in, joint torques (n,) out.

    Whoever needs to know how many inputs a model has, what they are called, what they are measured in or what they do
    asks here: `model.actuation`. One input is the case C = 1, and no other.

    Where segments lengthen, what drives their strains stands behind the torques of the joints, (n + S,): axial force
    times the segment's length, N m.

    Attributes
    ----------
    inputs : tuple of Chamber
        The law of each input, in the order in which their values stand.
    joints : int
    segment_length : tuple of float
        Of the segments that lengthen, m.
    segment_joints : tuple of tuple of int
        Joints that lie in each of them, from 0.
    turns : int
        Coordinates of each joint: 1 in a plane, 2 or 3 in space.
    """

    inputs: tuple[Chamber, ...]
    joints: int
    segment_length: tuple[float, ...] = ()
    segment_joints: tuple[tuple[int, ...], ...] = ()
    turns: int = 1

    @property
    def count(self) -> int:
        """Number of inputs, C."""
        return len(self.inputs)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the inputs."""
        return tuple(c.name for c in self.inputs)

    @property
    def kinds(self) -> tuple[str, ...]:
        """Return the kind of each input, as recordings have it: "pressure" (gauge)."""
        return tuple(c.kind for c in self.inputs)

    @property
    def units(self) -> tuple[str, ...]:
        """SI unit of each input."""
        return tuple(c.unit for c in self.inputs)

    @property
    def listing(self) -> str:
        """Names of the inputs, for a sentence."""
        return ", ".join(self.names)

    def labels(self, quantity: str) -> list[str]:
        """Return the name of a quantity of each input in tables, files and exports: ``pressure_NAME``.

        A lone input needs no name there: ``pressure``.
        """
        return [quantity] if self.count == 1 else [f"{quantity}_{name}" for name in self.names]

    @cached_property
    def gain(self) -> Array:
        """Share (C, N) of each chamber's torque that each coordinate feels; those of strains, or twists, behind."""
        joints = np.stack([np.broadcast_to(c.joint_gain, (self.joints,)) for c in self.inputs])
        if self.turns > 1:
            across = np.stack([np.broadcast_to(c.cross_gain, (self.joints,)) for c in self.inputs])
            lever = np.array([[c.lever if isinstance(c, Tendon) else 1.0] for c in self.inputs])
            bent = lever * np.stack([joints, across], axis=-1).reshape(self.count, -1)
            joints = np.pad(bent, ((0, 0), (0, (self.turns - 2) * self.joints)))
        if not self.segment_length:
            return joints
        axial = np.stack([self.axial_gains(c) for c in self.inputs])
        return np.hstack([joints, axial * self.segment_length])

    @cached_property
    def tendons(self) -> tuple[int, ...]:
        """Indices of the inputs that draw in a tendon, or a pair of them."""
        return tuple(i for i, c in enumerate(self.inputs) if isinstance(c, Tendon))

    @cached_property
    def _cords(self) -> list[tuple[int, Tendon, float]]:
        """Index and input of each tendon, and its sign: the second of a pair is let out where the first is drawn in."""
        each = [(i, c) for i, c in enumerate(self.inputs) if isinstance(c, Tendon)]
        return [(i, c, sign) for i, c in each for sign in ((1.0, -1.0) if c.pair else (1.0,))]

    @cached_property
    def levers(self) -> Array:
        """Lever (R, N) of each tendon at each coordinate, m; the two of a pair turn joints to opposite sides."""
        levers = np.reshape([self.gain[i] for i, *_ in self._cords], (-1, self.gain.shape[1]))
        levers[:, : self.turns * self.joints] *= np.reshape([sign for *_, sign in self._cords], (-1, 1))
        return levers

    @cached_property
    def tendon_constants(self) -> tuple[Array, Array, Array, Array]:
        """Stiffness [N/m], pretension [N], friction and slip rate [m/s] of each tendon, (R,), for the kernels."""
        k, T0, mu, w0 = np.reshape([c.constants() for _, c, _ in self._cords], (-1, 4)).T.copy()
        T0 -= [LEAST if sign < 0.0 else 0.0 for *_, sign in self._cords]
        return k, T0, mu, w0

    @cached_property
    def columns(self) -> Array:
        """Return the kernels' `gain` (C, N + R): columns of inputs that make torques, then of each tendon's command."""
        if not self.tendons:
            return self.gain
        gain, drawn = np.array(self.gain), np.zeros((self.count, len(self._cords)))
        gain[list(self.tendons)] = 0.0
        for r, (i, _, sign) in enumerate(self._cords):
            drawn[i, r] = sign
        return np.hstack([gain, drawn])

    def axial_gains(self, chamber: Chamber) -> Array:
        """Axial force (S,) of a chamber on each segment in parts of its torque, 1/m; of a tendon see `drawn_in`."""
        if isinstance(chamber, Tendon):
            return self.drawn_in(chamber)
        turned = np.broadcast_to((chamber.joint_gain != 0) | (chamber.cross_gain != 0), (self.joints,))
        gain = chamber.axial_gain
        if gain.size == 1 and turned.any():
            return np.array([gain[0] * turned[list(inside)].any() for inside in self.segment_joints])
        return np.broadcast_to(gain, (len(self.segment_length),))

    def drawn_in(self, tendon: Tendon) -> Array:
        """Axial force (S,) of a tendon on each segment in parts of what it pulls with: -1 where it runs all along it.

        It runs from the base to the end of the last joint that it turns: along a segment for the part of its joints up
        to there, along one without joints if any lies beyond.
        """
        part, before = np.zeros(len(self.segment_length)), -1
        turned = np.broadcast_to((tendon.joint_gain != 0) | (tendon.cross_gain != 0), (self.joints,))
        last = int(np.flatnonzero(turned).max(initial=-1))
        for s, inside in enumerate(self.segment_joints):
            part[s] = np.mean([k <= last for k in inside]) if inside else float(last > before)
            before = max([before, *inside])
        return -part

    @property
    def remembers(self) -> bool:
        """Whether a chamber has slow states."""
        return any(c.remembers for c in self.inputs)

    @property
    def polynomial(self) -> bool:
        """Whether all laws are polynomials."""
        return all(c.law == POLYNOMIAL for c in self.inputs)

    def kernel(self) -> symbols.ActuationConstants:
        """Constants for the kernels, shorter laws filled up with zeros."""
        longest = max(c.torque.size for c in self.inputs)
        law = np.stack([np.pad(c.torque, (0, longest - c.torque.size)) for c in self.inputs])
        return symbols.ActuationConstants(law, np.array(self.columns), np.array([c.kernel()[1:] for c in self.inputs]))

    def pressures(self, value: Any) -> Array:
        """`value` as pressures (C,) [Pa]: a number is enough for one input; 0 is no pressure in any.

        Raises
        ------
        InputError
            When there are not as many as inputs.
        """
        p = np.array(value, dtype=float, ndmin=1)  # a copy: who passes an array may change it
        if p.shape == (1,) and p[0] == 0.0:
            return np.zeros(self.count)
        if p.shape != (self.count,):
            raise InputError(
                f"expected {self.count} pressure(s) in Pa, one for each chamber ({self.listing}), got shape {p.shape}"
            )
        return p

    def torques(self, pressure: Any) -> Array:
        """Torque (C,) of each chamber at rest at `pressure` (C,) [Pa], N m."""
        return np.array([float(c.torque_at(p)) for c, p in zip(self.inputs, self.pressures(pressure), strict=True)])

    def joint_torques(self, pressure: Any) -> Array:
        """Torques (N + R,) [N m] of coordinates, commands [N] of tendons behind them, at rest at `pressure` (C,) [Pa].

        Infinite if walls give way.
        """
        tau = np.empty(self.columns.shape[1])
        for c, torque in enumerate(self.torques(pressure)):
            chamber.share_out(c, torque, self.columns, tau)
        return tau

    def no_rest(self, pressure: Any) -> str:
        """A sentence on the chamber whose wall has no equilibrium at `pressure` (C,) [Pa]."""
        said = (c.no_rest(p) for c, p in zip(self.inputs, self.pressures(pressure), strict=True))
        return next(filter(None, said), "")

    def rest_state(self, pressure: Any) -> Array:
        """Slow states (C, 2) long at rest at `pressure` (C,) [Pa]: slow pressure [Pa], fourth power of the stretch."""
        return np.stack([c.rest_state(p) for c, p in zip(self.inputs, self.pressures(pressure), strict=True)])


def chambers_of(values: dict[str, Any], given: Sequence[Chamber]) -> tuple[Chamber, ...]:
    """The chambers of a model: as `given`, or the one that the `values` of its law, valve and rubber describe.

    Raises
    ------
    InputError
        When both are given, or neither.
    """
    if given and values:
        raise InputError(f"give chambers, or {', '.join(sorted(values))} of the only one, not both")
    if given:
        made = tuple(given)
        if not all(isinstance(c, Chamber) for c in made):
            raise InputError(f"chambers must be Chamber objects, got {given!r:.80}")
        if len({c.name for c in made}) < len(made):
            raise InputError(f"chambers need names that differ, got {', '.join(c.name for c in made)}")
        return made
    if "torque" not in values:
        raise InputError("a model needs a torque law: torque = (A d,) [N m/Pa], or chambers")
    return (Chamber(**values),)
