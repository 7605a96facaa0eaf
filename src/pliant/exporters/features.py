"""Features of a model that an export target may not support, and how to remove each from a model."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import MISSING, fields, is_dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from pliant.equations.laws import POLYNOMIAL
from pliant.equations.spring_terms import SPRING_TERMS
from pliant.errors import InputError
from pliant.mechanics.springs import springs_of
from pliant.model import Chamber, Memory, Model, Space, Tendon
from pliant.model.extension import CURVES
from pliant.model.model import DEFAULTS
from pliant.simulation.state import equilibrium, first_alone, typical_pressure


class Feature(NamedTuple):
    """A property of a model that not every export target supports, such as creep or dead time."""

    title: str
    names: Callable[[Model], tuple[str, ...]]  # names of a model's parts with this feature; empty: none
    without: Callable[[Model], Model]  # returns the nearest model without the feature
    fields: tuple[str, ...]  # fields of the model's parts that describe the feature, as Part.field


def of_model(
    title: str, has: Callable[[Model], object], without: Callable[[Model], Model], *parts: str, name: str = "",
) -> Feature:
    """Return a feature of a whole model, which it has if ``has(model)`` is true. `name` names it in messages; default:
    the title. `parts` are the fields that describe it.
    """
    return Feature(title, lambda model: (name or title,) if has(model) else (), without, parts)


def of_each(
    title: str, has: Callable[[Chamber], object], without: Callable[[Model], Model], *parts: str, name: str = "",
) -> Feature:
    """Return a feature of each chamber for which ``has(chamber)`` is true. `name` names it in messages; default: the
    title. If the model has several chambers, the chamber's name is appended. `parts` are the fields that describe it.
    """

    def names(model: Model) -> tuple[str, ...]:
        ending = (f" of {c.name}" if model.actuation.count > 1 else "" for c in model.chambers)
        return tuple((name or title) + end for c, end in zip(model.chambers, ending, strict=True) if has(c))

    return Feature(title, names, without, parts)


def numbered(name: str, count: Callable[[Model], int]) -> Callable[[Model], tuple[str, ...]]:
    """Return a function that takes a model and returns the names ``name 1`` ... ``name k`` for k = ``count(model)``."""
    return lambda model: tuple(f"{name} {k + 1}" for k in range(count(model)))


def lag(chamber: Chamber) -> bool:
    """Return whether a chamber's valve has a lag or a limited rate, in addition to any dead time."""
    v = chamber.valve
    lagging = v.rise_time, v.fall_time, v.natural_frequency, v.rise_rate, v.fall_rate, v.opening_time, v.settle_share
    return any(lagging)


def curved(chamber: Chamber) -> bool:
    """Return whether a chamber's torque law is a polynomial with terms beyond the linear one."""
    return chamber.law == POLYNOMIAL and bool(chamber.torque[1:].any())


def of_chambers(change: Callable[[Chamber], Chamber]) -> Callable[[Model], Model]:
    """Return a function that takes a model and returns a copy with ``change(chamber)`` in place of each chamber."""
    return lambda model: model.with_(chambers=tuple(change(c) for c in model.chambers))


def of_valve(**changes: float) -> Callable[[Model], Model]:
    """Return a function that takes a model and returns a copy in which the valve of each chamber has the field values
    `changes`.
    """
    return of_chambers(lambda c: replace(c, valve=replace(c.valve, **changes)))


def of_memory(**changes: Any) -> Callable[[Model], Model]:
    """Return a function that takes a model and returns a copy whose hysteresis parameters have the values `changes`."""
    return lambda model: model.with_(memory=replace(model.memory, **changes))


def straight_law(model: Model) -> Model:
    """Return the model with joint torques proportional to pressure. They equal the original torques at half of the
    model's typical pressure.
    """
    level = 0.5 * (typical_pressure(model) or 1e5)

    def straight(chamber: Chamber) -> Chamber:
        rigid = replace(chamber, inflation_limit=0.0)
        return replace(chamber, law=POLYNOMIAL, torque=np.array([float(rigid.torque_at(level)) / level]))

    return of_chambers(straight)(model)


def unbounded(model: Model) -> Model:
    """Return the model with polynomial springs in place of its springs whose softening is bounded. The new torque at
    the joint angle q is K q (1 + s q + a q^2); K is kept, s and a are fitted to the old torque.

    The fit covers the bend up to that of the typical pressure. Terms of the springs after these two are kept.
    """
    bare = springs_of(model.with_(**dict.fromkeys(LATER_TERMS, 0.0)))
    most = max(np.abs(equilibrium(model, first_alone(model, typical_pressure(model)))).max(), 0.01)
    bend = np.linspace(-most, most, 41)[:, None]
    held = np.array([bare.torque(np.full(model.n, q)) for q in bend[:, 0]])
    more = (held / model.stiffness - bend) / most
    shape, *_ = np.linalg.lstsq((bend / most) ** [2, 3], more)
    return model.with_(stiffening=shape[0] / most, cubic_stiffening=shape[1] / most**2, stiffening_bound=[0.0])


def one_lag(chamber: Chamber) -> Chamber:
    """Return the chamber with the mean of its valve's rise time and fall time in place of both."""
    mean = 0.5 * (chamber.valve.rise_time + chamber.valve.fall_time)
    return replace(chamber, valve=replace(chamber.valve, rise_time=mean, fall_time=mean))


def first_order(chamber: Chamber) -> Chamber:
    """Return the chamber with a first-order valve in place of its second-order valve. Both lag equally behind a slowly
    changing command.
    """
    v = chamber.valve
    if not v.natural_frequency:
        return chamber
    late = v.damping_ratio / (np.pi * v.natural_frequency)
    return replace(chamber, valve=replace(v, natural_frequency=0.0, rise_time=late, fall_time=late))


def soft(model: Model) -> bool:
    """Return whether the model's joint springs are nonlinear (soften or stiffen with the angle)."""
    return any(getattr(model, name).any() for name in SPRING_TERMS)


def straight_springs(model: Model) -> Model:
    """Return the model with linear springs in its joints."""
    return model.with_(**dict.fromkeys(CURVES, 0.0))


def refused(words: str) -> Callable[[Model], Model]:
    """Return a function that raises InputError for a model, with its name before `words`: there is no model without the
    feature.
    """

    def refuse(model: Model) -> Model:
        raise InputError(f"{model.name!r} {words}")

    return refuse


def both_taut(tendon: Chamber) -> Chamber:
    """Return a pair of tendons as one linear spring without pretension, other chambers unchanged. With pretension the
    spring has twice a tendon's stiffness and imbalance, which is exact while both tendons are taut.
    """
    if not (isinstance(tendon, Tendon) and tendon.pair):
        return tendon
    taut = 2.0 if tendon.pretension > 0.0 else 1.0
    stiffness, imbalance = taut * tendon.line_stiffness, taut * tendon.imbalance
    return replace(tendon, line_stiffness=stiffness, imbalance=imbalance, pretension=0.0)


def spring_term(name: str) -> Feature:
    """Return the feature for one nonlinear spring term, such as `cubic_stiffening`."""
    return of_model(
        f"spring term {name}", lambda m: getattr(m, name).any(), lambda m: m.with_(**{name: [0.0]}), f"Model.{name}"
    )


def longer(model: Model) -> tuple[str, ...]:
    """Return a name for each extensible segment of a model, such as "segment tip that lengthens"."""
    return tuple(f"segment {e.name} that lengthens" for e in model.extensions)


def without_segments(model: Model) -> Model:
    """Return the model without its extensible segments and without their hysteresis."""
    return of_memory(**dict.fromkeys(AXIAL_BRANCHES, ()))(model).with_(extensions=())


AXIAL_BRANCHES = tuple(f"axial_{f}" for f in ("creep_share", "creep_time", "slip_share", "slip_strain"))
STRAIGHT: dict[str, Any] = dict.fromkeys(CURVES) | {"stiffens_bending": False}  # only EA e of the axial springs
LENGTHENING = ("Model.extensions", "Chamber.axial_gain",
               *(f"Extension.{f}" for f in ("stiffness", "damping", "start", "stop")))  # fmt: skip
FEATURES: dict[str, Feature] = {
    "springs": of_model(
        "springs and dampers", lambda _: True, lambda m: m, "Model.stiffness", "Model.damping", "Extension.stiffness"
    ),
    "drive": of_each(
        "torque by pressure", lambda c: c.torque.any(), lambda m: m,
        "Chamber.torque", "Chamber.joint_gain", "Chamber.cross_gain", "Chamber.axial_gain",
    ),
    "chambers": Feature(
        "several chambers", lambda m: tuple(f"chamber {c.name}" for c in m.chambers[1:]),
        lambda m: m.with_(chambers=m.chambers[:1]), ("Model.chambers",),
    ),
    "points": of_model(
        "observed points", lambda m: m.stations, lambda m: m.with_(stations=()),
        "Model.stations", "Station.link", "Station.along", "Station.across", "Station.aside",
    ),
    "lengthening": Feature(
        "a body in a plane that lengthens", lambda m: () if m.space else longer(m), without_segments, LENGTHENING,
    ),
    "space_lengthening": Feature(
        "a body in space that lengthens", lambda m: longer(m) if m.space else (), without_segments, LENGTHENING,
    ),
    "curved_segments": Feature(
        "axial springs that soften or stiffen",
        lambda m: tuple(f"axial spring of segment {e.name} that softens or stiffens" for e in m.extensions if e.curved),
        lambda m: m.with_(extensions=tuple(replace(e, **STRAIGHT) for e in m.extensions)),
        tuple(f"Extension.{name}" for name in CURVES),
    ),
    "tied_segments": Feature(
        "a strain that changes the bending stiffness",
        lambda m: tuple(f"bending stiffness that changes with the strain of segment {e.name}"
                        for e in m.extensions if e.stiffens_bending),
        lambda m: m.with_(extensions=tuple(replace(e, stiffens_bending=False) for e in m.extensions)),
        ("Extension.stiffens_bending",),
    ),
    "axial_memory": of_model(
        "hysteresis of segments that lengthen", lambda m: m.memory.has_axial,
        of_memory(**dict.fromkeys(AXIAL_BRANCHES, ())), *(f"Memory.{name}" for name in AXIAL_BRANCHES),
        name="hysteresis of segments",
    ),
    "gravity": of_model(
        "gravity", lambda m: m.gravity.any(), lambda m: m.with_(gravity=np.zeros_like(m.gravity)), "Model.gravity",
    ),
    "softening": of_model(
        "springs that soften or stiffen", soft, straight_springs, "Model.stiffening", "Model.cubic_stiffening",
        name="softening springs",
    ),
    "bounded": of_model(
        "springs that soften within a bound", lambda m: (m.stiffening * m.stiffening_bound).any(), unbounded,
        "Model.stiffening_bound", name="bounded softening",
    ),
    **{  # terms beyond the first two: a target that does not list them refuses them
        term: spring_term(term) for term in tuple(SPRING_TERMS)[2:]
    },
    "law": of_each("torque law of higher degree", curved, straight_law, "Chamber.torque"),
    "own_law": of_each(
        "torque law that is no polynomial", lambda c: c.law != POLYNOMIAL, straight_law, "Chamber.law",
    ),
    "lagging_law": of_each(
        "torque law of higher degree behind a lagging valve", lambda c: curved(c) and lag(c), straight_law,
        "Chamber.torque",
    ),
    "dead_time": of_each("dead time", lambda c: c.valve.dead_time, of_valve(dead_time=0.0), "Valve.dead_time"),
    "two_lags": of_each(
        "rise and fall times that differ", lambda c: c.valve.rise_time != c.valve.fall_time, of_chambers(one_lag),
        "Valve.rise_time", "Valve.fall_time",
    ),
    "lag": of_each(
        "first-order valve", lambda c: c.valve.rise_time or c.valve.fall_time, of_valve(rise_time=0.0, fall_time=0.0),
        "Valve.rise_time", "Valve.fall_time",
    ),
    "second_order": of_each(
        "second-order valve", lambda c: c.valve.natural_frequency, of_chambers(first_order),
        "Valve.natural_frequency", "Valve.damping_ratio",
    ),
    "rates": of_each(
        "valve of limited rate", lambda c: c.valve.rise_rate or c.valve.fall_rate,
        of_valve(rise_rate=0.0, fall_rate=0.0), "Valve.rise_rate", "Valve.fall_rate", name="limited rate of the valve",
    ),
    "opening": of_each(
        "flow through the valve's opening", lambda c: c.valve.opening_time, of_valve(opening_time=0.0),
        "Valve.opening_time",
    ),
    "settling": of_each(
        "pressure that settles late", lambda c: c.valve.settle_share, of_valve(settle_share=0.0),
        "Valve.settle_share", "Valve.settle_time", name="late settling of the valve",
    ),
    "dead_band": of_each(
        "dead band of the regulator", lambda c: c.valve.dead_band, of_valve(dead_band=0.0), "Valve.dead_band",
    ),
    "swelling": of_each(
        "swelling", lambda c: c.swell_share, of_chambers(lambda c: replace(c, swell_share=0.0)),
        "Chamber.swell_share", "Chamber.swell_time",
    ),
    "inflation": of_each(
        "inflation", lambda c: c.inflation_limit, of_chambers(lambda c: replace(c, inflation_limit=0.0)),
        "Chamber.inflation_limit", "Chamber.inflation_time", "Chamber.inflation_jm",
    ),
    "creep": Feature(
        "creep", numbered("creep branch", lambda m: len(m.memory.creep_share)),
        of_memory(creep_share=(), creep_time=()), ("Memory.creep_share", "Memory.creep_time"),
    ),
    "slip": Feature(
        "slip elements", numbered("slip element", lambda m: len(m.memory.slip_share)),
        of_memory(slip_share=(), slip_angle=()), ("Memory.slip_share", "Memory.slip_angle"),
    ),
    "space": of_model(
        "a body in space", lambda m: m.space is not None,
        refused("is a model in space, but this target supports planar models only: export to mjcf, c99, fmu, "
                "state-space or urdf"),
        "Model.space", "Space.stiffness_ratio", "Space.rest_turn", "Space.base_tilt", "Space.radius",
    ),
    "twist": of_model(
        "joints that twist", lambda m: m.space is not None and m.space.twist_ratio,
        lambda m: m.with_(space=replace(m.space or Space(), twist_ratio=0.0)), "Space.twist_ratio",
    ),
    "soft_swing": of_model(
        "springs that soften or stiffen, of a body in space", lambda m: m.space is not None and soft(m),
        straight_springs, "Model.stiffening", "Model.cubic_stiffening",
        name="springs that soften with the size of a swing",
    ),
    "space_memory": of_model(
        "hysteresis of a body in space", lambda m: m.space is not None and m.memory,
        lambda m: m.with_(memory=Memory()), "Model.memory", name="hysteresis in space",
    ),
    "tendons": Feature(
        "tendons", lambda m: tuple(f"tendon {c.name}" for c in m.chambers if isinstance(c, Tendon)),
        refused("is driven by tendons, which this target cannot express: export to mjcf, c99 or fmu"),
        ("Tendon.driven_by", "Tendon.lever", "Tendon.taper", "Tendon.at", "Tendon.line_stiffness", "Tendon.pretension",
         "Tendon.imbalance", "Tendon.pulley", "Tendon.pair"),
    ),
    "tendon_friction": of_each(
        "friction of tendons", lambda c: isinstance(c, Tendon) and c.friction,
        of_chambers(lambda c: replace(c, friction=0.0) if isinstance(c, Tendon) else c),
        "Tendon.friction", "Tendon.slip_rate", name="friction",
    ),
    "pair_pretension": of_each(
        "pretension of pairs of tendons", lambda c: isinstance(c, Tendon) and c.pair and c.pretension,
        of_chambers(both_taut), name="pretension",
    ),
    "boucwen": of_model(
        "Bouc-Wen", lambda m: m.memory.boucwen_share, of_memory(boucwen_share=0.0),
        *(f"Memory.boucwen_{f}" for f in ("share", "beta", "gamma", "exponent")),
    ),
}
EVERYWHERE = (  # fields that every target writes, names, and fields that contain others
    "Model.link_length", "Model.link_mass", "Model.rest_angle", "Model.mass_at", "Model.tip_mass", "Model.base_length",
    "Model.base_angle", "Model.memory", "Model.name", "Model.source", "Chamber.name",
    "Chamber.valve", "Extension.name", "Station.name",
)
KNOWN = frozenset(EVERYWHERE).union(*(feature.fields for feature in FEATURES.values()))
ALL = frozenset(FEATURES)
LATER_TERMS = frozenset(tuple(SPRING_TERMS)[2:])  # later terms of the springs, see `SPRING_TERMS`


def missing(model: Model, can: frozenset[str]) -> tuple[str, ...]:
    """Return the keys of all features of `model` that an export target does not support. `can` holds the keys of the
    features that it supports.

    Raises
    ------
    InputError
        When the model has a field that belongs to no feature, so that no exporter would write it.
    """
    if strange := tuple(unknown(model)):
        raise InputError(
            f"{', '.join(strange)}: unknown to the exporters, which would lose it: add this field to a feature of "
            "pliant.exporters.features, or leave it at its default"
        )
    return tuple(key for key, feature in FEATURES.items() if key not in can and feature.names(model))


def unknown(part: Any) -> Iterator[str]:
    """Yield the name, such as "Valve.dead_time", of each field of a model that belongs to no known feature and differs
    from its default.
    """
    values = part._asdict() if hasattr(part, "_asdict") else {f.name: getattr(part, f.name) for f in fields(part)}
    for name, value in values.items():
        title = title_of(part, name)
        if title not in KNOWN:
            if not same(value, default_of(part, name)):
                yield title
            continue
        for inner in value if isinstance(value, tuple) else (value,):
            if is_dataclass(inner) or hasattr(inner, "_asdict"):
                yield from unknown(inner)


def title_of(part: Any, name: str) -> str:
    """Return the name of a model's field as "Part.field", such as "Valve.dead_time".

    For a tendon's field that every chamber has, the part is Chamber.
    """
    inherited = isinstance(part, Chamber) and name in {f.name for f in fields(Chamber)}
    return f"{Chamber.__name__ if inherited else type(part).__name__}.{name}"


def default_of(part: Any, name: str) -> Any:
    """Return the default value of the field `name` of `part`, or MISSING if it has none."""
    if isinstance(part, Model):
        return DEFAULTS.get(name, MISSING)
    if hasattr(part, "_field_defaults"):
        return part._field_defaults.get(name, MISSING)
    (field,) = (f for f in fields(part) if f.name == name)
    return field.default_factory() if field.default_factory is not MISSING else field.default


def same(value: Any, default: Any) -> bool:
    """Return whether a value equals a default value, with arrays compared element by element."""
    if default is MISSING:
        return False
    return bool(np.all(value == default)) if isinstance(value, np.ndarray) else bool(value == default)


def named(model: Model, keys: tuple[str, ...]) -> tuple[str, ...]:
    """Return the names of a model's parts that have the features with the given keys, such as "creep branch 1"."""
    return tuple(name for key in keys for name in FEATURES[key].names(model))


def without(model: Model, keys: tuple[str, ...]) -> Model:
    """Return the model without the features that have the given keys."""
    for key in keys:
        model = FEATURES[key].without(model)
    return model
