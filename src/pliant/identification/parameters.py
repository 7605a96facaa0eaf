"""Parameters of a fit: their names, units and bounds, and functions that apply their values to a model."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from pliant.errors import InputError
from pliant.identification import part_parameters
from pliant.identification.chamber_parameters import changed_chambers, check_chamber_names, owners
from pliant.identification.names import RECORDING, find_path, path_of, paths
from pliant.identification.part_parameters import memory_changes, usual_start
from pliant.model import Model, Station
from pliant.model.parts import BODY, STATION
from pliant.model.quantity import Quantity, quantities

WIDE = 1.959964  # standard errors to each side of a 95 % interval
MOSTLY_PRIOR = 0.7  # of the prior's standard deviation left after a fit: half of the information is the prior's


@dataclass(frozen=True)
class Parameter:
    """A fit parameter with value and bounds in SI units, which belongs to the model or to one recording.

    Its `unit`, and bounds that are always valid, follow from its name.

    Parameters
    ----------
    name : str
        A name of `pliant.identification.names.families`, or ``recording.name`` for a parameter of one recording alone.
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
        if self.shrink and not path_of(self.name).of_one_joint:
            raise InputError(f"parameter {self.name}: shrink is only for a parameter of a single joint, such as "
                             "stiffness_2: leave it out")  # fmt: skip

    def with_(self, **changes: Any) -> Parameter:
        """Return a copy of the parameter in which the given attributes are replaced."""
        return replace(self, **changes)

    @property
    def interval(self) -> tuple[float, float] | None:
        """Return the part of the 95 % interval (SI) that lies within the bounds; None without a standard error."""
        if self.value is None or self.std is None:
            return None
        return max(self.value - WIDE * self.std, self.lower), min(self.value + WIDE * self.std, self.upper)

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


OF_A_RECORD = frozenset(quantities(RECORDING.record))  # parameters of a recording that no model has


def kind_of(name: str) -> Quantity:
    """Return the unit, bounds and meaning of a parameter by its `name`, with or without a recording's or chamber's
    prefix.
    """
    return path_of(name).quantity


def shared_name(name: str) -> str:
    """Return a parameter's name without the recording, chamber or joint number in it. The name of a station's position,
    such as ``tip.along``, is returned whole.
    """
    path = find_path(name)
    if path is None:
        return name.rpartition(".")[2]
    if path.part is STATION:
        return f"{path.owner.rpartition('.')[2]}.{path.own}"
    return path.stem if path.of_one_joint else path.own


def for_record(values: Mapping[str, float], record: str) -> dict[str, float]:
    """Return the parameter values of one recording: the shared ones, overridden by those named ``RECORDING.name``."""
    prefix = f"{record}."
    of_record = {name.removeprefix(prefix): value for name, value in values.items() if name.startswith(prefix)}
    return {**values, **of_record}


def of_the_model(values: Mapping[str, float]) -> tuple[tuple[str, float], ...]:
    """Return the (name, value) pairs of parameters of the model, without those of a recording such as ``start``."""
    return tuple(pair for pair in values.items() if pair[0].rpartition(".")[2] not in OF_A_RECORD)


def apply(model: Model, values: Mapping[str, float], cache: dict[Any, Any] | None = None) -> Model:
    """Return the model with the parameter `values` (SI) applied. Parameters that no model has, such as those of a
    recording, are ignored.

    Each value replaces the model's own, so that applying the same values twice changes nothing. `cache` keeps the
    chambers and the hysteresis of this model for calls in which their parameters have the same values.
    """
    cache = {} if cache is None else cache
    if "joint_share" in values:
        model = moved_joints(model, values["joint_share"])
    changes = body_changes(model, values)
    changes |= part_parameters.stiffened(model, values)
    changes |= memory_changes(model, values, cache)
    stiffened = changes.pop("extensions", model.extensions)
    parts = {
        "chambers": changed_chambers(model, values, cache),
        "extensions": part_parameters.changed_extensions(stiffened, values),
        "space": part_parameters.changed_space(model, values),
    }
    changes |= {name: part for name, part in parts.items() if part != getattr(model, name)}
    if "gravity_angle" in values:
        changes["gravity"] = turned_gravity(model, values["gravity_angle"])
    stated = [values.get(f"gravity_{axis}") for axis in "xyz"[: model.gravity.size]]
    if any(g is not None for g in stated):
        before = changes.get("gravity", model.gravity)
        changes["gravity"] = np.array([old if g is None else g for old, g in zip(before, stated, strict=True)])
    if "mass" in values:
        changes["link_mass"] = model.link_mass * (values["mass"] / model.link_mass.sum())
    changes |= moved_stations(model, values)
    return model.with_(**changes) if changes else model


def body_changes(model: Model, values: Mapping[str, float]) -> dict[str, Any]:
    """Return the body's changed fields under the parameter `values`, as a dict for `Model.with_`. A value for all
    joints comes before those of single joints.
    """
    changes: dict[str, Any] = {}
    for name, path in sorted(paths(values, BODY), key=lambda pair: pair[1].number):
        if path.owner:
            continue
        if path.quantity.per != "joint":
            changes[path.field] = values[name]
        elif not path.numbers:
            changes[path.field] = np.full(model.n, values[name])
        else:
            changes.setdefault(path.field, getattr(model, path.field).copy())[path.number - 1] = values[name]
    return changes


def is_place(name: str) -> bool:
    """Return whether a parameter is a coordinate of a station, which moves no other part of the model."""
    path = find_path(name)
    return path is not None and path.part is STATION


def moved_stations(model: Model, values: Mapping[str, float]) -> dict[str, Any]:
    """Return the model's stations at the positions in `values`, as an argument of `Model.with_`; {} if none moves."""
    if not any(paths(values, STATION)):
        return {}
    axes = quantities(Station)
    coordinates = ({k: values.get(f"{s.name}.{k}", getattr(s, k)) for k in axes} for s in model.points)
    return {"stations": tuple(s._replace(**moved) for s, moved in zip(model.points, coordinates, strict=True))}


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
    part_parameters.check_segment_names([p.name for p in parameters], model, records | stations)
    part_parameters.check_space_names([p.name for p in parameters], model)
    known = records | stations | {*owners(model), *part_parameters.segments(model)}
    listed: set[str] = set()
    for p in parameters:
        if p.name in listed:
            raise InputError(f"parameter {p.name} is listed twice: remove one of the two")
        listed.add(p.name)
        owner, dot, _ = p.name.partition(".")
        if dot and owner not in known:
            what = "recording, station or chamber" if owners(model) else "recording or station"
            there = ", ".join(sorted(known))
            raise InputError(f"parameter {p.name}: no {what} is called {owner!r}; use one of {there}")
        path = path_of(p.name)
        if path.quantity.per in ("joint", "axis and joint") and path.numbers and not 1 <= path.number <= model.n:
            raise InputError(f"parameter {p.name}: the model has joints 1 to {model.n}; use one of their numbers")
    for start in ("", *(f"{name}." for name in owners(model))):
        if f"{start}gain" in listed and any(name.startswith(f"{start}joint_gain_") for name in listed):
            raise InputError(
                f"the parameters {start}gain and {start}joint_gain_<i> both set the gains of joints: leave one of them "
                "out"
            )


def values_of(parameters: Iterable[Parameter]) -> dict[str, float]:
    """Return the known values (SI) of parameters by name."""
    return {p.name: float(p.value) for p in parameters if p.value is not None}
