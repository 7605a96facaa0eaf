"""A pressure chamber of an actuator: its torque law, rubber and valve, the joints that it bends,
and its axial force.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from typing import Annotated, Any

import numpy as np

from pliant.equations import chamber, laws
from pliant.errors import InputError
from pliant.model.actuation_input import PRESSURE, ActuationInput, CrossGain, JointGain, rest_growth
from pliant.model.checks import check_numbers, numbers, one_number
from pliant.model.quantity import MOST_TERMS, Quantity, declaring, quantities, scalars
from pliant.model.valve import Valve, check_valve

Array = np.ndarray


@declaring
@dataclass(frozen=True, eq=False)
class Chamber(ActuationInput):
    """A pressure chamber: the torque on the joints as a function of its gauge pressure, and the lag of this pressure.
    SI units.

    `kind` and `unit` describe its input value, `valve` the lag of its pressure, and the gains the coordinates on which
    it acts.

    Parameters
    ----------
    torque : array (k,)
        Coefficients of the torque law tau = torque[0] p + torque[1] p^2 + ..., N m/Pa^i, p gauge. The paper's is (A
        d,). For another `law`, its parameters.
    joint_gain : array (n,)
        Fraction of the torque at each joint; 1 by virtual work. A single number applies to all joints.
    valve : Valve
        The lag between commanded and actual pressure.
    swell_share, swell_time : float
        Viscoelastic lag: this fraction of the torque beyond torque[0] p follows the pressure with a lag of time
        constant swell_time, s. See `pliant.equations.chamber.swollen_torque`. 0: no lag.
    inflation_limit, inflation_time, inflation_jm : float
        Hyperelastic wall: shear modulus times wall thickness over radius of a thin tube [Pa], time constant [s] of its
        rubber at low pressure, and J_m of Gent's rubber, the largest stretch^2 + stretch^-2 - 2. With J_m = 0 the
        rubber is neo-Hookean and expands without bound at `inflation_limit`. The torque grows with the cube of the
        stretch; see `pliant.equations.chamber.wall_rate`. Limit 0: a rigid wall.
    axial_gain : array (S,)
        Axial force on each segment that lengthens (`pliant.model.Extension`), over the torque, 1/m. By virtual work it
        is 1 / offset for a chamber at an offset [m] from the neutral axis: its volume A (L (1 + e) + offset sum q)
        gives the torque p A offset and the force p A. A single number applies to the segments whose joints it turns.
    cross_gain : array (n,)
        For a chain in space: fraction of the torque about the y axis of each joint; `joint_gain` is that about its x
        axis. A chamber at an azimuth alpha from x towards y has joint_gain sin(alpha) and cross_gain -cos(alpha).
    name : str
        Name of the chamber in recordings and parameters.
    law : str
        "polynomial", or the name of another law of `pliant.equations.laws`.

    Raises
    ------
    InputError
        When a parameter is not finite or not physical.

    Examples
    --------
    >>> import pliant
    >>> float(pliant.Chamber(torque=(1.5e-6,)).torque_at(100e3))  # N m
    0.15
    """

    kind = PRESSURE  # as recordings name the kinds of their inputs
    unit = "Pa"
    noun = "chamber"
    torque: Annotated[Array, Quantity(
        "N m/Pa^k", "coefficient of pressure^k in the torque law", per="power", most=1e3, scales="inputs",
        source="tau of Eq. (5)")]
    joint_gain: JointGain = field(default_factory=lambda: np.ones(1))
    valve: Valve = field(default_factory=Valve)
    swell_share: Annotated[float, Quantity(
        "1", "fraction of the torque law's growth with pressure that lags", sign="not negative", most=1e3,
        lower=0.0, upper=1.0, scale=0.1, start=0.3)] = 0.0
    swell_time: Annotated[float, Quantity(
        "s", "time constant of the lagging fraction swell_share of the torque", sign="positive", least=1e-6, most=1e9,
        lower=1e-3, upper=1e4, start=1.0)] = 1.0
    inflation_limit: Annotated[float, Quantity(
        "Pa", "pressure at which the chamber's wall expands without limit", sign="not negative", least=1.0, most=1e12,
        zero=True, lower=1e3, upper=1e9)] = 0.0
    inflation_time: Annotated[float, Quantity(
        "s", "time constant of the wall's expansion at low pressure", sign="positive", least=1e-6, most=1e9,
        lower=1e-4, upper=1e3, start=0.05)] = 0.1
    inflation_jm: Annotated[float, Quantity(
        "1", "J_m of Gent's law, which bounds the stretch of the wall", sign="not negative", least=0.1, most=1e9,
        zero=True, lower=1.0, upper=1e4, start=50.0)] = 0.0
    axial_gain: Annotated[Array, Quantity(
        "1/m", "axial force of a chamber over its torque; 1 / offset by geometry", per="segment", most=1e6,
        lower=-1e5, upper=1e5, scales="inputs")] = field(default_factory=lambda: np.zeros(1))
    cross_gain: CrossGain = field(default_factory=lambda: np.zeros(1))
    name: str = "chamber"
    law: str = laws.POLYNOMIAL

    def __post_init__(self) -> None:
        self._check_gains()
        check_chamber(self)

    @classmethod
    def at_offset(cls, area: float, offset: float, joints: Any, **more: Any) -> Chamber:
        """Return a chamber of known cross-section `area` [m^2], whose axis is at a signed `offset` [m] from the neutral
        axis.

        Parameters
        ----------
        joints : array (n,)
            1 for each joint that it turns, 0 for the others. A negative offset turns them the other way.
        **more
            Other parameters of `Chamber`.

        Raises
        ------
        InputError
            When the area is not positive or the offset is 0. (A chamber on the axis turns no joint: give it joint_gain
            0.)
        """
        area, offset = one_number("area", area), one_number("offset", offset)
        if not area > 0 or offset == 0 or not np.isfinite([area, offset]).all():
            raise InputError(f"a chamber needs a positive area [m^2] and a non-zero offset [m], got {area}, {offset}")
        turned = np.copysign(1.0, offset) * numbers("joints", joints)
        law, axial = np.array([area * abs(offset)]), np.array([1.0 / abs(offset)])
        return cls(torque=law, joint_gain=turned, axial_gain=axial, **more)

    def uses(self, field: str) -> bool:
        return field in quantities(Chamber)

    def axial_gains(self, joints: int, segment_joints: tuple[tuple[int, ...], ...]) -> Array:
        turned, gain = self.turned(joints), self.axial_gain
        if gain.size == 1 and turned.any():
            return np.array([gain[0] * turned[list(inside)].any() for inside in segment_joints])
        return np.broadcast_to(gain, (len(segment_joints),))

    def law_unit(self, power: int) -> str:
        if self.law == laws.POLYNOMIAL:
            return "N m/Pa" + (f"^{power + 1}" if power else "")
        rows = [row.unit for row in laws.LAWS[int(laws.NUMBERS[self.law]) - 1].parameters.values()]
        return rows[power] if power < len(rows) else "1"

    def sentences(self, *, alone: bool) -> list[str]:
        """Return sentences that describe the chamber's torque law, valve and rubber. With `alone`,
        they omit its name.
        """
        powers = ("p", *(f"p^{k}" for k in range(2, self.torque.size + 1)))
        law = " + ".join(f"{a:.4g} {p}" for a, p in zip(self.torque, powers, strict=True))
        if self.law != laws.POLYNOMIAL:
            law = f"{self.law} ({', '.join(f'{a:.4g}' for a in self.torque)})"
        who = "" if alone else f"{self.name}: "
        joints = "each joint" if alone else f"joints {', '.join(str(i + 1) for i in np.flatnonzero(self.joint_gain))}"
        said = [f"{who}torque at {joints}: {law} N m, p in Pa gauge"]
        if valve := self.valve.words():
            said.append(f"{who}valve: {valve}")
        if self.swell_share:
            said.append(f"{who}viscoelastic lag: fraction {self.swell_share:.3g}, {self.swell_time:.3g} s")
        if self.inflation_limit:
            bound = f", J_m {self.inflation_jm:.4g}" if self.inflation_jm else ""
            said.append(f"{who}inflation: limit {self.inflation_limit:.4g} Pa, {self.inflation_time:.3g} s{bound}")
        if self.axial_gain.any():
            said.append(f"{who}axial force: {', '.join(f'{g:.4g}' for g in self.axial_gain)} 1/m of the torque")
        return said


def grown(torque: Array, pressure: Array, values: Mapping[str, Array]) -> Array:
    """Multiply the static torques of N chambers by the effect of their inflating walls in equilibrium. The array
    `torque` (N,) [N m] of the torques without inflation is changed in place and returned.

    `pressure` (N,) are gauge pressures [Pa], `values` holds the chambers' parameters as arrays (N,).
    """
    soft, limit = np.flatnonzero(values["inflation_limit"]), values["inflation_limit"]
    torque[soft] *= chamber.lever_growth(rest_growth(pressure[soft], limit[soft], values["inflation_jm"][soft]))
    return torque


def remembering(values: Mapping[str, Array]) -> Array:
    """Return for each of N chambers whether it has slow states (viscoelastic lag or inflation), as booleans (N,)."""
    return np.asarray((values["swell_share"] != 0) | (values["inflation_limit"] != 0))


FIELDS = tuple(f.name for f in fields(Chamber) if f.name != "name")  # keyword arguments of a single chamber
RUBBER = scalars(Chamber)


def check_chamber(made: Chamber) -> None:
    """Raise InputError if a parameter of a chamber is not finite or not physical."""
    of = "model" if made.name == "chamber" else f"chamber {made.name!r}:"
    if made.swell_share > 1:
        raise InputError(f"{of} swell_share must be at most 1, because it is a fraction, got {made.swell_share}")
    check_law(made, of)
    polynomial = made.law == laws.POLYNOMIAL
    check_numbers(made, of, [name for name in quantities(Chamber) if polynomial or name != "torque"])
    if not made.torque.size:
        raise InputError(f"{of} torque must have at least one coefficient [N m/Pa], such as area times lever arm")
    if made.torque.size > MOST_TERMS:
        raise InputError(f"{of} torque must have at most {MOST_TERMS} numbers, got {made.torque.size}")
    check_valve(made.valve, of)


def check_law(made: Chamber, of: str) -> None:
    """Raise InputError if the name of a chamber's torque law is unknown, or the law's parameters are out of bounds."""
    if made.law not in laws.NUMBERS:
        raise InputError(f"{of} law must be one of {', '.join(laws.NUMBERS)}, got {made.law!r:.60}")
    if made.law == laws.POLYNOMIAL:
        return
    rows = laws.LAWS[int(laws.NUMBERS[made.law]) - 1].parameters
    if made.torque.size != len(rows):
        raise InputError(
            f"{of} torque of the law {made.law!r} must hold the numbers {', '.join(rows)}, got "
            f"{made.torque.size} number(s)"
        )
    for value, (name, row) in zip(made.torque, rows.items(), strict=True):
        if not (np.isfinite(value) and row.lower <= value <= row.upper):
            raise InputError(
                f"{of} {name} of the law {made.law!r} must lie within {row.lower:g} ... {row.upper:g} {row.unit}, got "
                f"{value:g}: check its unit"
            )
