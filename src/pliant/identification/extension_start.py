"""Start values for the parameters of extensible segments."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from pliant.identification.chamber_parameters import prefixes
from pliant.identification.experiment import Experiment
from pliant.identification.extension_parameters import ALWAYS
from pliant.mechanics import mechanics_of
from pliant.model import Model
from pliant.numerics.curve import arc_lengths

FAR = 0.9  # of the peak displacement: frames beyond count as bent


def extension_starts(model: Model, experiments: Sequence[Experiment], torques: Mapping[str, float]) -> dict[str, float]:
    """Return start values, by name, of the extensible segments' parameters. Axial gains come from the measured strain.

    Each axial gain makes the largest torque lengthen the body as measured. `torques` holds the start coefficients of
    the chambers' torque laws.
    """
    if not mechanics_of(model).lengthens:
        return {}
    found = {name: float(np.mean([getattr(e, f) for e in model.extensions])) for name, f in ALWAYS.items()}
    found |= {f"{e.name}.{name}": getattr(e, f) for e in model.extensions for name, f in ALWAYS.items()}
    strain, force = max([grown(e) for e in experiments], default=0.0), found["axial_stiffness"]
    for start, chamber in zip(prefixes(model), model.chambers, strict=True):
        law = {int(n[-1]): v for n, v in torques.items() if n.removeprefix(start).removesuffix(n[-1]) == "torque_"}
        seen = [t for e in experiments if (t := e.driving(chamber.name))]
        level = max([t.peak for t in seen], key=abs, default=0.0)
        torque = sum(v * level**k for k, v in law.items()) or float(chamber.torque_at(level))
        found[f"{start}axial_gain"] = strain * force / torque if torque > 0 else 0.0
    return {"axial_gain": float(np.mean([found[f"{s}axial_gain"] for s in prefixes(model)]))} | found


def grown(exp: Experiment) -> float:
    """Return the axial strain of the body at its peak displacement, from arcs through its stations; at least 0."""
    seen = np.isfinite(exp.position).all(axis=(1, 2))
    length, tip = arc_lengths(exp.position[seen]), exp.last_station[seen]
    if length.size < 10:
        return 0.0
    moved = np.linalg.norm(tip - np.median(tip[:5], axis=0), axis=1)
    return max(float(np.median(length[moved > FAR * moved.max()]) / np.median(length[:5]) - 1.0), 0.0)
