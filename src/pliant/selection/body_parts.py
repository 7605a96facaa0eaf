"""Parts of a body that a term gives values of their own: segments between the ends of tendons, places of markers, and
tensions of tendons.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pliant.errors import InputError
from pliant.identification.chamber_parameters import prefixes
from pliant.identification.experiment import Experiment
from pliant.identification.parameters import Parameter
from pliant.mechanics import mechanics_of
from pliant.model import Extension, Model
from pliant.model.parts import STATION, fitted

Array = np.ndarray
NEAR = 0.02  # of the length: standard deviation of a marker's place about that of the first frames
APART = 0.05  # of the length: ends of tendons closer than this are one
DAMPED = 0.03  # s, damping of a segment over its stiffness


def tendon_ends(model: Model) -> list[float]:
    """Return the different places [m from the base] at which the tendons of a body of equal segments end."""
    ends: list[float] = []
    for tendon in (c for c in model.chambers if c.signs):
        lever = np.broadcast_to(np.hypot(tendon.joint_gain, tendon.cross_gain), (model.n,))
        passed = float((lever / max(lever.max(), 1e-300)).sum()) / model.n
        if all(abs(passed * model.length - end) > APART * model.length for end in ends):
            ends.append(passed * model.length)
    return sorted(end for end in ends if end > APART * model.length)


def segments_of_tendons(model: Model) -> tuple[Extension, ...]:
    """Return a segment up to each end of a tendon, which its tension shortens, with the stiffness of a round body whose
    radius is the distance of the tendons from the axis; () for a body without tendons or with too few links.
    """
    levers = [float(c.value_of("lever")) for c in model.chambers if c.signs]
    ends = tendon_ends(model)
    if not levers or not ends:
        return ()
    axial = 4.0 * float(model.stiffness.mean() * model.length) / model.n / float(np.mean(levers)) ** 2
    stops = [*(end for end in ends if end < (1.0 - APART) * model.length), None]
    starts = [0.0, *(stop for stop in stops if stop is not None)]
    segments = tuple(Extension(axial, DAMPED * axial, a, b, f"segment_{k + 1}")
                     for k, (a, b) in enumerate(zip(starts, stops, strict=True)))  # fmt: skip
    try:
        model.with_(extensions=segments)
    except InputError:  # too few links
        return ()
    return segments


def other_markers(model: Model, experiments: Sequence[Experiment]) -> list[Parameter]:
    """Return the places of all markers but the last of each recording, near those of the model, as far as it has them
    already.
    """
    tracked = [e for e in experiments if not e.without_positions]
    last = {e.stations[-1] for e in tracked}
    names = dict.fromkeys(n for e in tracked for n in e.stations if n not in last)
    stations = {p.name: p for p in model.stations}
    axes = list(fitted(STATION))[: mechanics_of(model).dimension]
    return [near(f"{n}.{axis}", float(getattr(stations[n], axis)) if n in stations else 0.0, model)
            for n in names for axis in axes]  # fmt: skip


def near(name: str, value: float, model: Model) -> Parameter:
    """Return a place [m] with a prior near its value."""
    return Parameter(name, value, prior=value, prior_std=NEAR * model.length)


def tensions(model: Model, driven: Sequence[Experiment]) -> dict[str, list[Parameter]]:
    """Return the pretensions, and the stiffnesses, of all tendons that a displacement or an angle drives, by the name
    of their term. Their priors are as wide as the tension that the highest input would cause in a body that does not
    move, and as the stiffness: the common scale of tensions and springs stays.
    """
    rows: dict[str, list[Parameter]] = {}
    for start, tendon in zip(prefixes(model), model.chambers, strict=True):
        peak = max((abs(t.peak) for e in driven if (t := e.driving(tendon.name)) is not None), default=0.0)
        if tendon.uses("pretension") and peak > 0.0:
            sizes = {"pretension": float(tendon.torque[0]) * peak, "line_stiffness": tendon.value_of("line_stiffness")}
            for name, (field, size) in zip(("pretension", "line"), sizes.items(), strict=True):
                value = float(tendon.value_of(field))
                rows.setdefault(name, []).append(Parameter(f"{start}{field}", value, prior=value, prior_std=size))
    return rows
