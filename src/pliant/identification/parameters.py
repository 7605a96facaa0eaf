"""Parameters of a fit: their names, units and bounds, and functions that apply their values to a model."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from difflib import get_close_matches
from functools import cache, reduce
from typing import Any

import numpy as np

from pliant.errors import InputError
from pliant.identification import extension_parameters, space_parameters
from pliant.identification.chamber_parameters import changed_chambers, check_chamber_names, matching, owners
from pliant.identification.memory_parameters import ROWS, memory_changes, usual_start
from pliant.model import Model
from pliant.model.torque_law import law_parameters

MOSTLY_PRIOR = 0.7  # of the prior's standard deviation left after a fit: half of the information is the prior's


@dataclass(frozen=True)
class Parameter:
    """A fit parameter with value and bounds in SI units, which belongs to the model or to one recording.

    Its `unit`, and bounds that are always valid, follow from its name.

    Parameters
    ----------
    name : str
        One of `KNOWN`, or ``recording.name`` for a parameter of one recording alone.
    value : float or None
        Start value of a free parameter or value of a fixed one, SI. None: the start is estimated from the recordings.
    lower, upper : float
        Bounds, SI.
    free : bool
        Whether the fit may change the value.
    scale : float
        Typical size by which the optimiser scales the parameter, SI. 0: taken from the start value.
    source : str
        Where the value comes from, as text for reports.
    std : float or None
        Standard error after a fit.
    prior, prior_std : float or None
        Mean and standard deviation of the value known before the fit (Gaussian prior), SI. Without `prior`, the mean
        is the first start value.
    shrink : float
        For a parameter of one joint: standard deviation of the joints' values about their mean, as a fraction of that
        mean. 0: the joints are fitted independently.

    Raises
    ------
    InputError
        When the name is unknown, the bounds cross, the value lies outside them, or a fixed one has no value.
    """

    name: str
    value: float | None = None
    lower: float = -np.inf
    upper: float = np.inf
    free: bool = True
    unit: str = ""
    scale: float = 0.0
    source: str = ""
    std: float | None = None
    prior: float | None = None
    prior_std: float | None = None
    shrink: float = 0.0

    def __post_init__(self) -> None:
        kind = kind_of(self.name)
        object.__setattr__(self, "unit", self.unit or kind.unit)
        object.__setattr__(self, "lower", max(self.lower, kind.lower))
        object.__setattr__(self, "upper", min(self.upper, kind.upper))
        object.__setattr__(self, "scale", self.scale or kind.scale)
        usual = usual_start(self.name)
        if self.value is None and self.free and usual is not None:
            object.__setattr__(self, "value", float(np.clip(usual, self.lower, self.upper)))
            object.__setattr__(self, "source", self.source or "usual start")
        if self.prior is None and self.prior_std is not None:  # here, so that no later start value moves the mean
            object.__setattr__(self, "prior", self.value)
        if not self.lower < self.upper:
            raise InputError(
                f"parameter {self.name}: lower bound {self.lower} is not below upper bound {self.upper}: change one"
            )
        if self.value is not None and not (np.isfinite(self.value) and self.lower <= self.value <= self.upper):
            raise InputError(
                f"parameter {self.name}: value {self.value} is not within its bounds {self.lower} ... {self.upper}: "
                "change the value, or lower and upper"
            )
        if self.value is None and not self.free:
            raise InputError(f"parameter {self.name} is fixed and needs a value: give one, or free the parameter")
        if self.prior is not None and self.prior_std is None:
            raise InputError(f"parameter {self.name}: a prior needs a standard deviation too: give prior_std")
        if self.prior_std is not None and not self.prior_std > 0:
            raise InputError(f"parameter {self.name}: prior_std must be positive, got {self.prior_std}")
        if self.shrink < 0:
            raise InputError(f"parameter {self.name}: shrink must be a positive fraction, got {self.shrink}")
        if self.shrink and not re.search(r"_(\d+|\*)$", self.name):
            raise InputError(f"parameter {self.name}: shrink is only for a parameter of a single joint, such as "
                             "stiffness_2: leave it out")  # fmt: skip

    def with_(self, **changes: Any) -> Parameter:
        """Return a copy of the parameter in which the given attributes are replaced."""
        return replace(self, **changes)

    @property
    def narrowed(self) -> float | None:
        """Return the ratio of the parameter's standard error to that of its prior, 1 if the data add no information.
        None without a prior or a standard error.
        """
        return None if self.prior_std is None or self.std is None else self.std / self.prior_std

    @property
    def moved(self) -> float | None:
        """Return the difference of the fitted value from the prior's mean, in standard deviations of the prior; None
        without a prior.
        """
        if self.prior_std is None or self.prior is None or self.value is None:
            return None
        return (self.value - self.prior) / self.prior_std

    @property
    def rests_on(self) -> str:
        """Return a phrase on the source of the parameter's value: given, the data, or the prior."""
        if not self.free:
            return "given"
        if self.prior_std is None:
            return "data"
        prior_text = f"prior {self.prior:.4g} +- {self.prior_std:.2g}" if self.prior is not None else "prior"
        if self.narrowed is None or self.moved is None:
            return f"{prior_text} alone"
        which = prior_text if self.narrowed > MOSTLY_PRIOR else f"data and {prior_text}"
        return f"{which}; moved by {self.moved:+.1f} of its sd, narrowed to {100 * min(self.narrowed, 1.0):.0f} %"


@dataclass(frozen=True)
class Kind:
    """Unit, bounds, typical size and meaning of a parameter, as its name determines them."""

    unit: str
    lower: float = -np.inf
    upper: float = np.inf
    scale: float = 0.0
    meaning: str = ""


PER_JOINT = ("stiffness", "damping", "rest_angle")
KNOWN: dict[str, Kind] = {
    "stiffness": Kind("N m/rad", lower=1e-9, meaning="stiffness of every joint"),
    "damping": Kind("N m s/rad", lower=0.0, meaning="damping of every joint"),
    "body_stiffness": Kind("N m/rad", lower=1e-9, meaning="stiffness of the first joint; others and EA in proportion"),
    r"stiffness_(\d+|\*)": Kind("N m/rad", lower=1e-9, meaning="stiffness of one joint, 1 the first, * each"),
    r"damping_(\d+|\*)": Kind("N m s/rad", lower=0.0, meaning="damping of one joint, 1 the first, * each"),
    "rest_angle": Kind("rad", lower=-3.2, upper=3.2, scale=0.05, meaning="rest angle of every joint"),
    r"rest_angle_(\d+|\*)": Kind("rad", lower=-3.2, upper=3.2, scale=0.05, meaning="rest angle of one joint, * each"),
    "joint_share": Kind("1", lower=0.0, upper=0.99, scale=0.1, meaning="position of a joint in its segment, 0 at base"),
    "gravity_angle": Kind("rad", lower=-6.3, upper=6.3, scale=0.05, meaning="angle of gravity from the base tangent"),
    "gain": Kind("1", scale=1.0, meaning="mean of the joints' gains: a factor on the whole torque law"),
    r"joint_gain_(\d+|\*)": Kind("1", scale=0.3, meaning="factor on the torque law at one joint, * each"),
    r"cross_gain_(\d+|\*)": Kind("1", scale=0.3, meaning="factor on the torque law about y at one joint, in space"),
    "lever": Kind("m", lower=1e-6, scale=2e-3, meaning="distance of a tendon's path from the axis, at the base"),
    "taper": Kind("1", scale=5e-3, meaning="decrease of a tendon's distance from the axis per length"),
    "line_stiffness": Kind("N/m", lower=1e-6, meaning="stiffness of a tendon with its motor and mounts"),
    "pretension": Kind("N", scale=1.0, meaning="tension of a tendon at rest; below 0 it hangs slack"),
    "imbalance": Kind("N", scale=1.0, meaning="pretension of a pair's first tendon less that of its second"),
    "friction": Kind("1", lower=0.0, upper=5.0, scale=0.1, meaning="coefficient of friction along a tendon"),
    "pulley": Kind("m", lower=1e-6, meaning="radius of a motor's pulley"),
    "gain_[xy]": Kind("1", scale=0.3, meaning="mean factor on the torque about x or y, in space"),
    r"torque_[1-9]": Kind("N m/Pa^k", meaning="coefficient of pressure^k in the torque law"),
    "mass": Kind("kg", lower=1e-9, meaning="mass of all links together, without the tip mass"),
    "tip_mass": Kind("kg", lower=0.0, scale=5e-3, meaning="cap or load at the last tip"),
    "valve_rise": Kind("s", lower=0.0, upper=30.0, scale=0.02, meaning="valve time constant, pressure rising"),
    "valve_fall": Kind("s", lower=0.0, upper=30.0, scale=0.02, meaning="valve time constant, pressure falling"),
    "valve_dead_time": Kind("s", lower=0.0, upper=5.0, scale=0.01, meaning="valve dead time"),
    "base_angle": Kind("rad", lower=-1.0, upper=1.0, scale=0.05, meaning="angle of the base tangent from +y"),
    "base_x": Kind("m", scale=1e-3, meaning="offset of the recording's frame, x"),
    "base_y": Kind("m", scale=1e-3, meaning="offset of the recording's frame, y"),
    "base_z": Kind("m", scale=1e-3, meaning="offset of the recording's frame, z, in space"),
    r".+\.along": Kind("m", scale=2e-3, meaning="position of a station along its link"),
    r".+\.across": Kind("m", scale=2e-3, meaning="position of a station across its link"),
    r".+\.aside": Kind("m", scale=2e-3, meaning="position of a station out of the plane, in space"),
    "start": Kind("s", scale=0.01, meaning="when the pulse begins, or the pressure clock's offset"),
    "stop": Kind("s", scale=0.01, meaning="when the pulse ends"),
    "latency": Kind("s", lower=-5.0, upper=5.0, scale=5e-3, meaning="delay of the shape's time stamps behind pressure"),
    "sensor_lag": Kind("s", lower=0.0, upper=10.0, scale=0.02, meaning="time constant of the shape's sensor"),
    "release": Kind("s", scale=0.01, meaning="when the held body is let go"),
    "release_time": Kind("s", lower=0.0, upper=0.2, scale=0.01, meaning="time that the hand takes to let go"),
    "base_turn": Kind("rad", lower=-0.2, upper=0.2, scale=0.01, meaning="turn of a clamp that yields at release"),
    "hold_force": Kind("N", scale=0.05, meaning="force at the tip, along x, that holds the body before its release"),
    **{n: Kind(*row) for n, row in {**ROWS, **extension_parameters.ROWS, **space_parameters.ROWS}.items()},
}


OF_A_RECORD = frozenset({  # parameters of a recording that no model has
    "base_x", "base_y", "base_z", "start", "stop", "latency", "release", "release_time", "base_turn", "hold_force",
})  # fmt: skip


@cache
def kind_of(name: str) -> Kind:
    """Return the unit, bounds and meaning of a parameter by its `name`, with or without a recording's or chamber's
    prefix.
    """
    for candidate in (name, name.partition(".")[2]):
        for pattern, kind in KNOWN.items():
            if candidate and re.fullmatch(pattern, candidate):
                return kind
        if candidate in law_parameters():
            return Kind(*law_parameters()[candidate])
    plain = ((r"(\d+|\*)", "<i>"), ("[1-9]", "<k>"), (r".+\.", "<station>."), (r"(\d+)", "<i>"),
             ("([xyz])", "<axis>"), ("([xy])", "<axis>"), ("[xy]", "<axis>"))  # fmt: skip
    readable = [reduce(lambda text, pair: text.replace(*pair), plain, pattern) for pattern in KNOWN]
    readable += law_parameters()
    near = get_close_matches(name[:80].rpartition(".")[2], readable, 1, 0.6)
    meant = f"did you mean {near[0]!r}? Known are " if near else "use one of "
    raise InputError(
        f"unknown parameter {name!r}: {meant}{', '.join(readable)}, some also with the name of a recording or chamber "
        "and a dot in front"
    )


def shared_name(name: str) -> str:
    """Return a parameter's name without the recording, chamber or joint number in it. The name of a station's position,
    such as ``tip.along``, is returned whole.
    """
    of_station = name.endswith((".along", ".across", ".aside")) and name.count(".") == 1
    own = name if of_station else name.partition(".")[2] or name
    return re.sub(r"^(stiffness|damping|rest_angle|joint_gain|cross_gain)_\d+$", r"\1", own)


def for_record(values: Mapping[str, float], record: str) -> dict[str, float]:
    """Return the parameter values of one recording: the shared ones, overridden by those named ``RECORDING.name``."""
    prefix = f"{record}."
    own = {name.removeprefix(prefix): value for name, value in values.items() if name.startswith(prefix)}
    return {**values, **own}


def of_the_model(values: Mapping[str, float]) -> tuple[tuple[str, float], ...]:
    """Return the (name, value) pairs of parameters of the model, without those of a recording such as ``start``."""
    return tuple(pair for pair in values.items() if pair[0].rpartition(".")[2] not in OF_A_RECORD)


def apply(model: Model, values: Mapping[str, float]) -> Model:
    """Return the model with the parameter `values` (SI) applied. Parameters that no model has, such as those of a
    recording, are ignored.

    Each value replaces the model's own, so that applying the same values twice changes nothing.
    """
    if "joint_share" in values:
        model = moved_joints(model, values["joint_share"])
    changes: dict[str, Any] = {k: values[k] for k in ("tip_mass", "base_angle") if k in values}
    names = tuple(values)
    for field in PER_JOINT:
        joint = {int(k.rpartition("_")[2]): values[k] for k in matching(rf"{field}_\d+", names)}
        if field in values or joint:
            array = np.full(model.n, values[field]) if field in values else getattr(model, field).copy()
            for i, value in joint.items():
                array[i - 1] = value
            changes[field] = array
    changes |= extension_parameters.stiffened(model, values)
    changes |= memory_changes(model, values)
    chambers = changed_chambers(model, values)
    if any(a is not b for a, b in zip(chambers, model.chambers, strict=True)):
        changes["chambers"] = chambers
    extensions = extension_parameters.changed_extensions(changes.get("extensions", model.extensions), values)
    if extensions != model.extensions:
        changes["extensions"] = extensions
    if "gravity_angle" in values:
        changes["gravity"] = turned_gravity(model, values["gravity_angle"])
    if "mass" in values:
        changes["link_mass"] = model.link_mass * (values["mass"] / model.link_mass.sum())
    if (space := space_parameters.changed_space(model, values)) is not model.space:
        changes["space"] = space
    changes |= moved_stations(model, values)
    return model.with_(**changes) if changes else model


def moved_stations(model: Model, values: Mapping[str, float]) -> dict[str, Any]:
    """Return the model's stations at the positions in `values`, as an argument of `Model.with_`; {} if none moves."""
    if not any(name.endswith((".along", ".across", ".aside")) for name in values):
        return {}
    axes = ("along", "across", "aside")
    places = ({k: values.get(f"{s.name}.{k}", getattr(s, k)) for k in axes} for s in model.points)
    return {"stations": tuple(s._replace(**own) for s, own in zip(model.points, places, strict=True))}


def moved_joints(model: Model, share: float) -> Model:
    """Return the chain with each joint at the fraction `share` of its body segment.
    Stations keep their positions at rest.
    """
    segment = model.length / model.n
    length = np.full(model.n, segment)
    length[-1] = (1.0 - share) * segment
    if not np.allclose(model.link_length[:-1], segment, rtol=1e-6):
        raise InputError("the parameter joint_share needs a chain of equal segments, and this model's segments differ: "
                         "leave joint_share out")  # fmt: skip
    shift = share * segment - model.base_length
    density = model.link_mass.sum() / model.link_length.sum()
    stations = tuple(s._replace(along=s.along - shift) if s.link >= 0 else s for s in model.points)
    return model.with_(
        link_length=length, base_length=share * segment, link_mass=density * length, stations=stations
    )


def turned_gravity(model: Model, angle: float) -> np.ndarray:
    """Return a gravity vector (2,) [m/s^2] of the model's magnitude, at `angle` [rad] from the base tangent +y."""
    strength = float(np.hypot(*model.gravity))
    if strength == 0:
        raise InputError("the parameter gravity_angle turns gravity, but the model's gravity is zero: give the model "
                         "gravity")  # fmt: skip
    return strength * np.array([-np.sin(angle), np.cos(angle)])


def each_joint(parameters: Iterable[Parameter], joints: int) -> list[Parameter]:
    """Return the parameters with wildcards such as ``stiffness_*`` expanded to one parameter per joint."""
    written = []
    for p in parameters:
        stem = p.name.removesuffix("_*")
        written += [p] if stem == p.name else [p.with_(name=f"{stem}_{i + 1}") for i in range(joints)]
    return written


def check_names(parameters: Iterable[Parameter], model: Model, records: set[str], stations: set[str]) -> None:
    """Raise InputError for a duplicate parameter, or one that names an unknown joint, recording, station or chamber."""
    parameters = list(parameters)
    if both := records & stations:
        raise InputError(f"{min(both)!r} names a recording and a station, so that the owner of its parameters is not "
                         "clear: rename one of the two")  # fmt: skip
    check_chamber_names([p.name for p in parameters], model, records | stations)
    extension_parameters.check_segment_names([p.name for p in parameters], model, records | stations)
    space_parameters.check_space_names([p.name for p in parameters], model)
    known = records | stations | {*owners(model), *extension_parameters.segments(model)}
    seen: set[str] = set()
    for p in parameters:
        if p.name in seen:
            raise InputError(f"parameter {p.name} is listed twice: remove one of the two")
        seen.add(p.name)
        owner, dot, own = p.name.partition(".")
        if dot and owner not in known:
            what = "recording, station or chamber" if owners(model) else "recording or station"
            there = ", ".join(sorted(known))
            raise InputError(f"parameter {p.name}: no {what} is called {owner!r}; use one of {there}")
        number = re.fullmatch(rf"(?:{'|'.join(PER_JOINT)}|joint_gain)_(\d+)", own or owner)
        if number and not 1 <= int(number[1]) <= model.n:
            raise InputError(f"parameter {p.name}: the model has joints 1 to {model.n}; use one of their numbers")
    for start in ("", *(f"{name}." for name in owners(model))):
        if f"{start}gain" in seen and any(name.startswith(f"{start}joint_gain_") for name in seen):
            raise InputError(
                f"the parameters {start}gain and {start}joint_gain_<i> both set the gains of joints: leave one of them "
                "out"
            )


def values_of(parameters: Iterable[Parameter]) -> dict[str, float]:
    """Return the known values (SI) of parameters by name."""
    return {p.name: float(p.value) for p in parameters if p.value is not None}
