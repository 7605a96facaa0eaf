"""Memory, swelling and the valve's limits as parameters: names, bounds, where a fit begins, the way into the model."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from pliant.errors import InputError
from pliant.identification.chamber_parameters import matching
from pliant.model import Model
from pliant.model.memory import Payne, Springpot, payne, springpot
from pliant.model.spring import SPRING_BOUND, SPRING_TERMS, in_words

# name: (unit, lower, upper, scale, meaning)
ROWS: dict[str, tuple[str, float, float, float, str]] = {
    r"creep_share_[1-9]": ("1", 0.0, 50.0, 0.1, "stiffness of a creep branch in parts of each joint's"),
    r"creep_time_[1-9]": ("s", 1e-3, 1e4, 0.0, "relaxation time of a creep branch"),
    r"slip_share_[1-9]": ("1", 0.0, 50.0, 0.1, "stiffness of a slip element in parts of each joint's"),
    r"slip_angle_[1-9]": ("rad", 1e-6, 10.0, 0.0, "joint turn at which a slip element slips"),
    r"axial_creep_share_[1-9]": ("1", 0.0, 50.0, 0.1, "stiffness of an axial creep branch in parts of EA"),
    r"axial_creep_time_[1-9]": ("s", 1e-3, 1e4, 0.0, "relaxation time of an axial creep branch"),
    r"axial_slip_share_[1-9]": ("1", 0.0, 50.0, 0.1, "stiffness of an axial slip element in parts of EA"),
    r"axial_slip_strain_[1-9]": ("1", 1e-6, 10.0, 0.0, "strain at which an axial slip element slips"),
    "fractional_share": ("1", 0.0, 10.0, 0.02, "size of the springpot at 1 rad/s in parts of each joint's stiffness"),
    "fractional_order": ("1", 0.02, 0.9, 0.1, "order of the springpot: 0 a spring, 1 a dashpot"),
    "fractional_low": ("Hz", 1e-6, 1e6, 0.0, "slow end of the band in which the springpot holds, never free"),
    "fractional_high": ("Hz", 1e-6, 1e6, 0.0, "its fast end"),
    "payne_share": ("1", 0.0, 1e4, 0.5, "what small swings are stiffer by than large ones, in parts of each joint's"),
    "payne_angle": ("rad", 1e-6, 10.0, 0.0, "amplitude of a joint's swings at which half of it is left"),
    "payne_exponent": ("1", 0.05, 0.5, 0.1, "Kraus' m: how fast it is lost as swings grow, at most 0.5"),
    "payne_low": ("rad", 1e-6, 10.0, 0.0, "small end of the amplitudes in which Payne's curve holds, never free"),
    "payne_high": ("rad", 1e-6, 10.0, 0.0, "its large end"),
    "boucwen_share": ("1", 1e-9, 50.0, 0.1, "stiffness of the Bouc-Wen branch in parts of each joint's"),
    "boucwen_beta": ("1/rad^n", 1e-6, 1e8, 0.0, "Bouc-Wen beta"),
    "boucwen_gamma": ("1/rad^n", -1e8, 1e8, 10.0, "Bouc-Wen gamma, at most beta in size"),
    "boucwen_exponent": ("1", 1.0, 10.0, 1.0, "Bouc-Wen exponent n"),
    **{
        name: (term.unit, *term.fit, f"{term.letter} of springs {in_words()}, the same for all joints")
        for name, term in SPRING_TERMS.items()
    },
    SPRING_BOUND: ("1", 1e-3, 0.99, 0.2, "f of the same springs: what s does to their slope at most, in parts of K"),
    "swell_share": ("1", 0.0, 1.0, 0.1, "share of the torque law's growth with pressure that comes late"),
    "valve_rise_rate": ("Pa/s", 1e3, 1e9, 0.0, "fastest rise of the pressure"),
    "valve_fall_rate": ("Pa/s", 1e3, 1e9, 0.0, "fastest fall of the pressure"),
    "valve_dead_band": ("Pa", 0.0, 1e6, 1e3, "what a regulator leaves of its command"),
    "valve_opening_time": ("s", 1e-3, 30.0, 0.0, "time in which choked flow would fill the chamber"),
    "valve_settle_share": ("1", 0.0, 0.9, 0.1, "share of the pressure that comes late"),
    "valve_settle_time": ("s", 0.2, 1e3, 0.0, "how late"),
    "swell_time": ("s", 1e-3, 1e4, 0.0, "how late"),
    "inflation_limit": ("Pa", 1e3, 1e9, 0.0, "pressure towards which the chamber's wall expands without end"),
    "inflation_time": ("s", 1e-4, 1e3, 0.0, "time that the wall takes at low pressure"),
    "inflation_jm": ("1", 1.0, 1e4, 0.0, "J_m of a wall of Gent's rubber, which bounds its stretch"),
}
LAYOUTS: dict[str, tuple[Callable[..., Springpot | Payne], tuple[str, ...], str]] = {
    # laws of few numbers: what lays them out, its numbers, the kind of branch that it lays
    "fractional": (springpot, ("share", "order", "low", "high"), "creep"),
    "payne": (payne, ("share", "angle", "exponent", "low", "high"), "slip"),
}
PAIRS = {"creep": ("share", "time"), "slip": ("share", "angle"),
         "axial_creep": ("share", "time"), "axial_slip": ("share", "strain")}  # fmt: skip


def usual_start(name: str) -> float | None:
    """Return the start value of a parameter of hysteresis or creep; None for any other name.

    Branches of one kind begin apart: from equal ones no fit would tell them from each other.
    """
    own = name.rpartition(".")[2]
    single = {"fractional_share": 0.05, "fractional_order": 0.25,
              "payne_share": 3.0, "payne_angle": 0.02, "payne_exponent": 0.4,
              "boucwen_share": 0.1, "boucwen_beta": 20.0, "boucwen_gamma": 10.0, "boucwen_exponent": 1.5,
              **dict.fromkeys(SPRING_TERMS, 0.0), SPRING_BOUND: 0.75,
              "swell_share": 0.3, "swell_time": 1.0, "inflation_time": 0.05, "inflation_jm": 50.0,
              "valve_dead_band": 1e3, "valve_opening_time": 0.1, "valve_settle_share": 0.1, "valve_settle_time": 2.0,
              "valve_rise_rate": 3e5, "valve_fall_rate": 3e5,
              **{f"axial_{term}": 0.0 for term in SPRING_TERMS}, f"axial_{SPRING_BOUND}": 0.75}  # fmt: skip
    if own in single:
        return single[own]
    if found := re.fullmatch(r"(?:axial_)?(creep|slip)_(share|time|angle|strain)_([1-9])", own):
        j = int(found[3]) - 1
        return {"share": 0.1, "time": 0.3 * 8.0**j, "angle": 0.01 * 3.0**j, "strain": 0.003 * 3.0**j}[found[2]]
    return None


def chamber_guess(highest: float) -> dict[str, float]:
    """Return the start value of a hyperelastic wall's limit: twice the `highest` pressure [Pa] of the recordings."""
    return {"inflation_limit": 2.0 * highest}


def laid_out(values: Mapping[str, float]) -> dict[str, Any]:
    """The branches that the springpot and Payne's curve of `values` are laid out in; empty without one."""
    entries: dict[str, Any] = {}
    for law, (lay, fields, kind) in LAYOUTS.items():
        given = {field: values[f"{law}_{field}"] for field in fields if f"{law}_{field}" in values}
        if not given.keys() - {"low", "high"}:
            continue
        if missing := [f"{law}_{field}" for field in fields if field not in given]:
            raise InputError(f"{law}_* needs all of its {len(fields)} numbers: {', '.join(missing)} is missing")
        if matching(f"{kind}_(share|time|angle)_[1-9]", tuple(values)):
            raise InputError(f"{law}_* lays out all {kind} branches itself: leave out either {law}_* or {kind}_*")
        made = lay(*(given[field] for field in fields))._asdict()
        entries |= {name: row for name, row in made.items() if name != "spring"}
    return entries


def memory_changes(model: Model, values: Mapping[str, float]) -> dict[str, Any]:
    """The model's memory and stiffening with those of `values` put in; new branches follow the model's own."""
    changes: dict[str, Any] = {}
    for field in (*SPRING_TERMS, SPRING_BOUND):
        if field in values:
            changes[field] = np.full(model.n, values[field])
    names = tuple(values)
    entries: dict[str, Any] = {k: values[k] for k in matching("boucwen_[a-z]+", names)}
    entries |= laid_out(values)
    for kind, fields in PAIRS.items():
        for field in fields:
            row = list(entries.get(f"{kind}_{field}", getattr(model.memory, f"{kind}_{field}")))
            given = {int(k[-1]): values[k] for k in matching(f"{kind}_{field}_[1-9]", names)}
            for j in sorted(given):
                if j > len(row) + 1:
                    raise InputError(f"parameter {kind}_{field}_{j}: number branches 1, 2, ... without a gap")
                row[j - 1 :] = [given[j], *row[j:]]
            if given:
                entries[f"{kind}_{field}"] = tuple(row)
        lengths = [len(entries.get(f"{kind}_{f}", getattr(model.memory, f"{kind}_{f}"))) for f in fields]
        if lengths[0] != lengths[1]:
            raise InputError(
                f"each {kind} branch needs a {kind}_{fields[0]}_<j> and a {kind}_{fields[1]}_<j>: "
                f"there are {lengths[0]} and {lengths[1]}"
            )
    if entries:
        changes["memory"] = replace(model.memory, **entries)
    return changes
