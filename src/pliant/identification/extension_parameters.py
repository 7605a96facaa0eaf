"""The parameters of segments that lengthen, of all of them or, as ``segment.name``, of one; where their fit begins."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from pliant.errors import InputError
from pliant.identification.chamber_parameters import owners, prefixes
from pliant.model import Extension, Model
from pliant.numerics.arcs import arc_lengths

if TYPE_CHECKING:
    from pliant.identification.experiment import Experiment

# name: (unit, lower, upper, scale, meaning)
ROWS: dict[str, tuple[str, float, float, float, str]] = {
    "axial_stiffness": ("N", 1e-6, np.inf, 0.0, "EA of a segment that lengthens, force per strain"),
    "axial_damping": ("N s", 0.0, np.inf, 0.0, "force per rate of strain of a segment that lengthens"),
    "axial_gain": ("1/m", -1e5, 1e5, 0.0, "axial force of a chamber in parts of its torque; 1 / offset by geometry"),
}
OWN = {"axial_stiffness": "stiffness", "axial_damping": "damping"}
FAR = 0.9  # of the travel: frames that count as bent


def segments(model: Model) -> tuple[str, ...]:
    """Names that open the parameters of one segment."""
    return tuple(e.name for e in model.extensions)


def changed_extensions(model: Model, values: Mapping[str, float]) -> tuple[Extension, ...]:
    """The segments with `values` put in: those for all of them, overruled by a segment's own."""
    made = []
    for e in model.extensions:
        own: dict[str, Any] = {field: values[name] for name, field in OWN.items() if name in values}
        own |= {field: values[f"{e.name}.{name}"] for name, field in OWN.items() if f"{e.name}.{name}" in values}
        made.append(replace(e, **own) if own else e)
    return tuple(made)


def check_segment_names(names: Iterable[str], model: Model, others: set[str]) -> None:
    """Refuse parameters of segments that nobody has, and a segment named like a recording, station or chamber."""
    mine = segments(model)
    if both := set(mine) & (others | set(owners(model))):
        raise InputError(
            f"{min(both)!r} names a segment and a recording, station or chamber: rename one, their parameters would be "
            "mixed"
        )
    for name in names:
        owner, dot, own = name.partition(".")
        if (own if dot else owner) in ROWS and not mine:
            raise InputError(
                f"parameter {name}: nothing of the model lengthens; give it extensions (in a study: "
                "[[actuator.extensions]])"
            )
        if dot and owner in mine and own not in OWN:
            raise InputError(f"parameter {name}: {owner!r} is a segment, which has {', '.join(OWN)}")


def extension_starts(model: Model, experiments: Sequence[Experiment], torques: Mapping[str, float]) -> dict[str, float]:
    """The segments' own numbers, and axial gains at which the largest torques lengthen the body as it was seen to.

    `torques` holds coefficients of the chambers' laws where these begin.
    """
    if not model.extensions:
        return {}
    found = {name: float(np.mean([getattr(e, f) for e in model.extensions])) for name, f in OWN.items()}
    found |= {f"{e.name}.{name}": getattr(e, f) for e in model.extensions for name, f in OWN.items()}
    strain, force = max([grown(e) for e in experiments], default=0.0), found["axial_stiffness"]
    for start, chamber in zip(prefixes(model), model.chambers, strict=True):
        law = {int(n[-1]): v for n, v in torques.items() if n.removeprefix(start).removesuffix(n[-1]) == "torque_"}
        level = max([float(t.pressure.max()) for e in experiments for t in pressures(e, chamber.name)], default=0.0)
        torque = sum(v * level**k for k, v in law.items()) or float(chamber.torque_at(level))
        found[f"{start}axial_gain"] = strain * force / torque if torque > 0 else 0.0
    return {"axial_gain": float(np.mean([found[f"{s}axial_gain"] for s in prefixes(model)]))} | found


def pressures(exp: Experiment, chamber: str) -> list[Any]:
    """The measured pressures that drive a chamber in an experiment."""
    if exp.drives:
        return [exp.drives[chamber]] if chamber in exp.drives else []
    return [] if exp.pressure is None else [exp.pressure]


def grown(exp: Experiment) -> float:
    """Strain of the body where its last station is displaced most, by arcs through its stations; never negative."""
    seen = np.isfinite(exp.position).all(axis=(1, 2))
    length, tip = arc_lengths(exp.position[seen]), exp.last_station[seen]
    if length.size < 10:
        return 0.0
    moved = np.linalg.norm(tip - np.median(tip[:5], axis=0), axis=1)
    return max(float(np.median(length[moved > FAR * moved.max()]) / np.median(length[:5]) - 1.0), 0.0)
