"""Definitions of the stages of a model selection. Each stage frees some parameters more than the stage below."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

from pliant.identification.chamber_parameters import has_effect, prefixes
from pliant.identification.parameters import Parameter
from pliant.model import Model

Entry = Parameter | str
Scan = tuple[tuple[str, tuple[float, ...]], ...]  # names, and the values [SI] that they begin at, one after another


class Stage(NamedTuple):
    """A stage of a model selection: its name, the parameters that it frees, and the stage to whose parameters it adds.

    `frees` lists alternatives: among those that the recordings determine, the one of the lowest BIC is taken. `drops`
    names parameters of lower stages that this one replaces. `scan` gives start values, far apart, that are tried one
    after another. A name that begins with ``*.`` means one parameter for each chamber.
    """

    name: str
    title: str
    frees: tuple[tuple[Entry, ...], ...] = ()
    drops: tuple[str, ...] = ()
    scan: Scan = ()


def each_chamber(entry: Entry, model: Model) -> tuple[Entry, ...]:
    """Expand a parameter name ``*.name`` to one entry for each chamber of the model that has it, ``chamber.name``."""
    name = entry if isinstance(entry, str) else entry.name
    if not name.startswith("*."):
        return (entry,)
    starts = prefixes(model) if model.actuation.count > 1 else ("",)
    owners = zip(starts, model.chambers, strict=True)
    names = [f"{start}{name[2:]}" for start, chamber in owners if has_effect(name[2:], chamber)]
    return tuple(n if isinstance(entry, str) else replace(entry, name=n) for n in names)


def of_chambers(stage: Stage, model: Model) -> Stage:
    """Return the stage with each wildcard ``*.name`` expanded to one parameter per chamber of the model."""

    def out(name: str) -> list[str]:
        return [n for n in each_chamber(name, model) if isinstance(n, str)]

    return stage._replace(
        frees=tuple(tuple(e for entry in choice for e in each_chamber(entry, model)) for choice in stage.frees),
        drops=tuple(n for name in stage.drops for n in out(name)),
        scan=tuple((n, row) for name, row in stage.scan for n in out(name)),
    )


LAGS = (0.02, 0.1, 0.4, 1.5)
ELASTIC = ("stiffness", "damping")
CREEP = ("creep_share_1", "creep_time_1")
BOUC_WEN = ("boucwen_share", "boucwen_beta", Parameter("boucwen_gamma", 0.0, free=False))
GENT = Parameter("inflation_jm", 20.0, prior=20.0, prior_std=4.0, source="tensile test of Dragon Skin 10")
SOFTEN = ("stiffening", Parameter("stiffening_bound", 0.75, free=False))  # as of a neo-Hookean wall
STAGES: tuple[Stage, ...] = (
    Stage("given", "as given"),
    Stage("elastic", "K and D", (ELASTIC,)),
    Stage("torque", "+ torque law", ((*ELASTIC, "*.torque_1", "*.torque_2"), (*ELASTIC, "*.torque_1"))),
    Stage("lag", "+ lag of the pressure", (("valve_rise_time", "valve_fall_time"), ("valve_rise_time",)),
         scan=(("valve_rise_time", LAGS), ("valve_fall_time", LAGS))),
    Stage("soften", "+ springs that soften", (SOFTEN,)),
    Stage("joints", "+ K of each joint", ((Parameter("stiffness_*", shrink=0.3),),), drops=("stiffness",)),
    Stage("creep", "+ creep", (CREEP,), scan=(("creep_time_1", (0.1, 0.7, 5.0)),)),
    Stage("hysteresis", "+ hysteresis", (("slip_share_1", "slip_angle_1"), BOUC_WEN),
         scan=(("slip_angle_1", (0.003, 0.02, 0.1)), ("boucwen_beta", (300.0, 50.0, 10.0)))),
)
MORE_STAGES: tuple[Stage, ...] = (  # taken where a study names them
    Stage("odd", "odd cubic torque law", (("*.torque_1", "*.torque_3"),), drops=("*.torque_2",)),
    Stage("stiffen", "+ springs that stiffen again", (("cubic_stiffening",),)),
    Stage("valves", "+ a lag of each chamber", (("*.valve_rise_time", "*.valve_fall_time"), ("*.valve_rise_time",)),
         drops=("valve_rise_time", "valve_fall_time"), scan=(("*.valve_rise_time", LAGS), ("*.valve_fall_time", LAGS))),
    Stage("wall", "+ hyperelastic wall in place of the curved torque law",
         (("inflation_limit", "inflation_time"), ("inflation_limit", Parameter("inflation_time", 0.05, free=False))),
         drops=("*.torque_2",), scan=(("inflation_time", (0.02, 0.1)),)),
    Stage("gent", "+ Gent's bound of the wall's stretch, by a prior of Dragon Skin 10", ((GENT,),)),
    Stage("settle", "+ late settling of the regulator", (("valve_settle_share", "valve_settle_time"),),
         scan=(("valve_settle_time", (0.3, 1.0, 3.0)),)),
    Stage("vent", "+ limited fall", (("valve_fall_rate",),), scan=(("valve_fall_rate", (1e4, 1e5, 1e6)),)),
    Stage("swell", "+ late swelling", (("swell_share", "swell_time"),), scan=(("swell_time", (0.1, 0.5, 2.0)),)),
    Stage("payne", "+ stiffness that falls with amplitude", (("payne_share", "payne_angle", "payne_exponent"),),
         drops=("slip_share_1", "slip_angle_1"),
         scan=(("payne_share", (0.3, 3.0, 30.0)), ("payne_angle", (0.05, 0.02, 0.01)))),
    Stage("azimuths", "+ direction and size of each chamber's pull, in space", (("*.gain_x", "*.gain_y"),),
         drops=("*.torque_1",)),
    Stage("directions", "+ another stiffness about y, in space", (("stiffness_ratio",),)),
    Stage("twist", "+ torsional stiffness, in space", (("twist_ratio",),)),
    Stage("creep_2", "+ second creep branch", ((*CREEP, "creep_share_2", "creep_time_2"),),
         scan=(("creep_time_2", (0.5, 2.0, 10.0)),)),
)
