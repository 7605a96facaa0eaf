"""The table [actuator] of a study file: the body, with the parameters of a model under the names that the model gives
them.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np
from pydantic import BaseModel, Field, model_validator

from pliant.errors import InputError
from pliant.model import Chamber, Extension, Memory, Space, Station, Tendon, Valve
from pliant.model.chamber import FIELDS
from pliant.model.parameters import MassAt, ModelParameters
from pliant.model.tables import Table, TableLayout, fields_of
from pliant.units import DrivenBy

if TYPE_CHECKING:
    from numpy.typing import NDArray

Name = Annotated[str, Field(min_length=1, pattern=r"^[^.]+$")]  # the part's parameters are called name.parameter
Joints = Annotated[list[int], Field(min_length=1)]  # numbered from 1
Each = float | list[float]  # one number for all, or one for each
BOUNDED = TableLayout(bounded=True)


class PartTable(Table, BaseModel):
    """A table of the body, whose entries are those of a part of the model and the further ones stated here."""

    if TYPE_CHECKING:

        def __getattr__(self, name: str) -> Any: ...


@fields_of(Valve, BOUNDED)
class ValveTable(PartTable):
    """The lag between the commanded and the acting value of an input; see `pliant.model.Valve`."""


@fields_of(Memory)
class MemoryTable(PartTable):
    """Creep and hysteresis of the joints and of the segments that lengthen; see `pliant.model.Memory`."""


@fields_of(
    Chamber,
    TableLayout(("name",), ("cross_gain",), {"torque": [0.0], "joint_gain": 1.0, "axial_gain": 0.0}, bounded=True),
    name=Name, joint_gain=Each, axial_gain=Each, valve=ValveTable,
)
class ChamberTable(PartTable):
    """One of several chambers: the joints on which it acts, its torque law, rubber and valve; see
    `pliant.model.Chamber`. `joint_gain` is that at the chamber's joints; below 0 it bends to the other side.
    """

    joints: Joints | None = None  # default: all
    azimuth_deg: float | None = None  # in space: around the axis, from x of the base frame towards y


@fields_of(
    Tendon, TableLayout(("name", "driven_by", "lever"), {"joint_gain", "cross_gain", "at"},
                   {"line_stiffness": 1000.0}, bounded=True),
    name=Name, driven_by=DrivenBy, valve=ValveTable,
)
class TendonTable(PartTable):
    """One tendon of a body in space, or a pair of tendons on one motor; see `pliant.model.Tendon`. The line stiffness
    is not used if it is driven by a tension.
    """

    joints: Joints | None = None  # joints that it passes; default: all
    azimuth_deg: float | None = None  # around the axis, from x of the base frame to y; default: estimated from the tip
    stop: float | None = Field(default=None, gt=0)  # m from the base, where it ends; default: the last of its joints


@fields_of(Extension, TableLayout(defaults={"stiffness": 1000.0}, bounded=True), name=Name)
class ExtensionTable(PartTable):
    """A segment of the body that lengthens, between two positions along it; see `pliant.model.Extension`."""


@fields_of(Station, TableLayout(without=("link",), defaults={"along": 0.0}))
class StationTable(PartTable):
    """The position of an observed point, such as a marker, on the body: `along` is added to `at`, along the link.
    Without this table the position is computed from the first frames.
    """

    at: float  # m along the body, from the base


@fields_of(Space, BOUNDED, rest_turn=list[list[float]])
class SpaceTable(PartTable):
    """Properties of a body that moves in space; see `pliant.model.Space`."""


class TaperTable(PartTable):
    """A solid round body whose radius changes along it, from which stiffness, mass and axial stiffness are computed."""

    at: list[float] = Field(min_length=2)  # m from the base; the radius is linear between these positions
    radius: list[float] = Field(min_length=2)  # m
    modulus: float = Field(gt=0)  # Pa, of elasticity
    density: float = Field(gt=0)  # kg/m^3


@fields_of(
    ModelParameters,
    TableLayout(without=("link_length", "link_mass", "chambers", "extensions", "space", "stations", "name", "source",
                         "moving_base"),
           optional=True, bounded=True),
    stiffness=Each, damping=Each, rest_angle=Each, stiffening=Each, cubic_stiffening=Each, stiffening_bound=Each,
    mass_at=MassAt, memory=MemoryTable,
)
@fields_of(Chamber, TableLayout(without=("name", "cross_gain"), optional=True, bounded=True), joint_gain=Each,
           axial_gain=Each, valve=ValveTable)
class ActuatorEntry(PartTable):
    """The body, in SI units; entries take precedence over the preset, if one is named. Those of a chamber are for a
    body with a single one. Gravity is (x, y) in the same axes as force_n, or (x, y, z) of the tracker.
    """

    preset: str | None = None  # a module of pliant.actuators
    length: float | None = None  # m, of the part that bends
    mass: float | None = None  # kg, without the tip mass
    segments: list[float] | None = None  # m, lengths of segments that differ, from the base on, instead of length
    segment_links: list[int] | None = None  # links of each segment; default: alike in all, two if links is not stated
    links: int | None = Field(None, ge=1, le=64)
    joint_placement: Literal["base", "midsegment"] | None = None
    chambers: list[ChamberTable] = []  # several chambers, instead of torque
    tendons: list[TendonTable] = []  # tendons of a body in space, instead of chambers or with them
    extensions: list[ExtensionTable] = []  # segments that lengthen
    taper: TaperTable | None = None  # in place of mass and stiffness
    stations: list[StationTable] = []  # observed points
    space: bool | SpaceTable = False  # the body moves in space, not in a plane
    section_area: float | None = Field(None, gt=0)  # m^2 of solid section, used to check a fitted mass
    diameter: float | None = Field(None, gt=0)  # m, outer, used to check density, modulus and torque
    source: dict[str, str] = {}

    @model_validator(mode="after")
    def divided(self) -> ActuatorEntry:
        """Complete length and links by the segments, and check that these agree with what is stated."""
        if self.segments is None:
            if self.segment_links is not None:
                raise ValueError("segment_links needs segments = [...], the lengths of the segments")
            return self
        count, length = len(self.segments), sum(self.segments)
        if not count or not all(0 < s < np.inf for s in self.segments):
            raise ValueError(f"segments needs positive lengths in m, got {self.segments}")
        if self.length is not None and abs(self.length - length) > 1e-6 * length:
            raise ValueError(f"segments add up to {length:.6g} m, but length is {self.length:.6g} m: remove length")
        if self.taper is not None:
            raise ValueError("segments cannot be combined with taper: state length")
        links = self.segment_links or [max((self.links or 2 * count) // count, 1)] * count
        if len(links) != count or min(links) < 1:
            raise ValueError(f"segment_links needs one number of links for each of the {count} segments, got {links}")
        if self.links not in (None, sum(links)):
            raise ValueError(f"links = {self.links} cannot be divided among the {count} segments: remove links, or "
                             "state segment_links = [...], the links of each, whose sum is links")
        self.length, self.segment_links, self.links = length, links, sum(links)
        return self

    def parts(self, joints: int) -> NDArray[np.float64] | None:
        """Return the length (joints,) [m] of the part of the body that belongs to each joint; None if the body has no
        stated segments.
        """
        if self.segments is None or self.segment_links is None:
            return None
        if sum(self.segment_links) != joints:
            raise InputError(f"the segments have {sum(self.segment_links)} links, and a fit asks for {joints}: remove "
                             "links from the fit")
        return np.repeat(np.array(self.segments) / self.segment_links, self.segment_links)

    def single_chamber(self) -> list[str]:
        """Return the entries that describe the only chamber of a body."""
        return [name for name in FIELDS if getattr(self, name, None) is not None]
