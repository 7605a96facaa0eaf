"""The model with which a search begins: stiffness, damping and a torque proportional to each input."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from pliant.identification.chamber_parameters import has_effect, prefixes
from pliant.identification.experiment import Experiment
from pliant.identification.parameters import Parameter, shared_name
from pliant.mechanics import mechanics_of
from pliant.model import Model, Tendon
from pliant.selection.determined import DETERMINED
from pliant.selection.fitted import FitSetting, FittedModel, fitted

Entry = Parameter | str


def beginning(model: Model, train: Sequence[Experiment], common: Sequence[Entry]) -> list[Entry]:
    """Return the parameters with which a search begins: those in `common`, and unless these replace them stiffness,
    damping and a torque proportional to each input; of a body that lengthens also axial damping and the axial force of
    each chamber. Its axial stiffness is stated: only the ratio of the forces to it shows.
    """
    stated = {e if isinstance(e, str) else e.name for e in common}
    kinds = {shared_name(name.removesuffix("_*")) for name in stated}
    names = [n for n in ("stiffness", "damping") if n not in kinds and "body_stiffness" not in kinds]
    if any(e.excitation != "release" for e in train):
        names += [n for n in torque_names(model) if n not in stated]
    if mechanics_of(model).lengthens and not isinstance(model.chambers[0], Tendon):
        names += [n for n in ("axial_damping",) if n not in kinds]
        names += [f"{start}axial_gain" for start, chamber in zip(prefixes(model), model.chambers, strict=True)
                  if not isinstance(chamber, Tendon) and f"{start}axial_gain" not in stated]  # fmt: skip
    return [*common, *names]


def torque_names(model: Model) -> list[str]:
    """Return the names of the parameters that scale the torque of each input: gains in space, coefficients in a plane.

    A chamber in the plane that has a torque law other than a linear one keeps it.
    """
    names = []
    for start, chamber in zip(prefixes(model), model.chambers, strict=True):
        if model.space is not None:
            names += [f"{start}gain_{axis}" for axis in "xy"] if start else []
        elif has_effect("torque_1", chamber) and not chamber.torque.any():
            names.append(f"{start}torque_1")
    return names


def anchored(parent: FittedModel, setting: FitSetting) -> FittedModel:
    """Return a fit of the first model in which the stiffness is held, if the recordings do not determine it.

    Stiffness, damping and torque then have a common scale that no recording of this body shows, and the other
    parameters are determined relative to the stiffness.
    """
    error, value = parent.standard_errors.get("stiffness", 0.0), parent.values.get("stiffness", 0.0)
    if error is not None and error <= DETERMINED * value:
        return parent
    why = f"held: the recordings show only {value:.3g}" + ("" if error is None else f" +- {error:.2g}")
    held = [replace(p, free=False, source=why) if p.name == "stiffness" else p for p in parent.parameters]
    return fitted(setting, parent.model, held)
