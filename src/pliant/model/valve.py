"""The valve or pressure regulator between commanded and actual pressure."""

from __future__ import annotations

from dataclasses import dataclass, fields
from math import isfinite
from typing import Annotated, Any

from pliant.errors import InputError
from pliant.model.quantity import Quantity, declaring, quantities


@declaring
@dataclass(frozen=True)
class Valve:
    """A valve between commanded and actual pressure: dead time, then no lag, a first-order lag or a second-order lag.

    Parameters
    ----------
    rise_time, fall_time : float
        Time constants of the first-order lag while the pressure rises and falls, s; 0: none.
    rise_rate, fall_rate : float
        Largest rates of rise and fall of the pressure, Pa/s, as of a choked orifice; 0: no limit.
    settle_share, settle_time : float
        This fraction of the pressure has a further lag of time constant settle_time, s, as of a regulator that closes
        the last of its gap slowly. Fraction 0: none.
    dead_band : float
        Remaining error of a regulator, Pa: for a command u it settles at u - dead_band if u > dead_band, at
        u + dead_band if u < -dead_band, and at 0 in between.
    opening_time : float
        For a chamber that fills and vents through an opening, s: the time in which choked flow would fill it from
        vacuum to the pressure before the opening. Source: ISO 6358-1:2013, critical pressure ratio 0.5; see
        `pliant.simulation.pressure_loops`. 0: no opening.
    dead_time : float
        Delay between command and first reaction, s.
    natural_frequency : float
        Natural frequency of a second-order valve, Hz; 0: not of second order.
    damping_ratio : float
        Damping ratio of a second-order valve.

    Raises
    ------
    InputError
        When a value is negative or not finite, or parameters of both first and second order are given.
    """

    rise_time: Annotated[float, Quantity(
        "s", "valve time constant, pressure rising", sign="not negative", least=1e-30, most=1e6, zero=True,
        lower=0.0, upper=30.0, scale=0.02, guess=0.02, formerly=("valve_rise",))] = 0.0
    fall_time: Annotated[float, Quantity(
        "s", "valve time constant, pressure falling", sign="not negative", least=1e-30, most=1e6, zero=True,
        lower=0.0, upper=30.0, scale=0.02, guess=0.02, formerly=("valve_fall",))] = 0.0
    dead_time: Annotated[float, Quantity(
        "s", "valve dead time", sign="not negative", most=1e6, lower=0.0, upper=5.0, scale=0.01,
        guess=0.005)] = 0.0
    natural_frequency: Annotated[float, Quantity(
        "Hz", "natural frequency of a valve of second order", sign="not negative", least=1e-6, most=1e6, zero=True,
        fitted=False)] = 0.0
    damping_ratio: Annotated[float, Quantity(
        "1", "damping ratio of a valve of second order", sign="not negative", most=1e4, fitted=False)] = 0.7
    rise_rate: Annotated[float, Quantity(
        "Pa/s", "fastest rise of the pressure", sign="not negative", least=1e-3, most=1e15, zero=True,
        lower=1e3, upper=1e9, start=3e5)] = 0.0
    fall_rate: Annotated[float, Quantity(
        "Pa/s", "fastest fall of the pressure", sign="not negative", least=1e-3, most=1e15, zero=True,
        lower=1e3, upper=1e9, start=3e5)] = 0.0
    settle_share: Annotated[float, Quantity(
        "1", "fraction of the pressure that settles late", sign="not negative", most=1.0,
        lower=0.0, upper=0.9, scale=0.1, start=0.1)] = 0.0
    settle_time: Annotated[float, Quantity(
        "s", "time constant of the late settling of the pressure", sign="positive", least=1e-6, most=1e6,
        lower=0.2, upper=1e3, start=2.0)] = 1.0
    dead_band: Annotated[float, Quantity(
        "Pa", "difference between command and pressure that a regulator leaves", sign="not negative", most=1e7,
        lower=0.0, upper=1e6, scale=1e3, start=1e3)] = 0.0
    opening_time: Annotated[float, Quantity(
        "s", "time that choked flow would take to fill the chamber", sign="not negative", least=1e-6, most=1e6,
        zero=True, lower=1e-3, upper=30.0, start=0.1, source="ISO 6358-1:2013")] = 0.0

    def __post_init__(self) -> None:
        declared = quantities(Valve)
        for name, quantity in declared.items():
            value = getattr(self, name)
            if not isfinite(value) or value < 0:
                raise InputError(f"valve {name} must be finite and not negative, got {value}")
            if name not in ("settle_share", "settle_time"):
                quantity.check_limit("valve", name, value)
        if self.settle_share > 1 or not self.settle_time > 0:
            raise InputError(
                f"valve settle_share must be at most 1 and settle_time positive, got {self.settle_share} and "
                f"{self.settle_time}"
            )
        declared["settle_time"].check_limit("valve", "settle_time", self.settle_time)
        first = self.rise_time or self.fall_time or self.rise_rate or self.fall_rate
        if self.natural_frequency and first:
            raise InputError("a valve has rise_time and fall_time, or natural_frequency: set only one of the two kinds")
        if self.natural_frequency and self.damping_ratio == 0:
            raise InputError("valve damping_ratio must be positive, got 0: the pressure would ring forever")

    def words(self) -> str:
        """Return the values of the valve that have an effect as text; '' for an ideal valve."""
        others = ("damping_ratio", "settle_time")  # have no effect alone
        named = [(f.name, getattr(self, f.name)) for f in fields(self) if f.name not in others]
        return ", ".join(f"{name} {value:g}" for name, value in named if value)



def check_valve(valve: Any, of: str) -> None:
    """Raise InputError unless `valve` is a Valve; `of` begins the message."""
    if not isinstance(valve, Valve):
        raise InputError(f"{of} valve must be a Valve, got {valve!r:.60}")
