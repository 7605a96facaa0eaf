"""Entries of the task file (TOML) of the command `pliant control`, and their checks."""

from __future__ import annotations

import math
import tomllib
from ipaddress import IPv4Address
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, ValidationError, field_validator, model_validator

from pliant.control.contract import controller_kind
from pliant.control.plan import Task
from pliant.control.tuning import Limits, Tuning
from pliant.control.valve import SupplyValve
from pliant.errors import explain_validation
from pliant.files import read_entries

EXAMPLE = """\
# set-points of the tip, and what may be asked of the valve
period_ms = 4.0
highest_kpa = 190.0    # of tendons highest_n, highest_mm or highest_rad; one number or one for each
duration_s = 2.0
feedback = "lqr"       # or "mpc" (extra mpc), "pid"
planned = true         # changes as fast as the limits allow; false: ramps
ramp_s = 0.03          # time of a change that is not planned
[[setpoint]]
time_s = 0.0
displacement_mm = 25.0   # of a body of several chambers instead: tip_x_mm, tip_y_mm, tip_z_mm, angle_deg
# [path]               # instead of set-points: straight between these
# time_s = [0.0, 1.0, 2.0]
# displacement_mm = [0.0, 25.0, 5.0]
[valve]                # of the rig; without this table the model's
rise_hz = 9.01
fall_hz = 6.46
damping_ratio = 0.765
dead_time_ms = 8.12
"""


def _number(value: Any) -> Any:
    if isinstance(value, bool) or not isinstance(value, int | float) or math.isnan(value):
        raise ValueError("must be a number")
    return value


def _positive(value: Any) -> Any:
    if isinstance(value, bool) or not isinstance(value, int | float) or not value > 0:
        raise ValueError("must be a positive number")
    return value


def _pressures(value: Any) -> Any:
    return [_positive(p) for p in value] if isinstance(value, list) and value else _positive(value)


def _flag(value: Any) -> Any:
    if not isinstance(value, bool):
        raise ValueError("must be true or false")  # noqa: TRY004  pydantic needs a ValueError
    return value


def _address(value: Any) -> Any:
    try:
        return str(IPv4Address(value))
    except ValueError:
        raise ValueError("must be the address of a machine, such as '192.168.7.2'") from None


Number = Annotated[float, BeforeValidator(_number)]
Positive = Annotated[float, BeforeValidator(_positive)]
Flag = Annotated[bool, BeforeValidator(_flag)]
Pressures = Annotated[float | list[float], BeforeValidator(_pressures)]
Host = Annotated[str, BeforeValidator(_address)]
SCALES = {"kpa": ("Pa", 1e3), "n": ("N", 1.0), "mm": ("m", 1e-3), "rad": ("rad", 1.0)}  # of limits, by their names
LIMITS_IN = {unit: f"highest_{name}" for name, (unit, _) in SCALES.items()}
LONGEST_MS = 5000.0  # longest hold time of a receiver, whatever its task says


class Entry(BaseModel):
    """Base class of the tables of a control task file. An unknown key is an error."""

    model_config = ConfigDict(extra="forbid", frozen=True)


class SetPointEntry(Entry):
    """Table ``[[setpoint]]`` of a control task file: the target values from a time on."""

    time_s: Number
    displacement_mm: Number | None = Field(None, description="displacement of the tip from rest, for one chamber")
    tip_x_mm: Number | None = Field(None, description="change of the tip's x from rest, for several chambers")
    tip_y_mm: Number | None = Field(None, description="change of the tip's y")
    tip_z_mm: Number | None = Field(None, description="change of the tip's z, in space")
    angle_deg: Number | None = Field(None, description="change of the last link's angle")

    @model_validator(mode="after")
    def _one_kind(self) -> SetPointEntry:
        wanted(self)
        return self


class PathEntry(Entry):
    """Table ``[path]`` of a control task file: target values at given times, joined by straight lines."""

    time_s: list[Number]
    displacement_mm: list[Number] | None = None
    tip_x_mm: list[Number] | None = None
    tip_y_mm: list[Number] | None = None
    tip_z_mm: list[Number] | None = None
    angle_deg: list[Number] | None = None

    @model_validator(mode="after")
    def _as_many(self) -> PathEntry:
        if not self.time_s or any(len(getattr(self, name)) != len(self.time_s) for name in wanted(self)):
            raise ValueError("needs as many displacements as times, at least one")
        return self


OUTPUTS = {
    "tip_x_mm": ("tip_x", 1e-3), "tip_y_mm": ("tip_y", 1e-3), "tip_z_mm": ("tip_z", 1e-3),
    "angle_deg": ("angle_sum", math.pi / 180.0),
}


def wanted(entry: SetPointEntry | PathEntry) -> tuple[str, ...]:
    """Return the names of the target values that a set-point or path table contains: displacement_mm, or names of
    outputs.

    Raises
    ------
    ValueError
        When the entry gives none of them, or both kinds.
    """
    several = tuple(name for name in OUTPUTS if getattr(entry, name) is not None)
    if bool(several) == (entry.displacement_mm is not None):
        raise ValueError(f"needs displacement_mm for one chamber, or some of {', '.join(OUTPUTS)} for several")
    return several or ("displacement_mm",)


class TaskValve(Entry):
    """Table ``[valve]`` of a control task file: the test rig's pressure valve."""

    rise_hz: Positive = Field(description="natural frequency while it fills")
    fall_hz: Positive = Field(description="natural frequency while it empties")
    damping_ratio: Positive
    dead_time_ms: Positive = Field(description="between command and first reaction")

    @property
    def supply(self) -> SupplyValve:
        """The test rig's valve in SI units."""
        return SupplyValve(self.rise_hz, self.fall_hz, self.damping_ratio, 1e-3 * self.dead_time_ms)


class ReceiverEntry(Entry):
    """Table ``[receiver]`` of a control task file: settings of the program that receives the commands and sets the
    valves.

    `pliant.loop.receiver_of` uses them.
    """

    host: str = Field("127.0.0.1", min_length=1, description="address of this machine at which it listens")
    port: int = Field(5005, ge=1, le=65535)
    key_file: str | None = Field(None, description="file of the key shared with the loop, relative to the task file")
    private_link: Flag = Field(False, description="only trusted machines share the link to `host`: no key is needed")
    senders: list[Host] = Field([], description="addresses that may send; default: any")
    chambers: int | None = Field(None, ge=1, le=64, description="default: as many as `highest_kpa` has")
    highest_kpa: Pressures | None = Field(None, description="default: the task's")
    hold_ms: Positive = Field(100.0, description="hold time of commands without one")
    longest_hold_ms: Positive = Field(500.0, description="longest hold time of a command, at most 5000")
    window_ms: Positive | None = Field(
        None, description="how far a time stamp may be ahead, at most 5000; default: `longest_hold_ms`"
    )

    @model_validator(mode="after")
    def _within_bounds(self) -> ReceiverEntry:
        if not self.hold_ms <= self.longest_hold_ms <= LONGEST_MS or (self.window_ms or 0.0) > LONGEST_MS:
            raise ValueError(f"needs hold_ms <= longest_hold_ms <= {LONGEST_MS:g} and window_ms <= {LONGEST_MS:g}")
        each = self.highest_kpa
        if isinstance(each, list) and self.chambers not in (None, len(each)):
            raise ValueError(f"has {len(each)} pressures in highest_kpa for {self.chambers} chambers")
        return self


class TaskFile(Entry):
    """The entries of a control task file, with their default values."""

    period_ms: Positive = Field(4.0, description="period of frames and loop; it must equal the plant's")
    highest_kpa: Pressures = Field(
        190.0, description="highest command, one number or one for each chamber; the lowest is 0"
    )
    slew_kpa_per_s: Positive = Field(math.inf, description="fastest change of a command")
    highest_n: Pressures | None = Field(None, description="of tendons, in place of `highest_kpa`: tension, N")
    highest_mm: Pressures | None = Field(None, description="of tendons driven by a displacement, mm")
    highest_rad: Pressures | None = Field(None, description="of tendons driven by the angle of a motor, rad")
    slew_n_per_s: Positive = Field(math.inf, description="fastest change of a tension")
    slew_mm_per_s: Positive = Field(math.inf, description="of a displacement")
    slew_rad_per_s: Positive = Field(math.inf, description="of the angle of a motor")
    duration_s: Positive = 2.0
    feedback: str = Field("lqr", description="the controller: lqr, mpc, pid, or an installed one")
    planned: Flag = Field(True, description="changes as fast as the limits allow, planned ahead; false: ramps")
    ramp_s: Positive = Field(0.03, description="time of a change that is not planned")
    effort: Positive = Field(0.3, description="weight of the command: larger is quieter and slower")
    damping_time_s: Positive = Field(0.09, description="weight of the tip's speed relative to its error")
    integral_time_s: Positive = Field(0.3, description="weight of the integral of the error; larger is slower")
    setpoint: list[SetPointEntry] = Field([], description="targets, each from a time on")
    path: PathEntry | None = Field(None, description="path to follow instead of set-points")
    valve: TaskValve | None = Field(None, description="the rig's valve, for all chambers; default: the model's")
    valves: dict[str, TaskValve] = Field({}, description="the rig's valves by chamber name, instead of `valve`")
    receiver: ReceiverEntry | None = Field(None, description="limits of the receiver at the valve")

    @field_validator("feedback")
    @classmethod
    def _known(cls, name: str) -> str:
        controller_kind(name)
        return name

    @model_validator(mode="after")
    def _wants_something(self) -> TaskFile:
        if not self.setpoint and self.path is None:
            raise ValueError("needs at least one [[setpoint]] with time_s and displacement_mm, or a [path]")
        limits = [name for name in SCALES if f"highest_{name}" in self.model_fields_set]
        slews = [name for name in SCALES if f"slew_{name}_per_s" in self.model_fields_set]
        if len({*limits, *slews}) > 1 or (slews and slews[0] != self._scale):
            entries = ", ".join([*(f"highest_{n}" for n in limits), *(f"slew_{n}_per_s" for n in slews)])
            raise ValueError(f"limits all inputs in one unit, in highest_... and slew_..._per_s alike, got {entries}")
        if self.valve and self.valves:
            raise ValueError("may have [valve] for all chambers or [valves.NAME] for each, not both")
        if len({wanted(p) for p in self.setpoint}) > 1:
            raise ValueError("every [[setpoint]] must give the same ones of " + ", ".join(OUTPUTS))
        return self

    @property
    def period(self) -> float:
        """Period of the control loop [s]."""
        return 1e-3 * self.period_ms

    @property
    def _scale(self) -> str:
        """Name of the unit of the limits: that of highest_..."""
        return next((name for name in ("n", "mm", "rad") if getattr(self, f"highest_{name}") is not None), "kpa")

    @property
    def unit(self) -> str:
        """SI unit of the commands: "Pa" for pressures; "N", "m" or "rad" for tendons."""
        return SCALES[self._scale][0]

    @property
    def limits(self) -> Limits:
        """Limits of the commands, in the commands' SI unit."""
        name, (_, factor) = self._scale, SCALES[self._scale]
        slew, each = factor * getattr(self, f"slew_{name}_per_s"), getattr(self, f"highest_{name}")
        if isinstance(each, list):
            return Limits(factor * max(each), slew, tuple(factor * p for p in each))
        return Limits(factor * each, slew)

    @property
    def supply(self) -> SupplyValve | dict[str, SupplyValve] | None:
        """The test rig's valves: one valve for all chambers, a dict from chamber name to valve, or None if the model's
        valves are used.
        """
        if self.valves:
            return {name: entry.supply for name, entry in self.valves.items()}
        return None if self.valve is None else self.valve.supply

    @property
    def task(self) -> Task:
        """The control task in SI units."""
        names = wanted(self.path or self.setpoint[0])
        columns = [[getattr(p, name) for p in self.setpoint] for name in names]
        time = [p.time_s for p in self.setpoint]
        if self.path is not None:
            columns, time = [getattr(self.path, name) for name in names], self.path.time_s
        outputs = tuple(OUTPUTS[name] for name in names if name in OUTPUTS)
        levels = np.array([[1e-3 * value for value in column] for column in columns]).T
        if outputs:
            levels = np.array(columns, dtype=float).T * [unit for _, unit in outputs]
        return Task(
            np.array(time), levels if outputs else levels[:, 0], self.duration_s, path=self.path is not None,
            ramp=self.ramp_s, planned=self.planned, feedback=self.feedback,
            tuning=Tuning(self.effort, self.damping_time_s, self.integral_time_s),
            outputs=tuple(name for name, _ in outputs),
        )


def read_task(path: str | Path | None) -> TaskFile:
    """Read and check a control task file (TOML). Without a path, return the built-in example.

    Raises
    ------
    InputError
        When the file cannot be read, or an entry is unknown, missing or wrong.
    """
    content = tomllib.loads(EXAMPLE) if path is None else read_entries(path, "task")
    try:
        return TaskFile.model_validate(content)
    except ValidationError as error:
        raise explain_validation(error, f"task {path}", TaskFile) from None
