"""Fit parameters of creep, hysteresis, viscoelastic lag and valve limits: names, bounds, start
values, use in a model.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from pliant.equations.spring_terms import SPRING_BOUND, SPRING_TERMS, in_words
from pliant.errors import InputError
from pliant.identification.chamber_parameters import matching
from pliant.model import Model
from pliant.model.memory import Payne, Springpot, payne, springpot

# name: (unit, lower, upper, scale, meaning)
ROWS: dict[str, tuple[str, float, float, float, str]] = {
    r"creep_share_[1-9]": ("1", 0.0, 50.0, 0.1, "stiffness of a creep branch over each joint's"),
    r"creep_time_[1-9]": ("s", 1e-3, 1e4, 0.0, "relaxation time of a creep branch"),
    r"slip_share_[1-9]": ("1", 0.0, 50.0, 0.1, "stiffness of a slip element over each joint's"),
    r"slip_angle_[1-9]": ("rad", 1e-6, 10.0, 0.0, "joint rotation at which a slip element slips"),
    r"axial_creep_share_[1-9]": ("1", 0.0, 50.0, 0.1, "stiffness of an axial creep branch over EA"),
    r"axial_creep_time_[1-9]": ("s", 1e-3, 1e4, 0.0, "relaxation time of an axial creep branch"),
    r"axial_slip_share_[1-9]": ("1", 0.0, 50.0, 0.1, "stiffness of an axial slip element over EA"),
    r"axial_slip_strain_[1-9]": ("1", 1e-6, 10.0, 0.0, "strain at which an axial slip element slips"),
    "fractional_share": ("1", 0.0, 10.0, 0.02, "stiffness of the springpot at 1 rad/s over each joint's"),
    "fractional_order": ("1", 0.02, 0.9, 0.1, "order of the springpot: 0 a spring, 1 a dashpot"),
    "fractional_low": ("Hz", 1e-6, 1e6, 0.0, "lowest frequency at which the springpot holds, never free"),
    "fractional_high": ("Hz", 1e-6, 1e6, 0.0, "highest frequency at which the springpot holds, never free"),
    "payne_share": ("1", 0.0, 1e4, 0.5, "extra stiffness of small oscillations over each joint's stiffness"),
    "payne_angle": ("rad", 1e-6, 10.0, 0.0, "oscillation amplitude of a joint that halves the extra stiffness"),
    "payne_exponent": ("1", 0.05, 0.5, 0.1, "Kraus' m: how steeply the stiffness falls with amplitude, at most 0.5"),
    "payne_low": ("rad", 1e-6, 10.0, 0.0, "smallest amplitude at which Payne's curve holds, never free"),
    "payne_high": ("rad", 1e-6, 10.0, 0.0, "largest amplitude at which Payne's curve holds, never free"),
    "boucwen_share": ("1", 1e-9, 50.0, 0.1, "stiffness of the Bouc-Wen branch over each joint's"),
    "boucwen_beta": ("1/rad^n", 1e-6, 1e8, 0.0, "Bouc-Wen beta"),
    "boucwen_gamma": ("1/rad^n", -1e8, 1e8, 10.0, "Bouc-Wen gamma, at most beta in size"),
    "boucwen_exponent": ("1", 1.0, 10.0, 1.0, "Bouc-Wen exponent n"),
    **{
        name: (term.unit, *term.fit, f"{term.letter} of springs {in_words()}, the same for all joints")
        for name, term in SPRING_TERMS.items()
    },
    SPRING_BOUND: ("1", 1e-3, 0.99, 0.2, "f of the same springs: what s does to their slope at most, in parts of K"),
    "swell_share": ("1", 0.0, 1.0, 0.1, "fraction of the torque law's growth with pressure that lags"),
    "valve_rise_rate": ("Pa/s", 1e3, 1e9, 0.0, "fastest rise of the pressure"),
    "valve_fall_rate": ("Pa/s", 1e3, 1e9, 0.0, "fastest fall of the pressure"),
    "valve_dead_band": ("Pa", 0.0, 1e6, 1e3, "difference between command and pressure that a regulator leaves"),
    "valve_opening_time": ("s", 1e-3, 30.0, 0.0, "time that choked flow would take to fill the chamber"),
    "valve_settle_share": ("1", 0.0, 0.9, 0.1, "fraction of the pressure that settles late"),
    "valve_settle_time": ("s", 0.2, 1e3, 0.0, "time constant of the late settling of the pressure"),
    "swell_time": ("s", 1e-3, 1e4, 0.0, "time constant of the lagging fraction swell_share of the torque"),
    "inflation_limit": ("Pa", 1e3, 1e9, 0.0, "pressure at which the chamber's wall expands without limit"),
    "inflation_time": ("s", 1e-4, 1e3, 0.0, "time constant of the wall's expansion at low pressure"),
    "inflation_jm": ("1", 1.0, 1e4, 0.0, "J_m of Gent's law, which bounds the stretch of the wall"),
}
LAYOUTS: dict[str, tuple[Callable[..., Springpot | Payne], tuple[str, ...], str]] = {
    # law: (function that expands it into branches, parameters of the law, kind of branch)
    "fractional": (springpot, ("share", "order", "low", "high"), "creep"),
    "payne": (payne, ("share", "angle", "exponent", "low", "high"), "slip"),
}
PAIRS = {"creep": ("share", "time"), "slip": ("share", "angle"),
         "axial_creep": ("share", "time"), "axial_slip": ("share", "strain")}  # fmt: skip


def usual_start(name: str) -> float | None:
    """Return the default start value of a creep, hysteresis, lag or valve-limit parameter; None for any other name.

    Branches of one kind get different start values, since a fit could not separate equal ones.
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
    """Return the start value of the wall limit as {"inflation_limit": Pa}: twice the `highest`
    recorded pressure [Pa].
    """
    return {"inflation_limit": 2.0 * highest}


def laid_out(values: Mapping[str, float]) -> dict[str, Any]:
    """Return the creep branches that approximate a springpot and the slip branches that approximate Payne's curve, for
    the parameters in `values`. The result is a dict of fields of the model's hysteresis and creep.
    """
    entries: dict[str, Any] = {}
    for law, (lay, fields, kind) in LAYOUTS.items():
        given = {field: values[f"{law}_{field}"] for field in fields if f"{law}_{field}" in values}
        if not given.keys() - {"low", "high"}:
            continue
        if missing := [f"{law}_{field}" for field in fields if field not in given]:
            raise InputError(
                f"{law}_* needs all of its {len(fields)} parameters: {', '.join(missing)} is missing; "
                "add what is missing"
            )
        if matching(f"{kind}_(share|time|angle)_[1-9]", tuple(values)):
            raise InputError(f"{law}_* sets all {kind} branches itself: leave out either {law}_* or {kind}_*")
        kernel_rows = lay(*(given[field] for field in fields))._asdict()
        entries |= {name: row for name, row in kernel_rows.items() if name != "spring"}
    return entries


def memory_changes(model: Model, values: Mapping[str, float]) -> dict[str, Any]:
    """Return the changes that `values` make to a model's creep, hysteresis and stiffening, as a
    dict for `Model.with_`.
    """
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
                    raise InputError(f"parameter {kind}_{field}_{j}: number the branches 1, 2, ... without a gap")
                row[j - 1 :] = [given[j], *row[j:]]
            if given:
                entries[f"{kind}_{field}"] = tuple(row)
        lengths = [len(entries.get(f"{kind}_{f}", getattr(model.memory, f"{kind}_{f}"))) for f in fields]
        if lengths[0] != lengths[1]:
            raise InputError(
                f"each {kind} branch needs a {kind}_{fields[0]}_<j> and a {kind}_{fields[1]}_<j>: "
                f"there are {lengths[0]} and {lengths[1]}; add the missing ones"
            )
    if entries:
        changes["memory"] = replace(model.memory, **entries)
    return changes
