"""What all inputs of an actuator have in common, chambers and tendons: gains, lag, torque law and interface."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import fields, replace
from typing import TYPE_CHECKING, Annotated, Any, Self

import numpy as np

from pliant.equations import chamber, laws, symbols
from pliant.errors import InputError
from pliant.model.checks import EqualByFields, numbers, one_number
from pliant.model.quantity import Quantity, quantities
from pliant.model.valve import Valve
from pliant.shapes import Float

Array = np.ndarray
PRESSURE = "pressure"  # kind of the input of a chamber
JointGain = Annotated[Array, Quantity(
    "1", "factor on the torque law at every joint", per="joint", most=1e6, scale=0.3, alike=False,
    formerly=("gain",))]
CrossGain = Annotated[Array, Quantity(
    "1", "factor on the torque law about y, in space, at every joint", per="joint", most=1e6, scale=0.3,
    alike=False, only="in space")]
SHARED = ("name", "valve", "joint_gain", "cross_gain")  # fields of every input


def rest_growth(pressure: Array, limit: Any, jm: Any = 0.0) -> Array:
    """Return the fourth power of the wall's hoop stretch in equilibrium at `pressure` [Pa]. `limit` [Pa] is the
    chamber's `inflation_limit`; where it is 0, the wall is rigid and the result 1.

    With Gent's rubber (`jm` > 0) it is finite at every pressure. Otherwise it is infinite from the limit on.
    """
    push, jm = np.broadcast_arrays(pressure / np.where(limit, limit, np.inf), jm)
    y = np.where(push < 1.0, 1.0 / np.where(push < 1.0, 1.0 - push, 1.0), np.inf)
    for index in map(tuple, np.argwhere(jm)):
        y[index] = rest_of_gent(float(push[index]), float(jm[index]))
    return y


def rest_of_gent(push: float, jm: float) -> float:
    """Return the fourth power of a Gent wall's hoop stretch in equilibrium. `push` is the pressure divided by the
    chamber's `inflation_limit`.
    """
    wall = symbols.ChamberConstants(np.zeros(1), 0.0, 1.0, 1.0, 1.0, jm, 0.0)
    y = 1.0 / (1.0 - push) if push < 0.5 else (jm * (1.0 + 0.02 * push) + 4.0) ** 2  # beyond the equilibrium
    for _ in range(100):  # from beyond the equilibrium Newton converges monotonically: the rate is concave in y
        rate, slope = chamber.wall_rate(push, y, wall)
        y -= rate / slope
        if abs(rate) <= 1e-14 * abs(slope) * y:
            break
    return float(y)


class ActuationInput(EqualByFields, ABC):
    """One input of an actuator, a pressure chamber or a tendon: the torque or force that its value causes, the
    coordinates on which it acts, and the lag of its value. SI units.

    The rubber of a chamber and a torque law other than a polynomial are absent unless a class has these fields.
    """

    if TYPE_CHECKING:  # annotations that are seen when a program runs would change the order of the declarations
        name: str
        valve: Valve
        joint_gain: Array
        cross_gain: Array
        torque: Array
        kind: str
        unit: str
        axial_gain: Array
        swell_share: float
        swell_time: float
        inflation_limit: float
        inflation_time: float
        inflation_jm: float
        law: str
        line_stiffness: float
        signs: tuple[float, ...]
    swell_share, swell_time = 0.0, 1.0
    inflation_limit, inflation_time, inflation_jm = 0.0, 0.1, 0.0
    law = laws.POLYNOMIAL
    axial_gain = np.zeros(1)
    line_stiffness = 0.0  # N/m, of a tendon
    signs = ()  # of the tendons that it pulls: -1 for the second of a pair, which is let out
    noun = "input"  # in messages
    gain_unit = "1"  # of torque or force at a joint, over that of the input

    def _check_gains(self) -> None:
        """Make the fields that hold several numbers arrays, and those that hold one a float."""
        for name, quantity in quantities(type(self)).items():
            if quantity.per:
                a = numbers(name, getattr(self, name))
                a.setflags(write=False)
                object.__setattr__(self, name, a)
            else:
                object.__setattr__(self, name, one_number(name, getattr(self, name)))

    def changed(self, **values: Any) -> Self:
        """Return a copy with those of the given fields changed that the input has."""
        names = {f.name for f in fields(self)}
        return replace(self, **{name: value for name, value in values.items() if name in names})

    @abstractmethod
    def sentences(self, *, alone: bool) -> list[str]:
        """Return sentences that describe the law and the lag of the input. With `alone`, they omit its name."""

    @abstractmethod
    def uses(self, field: str) -> bool:
        """Return whether a declared field of a chamber or tendon, except its gains and its valve, has an effect on this
        input.
        """

    def value_of(self, field: str) -> float:
        """Return the value of a declared field that is a single number, 0 where it has no effect on this input."""
        return float(getattr(self, field)) if self.uses(field) else 0.0

    @abstractmethod
    def axial_gains(
        self, joints: int, segment_joints: tuple[tuple[int, ...], ...],
    ) -> Float[Array, " S"]:
        """Return the axial force on each of S extensible segments, divided by the input's torque or tension: (S,).

        `segment_joints` holds the indices of those of the `joints` that lie in each segment.
        """

    @abstractmethod
    def law_unit(self, power: int) -> str:
        """Return the unit of the coefficient number `power`, from 0, of the input's law."""

    def distance(self) -> Array:
        """Return the lever arm (1,) or (n,) [m] at each joint by which a gain is multiplied; 1 without a unit for a
        torque.
        """
        return np.ones(1)

    def turned(self, joints: int) -> Array:
        """Return whether the input acts on each of the joints, (joints,)."""
        return np.broadcast_to((self.joint_gain != 0) | (self.cross_gain != 0), (joints,))

    @property
    def swells(self) -> bool:
        """Whether part of the input's torque lags behind the pressure (viscoelastic lag)."""
        return self.swell_share > 0

    @property
    def grows(self) -> bool:
        """Whether the wall of a chamber is hyperelastic, so that it inflates."""
        return self.inflation_limit > 0

    @property
    def remembers(self) -> bool:
        """Whether the input's torque depends on slow states (lagged pressure, wall stretch) besides the present
        pressure.
        """
        return self.swells or self.grows

    @property
    def plain(self) -> bool:
        """Whether the input's torque is a polynomial of the present pressure alone."""
        return self.law == laws.POLYNOMIAL and not self.remembers

    def rest_state(self, pressure: float) -> Array:
        """Return the equilibrium (2,) of the chamber's slow states at `pressure` [Pa]: lagged pressure and wall
        stretch.

        They are the lagged pressure [Pa] and the fourth power of the hoop stretch.
        """
        return np.array([pressure, float(self.growth_at(pressure))])

    def torque_at(self, pressure: Any) -> Any:
        """Return the static torque [N m] at gauge `pressure` [Pa], an array of any shape; infinite where the wall has
        no equilibrium.
        """
        torque = self.lever_at(pressure) * np.asarray(pressure, dtype=float)
        return torque * chamber.lever_growth(self.growth_at(pressure)) if self.inflation_limit else torque

    def lever_at(self, pressure: Any) -> Any:
        """Return the torque per unit pressure [N m/Pa] at gauge `pressure` [Pa] of any shape, without inflation of the
        wall.
        """
        return laws.lever(np.asarray(pressure, dtype=float), self.torque, laws.NUMBERS[self.law])

    def no_rest(self, pressure: float) -> str:
        """Return a message if the chamber's hyperelastic wall has no equilibrium at `pressure` [Pa], else ''."""
        if np.isfinite(self.torque_at(pressure)):
            return ""
        return (
            f"the chamber has no equilibrium at {pressure:.6g} Pa: its wall expands without bound from its "
            f"inflation_limit of {self.inflation_limit:.6g} Pa on; lower the pressure"
        )

    def growth_at(self, pressure: Any) -> Any:
        """Return the fourth power of the wall's hoop stretch in equilibrium at gauge `pressure` [Pa]; 1 for a rigid
        wall.
        """
        return rest_growth(np.asarray(pressure, dtype=float), self.inflation_limit, self.inflation_jm)

    def torque_slope(self, pressure: float) -> float:
        """Return d(torque)/d(pressure) [N m/Pa] of a chamber at `pressure` [Pa], with its lagged pressure held
        constant.

        Raises
        ------
        InputError
            When the wall is hyperelastic, because a linear model has no state for its stretch.
        """
        if self.inflation_limit:
            raise InputError(
                "linear models and controllers do not support a hyperelastic wall: fit a torque law without "
                "inflation_limit for them"
            )
        return float(self.law_slope(float(pressure)))

    def law_slope(self, pressure: Any) -> Any:
        """Return d(torque)/d(pressure) [N m/Pa] at a pressure [Pa] of any shape, for constant lagged pressure and a
        rigid wall.
        """
        p, form = np.asarray(pressure, dtype=float), laws.NUMBERS[self.law]
        rise = laws.lever_secant(p, p, self.torque, form)
        return self.lever_at(p) + p * (1.0 - self.swell_share) * rise

    @property
    def key(self) -> tuple[Any, ...]:
        """Hashable key of all parameters that determine the input's torque, without the gains at the joints."""
        return (self.torque.tobytes(), self.valve, *self.kernel()[1:])

    def kernel(self) -> symbols.ChamberConstants:
        """Return the chamber's constants as a record for the compiled kernels."""
        return symbols.ChamberConstants(
            self.torque, self.swell_share, self.swell_time, self.inflation_limit, self.inflation_time,
            self.inflation_jm, laws.NUMBERS[self.law],
        )
