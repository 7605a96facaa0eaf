"""Fit parameters of chambers and tendons: ``name`` applies to all chambers, ``chamber.name`` to one."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from functools import lru_cache
from typing import Any, Protocol

import numpy as np

from pliant.equations.laws import POLYNOMIAL
from pliant.errors import InputError
from pliant.model import Chamber, Model, Tendon
from pliant.model.chamber import RUBBER
from pliant.model.torque_law import laid_torque, law_parameters, torque_laws

Array = np.ndarray
VALVE = {
    "valve_rise": "rise_time", "valve_fall": "fall_time", "valve_dead_time": "dead_time",
    "valve_rise_rate": "rise_rate", "valve_fall_rate": "fall_rate",
    "valve_dead_band": "dead_band", "valve_settle_share": "settle_share", "valve_settle_time": "settle_time",
    "valve_opening_time": "opening_time",
}  # fmt: skip
GAINS = r"gain|gain_[xy]|(joint|cross)_gain_(\d+|\*)"
TENDON = ("lever", "taper", "line_stiffness", "pretension", "imbalance", "pulley", "friction")
OWN = re.compile(rf"torque_[1-9]|axial_gain|{GAINS}|{'|'.join((*VALVE, *RUBBER, *TENDON))}")


@lru_cache(4096)
def matching(pattern: str, names: tuple[str, ...]) -> tuple[str, ...]:
    """Return those of `names` that match the regular expression `pattern` in full. The result is cached."""
    return tuple(name for name in names if re.fullmatch(pattern, name))


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


def changed_chambers(model: Model, values: Mapping[str, float]) -> tuple[Chamber, ...]:
    """Return the model's chambers with the parameter `values` applied. ``chamber.name`` overrides ``name``.

    In a model of several chambers, a gain applies only with its chamber's name.
    """
    named, changed = owners(model), []
    shared = values
    if model.actuation.count > 1:
        gains = matching(GAINS, tuple(values))
        shared = {k: v for k, v in values.items() if k not in gains}
    for chamber in model.chambers:
        own = shared
        if named:
            start = f"{chamber.name}."
            own = {**shared, **{k.removeprefix(start): v for k, v in values.items() if k.startswith(start)}}
        changes = chamber_changes(chamber, own)
        changed.append(replace(chamber, **changes) if changes else chamber)
    return tuple(changed)


def chamber_changes(chamber: Chamber, values: Mapping[str, float]) -> dict[str, Any]:
    """Return a chamber's changed fields under the parameter `values`, as a dict for `dataclasses.replace`."""
    changes: dict[str, Any] = {k: values[k] for k in RUBBER if k in values}
    names = tuple(values)
    if "axial_gain" in values and not isinstance(chamber, Tendon):
        pushed = chamber.axial_gain != 0
        changes["axial_gain"] = np.where(pushed if pushed.any() else True, values["axial_gain"], 0.0)
    changes |= changed_gains(chamber, values) | tendon_changes(chamber, values)
    if powers := {int(k[-1]): values[k] for k in matching("torque_[1-9]", names)}:
        law = np.zeros(max([chamber.torque.size, *powers]))
        law[: chamber.torque.size] = chamber.torque if chamber.law == POLYNOMIAL else 0.0
        for k, value in powers.items():
            law[k - 1] = value
        changes |= {"law": POLYNOMIAL, "torque": law}
    changes |= laid_torque(values)
    if moved := {field: values[name] for name, field in VALVE.items() if name in values}:
        changes["valve"] = replace(chamber.valve, **moved)
    return changes


def tendon_changes(chamber: Chamber, values: Mapping[str, float]) -> dict[str, float]:
    """Return a tendon's changed fields under the parameter `values`, as a dict; {} for a pressure chamber."""
    return {name: values[name] for name in TENDON if name in values} if isinstance(chamber, Tendon) else {}


def changed_gains(chamber: Chamber, values: Mapping[str, float]) -> dict[str, Array]:
    """Return a chamber's changed gains at its n joints, as a dict of arrays (n,) by field name; {} if none changes. A
    parameter in `values` sets the gain of a single joint, or scales all gains to a given mean.
    """
    changes: dict[str, Array] = {}
    for field in ("joint_gain", "cross_gain"):
        if joint := {int(k.rpartition("_")[2]): values[k] for k in matching(rf"{field}_\d+", tuple(values))}:
            changes[field] = np.array(np.broadcast_to(getattr(chamber, field), chamber.joint_gain.shape))
            for i, value in joint.items():
                changes[field][i - 1] = value
    if "gain_x" in values or "gain_y" in values:
        changes |= turned_gains(chamber, values)
    if "gain" in values:
        mean = float(chamber.joint_gain.mean())
        if mean == 0:
            raise InputError("the parameter gain scales the joints' gains, but their mean is 0: "
                             "change joint_gain of the model, or leave gain out")  # fmt: skip
        changes["joint_gain"] = chamber.joint_gain * (values["gain"] / mean)
    return changes


def turned_gains(chamber: Chamber, values: Mapping[str, float]) -> dict[str, Array]:
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
        owner, dot, own = name.partition(".")
        if dot and owner in mine and not (OWN.fullmatch(own) or own in law_parameters()):
            raise InputError(
                f"parameter {name}: {owner!r} is a chamber, and no chamber has a parameter {own!r}. Use torque_<k>, "
                f"gain, joint_gain_<i>, axial_gain, {', '.join((*VALVE, *RUBBER, *law_parameters()))}"
            )
        meant = [model.chambers[mine.index(owner)]] if dot and owner in mine else model.chambers
        check_effect(name, own if dot else name, meant)
        if several and re.fullmatch(GAINS, own if dot and owner not in mine else name):
            raise InputError(
                f"parameter {name}: in a model of several chambers, name the chamber of a gain, such as "
                f"{mine[0]}.{own or name}; the chambers are {', '.join(mine)}"
            )


def check_effect(name: str, own: str, chambers: Sequence[Chamber]) -> None:
    """Raise InputError if a parameter, called `own` without the name of its owner, belongs to the law of a chamber or
    tendon, but has no effect on any of `chambers`. `name` is its full name.
    """
    if not (OWN.fullmatch(own) or own in law_parameters()) or any(has_effect(own, c) for c in chambers):
        return
    who = " and ".join(f"{c.name!r}, a {'tendon' if isinstance(c, Tendon) else 'chamber'} driven by its {c.kind}"
                       for c in chambers)  # fmt: skip
    known = [n for n in (*TENDON, "torque_<k>") if any(has_effect(n.replace("<k>", "1"), c) for c in chambers)]
    raise InputError(f"parameter {name}: {own} has no effect on {who}: use {', '.join(known)}")


def has_effect(own: str, chamber: Chamber) -> bool:
    """Return whether a parameter changes the law of a pressure chamber or of a tendon."""
    if not isinstance(chamber, Tendon):
        return own not in TENDON
    if own in TENDON:
        elastic = chamber.elastic or own not in ("line_stiffness", "pretension", "imbalance", "pulley")
        return elastic and (own != "pulley" or chamber.driven_by == "angle") and (own != "imbalance" or chamber.pair)
    return bool(re.fullmatch(GAINS, own)) or own in VALVE


def held_gains(parameters: Iterable[Named], model: Model) -> tuple[str, ...]:
    """Return the name prefixes of the chambers whose joint gains and torque law are all free. Recordings determine only
    their product, so that a fit must hold the mean gain of such a chamber.
    """
    listed = {p.name: p for p in parameters}
    several = model.actuation.count > 1
    pairs = zip(prefixes(model), model.chambers, strict=True)
    return tuple(start for start, chamber in pairs if shares_scale(listed, chamber, start, several=several))


def shares_scale(listed: Mapping[str, Named], chamber: Chamber, start: str, *, several: bool) -> bool:
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
