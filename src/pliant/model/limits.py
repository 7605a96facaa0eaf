"""Physical limits of all model parameters, in one table.

A number beyond its limits means a wrong unit or a damaged file, and could cause overflow, division by zero or endless
loops. Each limit is at least a factor of a thousand from any body that was built. Where the lower bound of a fit is 0,
the steps of its numerical derivatives are within the limits.
"""

from __future__ import annotations

from typing import NamedTuple

from pliant.equations.spring_terms import SPRING_TERMS
from pliant.errors import InputError

MOST_LINKS = 128  # beyond, compiling and stepping take minutes, and a chain is not a reduced model
MOST_TERMS = 16  # of the torque law, and branches of each kind of hysteresis
MOST_STATIONS = 4096


class Limit(NamedTuple):
    """Smallest and largest absolute value allowed for a parameter, its unit, and whether 0 is allowed as well."""

    least: float
    most: float
    unit: str
    zero: bool = False


LIMITS = {
    "link_length": Limit(1e-6, 1e3, "m"),
    "link_mass": Limit(1e-12, 1e5, "kg", zero=True),
    "tip_mass": Limit(0.0, 1e5, "kg"),
    "base_length": Limit(0.0, 1e3, "m"),
    "stiffness": Limit(1e-12, 1e9, "N m/rad"),
    "damping": Limit(0.0, 1e9, "N m s/rad"),
    **{name: Limit(0.0, term.most, term.unit) for name, term in SPRING_TERMS.items()},
    "stiffening_bound": Limit(1e-3, 1.0, "", zero=True),
    "rest_angle": Limit(0.0, 1e3, "rad"),
    "base_angle": Limit(0.0, 1e3, "rad"),
    "joint_gain": Limit(0.0, 1e6, ""),
    "cross_gain": Limit(0.0, 1e6, ""),
    "lever": Limit(0.0, 1e2, "m"),
    "taper": Limit(0.0, 10.0, ""),
    "line_stiffness": Limit(0.0, 1e9, "N/m"),
    "pretension": Limit(0.0, 1e6, "N"),
    "imbalance": Limit(0.0, 1e6, "N"),
    "pulley": Limit(0.0, 1e2, "m"),
    "friction": Limit(0.0, 1e2, ""),
    "slip_rate": Limit(1e-9, 1e3, "m/s"),
    "axial_gain": Limit(0.0, 1e6, "1/m"),
    "axial_stiffness": Limit(1e-9, 1e12, "N"),
    "axial_damping": Limit(0.0, 1e12, "N s"),
    "torque": Limit(0.0, 1e3, "N m/Pa^k"),
    "gravity": Limit(0.0, 1e4, "m/s^2"),
    "swell_share": Limit(0.0, 1e3, ""),
    "swell_time": Limit(1e-6, 1e9, "s"),
    "inflation_limit": Limit(1.0, 1e12, "Pa", zero=True),
    "inflation_time": Limit(1e-6, 1e9, "s"),
    "inflation_jm": Limit(0.1, 1e9, "", zero=True),
    "station along": Limit(0.0, 1e3, "m"),
    "station across": Limit(0.0, 1e3, "m"),
    "station aside": Limit(0.0, 1e3, "m"),
    "rise_time": Limit(1e-30, 1e6, "s", zero=True),
    "fall_time": Limit(1e-30, 1e6, "s", zero=True),
    "dead_time": Limit(0.0, 1e6, "s"),
    "natural_frequency": Limit(1e-6, 1e6, "Hz", zero=True),
    "damping_ratio": Limit(0.0, 1e4, ""),
    "rise_rate": Limit(1e-3, 1e15, "Pa/s", zero=True),
    "fall_rate": Limit(1e-3, 1e15, "Pa/s", zero=True),
    "dead_band": Limit(0.0, 1e7, "Pa"),
    "opening_time": Limit(1e-6, 1e6, "s", zero=True),
    "settle_share": Limit(0.0, 1.0, ""),
    "settle_time": Limit(1e-6, 1e6, "s"),
    "creep_share": Limit(0.0, 1e6, ""),
    "creep_time": Limit(1e-6, 1e12, "s"),
    "slip_share": Limit(0.0, 1e6, ""),
    "slip_angle": Limit(1e-9, 1e3, "rad"),
    "axial_creep_share": Limit(0.0, 1e6, ""),
    "axial_creep_time": Limit(1e-6, 1e12, "s"),
    "axial_slip_share": Limit(0.0, 1e6, ""),
    "axial_slip_strain": Limit(1e-9, 1e3, ""),
    "boucwen_share": Limit(0.0, 1e6, ""),
    "boucwen_beta": Limit(0.0, 1e9, "1/rad^n"),
    "boucwen_gamma": Limit(0.0, 1e9, "1/rad^n"),
    "boucwen_exponent": Limit(1.0, 50.0, ""),
}


def check_limit(what: str, name: str, value: float) -> None:
    """Raise InputError if the absolute value of a parameter is outside its physical limits.

    Parameters
    ----------
    what : str
        Owner of the parameter, for the message: "model", "valve", "memory".
    name : str
        Name of the parameter in `LIMITS`.
    value : float
        A finite number of any sign; its sign is checked elsewhere.
    """
    limit, size = LIMITS[name], abs(value)
    if limit.least <= size <= limit.most or (size == 0.0 and limit.zero):
        return
    zero = ", or be 0" if limit.zero else ""
    unit = f" {limit.unit}" if limit.unit else ""
    raise InputError(
        f"{what} {name} must have a size of {limit.least:g} to {limit.most:g}{unit}{zero}, got {value:g}: check its "
        "unit"
    )
