"""Fit parameters of chambers and tendons: ``name`` applies to all chambers, ``chamber.name`` to one."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any, Protocol

import numpy as np

from pliant.equations.laws import POLYNOMIAL
from pliant.errors import InputError
from pliant.identification.names import INPUT_MEANS, LAW, declarations, families, find_path, path_of, paths
from pliant.model import ActuationInput, Chamber, Model
from pliant.model.parts import CHAMBER, TENDON, VALVE, fitted
from pliant.model.torque_law import laid_torque, law_parameters, torque_laws

Array = np.ndarray
GAINS = ("gain", "gain_x", "gain_y", "joint_gain", "cross_gain")
OF_ONE_SIGN = ("axial_gain",)  # pressure lengthens
ALIKE_GAINS = (("gain_x", "gain_y"), OF_ONE_SIGN, ("torque_1",))  # of inputs, by kind: of one size in a body
OF_CHAMBERS = (CHAMBER, TENDON, VALVE, INPUT_MEANS, LAW)
OWN = tuple(name for name, row in declarations().items() if row.part in OF_CHAMBERS)


class Named(Protocol):
    """Interface of a fit parameter: its name, its value, and whether it is free."""

    @property
    def name(self) -> str: ...
    @property
    def value(self) -> float | None: ...
    @property
    def free(self) -> bool: ...


def owners(model: Model) -> tuple[str, ...]:
    """Return the names of the chambers, as used before the dot of a parameter name; () for one
    chamber without a name.
    """
    names = tuple(c.name for c in model.chambers)
    return () if names == (Chamber.name,) else names


def prefixes(model: Model) -> tuple[str, ...]:
    """Return the prefix of each chamber's parameter names, such as "left."; "" for a model with one unnamed chamber."""
    return tuple(f"{name}." for name in owners(model)) or ("",)


def changed_chambers(
    model: Model, values: Mapping[str, float], cache: dict[Any, ActuationInput],
) -> tuple[ActuationInput, ...]:
    """Return the model's chambers with the parameter `values` applied. ``chamber.name`` overrides ``name``.

    In a model of several chambers, a gain applies only with its chamber's name. Chambers are kept in `cache`, and taken
    from there where the same values were applied before.
    """
    named, changed = owners(model), []
    shared = {k: v for k, v in values.items() if "." not in k and of_chamber(k)}
    if model.actuation.count > 1:
        shared = {k: v for k, v in shared.items() if not is_gain(k)}
    stated: dict[str, dict[str, float]] = {name: {} for name in named}
    for name, value in values.items() if named else ():
        owner, _, parameter = name.partition(".")
        if owner in stated and parameter:
            stated[owner][parameter] = value
    for chamber in model.chambers:
        chamber_values = {**shared, **stated.get(chamber.name, {})}
        key = (chamber.name, *chamber_values.items())
        if key not in cache:
            for name in stated.get(chamber.name, ()):
                check_effect(f"{chamber.name}.{name}", name, [chamber])
            changes = chamber_changes(chamber, chamber_values)
            cache[key] = replace(chamber, **changes) if changes else chamber
        changed.append(cache[key])
    return tuple(changed)


def chamber_changes(chamber: ActuationInput, values: Mapping[str, float]) -> dict[str, Any]:
    """Return a chamber's changed fields under the parameter `values`, as a dict for `dataclasses.replace`."""
    changes: dict[str, Any] = {}
    moved, powers = {}, {}
    for name, path in paths(values, CHAMBER, TENDON, VALVE):
        if path.owner or not has_effect(path.own, chamber):
            continue
        if path.part is VALVE:
            moved[path.field] = values[name]
        elif path.quantity.per == "power":
            powers[path.number] = values[name]
        elif not path.quantity.per:
            changes[path.field] = values[name]
    if "axial_gain" in values and has_effect("axial_gain", chamber):
        pushed = chamber.axial_gain != 0
        changes["axial_gain"] = np.where(pushed if pushed.any() else True, values["axial_gain"], 0.0)
    changes |= changed_gains(chamber, values)
    if powers:
        law = np.zeros(max([chamber.torque.size, *powers]))
        law[: chamber.torque.size] = chamber.torque if chamber.law == POLYNOMIAL else 0.0
        for k, value in powers.items():
            law[k - 1] = value
        changes |= {"law": POLYNOMIAL, "torque": law}
    changes |= {} if chamber.signs else laid_torque(values)
    if moved:
        changes["valve"] = replace(chamber.valve, **moved)
    return changes


def changed_gains(chamber: ActuationInput, values: Mapping[str, float]) -> dict[str, Array]:
    """Return a chamber's changed gains at its n joints, as a dict of arrays (n,) by field name; {} if none changes. A
    parameter in `values` sets the gain of a single joint, or scales all gains to a given mean.
    """
    changes: dict[str, Array] = {}
    for name, path in paths(values, CHAMBER):
        if path.of_one_joint and not path.owner:
            gains = np.broadcast_to(getattr(chamber, path.field), chamber.joint_gain.shape)
            changes.setdefault(path.field, np.array(gains))[path.number - 1] = values[name]
    if "gain_x" in values or "gain_y" in values:
        changes |= turned_gains(chamber, values)
    if "gain" in values:
        mean = float(chamber.joint_gain.mean())
        if mean == 0:
            raise InputError("the parameter gain scales the joints' gains, but their mean is 0: "
                             "change joint_gain of the model, or leave gain out")  # fmt: skip
        changes["joint_gain"] = chamber.joint_gain * (values["gain"] / mean)
    return changes


def turned_gains(chamber: ActuationInput, values: Mapping[str, float]) -> dict[str, Array]:
    """Return a chamber's gains at n joints about both bending axes, as a dict of arrays (n,) by field name. They are
    scaled so that their means are ``gain_x`` and ``gain_y``.

    The means are over the joints that the chamber turns. The ratio of the lever between joints stays as it is.
    """
    lever = np.hypot(chamber.joint_gain, chamber.cross_gain)
    turned = lever > 0
    if not turned.any():
        raise InputError(f"gain_x and gain_y scale the gains of {chamber.name!r}, but all of these are 0: "
                         "give the chamber a joint_gain or cross_gain")  # fmt: skip
    lever = lever / lever[turned].mean()
    gains = {"joint_gain": chamber.joint_gain, "cross_gain": np.broadcast_to(chamber.cross_gain, lever.shape)}
    return {
        field: lever * values.get(name, float(np.mean(gain[turned] / lever[turned])))
        for (field, gain), name in zip(gains.items(), ("gain_x", "gain_y"), strict=True)
    }


def check_chamber_names(names: Iterable[str], model: Model, others: set[str]) -> None:
    """Raise InputError for a parameter that no chamber has or that changes nothing, for a gain without a chamber's name
    in a model of several chambers, or for a chamber named like a recording or station.
    """
    mine = owners(model)
    if both := set(mine) & others:
        raise InputError(
            f"{min(both)!r} names a chamber and a recording or station, so that the owner of its parameters is not "
            "clear: rename one of the two"
        )
    several = model.actuation.count > 1
    for name in names:
        owner, dot, parameter = name.partition(".")
        if dot and owner in mine and not of_chamber(parameter):
            known = [family for family in families() if of_chamber(family.partition("_<")[0])]
            raise InputError(
                f"parameter {name}: {owner!r} is a chamber, and no chamber has a parameter {parameter!r}. Use "
                f"{', '.join(known)}"
            )
        meant = [model.chambers[mine.index(owner)]] if dot and owner in mine else model.chambers
        check_effect(name, parameter if dot else name, meant)
        if several and is_gain(parameter if dot and owner not in mine else name):
            raise InputError(
                f"parameter {name}: in a model of several chambers, name the chamber of a gain, such as "
                f"{mine[0]}.{parameter or name}; the chambers are {', '.join(mine)}"
            )


def check_effect(name: str, own: str, chambers: Sequence[ActuationInput]) -> None:
    """Raise InputError if a parameter, called `own` without the name of its owner, belongs to the law of a chamber or
    tendon, but has no effect on any of `chambers`. `name` is its full name.
    """
    if not of_chamber(own) or any(has_effect(own, c) for c in chambers):
        return
    who = " and ".join(f"{c.name!r}, a {c.noun} driven by its {c.kind}"
                       for c in chambers)  # fmt: skip
    known = [n for n in (*fitted(TENDON), "torque_<k>") if any(has_effect(n.replace("<k>", "1"), c) for c in chambers)]
    raise InputError(f"parameter {name}: {own} has no effect on {who}: use {', '.join(known)}")


def has_effect(own: str, chamber: ActuationInput) -> bool:
    """Return whether a parameter changes the law of a pressure chamber or of a tendon."""
    path = path_of(own)
    if path.part is VALVE or path.stem in GAINS:
        return True
    return chamber.uses(path.field) if path.part in (CHAMBER, TENDON) else not chamber.signs


def of_chamber(own: str) -> bool:
    """Return whether the parameter `own`, named with or without its number, is that of a chamber or tendon."""
    path = find_path(own)
    return own in OWN or own in law_parameters() or (path is not None and path.part in OF_CHAMBERS)


def is_gain(name: str) -> bool:
    """Return whether a parameter, named without its chamber, is a gain at one joint or a mean of the gains."""
    path = find_path(name)
    return path is not None and not path.owner and path.stem in GAINS


def held_gains(parameters: Iterable[Named], model: Model) -> tuple[str, ...]:
    """Return the name prefixes of the chambers whose joint gains and torque law are all free. Recordings determine only
    their product, so that a fit must hold the mean gain of such a chamber.
    """
    listed = {p.name: p for p in parameters}
    several = model.actuation.count > 1
    pairs = zip(prefixes(model), model.chambers, strict=True)
    return tuple(start for start, chamber in pairs if shares_scale(listed, chamber, start, several=several))


def shares_scale(listed: Mapping[str, Named], chamber: ActuationInput, start: str, *, several: bool) -> bool:
    """Return whether a chamber's joint gains and its torque law's scale are all free, so that only their product is
    determined.
    """

    def own(name: str) -> Named | None:
        return listed.get(start + name) or (None if name.startswith("joint_gain") and several else listed.get(name))

    names = [f"joint_gain_{i + 1}" for i in range(chamber.joint_gain.size)]
    gains = [own(n) for n, g in zip(names, chamber.joint_gain, strict=True) if g or start + n in listed]
    if not gains or not all(p and (p.free or not p.value) for p in gains) or not any(p and p.free for p in gains):
        return False
    if laws := [law for law in torque_laws() if own(law.scaling())]:
        return any((p := own(law.scaling())) and p.free for law in laws)
    powers = {f"torque_{k + 1}" for k in np.flatnonzero(chamber.torque)}
    powers |= {name for k in range(1, 10) if own(name := f"torque_{k}")}
    law = [own(name) for name in powers]
    return any(p and p.free for p in law) and all(p and (p.free or not p.value) for p in law)
