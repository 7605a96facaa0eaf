"""A round body whose radius changes along it: stiffness of the joints, mass of the links, and converging tendons."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from pliant.errors import InputError
from pliant.model import Extension, Model, Station

if TYPE_CHECKING:
    from pliant.study.schema import ActuatorEntry, StationTable, TaperTable, TendonTable

Array = np.ndarray
SLICES = 200  # of each segment, for the integrals along it


def slices(length: float, joints: int) -> tuple[Array, float]:
    """Return the midpoints (joints, SLICES) [m] of thin slices of each joint's segment, and their thickness [m]."""
    thin = length / (joints * SLICES)
    return (thin * (np.arange(joints * SLICES) + 0.5)).reshape(joints, SLICES), thin


def checked_radius(taper: TaperTable, length: float) -> None:
    """Raise InputError if the radii are not given for increasing positions from the base to the tip."""
    at = np.array(taper.at)
    if at.size != len(taper.radius) or (np.diff(at) <= 0).any() or at[0] > 0 or at[-1] < length * (1 - 1e-9):
        raise InputError(
            "[actuator.taper] needs one radius for each position in at, increasing from 0 to the length of the body "
            f"({length:g} m)"
        )


def tapered_springs(taper: TaperTable, length: float, joints: int) -> Array:
    """Return the stiffness (joints,) [N m/rad] of joints in the middle of equal segments: 1 / integral of 1 / (E I)."""
    checked_radius(taper, length)
    s, thin = slices(length, joints)
    bending = taper.modulus * np.pi / 4 * np.interp(s, taper.at, taper.radius) ** 4
    return np.asarray(1.0 / np.sum(thin / bending, axis=1))


def tapered_masses(taper: TaperTable, length: float, link_length: Array) -> Array:
    """Return the mass (n,) of each link [kg], without the part before the first joint, which does not move."""
    ends = length - np.append(np.cumsum(link_length[::-1])[::-1], 0.0)
    s, thin = slices(length, link_length.size)
    section = taper.density * np.pi * np.interp(s, taper.at, taper.radius).ravel() ** 2
    return np.histogram(s.ravel(), ends, weights=thin * section)[0]


def tapered_extensions(
    taper: TaperTable, length: float, segments: Sequence[Extension], joints: int,
) -> tuple[Extension, ...]:
    """Return the extensible segments with the axial stiffness of the tapered body: length / integral of 1 / (E A)."""
    s, thin = slices(length, joints)
    axial = taper.modulus * np.pi * np.interp(s, taper.at, taper.radius) ** 2
    made = []
    for e in segments:
        inside = (s > e.start) & (s < e.end(length))
        soft = float(np.sum(thin / axial[inside]))
        made.append(replace(e, stiffness=(e.end(length) - e.start) / soft))
    return tuple(made)


def passed_joints(entry: TendonTable, length: float, joints: int) -> Array:
    """Return the distance (joints,) of a tendon from the axis at each joint, divided by its lever at the base.

    The distance is averaged over the joint's segment, and is 0 beyond the end of the tendon.
    """
    s, _ = slices(length, joints)
    stop = length if entry.stop is None else entry.stop
    return np.where(s < stop, np.maximum(1.0 - entry.taper * s / entry.lever, 0.0), 0.0).mean(axis=1)


def stations_of(entries: Sequence[StationTable], length: float, link_length: Array) -> tuple[Station, ...]:
    """Return the observed points of a body, each on the link that contains its position along the body."""
    joints = length - np.cumsum(link_length[::-1])[::-1]
    made = []
    for entry in entries:
        if not 0 <= entry.at <= length * (1 + 1e-9):
            raise InputError(f"station {entry.name}: at must be between 0 and the length of the body ({length:g} m)")
        link = int(np.searchsorted(joints, entry.at, side="right")) - 1
        before = 0.0 if link < 0 else float(joints[link])
        made.append(Station(entry.name, link, entry.at + entry.along - before, entry.across, entry.aside))
    return tuple(made)


def tapered(actuator: ActuatorEntry, segments: Sequence[Extension]) -> dict[str, Any]:
    """Return the stiffness, mass and extensible segments of an actuator whose radius changes along it.

    The masses of the single links are set later, by `fitted_out`.
    """
    taper, length, links = actuator.taper, actuator.length, actuator.links
    if taper is None or length is None or links is None or actuator.stiffness or actuator.mass:
        raise InputError("[actuator.taper] needs length and links, and replaces stiffness and mass: remove those")
    springs = tapered_springs(taper, length, links)
    mass = float(tapered_masses(taper, length, np.full(links, length / links)).sum())
    return {"stiffness": springs, "mass": mass,
            "extensions": tapered_extensions(taper, length, segments, links)}  # fmt: skip


def fitted_out(model: Model, actuator: ActuatorEntry) -> Model:
    """Return the model with the link masses of a tapered body, and with the stations that its study states."""
    changes: dict[str, Any] = {}
    if actuator.taper:
        changes["link_mass"] = tapered_masses(actuator.taper, model.length, model.link_length)
    if actuator.stations:
        changes["stations"] = stations_of(actuator.stations, model.length, model.link_length)
    return model.with_(**changes) if changes else model
