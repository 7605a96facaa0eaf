"""Features of a model that an export target may not support, and how to leave each out of a model."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from pliant.equations.laws import POLYNOMIAL
from pliant.errors import InputError
from pliant.mechanics.springs import springs_of
from pliant.model import ActuationInput, Memory, Model, Space, features
from pliant.model.extension import CURVES
from pliant.model.features import AXIAL_BRANCHES, LATER_TERMS
from pliant.simulation.state import equilibrium, first_alone, typical_pressure

Change = Callable[[Model], Model]


class Removable(NamedTuple):
    """A feature of a model (see `pliant.model.features`) with the function that leaves it out."""

    title: str
    names: Callable[[Model], tuple[str, ...]]
    fields: tuple[str, ...]
    without: Change  # returns the nearest model without the feature


def of_chambers(change: Callable[[ActuationInput], ActuationInput]) -> Change:
    """Return a function that takes a model and returns a copy with ``change(chamber)`` in place of each chamber."""
    return lambda model: model.with_(chambers=tuple(change(c) for c in model.chambers))


def of_valve(**changes: float) -> Change:
    """Return a function that takes a model and returns a copy in which the valve of each chamber has the field values
    `changes`.
    """
    return of_chambers(lambda c: replace(c, valve=replace(c.valve, **changes)))


def of_memory(**changes: Any) -> Change:
    """Return a function that takes a model and returns a copy whose hysteresis parameters have the values `changes`."""
    return lambda model: model.with_(memory=replace(model.memory, **changes))


def straight_law(model: Model) -> Model:
    """Return the model with joint torques proportional to pressure. For each chamber they equal the original torques at
    half of the chamber's typical pressure.
    """

    def straight(which: int, chamber: ActuationInput) -> ActuationInput:
        if chamber.law == POLYNOMIAL and chamber.torque.size == 1:
            return chamber
        level, rigid = 0.5 * (typical_pressure(model, which) or 1e5), replace(chamber, inflation_limit=0.0)
        return replace(chamber, law=POLYNOMIAL, torque=np.array([float(rigid.torque_at(level)) / level]))

    return model.with_(chambers=tuple(straight(i, c) for i, c in enumerate(model.chambers)))


def unbounded(model: Model) -> Model:
    """Return the model with polynomial springs in place of its springs whose softening is bounded. The new torque at
    the joint angle q is K q (1 + s q + a q^2); K is kept, s and a are fitted to the old torque.

    The fit covers the bend up to that of the typical pressure. Terms of the springs after these two are kept.
    """
    bare = springs_of(model.with_(**dict.fromkeys(LATER_TERMS, 0.0)))
    most = max(np.abs(equilibrium(model, first_alone(model, typical_pressure(model)))).max(), 0.01)
    bend = np.linspace(-most, most, 41)[:, None]
    torques = np.array([bare.torque(np.full(model.n, q)) for q in bend[:, 0]])
    more = (torques / model.stiffness - bend) / most
    shape, *_ = np.linalg.lstsq((bend / most) ** [2, 3], more)
    return model.with_(stiffening=shape[0] / most, cubic_stiffening=shape[1] / most**2, stiffening_bound=[0.0])


def one_lag(chamber: ActuationInput) -> ActuationInput:
    """Return the chamber with the mean of its valve's rise time and fall time in place of both."""
    mean = 0.5 * (chamber.valve.rise_time + chamber.valve.fall_time)
    return replace(chamber, valve=replace(chamber.valve, rise_time=mean, fall_time=mean))


def first_order(chamber: ActuationInput) -> ActuationInput:
    """Return the chamber with a first-order valve in place of its second-order valve. Both lag equally behind a slowly
    changing command.
    """
    v = chamber.valve
    if not v.natural_frequency:
        return chamber
    late = v.damping_ratio / (np.pi * v.natural_frequency)
    return replace(chamber, valve=replace(v, natural_frequency=0.0, rise_time=late, fall_time=late))




def straight_springs(model: Model) -> Model:
    """Return the model with linear springs in its joints."""
    return model.with_(**dict.fromkeys(CURVES, 0.0))


def refused(words: str) -> Change:
    """Return a function that raises InputError for a model, with its name before `words`: there is no model without the
    feature.
    """

    def refuse(model: Model) -> Model:
        raise InputError(f"{model.name!r} {words}")

    return refuse


def both_taut(tendon: Any) -> Any:
    """Return a pair of tendons as one linear spring without pretension, other chambers unchanged. With pretension the
    spring has twice a tendon's stiffness and imbalance, which is exact while both tendons are taut.
    """
    if len(tendon.signs) < 2:
        return tendon
    taut = 2.0 if tendon.pretension > 0.0 else 1.0
    stiffness, imbalance = taut * tendon.line_stiffness, taut * tendon.imbalance
    return replace(tendon, line_stiffness=stiffness, imbalance=imbalance, pretension=0.0)




def without_segments(model: Model) -> Model:
    """Return the model without its extensible segments and without their hysteresis."""
    return of_memory(**dict.fromkeys(AXIAL_BRANCHES, ()))(model).with_(extensions=())


def without_term(name: str) -> Change:
    """Return a function that takes a model and returns a copy without one nonlinear spring term."""
    return lambda model: model.with_(**{name: [0.0]})


def unchanged(model: Model) -> Model:
    """Return the model: it has no part that could be left out."""
    return model


STRAIGHT: dict[str, Any] = dict.fromkeys(CURVES) | {"stiffens_bending": False}  # only EA e of the axial springs
WITHOUT: dict[str, Change] = {  # by key of `FEATURES`
    "springs": unchanged,
    "drive": unchanged,
    "chambers": lambda m: m.with_(chambers=m.chambers[:1]),
    "points": lambda m: m.with_(stations=()),
    "lengthening": without_segments,
    "space_lengthening": without_segments,
    "curved_segments": lambda m: m.with_(extensions=tuple(replace(e, **STRAIGHT) for e in m.extensions)),
    "tied_segments": lambda m: m.with_(extensions=tuple(replace(e, stiffens_bending=False) for e in m.extensions)),
    "axial_memory": of_memory(**dict.fromkeys(AXIAL_BRANCHES, ())),
    "gravity": lambda m: m.with_(gravity=np.zeros_like(m.gravity)),
    "softening": straight_springs,
    "bounded": unbounded,
    **{term: without_term(term) for term in LATER_TERMS},
    "law": straight_law,
    "own_law": straight_law,
    "lagging_law": straight_law,
    "dead_time": of_valve(dead_time=0.0),
    "two_lags": of_chambers(one_lag),
    "lag": of_valve(rise_time=0.0, fall_time=0.0),
    "second_order": of_chambers(first_order),
    "rates": of_valve(rise_rate=0.0, fall_rate=0.0),
    "opening": of_valve(opening_time=0.0),
    "settling": of_valve(settle_share=0.0),
    "dead_band": of_valve(dead_band=0.0),
    "swelling": of_chambers(lambda c: c.changed(swell_share=0.0)),
    "inflation": of_chambers(lambda c: c.changed(inflation_limit=0.0)),
    "creep": of_memory(creep_share=(), creep_time=()),
    "slip": of_memory(slip_share=(), slip_angle=()),
    "space": refused("is a model in space, but this target supports planar models only: export to mjcf, c99, fmu, "
                     "state-space or urdf"),
    "twist": lambda m: m.with_(space=replace(m.space or Space(), twist_ratio=0.0)),
    "soft_swing": straight_springs,
    "space_memory": lambda m: m.with_(memory=Memory()),
    "tendons": refused("is driven by tendons, which this target cannot express: export to mjcf, c99 or fmu"),
    "tendon_friction": of_chambers(lambda c: c.changed(friction=0.0, entry_friction=0.0)),
    "tendon_chords": of_chambers(lambda c: c.changed(spacing=0.0)),
    "pair_pretension": of_chambers(both_taut),
    "boucwen": of_memory(boucwen_share=0.0),
}


FEATURES = {key: Removable(*features.FEATURES[key], change) for key, change in WITHOUT.items()}


def without(model: Model, keys: tuple[str, ...]) -> Model:
    """Return the nearest model without the features that have the given keys."""
    for key in keys:
        model = FEATURES[key].without(model)
    return model
