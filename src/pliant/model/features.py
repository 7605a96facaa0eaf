"""Features of a model, such as creep or dead time, and which of them a consumer of models takes into account.

A consumer (an export target, `linearise`, a filter, ...) lists the features that it takes into account. A model with
another feature is refused, so that no feature is lost without a message.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import MISSING, dataclass, field, fields, is_dataclass
from typing import Any, NamedTuple

import numpy as np

from pliant.equations.laws import POLYNOMIAL
from pliant.equations.spring_terms import SPRING_TERMS
from pliant.errors import InputError
from pliant.model.actuation_input import SHARED, ActuationInput
from pliant.model.extension import CURVES
from pliant.model.model import DEFAULTS, Model
from pliant.text import listed


class Feature(NamedTuple):
    """A property of a model that not every consumer takes into account, such as creep or dead time."""

    title: str
    names: Callable[[Model], tuple[str, ...]]  # names of a model's parts with this feature; empty: none
    fields: tuple[str, ...]  # fields of the model's parts that describe the feature, as Part.field


def of_model(title: str, has: Callable[[Model], object], *parts: str, name: str = "") -> Feature:
    """Return a feature of a whole model, which it has if ``has(model)`` is true. `name` names it in messages; default:
    the title. `parts` are the fields that describe it.
    """
    return Feature(title, lambda model: (name or title,) if has(model) else (), parts)


def of_each(title: str, has: Callable[[Any], object], *parts: str, name: str = "") -> Feature:
    """Return a feature of each chamber for which ``has(chamber)`` is true. `name` names it in messages; default: the
    title. If the model has several chambers, the chamber's name is appended. `parts` are the fields that describe it.
    """

    def names(model: Model) -> tuple[str, ...]:
        ending = (f" of {c.name}" if model.actuation.count > 1 else "" for c in model.chambers)
        return tuple((name or title) + end for c, end in zip(model.chambers, ending, strict=True) if has(c))

    return Feature(title, names, parts)


def numbered(name: str, count: Callable[[Model], int]) -> Callable[[Model], tuple[str, ...]]:
    """Return a function that takes a model and returns the names ``name 1`` ... ``name k`` for k = ``count(model)``."""
    return lambda model: tuple(f"{name} {k + 1}" for k in range(count(model)))


def lag(chamber: ActuationInput) -> bool:
    """Return whether a chamber's valve has a lag or a limited rate, in addition to any dead time."""
    v = chamber.valve
    lagging = v.rise_time, v.fall_time, v.natural_frequency, v.rise_rate, v.fall_rate, v.opening_time, v.settle_share
    return any(lagging)


def curved(chamber: ActuationInput) -> bool:
    """Return whether a chamber's torque law is a polynomial with terms beyond the linear one."""
    return chamber.law == POLYNOMIAL and bool(chamber.torque[1:].any())


def soft(model: Model) -> bool:
    """Return whether the model's joint springs are nonlinear (soften or stiffen with the angle)."""
    return any(getattr(model, name).any() for name in SPRING_TERMS)


def longer(model: Model) -> tuple[str, ...]:
    """Return a name for each extensible segment of a model, such as "segment tip that lengthens"."""
    return tuple(f"segment {e.name} that lengthens" for e in model.extensions)


def spring_term(name: str) -> Feature:
    """Return the feature for one nonlinear spring term, such as `cubic_stiffening`."""
    return of_model(f"spring term {name}", lambda m: getattr(m, name).any(), f"Model.{name}")


AXIAL_BRANCHES = tuple(f"axial_{f}" for f in ("creep_share", "creep_time", "slip_share", "slip_strain"))
LENGTHENING = ("Model.extensions", "Chamber.axial_gain",
               *(f"Extension.{f}" for f in ("stiffness", "damping", "start", "stop")))  # fmt: skip
FEATURES: dict[str, Feature] = {
    "springs": of_model(
        "springs and dampers", lambda _: True, "Model.stiffness", "Model.damping", "Extension.stiffness",
    ),
    "drive": of_each(
        "torque by pressure", lambda c: c.torque.any(),
        "Chamber.torque", "Chamber.joint_gain", "Chamber.cross_gain", "Chamber.axial_gain",
    ),
    "chambers": Feature(
        "several chambers", lambda m: tuple(f"chamber {c.name}" for c in m.chambers[1:]), ("Model.chambers",),
    ),
    "points": of_model(
        "observed points", lambda m: m.stations,
        "Model.stations", "Station.link", "Station.along", "Station.across", "Station.aside",
    ),
    "lengthening": Feature("a body in a plane that lengthens", lambda m: () if m.space else longer(m), LENGTHENING),
    "space_lengthening": Feature(
        "a body in space that lengthens", lambda m: longer(m) if m.space else (), LENGTHENING,
    ),
    "curved_segments": Feature(
        "axial springs that soften or stiffen",
        lambda m: tuple(f"axial spring of segment {e.name} that softens or stiffens" for e in m.extensions if e.curved),
        tuple(f"Extension.{name}" for name in CURVES),
    ),
    "tied_segments": Feature(
        "a strain that changes the bending stiffness",
        lambda m: tuple(f"bending stiffness that changes with the strain of segment {e.name}"
                        for e in m.extensions if e.stiffens_bending),
        ("Extension.stiffens_bending",),
    ),
    "axial_memory": of_model(
        "hysteresis of segments that lengthen", lambda m: m.memory.has_axial,
        *(f"Memory.{name}" for name in AXIAL_BRANCHES), name="hysteresis of segments",
    ),
    "base_motion": of_model(
        "prescribed motion of the base", lambda m: m.moving_base, "Model.moving_base", name="moving base",
    ),
    "gravity": of_model("gravity", lambda m: m.gravity.any(), "Model.gravity"),
    "softening": of_model(
        "springs that soften or stiffen", soft, "Model.stiffening", "Model.cubic_stiffening", name="softening springs",
    ),
    "bounded": of_model(
        "springs that soften within a bound", lambda m: np.logical_and(m.stiffening, m.stiffening_bound).any(),
        "Model.stiffening_bound", name="bounded softening",
    ),
    **{  # terms beyond the first two: a consumer that does not list them refuses them
        term: spring_term(term) for term in tuple(SPRING_TERMS)[2:]
    },
    "law": of_each("torque law of higher degree", curved, "Chamber.torque"),
    "own_law": of_each("torque law that is no polynomial", lambda c: c.law != POLYNOMIAL, "Chamber.law"),
    "lagging_law": of_each(
        "torque law of higher degree behind a lagging valve", lambda c: curved(c) and lag(c), "Chamber.torque",
    ),
    "dead_time": of_each("dead time", lambda c: c.valve.dead_time, "Valve.dead_time"),
    "two_lags": of_each(
        "rise and fall times that differ", lambda c: c.valve.rise_time != c.valve.fall_time,
        "Valve.rise_time", "Valve.fall_time",
    ),
    "lag": of_each(
        "first-order valve", lambda c: c.valve.rise_time or c.valve.fall_time, "Valve.rise_time", "Valve.fall_time",
    ),
    "second_order": of_each(
        "second-order valve", lambda c: c.valve.natural_frequency, "Valve.natural_frequency", "Valve.damping_ratio",
    ),
    "rates": of_each(
        "valve of limited rate", lambda c: c.valve.rise_rate or c.valve.fall_rate,
        "Valve.rise_rate", "Valve.fall_rate", name="limited rate of the valve",
    ),
    "opening": of_each("flow through the valve's opening", lambda c: c.valve.opening_time, "Valve.opening_time"),
    "settling": of_each(
        "pressure that settles late", lambda c: c.valve.settle_share, "Valve.settle_share", "Valve.settle_time",
        name="late settling of the valve",
    ),
    "dead_band": of_each("dead band of the regulator", lambda c: c.valve.dead_band, "Valve.dead_band"),
    "swelling": of_each("swelling", lambda c: c.swell_share, "Chamber.swell_share", "Chamber.swell_time"),
    "inflation": of_each(
        "inflation", lambda c: c.inflation_limit,
        "Chamber.inflation_limit", "Chamber.inflation_time", "Chamber.inflation_jm",
    ),
    "creep": Feature(
        "creep", numbered("creep branch", lambda m: len(m.memory.creep_share)),
        ("Memory.creep_share", "Memory.creep_time"),
    ),
    "slip": Feature(
        "slip elements", numbered("slip element", lambda m: len(m.memory.slip_share)),
        ("Memory.slip_share", "Memory.slip_angle"),
    ),
    "space": of_model(
        "a body in space", lambda m: m.space is not None,
        "Model.space", "Space.stiffness_ratio", "Space.rest_turn", "Space.base_tilt", "Space.radius",
    ),
    "twist": of_model(
        "joints that twist", lambda m: m.space is not None and m.space.twist_ratio, "Space.twist_ratio",
    ),
    "soft_swing": of_model(
        "springs that soften or stiffen, of a body in space", lambda m: m.space is not None and soft(m),
        "Model.stiffening", "Model.cubic_stiffening", name="springs that soften with the size of a swing",
    ),
    "space_memory": of_model(
        "hysteresis of a body in space", lambda m: m.space is not None and m.memory, "Model.memory",
        name="hysteresis in space",
    ),
    "tendons": Feature(
        "tendons", lambda m: tuple(f"tendon {c.name}" for c in m.chambers if c.signs),
        ("Tendon.driven_by", "Tendon.lever", "Tendon.taper", "Tendon.at", "Tendon.line_stiffness", "Tendon.pretension",
         "Tendon.imbalance", "Tendon.pulley", "Tendon.pair"),
    ),
    "tendon_friction": of_each(
        "friction of tendons", lambda c: getattr(c, "friction", 0.0) or getattr(c, "entry_friction", 0.0),
        "Tendon.friction", "Tendon.entry_friction", "Tendon.slip_rate", name="friction",
    ),
    "tendon_chords": of_each(
        "tendons that run straight between guides", lambda c: getattr(c, "spacing", 0.0), "Tendon.spacing",
        name="distance between guides",
    ),
    "pair_pretension": of_each(
        "pretension of pairs of tendons", lambda c: len(c.signs) == 2 and c.pretension,
        "Tendon.pretension", name="pretension",
    ),
    "boucwen": of_model(
        "Bouc-Wen", lambda m: m.memory.boucwen_share,
        *(f"Memory.boucwen_{f}" for f in ("share", "beta", "gamma", "exponent")),
    ),
}
EVERYWHERE = (  # fields that every consumer takes into account, names, and fields that contain others
    "Model.link_length", "Model.link_mass", "Model.rest_angle", "Model.mass_at", "Model.tip_mass", "Model.tip_inertia",
    "Model.base_length",
    "Model.base_angle", "Model.memory", "Model.name", "Model.source", "Chamber.name",
    "Chamber.valve", "Extension.name", "Station.name",
)
KNOWN = frozenset(EVERYWHERE).union(*(feature.fields for feature in FEATURES.values()))
LATER_TERMS = frozenset(tuple(SPRING_TERMS)[2:])  # later terms of the springs, see `SPRING_TERMS`

SPRINGS = LATER_TERMS | {"springs", "gravity", "points", "softening", "bounded"}
LAWS = frozenset({"drive", "chambers", "law", "own_law", "lagging_law"})
WALLS = frozenset({"swelling", "inflation"})
FIRST_ORDER = frozenset({"lag", "two_lags", "rates"})
VALVES = FIRST_ORDER | {"dead_time", "second_order", "opening", "settling", "dead_band"}
HYSTERESIS = frozenset({"creep", "slip", "boucwen"})
LENGTHENS = frozenset({"lengthening", "curved_segments", "tied_segments", "axial_memory"})
IN_SPACE = frozenset({"space", "twist", "soft_swing", "space_memory", "space_lengthening"})
TENDONS = frozenset({"tendons", "tendon_friction", "tendon_chords", "pair_pretension"})
MOVING = frozenset({"base_motion"})
RESTING = SPRINGS | LAWS | WALLS | VALVES | HYSTERESIS | LENGTHENS | IN_SPACE | TENDONS  # of a body with a base at rest
ALL = RESTING | MOVING  # what `simulate` computes
REMEDY = {"base_motion": "use simulate or a fit, or set moving_base to false for a body whose base rests"}


@dataclass(frozen=True)
class Consumer:
    """A function or class that computes with models, with the features of models that it takes into account.

    Attributes
    ----------
    name : str
        Name in messages, such as "linearise".
    can : frozenset of str
        Keys of `FEATURES` that it takes into account. Every other feature is refused.
    by_nature : dict
        Keys of features that have no part in what it computes, or enter in a simplified form, each with the reason.
        Its documentation states the same. They are not refused.
    remedy : dict
        What to do about a feature that is refused, by key; default: see `refusal`.
    """

    name: str
    can: frozenset[str]
    by_nature: Mapping[str, str] = field(default_factory=dict)
    remedy: Mapping[str, str] = field(default_factory=dict)

    def lacks(self, model: Model) -> tuple[str, ...]:
        """Return the keys of the features of a model that this consumer refuses."""
        return tuple(key for key in missing(model, self.can) if key not in self.by_nature)

    def check(self, model: Model) -> None:
        """Raise InputError, which names the features and says what to do, if the model has features that this consumer
        does not take into account.
        """
        if not isinstance(model, Model):
            raise InputError(f"{self.name} needs a Model, got {model!r:.80}: read the file of a model with load_model")
        if keys := self.lacks(model):
            raise InputError(self.refusal(model, keys))

    def refusal(self, model: Model, keys: tuple[str, ...]) -> str:
        """Return the message for the features `keys` of a model that this consumer refuses."""
        parts = ", ".join(with_field(key, model) for key in keys)
        advice = dict.fromkeys(self.remedy.get(key) or REMEDY.get(key, "use simulate, or a model without it")
                               for key in keys)  # fmt: skip
        return f"{self.name} does not support {parts}, which model {model.name!r} has: {'; '.join(advice)}"


def with_field(key: str, model: Model) -> str:
    """Return the names of a model's parts with the feature `key`, followed by the field that describes it, such as
    "late settling of the valve (settle_share)".
    """
    owner, _, name = FEATURES[key].fields[0].partition(".")
    parts = listed(named(model, (key,)))
    return f"{parts} ({name})" if owner in ("Valve", "Chamber", "Memory") or name == "moving_base" else parts


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
            f"{', '.join(strange)}: unknown to the consumers of models, which would lose it: add this field to a "
            "feature of pliant.model.features, or leave it at its default"
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
    shared = isinstance(part, ActuationInput) and name in SHARED
    return f"{'Chamber' if shared else type(part).__name__}.{name}"


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


