"""Conversion of a simulated motion to a labelled xarray dataset with units."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
import xarray as xr

from pliant.mechanics import mechanics_of
from pliant.model import Actuation, Model
from pliant.units import input_words
from pliant.version import __version__

Array = np.ndarray
AXES = {"x": "the swing about the x axis", "y": "the swing about the y axis", "twist": "the twist"}
ENDINGS = ("", *(f"_{axis}" for axis in AXES))  # of the names of joint variables: "" in a plane, the others in space
LABELS = {
    "joint_angle": ("rad", "joint angle from the rest shape"),
    "joint_rate": ("rad/s", "joint rate"),
    **{f"joint_angle_{axis}": ("rad", f"swing of the joint about the {axis} axis") for axis in "xy"},
    **{f"joint_rate_{axis}": ("rad/s", f"rate of the swing about the {axis} axis") for axis in "xy"},
    "joint_angle_twist": ("rad", "twist of the joint"),
    "joint_rate_twist": ("rad/s", "rate of the twist"),
    "tip_position": ("m", "position of the link tips in the base frame"),
    "station_position": ("m", "position of the observed points in the base frame"),
    "station_angle": ("rad", "angle of the carrier of each observed point from +y; from +z in space"),
    "hoop_stretch": ("1", "circumference of the chamber's wall over that without pressure"),
    "axial_strain": ("1", "axial strain of each segment that lengthens"),
    "axial_strain_rate": ("1/s", "rate of that strain"),
    "extension": ("m", "length that each segment has gained"),
    "kinetic_energy": ("J", "kinetic energy"),
    "elastic_energy": ("J", "energy of the joint springs, and of axial ones"),
    "gravitational_energy": ("J", "potential energy of gravity"),
    "input_work": ("J", "work done by the pressure since the start"),
    "dissipated_energy": ("J", "energy taken by the dampers since the start"),
    "memory_state": ("rad", "relaxed angle of creep branches, stretch of slip elements and of Bouc-Wen"),
    "memory_torque": ("N m", "torque of creep, slip and Bouc-Wen against the bend"),
    **{f"memory_state_{axis}": ("rad", f"the same, of {name}") for axis, name in AXES.items()},
    **{f"memory_torque_{axis}": ("N m", f"the same, along {name}") for axis, name in AXES.items()},
    "axial_memory_state": ("1", "relaxed strain of the segments' creep branches, stretch of their slip elements"),
    "axial_memory_force": ("N", "axial force of the segments' creep and slip against the strain"),
    "base_position": ("m", "position of the base frame's origin, in the axes of the base frame at rest"),
    "base_angle": ("rad", "angle of the base frame about +z"),
    "base_axes": ("1", "axes of the moved base frame as columns, in the axes of the base frame at rest"),
    "base_force": ("N", "force of the base on the body, in the axes of the moved base frame"),
    "base_moment": ("N m", "moment of the base on the body about the base frame's origin, in the same axes"),
    "memory_energy": ("J", "energy held by creep, slip and Bouc-Wen"),
    "memory_dissipation": ("J", "energy dissipated by creep, slip and Bouc-Wen since the start"),
}


class Motion(NamedTuple):
    """Arrays of a simulated motion over time: times, pressures, angles and angular rates."""

    times: Array  # (T,) s
    pressure: Array  # (T, C) Pa
    phi: Array  # (T, n) rad, absolute
    w: Array  # (T, n) rad/s


def trajectory(
    model: Model, motion: Motion, energies: dict[str, Array], memory: Mapping[str, tuple[tuple[str, ...], Array]], *,
    method: str, time_step: float,
) -> xr.Dataset:
    """Return a simulated motion as an xarray dataset with units, energies and hysteresis states.

    `memory` holds further variables: those of `memory.outputs`, and the stretch of chambers that inflate.
    """
    times, pressure, phi, w = motion
    chain, inputs = mechanics_of(model), model.actuation
    tips = chain.tips(phi)
    position, angle = chain.stations(phi, tips)
    values: dict[str, tuple[tuple[str, ...], Array]] = {
        **chain.variables(phi, w),
        "tip_position": (("time", "link", "axis"), tips),
        "station_position": (("time", "station", "axis"), position),
        "station_angle": (("time", "station"), angle),
        inputs.variable: (("time", "input"), pressure),
        **{name: (("time",), value) for name, value in energies.items()},
        **memory,
    }
    labels = model.memory.coordinates | chain.labels
    about = LABELS | {inputs.variable: about_inputs(inputs)}
    return xr.Dataset(
        {name: labelled(*entry, *about[name]) for name, entry in values.items()},
        coords={
            "time": labelled(("time",), np.asarray(times, dtype=float), "s", "time"),
            **{name: xr.Variable((name,), np.asarray(value), fastpath=True) for name, value in {
                "joint": range(1, model.n + 1), "link": range(1, model.n + 1),
                "station": [p.name for p in model.points], "axis": list("xyz")[: chain.dimension], **labels,
            }.items()},
            **inputs_of(model),
        },
        attrs={"schema": "pliant-trajectory", "model": model.name, "method": method, "step_s": time_step,
               "source": f"pliant {__version__}"},
    )


def about_inputs(inputs: Actuation) -> tuple[str, str]:
    """Return the unit and the long name of the variable of a dataset that holds the inputs of an actuator."""
    unit = ", ".join(dict.fromkeys(inputs.units))
    return unit, "gauge pressure behind the valve" if unit == "Pa" else f"{input_words(inputs.units)[0]} behind its lag"


def inputs_of(model: Model) -> dict[str, xr.Variable]:
    """Return the coordinates of a dataset along its inputs: their names, and their units unless all are pressures."""
    units = {"unit": list(model.actuation.units)} if model.actuation.variable != "pressure" else {}
    named = {"input": list(model.actuation.names), **units}
    return {name: xr.Variable(("input",), np.asarray(value), fastpath=True) for name, value in named.items()}


def inputs_in(motion: xr.Dataset) -> tuple[Array, list[str]]:
    """Return the inputs (T, C) of a simulated or estimated motion and the SI unit of each."""
    if "pressure" in motion:
        return motion["pressure"].values, ["Pa"] * motion.sizes["input"]
    return motion["actuation"].values, [str(unit) for unit in motion["unit"].values]


def labelled(dims: tuple[str, ...], values: Array, units: str, long_name: str) -> xr.Variable:
    """Return values as an xarray variable with its dimensions, unit and long name.

    The fast path avoids xarray's import of Dask.
    """
    return xr.Variable(dims, np.asarray(values), {"units": units, "long_name": long_name}, fastpath=True)
