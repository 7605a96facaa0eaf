"""What a model may have beyond links and springs: how each is named, and the model without it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any, NamedTuple

from pliant.model import Model
from pliant.simulation.levels import typical_pressure


class Feature(NamedTuple):
    """One property of a model that not every target can express."""

    title: str
    names: Callable[[Model], tuple[str, ...]]  # what a model has of it, each by its name; empty: nothing
    without: Callable[[Model], Model]  # the nearest model that has none of it


def when(name: str, has: Callable[[Model], object]) -> Callable[[Model], tuple[str, ...]]:
    """`name` for a model that has it."""
    return lambda model: (name,) if has(model) else ()


def numbered(name: str, count: Callable[[Model], int]) -> Callable[[Model], tuple[str, ...]]:
    """``name 1`` ... ``name k``."""
    return lambda model: tuple(f"{name} {k + 1}" for k in range(count(model)))


def lag(model: Model) -> bool:
    """Whether the pressure lags behind the command by more than a dead time."""
    v = model.valve
    return bool(v.rise_time or v.fall_time or v.natural_frequency or v.rise_rate or v.fall_rate or v.settle_share)


def curved(model: Model) -> bool:
    """Whether the torque is more than a multiple of the pressure."""
    return bool(model.torque[1:].any())


def of_valve(**changes: float) -> Callable[[Model], Model]:
    """A model with another valve."""
    return lambda model: model.with_(valve=replace(model.valve, **changes))


def of_memory(**changes: Any) -> Callable[[Model], Model]:
    """A model with another memory."""
    return lambda model: model.with_(memory=replace(model.memory, **changes))


def straight_law(model: Model) -> Model:
    """A torque that is a multiple of the pressure, right at half of the typical pressure."""
    level = 0.5 * (typical_pressure(model) or 1e5)
    rigid = model.with_(inflation_limit=0.0)
    return model.with_(torque=[float(rigid.torque_at(level)) / level])


def one_lag(model: Model) -> Model:
    """One time constant for rise and fall, their mean."""
    mean = 0.5 * (model.valve.rise_time + model.valve.fall_time)
    return of_valve(rise_time=mean, fall_time=mean)(model)


def first_order(model: Model) -> Model:
    """A first-order valve that is as late as the second-order one."""
    v = model.valve
    late = v.damping_ratio / (3.141592653589793 * v.natural_frequency)
    return of_valve(natural_frequency=0.0, rise_time=late, fall_time=late)(model)


FEATURES: dict[str, Feature] = {
    "springs": Feature("springs and dampers", when("springs and dampers", lambda _: True), lambda m: m),
    "drive": Feature("torque by pressure", when("torque by pressure", lambda m: m.torque.any()), lambda m: m),
    "gravity": Feature("gravity", when("gravity", lambda m: m.gravity.any()), lambda m: m.with_(gravity=[0.0, 0.0])),
    "softening": Feature(
        "springs that soften or stiffen", when("softening springs", lambda m: m.stiffening.any()),
        lambda m: m.with_(stiffening=[0.0]),
    ),
    "law": Feature("torque law beyond a multiple", when("torque law of higher degree", curved), straight_law),
    "lagging_law": Feature(
        "such a law behind a lagging valve",
        when("torque law of higher degree behind a lagging valve", lambda m: curved(m) and lag(m)), straight_law,
    ),
    "dead_time": Feature("dead time", when("dead time", lambda m: m.valve.dead_time), of_valve(dead_time=0.0)),
    "two_lags": Feature(
        "rise and fall times that differ",
        when("rise and fall times that differ", lambda m: m.valve.rise_time != m.valve.fall_time), one_lag,
    ),
    "lag": Feature(
        "first-order valve", when("first-order valve", lambda m: m.valve.rise_time or m.valve.fall_time),
        of_valve(rise_time=0.0, fall_time=0.0),
    ),
    "second_order": Feature(
        "second-order valve", when("second-order valve", lambda m: m.valve.natural_frequency), first_order
    ),
    "rates": Feature(
        "valve of limited rate", when("limited rate of the valve", lambda m: m.valve.rise_rate or m.valve.fall_rate),
        of_valve(rise_rate=0.0, fall_rate=0.0),
    ),
    "settling": Feature(
        "pressure that settles late", when("late settling of the valve", lambda m: m.valve.settle_share),
        of_valve(settle_share=0.0),
    ),
    "swelling": Feature(
        "swelling", when("swelling", lambda m: m.chamber.swell_share), lambda m: m.with_(swell_share=0.0)
    ),
    "inflation": Feature(
        "inflation", when("inflation", lambda m: m.chamber.inflation_limit), lambda m: m.with_(inflation_limit=0.0)
    ),
    "creep": Feature(
        "creep", numbered("creep branch", lambda m: len(m.memory.creep_share)),
        of_memory(creep_share=(), creep_time=()),
    ),
    "slip": Feature(
        "slip elements", numbered("slip element", lambda m: len(m.memory.slip_share)),
        of_memory(slip_share=(), slip_angle=()),
    ),
    "boucwen": Feature(
        "Bouc-Wen", when("Bouc-Wen", lambda m: m.memory.boucwen_share), of_memory(boucwen_share=0.0)
    ),
}
ALL = frozenset(FEATURES)
MEMORY = frozenset({"creep", "slip", "boucwen"})


def missing(model: Model, can: frozenset[str]) -> tuple[str, ...]:
    """Keys of what `model` has and a target that expresses `can` has not."""
    return tuple(key for key, feature in FEATURES.items() if key not in can and feature.names(model))


def named(model: Model, keys: tuple[str, ...]) -> tuple[str, ...]:
    """What the model has of these features, each by its name."""
    return tuple(name for key in keys for name in FEATURES[key].names(model))


def without(model: Model, keys: tuple[str, ...]) -> Model:
    """The model with these features taken out, one after the other."""
    for key in keys:
        model = FEATURES[key].without(model)
    return model
