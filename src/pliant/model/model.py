"""The class `Model`: a chain of rigid links with springs and dampers at its joints, driven by chambers or tendons."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import MISSING, dataclass, fields, replace
from functools import cached_property
from inspect import signature
from math import inf, isfinite
from typing import Any

import numpy as np

from pliant.display import Card
from pliant.errors import InputError
from pliant.model.actuation import Actuation, chambers_of
from pliant.model.actuation_input import ActuationInput
from pliant.model.chamber import FIELDS, Chamber
from pliant.model.checks import EqualByFields, check_names, check_numbers, numbers, one_number
from pliant.model.extensible import check_extensions, joints_inside
from pliant.model.extension import extensions_of
from pliant.model.parameters import ModelParameters, Station, stations_of
from pliant.model.quantity import MOST_LINKS, MOST_STATIONS, fields_per, quantities, scalars
from pliant.model.space import check_space, space_of
from pliant.model.summary import model_card
from pliant.model.valve import Valve
from pliant.options import full_signature

Array = np.ndarray
PER_LINK = fields_per(ModelParameters, "joint")
SCALARS = scalars(ModelParameters)
ARRAYS = tuple(name for name in quantities(ModelParameters) if name not in SCALARS)
DEFAULTS: dict[str, Any] = {
    f.name: f.default if f.default_factory is MISSING else f.default_factory() for f in fields(ModelParameters)
    if f.default is not MISSING or f.default_factory is not MISSING
}


GEOMETRY = frozenset({"link_length", "base_length", "chambers", "extensions", "space"})
OF_GEOMETRY = ("actuation", "stretch_share")  # cached properties of a model that depend on these fields alone
LINK_MASS = quantities(ModelParameters)["link_mass"]


def check_physical(model: ModelParameters, given: Collection[str]) -> None:
    """Raise InputError if one of the `given` parameters of a model is not finite or not physical."""
    check_numbers(model, "model", [name for name in quantities(ModelParameters) if name in given])
    if "link_mass" in given:
        for mass in set(model.link_mass.tolist()):
            LINK_MASS.check_limit("model", "link_mass", mass)
    if "stations" in given:
        check_stations(model)
    choices = (  # messages are formatted only where a check fails
        (model.mass_at in ("rod", "tip"), "mass_at must be 'rod' or 'tip', got {0.mass_at!r}"),
        (isinstance(model.moving_base, bool), "moving_base must be true or false, got {0.moving_base!r}"),
        (model.stiffening_bound.max(initial=0.0) < 1, "stiffening_bound must be below 1, got {0.stiffening_bound}"),
        (model.link_mass[:-1].min(initial=inf) > 0 and model.link_mass[-1] + model.tip_mass >= LINK_MASS.least,
         "link_mass must be positive for every link, got {0.link_mass}"),
    )
    for good, sentence in choices:
        if not good:
            raise InputError(f"model {sentence.format(model)}")
    check_space(model)
    check_extensions(model)


def check_stations(model: ModelParameters) -> None:
    """Raise InputError if an observed point of a model is not on one of its links, or two have the same name."""
    names = [s.name for s in model.stations]
    if len(names) > MOST_STATIONS:
        raise InputError(f"model must have at most {MOST_STATIONS} stations, got {len(names)}")
    check_names("model stations", names)
    for station in model.stations:
        if not (-1 <= station.link < model.n and all(map(isfinite, station[2:]))):
            raise InputError(
                f"model station {station.name!r} must sit on a link 0..{model.n - 1} or the base (-1), got {station}"
            )
        for name, quantity in quantities(Station).items():
            quantity.check_limit("model", f"station {name}", getattr(station, name))
        if station.aside and model.space is None:
            raise InputError(
                f"model station {station.name!r} lies out of the bending plane (aside = {station.aside:g} m): set "
                "aside to 0, or make the model spatial with space = Space()"
            )


@dataclass(frozen=True, repr=False, init=False, eq=False)
class Model(EqualByFields, ModelParameters):
    """Parameters of the reduced-order model of a soft actuator: a chain of n rigid links with springs and dampers at
    its joints. SI units.

    They enter Eqs. (1)-(5) of the paper.

    Parameters
    ----------
    link_length, link_mass : array (n,)
        Length [m] and mass [kg] of each link. A single number applies to all n links, with n from the longest array.
    stiffness, damping, rest_angle : array (n,)
        Of the joint before each link: stiffness [N m/rad], damping [N m s/rad], and angle without pressure, from the
        direction of the link before [rad].
    torque, joint_gain, valve, ...
        Parameters of a single `Chamber`; the paper's is torque = (A d,).
    chambers : tuple of Chamber
        Chambers and tendons, in place of the parameters of a single one.
    stiffening, cubic_stiffening : array (n,)
        s [1/rad] and a [1/rad^2] of springs K q (1 + s q + a q^2): s < 0 where a joint softens with its angle, a > 0
        where it stiffens again. The paper's are 0.  # D15
    stiffening_bound : array (n,)
        f, a bound on the effect of s: without a, the slope of the spring stays within K (1 - f) and K (1 + f). f is
        below 1, so that the slope stays positive; 0: no bound. A neo-Hookean wall on an inextensible layer has 3/4.
    mass_at : {"rod", "tip"}
        Whether a link is a uniform rod, or has all its mass at its tip (the paper's frames taken literally).
    tip_mass : float
        Cap or load at the tip of the last link, kg.
    tip_inertia : float
        Moment of inertia of the cap or load about an axis across the last link through its tip, kg m^2; 0 for a point
        mass. About the link's axis it is twice as large, as of a flat round disc.
    base_length, base_angle : float
        Length [m] of the rigid part between the origin and the first joint, and its angle from +y [rad].
    gravity : array (2,)
        Gravity in the base frame, m/s^2; (3,) in space.
    moving_base : bool
        Whether the base moves in a prescribed way, so that its motion is an input of the model; see
        `pliant.simulation.BaseMotion`. Functions that need a base at rest refuse such a model.
    memory : Memory
        Hysteresis of the joints: creep, friction and Bouc-Wen; none by default.
    extensions : tuple of Extension
        Segments that lengthen, base first; none by default.
    space : Space, optional
        Properties of a chain in space; by default the chain is planar.
    stations : tuple of Station
        Observed points; the link tips when empty.
    source : dict
        Source of each parameter, by its name.

    Raises
    ------
    InputError
        When a parameter is missing, not finite or not physical.
    """

    def __init__(self, **given: Any) -> None:
        names = {f.name for f in fields(self)}
        if unknown := sorted(set(given) - names - set(FIELDS)):
            raise TypeError(f"Model has no parameter {unknown[0]!r}: it takes {', '.join((*sorted(names), *FIELDS))}")
        stated = {k: v for k, v in given.items() if k in FIELDS}
        values = {**DEFAULTS, **{k: v for k, v in given.items() if k not in FIELDS}}
        if missing := sorted(names - set(values) - {"chambers"}):
            raise TypeError(f"Model needs {' and '.join(missing)}")
        values["chambers"] = chambers_of(stated, values.get("chambers", ()))
        values |= {name: numbers(name, values[name]) for name in ARRAYS}
        values["space"] = space_of(values["space"])
        if values["gravity"].size == 1 and not values["gravity"].any():
            values["gravity"] = np.zeros(3 if values["space"] else 2)
        n = max(*(values[name].size for name in PER_LINK), *(c.joint_gain.size for c in values["chambers"]),
                *(c.cross_gain.size for c in values["chambers"]))
        if n > MOST_LINKS:
            raise InputError(f"model must have at most {MOST_LINKS} links, got {n}")
        self._take(values, n)

    def _take(self, values: dict[str, Any], n: int) -> None:
        """Store `values` of some or all parameters of n links, and check them."""
        for name in values.keys() & ARRAYS:
            values[name] = each_link(name, values[name], n) if name in PER_LINK else values[name]
            values[name].setflags(write=False)  # a model is immutable
        values |= {name: one_number(name, values[name]) for name in values.keys() & SCALARS}
        if "chambers" in values:
            values["chambers"] = tuple(with_gains(c, n) for c in chambers_of({}, values["chambers"]))
        for name, convert in (("extensions", extensions_of), ("space", space_of), ("stations", stations_of),
                           ("source", dict)):
            if name in values:
                values[name] = convert(values[name])
        self.__dict__.update(values)
        check_physical(self, values)

    def card(self) -> Card:
        """Return a printable summary of the model: links, actuation, valve, hysteresis and gravity."""
        return model_card(self)

    @property
    def chamber(self) -> ActuationInput:
        """The single pressure chamber of this model.

        Raises
        ------
        InputError
            When the model has several chambers.
        """
        if self.actuation.count > 1:
            raise InputError(
                f"this function needs a model with one chamber, but {self.name!r} has {self.actuation.count}: "
                f"{self.actuation.listing}; use a model with only one of them"
            )
        return self.chambers[0]

    @cached_property
    def actuation(self) -> Actuation:
        """The inputs of the model: their number, kinds and units, and the joint torques and axial forces that they
        cause.
        """
        return Actuation(self.chambers, self.n, tuple(self.segment_length.tolist()), joints_inside(self), self.turns)

    @property
    def torque(self) -> Array:
        """Coefficients of the torque law of the model's single chamber: in N m/Pa for the pressure, in N m/Pa^2 for its
        square, and so on. For a law that is no polynomial, its parameters.
        """
        return self.chamber.torque

    @property
    def joint_gain(self) -> Array:
        """Fraction (n,) of the single chamber's torque that acts at each joint."""
        return self.chamber.joint_gain

    @property
    def valve(self) -> Valve:
        """The valve of the model's single chamber."""
        return self.chamber.valve

    def torque_at(self, pressure: Any) -> Any:
        """Return the static torque [N m] of the model's single chamber at gauge `pressure` [Pa] of any shape.

        It is that of `Chamber.torque_at`.
        """
        return self.chamber.torque_at(pressure)

    def with_(self, **changes: Any) -> Model:
        """Return a copy of the model with the given parameters changed and checked, for example
        ``model.with_(stiffness=2.0)``.

        Parameters of a `Chamber` change the single chamber of the model.
        """
        if changed_fields := {k: v for k, v in changes.items() if k in FIELDS}:
            changes = {k: v for k, v in changes.items() if k not in FIELDS}
            changes["chambers"] = (replace(self.chamber, **changed_fields),)
        values: dict[str, Any] = {f.name: self.__dict__[f.name] for f in fields(self)}
        arrays = {name: numbers(name, changes[name]) for name in changes.keys() & ARRAYS}
        if not (changes.keys() <= values.keys() and {arrays[k].size for k in arrays.keys() & PER_LINK} <= {1, self.n}):
            return Model(**values | changes)  # another number of links, or an unknown parameter
        copy = object.__new__(Model)
        copy.__dict__.update(values)
        copy._take(changes | arrays, self.n)
        if not changes.keys() & GEOMETRY:
            copy.__dict__.update({k: self.__dict__[k] for k in OF_GEOMETRY if k in self.__dict__})
        return copy


ONE_CHAMBER = signature(Chamber).parameters
KEYWORD_DEFAULTS = {**{name: ONE_CHAMBER[name].default for name in FIELDS}, "torque": None, **DEFAULTS, "chambers": ()}
FURTHER = (*FIELDS, *(f.name for f in fields(ModelParameters) if f.name not in ("link_length", "link_mass")))
Model.__signature__ = full_signature(  # type: ignore[attr-defined]
    Model, ("link_length", "link_mass", *FURTHER), KEYWORD_DEFAULTS,
)


def each_link(name: str, a: Array, n: int) -> Array:
    """Return a model parameter of one or n numbers as an array (n,), with one number for each link."""
    if n == 0 or a.size not in (1, n):
        raise InputError(f"model {name} must be one number or {n} (one for each link), got {a.size}")
    return np.repeat(a, n // a.size)


def with_gains(chamber: ActuationInput, n: int) -> ActuationInput:
    """Return a chamber whose `joint_gain` has one number for each of n joints. If it has a single number, this is
    repeated for every joint; the same is then done for `cross_gain`.
    """
    if chamber.joint_gain.size == n and chamber.cross_gain.size in (1, n):
        return chamber
    return chamber.changed(joint_gain=each_link("joint_gain", chamber.joint_gain, n),
                   cross_gain=each_link("cross_gain", chamber.cross_gain, n))
