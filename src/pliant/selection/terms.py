"""The terms that a search may add to a model: each with its parameters, and the values at which it has no effect."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from pliant.errors import InputError
from pliant.identification.chamber_parameters import has_effect, prefixes
from pliant.identification.experiment import Experiment
from pliant.identification.parameters import Parameter, values_of
from pliant.identification.torque_start import grown, highest_level
from pliant.mechanics import Mechanics, PlanarChain, SpatialChain, mechanics_of
from pliant.model import ActuationInput, Extension, Model
from pliant.selection.body_parts import near, other_markers, segments_of_tendons, tensions

NO_SHARE = 1e-6  # fraction or coefficient at which hysteresis, friction or a late part of the pressure has no effect
NO_FORCE = 1e-6  # N at which the friction of a tendon has no effect
REST = 0.1  # rad, of a joint: standard deviation of the rest turn about that of the model
WIDE = 0.5  # of an input's highest value, down to which it must come to show the curvature of its torque law
LONGER = 2.0  # length of a recording over a time of creep, below which the length itself is tried in place of the time
LEVELS = 3  # that show a dead band, or which of several torque laws holds
UNEQUAL = 0.5  # of their mean: standard deviation of the damping of the joints about it
SOFTER, FIRM = (0.1, 0.5, 2.5), 3.0  # of the axial stiffness of a round body: values that are tried; of its prior
# offered by name alone to bodies without tendons: unseen recordings of pneumatic arms were predicted worse with them
UNASKED = ("joint_damping", "markers", "origin", "wall_stiffening")
GROWN = 0.01  # strain along the stations from which a body in the plane may lengthen
TERMS = {  # the names of all terms, and what they add
    "joints": "stiffness of each joint",
    "softening": "springs that soften or stiffen, within a bound",
    "cubic": "springs that stiffen with the square of the bend",
    "directions": "another stiffness about y, in space",
    "rest": "a body that is bent at rest, in space",
    "creep": "creep",
    "creep_2": "a second creep branch",
    "joint_damping": "damping of each joint",
    "slip": "internal friction",
    "tendon_friction": "friction along the tendons",
    "entry_friction": "friction of tendons where they enter the body",
    "imbalance": "pretensions that differ within a pair of tendons",
    "pretension": "pretension of each tendon",
    "line": "stiffness of each tendon",
    "taper": "tendons that converge",
    "spacing": "tendons that run straight between guides",
    "axial_creep": "creep of the length",
    "wall_creep": "creep of bend and length",
    "torque_2": "curvature of the torque law",
    "torque_3": "odd cubic torque law",
    "swell": "a late part of the torque",
    "wall": "a hyperelastic wall",
    "bounded_wall": "a bound of the wall's stretch",
    "lag": "lag of the input",
    "vent": "a limited rate of the falling pressure",
    "fill": "a limited rate of the rising pressure",
    "opening": "chambers that fill and vent through an opening",
    "dead_band": "a dead band of the regulator",
    "settle": "late settling of the input",
    "clock": "offset of the input's clock",
    "base": "error of the base tangent",
    "origin": "offset of the base",
    "markers": "places of the other markers",
    "lengthening": "a body that lengthens",
    "segments": "segments that tendons shorten",
    "wall_stiffening": "walls that stiffen with the length",
}


class Term(NamedTuple):
    """A term that a search may add to a model.

    Attributes
    ----------
    name, title : str
        The name is one of `TERMS`, for a term of one chamber with the chamber's name and a dot before it. "stiffness"
        frees a stiffness which the first model holds.
    adds : tuple of Parameter
        The parameters of the term. Their values are the start of a fit.
    null : mapping
        Values (SI) at which the term has no effect, by parameter; the derivatives are taken there. Parameters without
        an entry keep the value of `grid` or of `adds`. Of a term that replaces a parameter: factors on its value.
        Empty for a law that has no derivative where it has no effect, such as a limited rate: it is tried as it is.
    grid : tuple of mappings
        Values of the parameters that have no effect of their own there, such as times: each is tried.
    replaces : tuple of str
        Parameters that the term's parameters replace.
    group : str
        Alternatives have the same group: a model has one of them at most.
    needs : str
        Name of a term without which this one has no meaning.
    includes : tuple of str
        Names of terms that this one has within it.
    limits : tuple of str
        Parameters whose upper bound stands for all higher values, which the recordings do not tell from it.
    segments : tuple of Extension
        Segments that the model needs for this term, so that its body lengthens.
    """

    name: str
    title: str
    adds: tuple[Parameter, ...]
    null: Mapping[str, float]
    grid: tuple[Mapping[str, float], ...] = ({},)
    replaces: tuple[str, ...] = ()
    group: str = ""
    needs: str = ""
    includes: tuple[str, ...] = ()
    limits: tuple[str, ...] = ()
    segments: tuple[Extension, ...] = ()

    def model(self, model: Model) -> Model:
        """Return the model, with the segments that lengthen if the term needs any."""
        return model.with_(extensions=self.segments) if self.segments else model

    @property
    def on_held_scale(self) -> bool:
        """Return whether the term replaces a parameter whose scale no recording shows (see `about`)."""
        return bool(self.replaces) and all(p.prior_std for p in self.adds)

    def on(self, model: Model) -> Term:
        """Return the term with the places of markers where the model has them: there it has no effect."""
        coordinates = {f"{s.name}.{axis}": value for s in model.stations for axis, value in s._asdict().items()}
        null = {name: coordinates.get(name, value) for name, value in self.null.items()}
        return self._replace(null=null, adds=tuple(
            near(p.name, coordinates[p.name], model) if p.name in coordinates else p for p in self.adds))

    def about(self, held: Mapping[str, float]) -> Term:
        """Return the term with priors about the parameters that it replaces, if these are `held` (SI): their scale,
        which no recording shows, then stays. The priors are as close as its parameters otherwise are to their mean.
        """
        value = next((held[name] for name in self.replaces if name in held), None)
        if value is None:
            return self
        return self._replace(adds=tuple(
            p.with_(shrink=0.0, prior=self.null[p.name] * value, prior_std=p.shrink * value) for p in self.adds))

    def at_null(self, row: Mapping[str, float], values: Mapping[str, float]) -> list[Parameter]:
        """Return the term's parameters where it has no effect on a model with the parameter `values` (SI), for one row
        of the grid. Those with an entry in `null` are free, the others are held.
        """
        factor = values[self.replaces[0]] if self.replaces else 1.0
        null = {name: factor * value for name, value in self.null.items()}
        return [p.with_(value=null.get(p.name, row.get(p.name, p.value)), free=p.name in null) for p in self.adds]

    def begun(self, row: Mapping[str, float], values: Mapping[str, float]) -> list[Parameter]:
        """Return the term's parameters as the start of a fit: at the `values` (SI) that a screen proposes, else at one
        row of the grid, else at their own.
        """
        now = {**{p.name: p.value for p in self.adds}, **row, **values}
        return [p if (v := now[p.name]) is None else p.with_(value=float(np.clip(v, p.lower, p.upper)))
                for p in self.adds]


def term(name: str, owner: str, adds: Sequence[Parameter], null: Mapping[str, float], **options: Any) -> Term:
    """Return a term of the model, or of the chamber `owner`, with the title of `TERMS`."""
    title = TERMS[name] + (f" of {owner.rstrip('.')}" if owner else "")
    return Term(owner + name, title, tuple(adds), null, **options)


def held(name: str, value: float) -> Parameter:
    """Return a parameter that is held constant (SI)."""
    return Parameter(name, value, free=False)


def known_term(name: str) -> str:
    """Return the name of a term. The name of a chamber before its dot is not checked.

    Raises
    ------
    ValueError
        For a name that is no term.
    """
    if name.rpartition(".")[2] not in TERMS:
        raise ValueError(f"unknown term {name!r}: use one of {', '.join(TERMS)}")
    return name


def terms_for(
    model: Model, experiments: Sequence[Experiment], *, only: Sequence[str] = (), without: Sequence[str] = (),
) -> tuple[Term, ...]:
    """Return the terms that may be added to a model for these recordings, in plane or space, for chambers and tendons.

    Parameters
    ----------
    model : Model
        The model with which a search begins: its chambers, tendons, segments and space decide which terms exist.
    experiments : sequence of Experiment
        Training recordings.
    only, without : sequences of str
        Names of `TERMS`: the only terms to return, and terms to leave out. Default: all, but for a body without tendons
        not those in `UNASKED`. The name of a chamber's term,
        such as "torque_2", means all chambers, "left.torque_2" one of them.

    Raises
    ------
    InputError
        For an unknown name.
    """
    try:
        for name in (*only, *without):
            known_term(name)
    except ValueError as error:
        raise InputError(f"a name {error}") from None

    def named(one: Term, names: Sequence[str]) -> bool:
        return one.name in names or one.name.rpartition(".")[2] in names

    longer = tuple(lengthening(model, experiments))
    every = (*springs(model), *relaxation(model, longer, longest(experiments)), *inputs(model, experiments),
             *places(model, experiments), *longer, *curved_walls(model, longer))
    left_out = without if only or model.actuation.tendons else (*without, *UNASKED)
    return tuple(t for t in every if (not only or named(t, only)) and not named(t, left_out))


def springs(model: Model) -> Iterator[Term]:
    """Yield the terms of the joints' springs. Laws that lose all stiffness at a large bend are not among them."""
    bound = held("stiffening_bound", 0.75)
    yield term("softening", "", [Parameter("stiffening", 0.0), bound], {"stiffening": 0.0})
    yield term("cubic", "", [Parameter("cubic_stiffening", 0.05, lower=0.0)], {"cubic_stiffening": 0.0})
    if model.n > 1:
        names = [f"stiffness_{i + 1}" for i in range(model.n)]
        ratio = model.stiffness / model.stiffness.mean()
        yield term("joints", "", [Parameter(n, shrink=0.3) for n in names],
                   {n: float(r) for n, r in zip(names, ratio, strict=True)}, replaces=("stiffness",))
    yield from TERMS_OF_CHAINS[type(mechanics_of(model))].springs(model)


def spatial_springs(model: Model) -> Iterator[Term]:
    """Yield the terms of the springs of a body in space: a stiffness of its own about y, and another shape at rest."""
    chain = SpatialChain(model)
    yield term("directions", "", [Parameter("stiffness_ratio", 1.0)], {"stiffness_ratio": chain.space.stiffness_ratio})
    turns = chain.rest_values
    yield term("rest", "", [Parameter(n, v, prior=v, prior_std=REST) for n, v in turns.items()], turns)


class ChainTerms(NamedTuple):
    """What a kind of chain adds to the terms.

    Attributes
    ----------
    springs : callable
        ``springs(model)`` yields the terms of springs that only this kind has.
    grown : float
        Strain along the stations from which a body of this kind may lengthen.
    """

    springs: Callable[[Model], Iterator[Term]]
    grown: float


TERMS_OF_CHAINS: dict[type[Mechanics], ChainTerms] = {
    PlanarChain: ChainTerms(lambda _: iter(()), GROWN), SpatialChain: ChainTerms(spatial_springs, -np.inf),
}


def longest(experiments: Sequence[Experiment]) -> float:
    """Return the time [s] of the longest recording of a motion; 0 if there is none."""
    return max((float(np.ptp(e.time)) for e in experiments if not e.poses), default=0.0)


def relaxation(model: Model, longer: Sequence[Term], span: float) -> Iterator[Term]:
    """Yield creep of the joints, with one branch and a second one, friction of joints and tendons, and creep of a body
    that lengthens, or that the term in `longer` lengthens, for recordings of up to `span` [s]. Settled poses show no
    creep.
    """
    if span > 0.0:
        yield creep("creep", "creep_share_1", "creep_time_1", (0.1, 0.7, 5.0), span)
        yield creep("creep_2", "creep_share_2", "creep_time_2", (0.3, 2.0, 15.0), span, needs="creep")
        if model.n > 1:
            names = [f"damping_{i + 1}" for i in range(model.n)]
            yield term("joint_damping", "", [Parameter(n, shrink=UNEQUAL) for n in names], dict.fromkeys(names, 1.0),
                       replaces=("damping",))  # fmt: skip
    yield branch("slip", "", "slip_share_1", "slip_angle_1", (0.003, 0.02, 0.1))
    if model.actuation.tendons:
        yield term("tendon_friction", "", [Parameter("friction", 0.1)], {"friction": NO_SHARE})
        yield term("entry_friction", "", [Parameter("entry_friction", 0.05)], {"entry_friction": NO_FORCE})
        yield from paths_of_tendons(model)
    if span > 0.0 and (mechanics_of(model).lengthens or longer):
        needs = next((t.name for t in longer), "")
        yield creep("axial_creep", "axial_creep_share_1", "axial_creep_time_1", (0.5, 3.0, 20.0), span, needs=needs)
        both = (creep("wall_creep", f"{axis}creep_share_1", f"{axis}creep_time_1", (0.7, 5.0, 20.0), span)
                for axis in ("", "axial_"))
        yield together("wall_creep", *both)._replace(needs=needs, includes=("creep", "axial_creep"))


def paths_of_tendons(model: Model) -> Iterator[Term]:
    """Yield unequal pretensions within pairs of tendons, tendons that converge along the body, and guides at a
    distance.
    """
    cords = [(start, c) for start, c in zip(prefixes(model), model.chambers, strict=True) if c.signs]
    now = {f"{start}imbalance": c.value_of("imbalance") for start, c in cords if c.uses("imbalance")}
    if now:
        yield term("imbalance", "", [Parameter(name, value) for name, value in now.items()], now)
    if not any(c.value_of("taper") for _, c in cords):
        yield term("taper", "", [Parameter("taper", 0.0)], {"taper": 0.0})
    if not any(c.value_of("spacing") for _, c in cords):
        length = float(model.base_length + model.link_length.sum()) / model.n
        yield tried("spacing", "spacing", (0.5 * length, length))


def together(name: str, one: Term, other: Term) -> Term:
    """Return one term of two that have the same cause, such as creep of a wall that bends and lengthens: each alone may
    predict no better. Their grids, of equal length, are run through side by side.
    """
    rows = ({**a, **b} for a, b in zip(one.grid, other.grid, strict=True))
    return term(name, "", (*one.adds, *other.adds), {**one.null, **other.null}, grid=tuple(rows),
                limits=(*one.limits, *other.limits))


def creep(
    name: str, share: str, time: str, grid: Sequence[float], span: float, **options: Any,
) -> Term:
    """Return a term of creep with a time that is tried on a grid, up to the length of the recordings. They do not show
    longer times: creep from before a recording lasts through it, and creep that hardly begins in it passes for a
    spring.
    """
    times = [t for t in grid if LONGER * t <= span]
    return term(name, "", [Parameter(share, 0.1), Parameter(time, min(grid[0], span), upper=span)], {share: NO_SHARE},
                grid=tuple({time: v} for v in (*times, span)), limits=(time,), **options)


def branch(name: str, owner: str, share: str, inner: str, grid: Sequence[float], **options: Any) -> Term:
    """Return a term of a fraction `share` without effect at 0, and an inner time or angle that is tried on a grid."""
    return term(name, owner, [Parameter(share, 0.1), Parameter(inner, grid[0])], {share: NO_SHARE},
                grid=tuple({inner: v} for v in grid), **options)


def inputs(model: Model, experiments: Sequence[Experiment]) -> Iterator[Term]:
    """Yield the terms of the inputs: torque laws of chambers, tensions of tendons, lags of valves, the clock."""
    driven = [e for e in experiments if e.excitation != "release"]
    for start, chamber in zip(prefixes(model), model.chambers, strict=True) if driven else ():
        if chamber.uses("torque") and shows_curvature(chamber, driven):
            yield from torque_laws(start, chamber, highest_level(driven))
    for name, parameters in tensions(model, driven).items():
        yield term(name, "", parameters, values_of(parameters))
    if all(e.poses for e in driven):
        return
    slow = [start for start, c in zip(prefixes(model), model.chambers, strict=True) if has_effect("valve_rise_time", c)]
    for start in dict.fromkeys(["", *slow] if slow else []):  # a common lag, and one of each chamber
        names = [f"{start}valve_rise_time", f"{start}valve_fall_time"]
        yield term("lag", start, [Parameter(n, 0.02) for n in names], dict.fromkeys(names, 0.0))
    if slow:
        yield from regulators([e for e in driven if e.nominal])
        yield branch("settle", "", "valve_settle_share", "valve_settle_time", (0.3, 1.0, 3.0))
    if any(e.excitation == "trace" for e in driven):
        yield term("clock", "", [Parameter("start", 0.0)], {"start": 0.0})


def regulators(nominal: Sequence[Experiment]) -> Iterator[Term]:
    """Yield what may be between a nominal pressure and that in the chambers, for pulses and steps whose pressure was
    not measured: limited rates or an opening, and a dead band. Two levels do not tell a dead band from the curvature of
    a torque law.
    """
    if any(e.excitation == "pulse" for e in nominal):
        yield tried("vent", "valve_fall_rate", (3e4, 1e5, 1e6))
    if nominal:
        yield tried("fill", "valve_rise_rate", (3e4, 1e5, 1e6), group="fill")
        yield tried("opening", "valve_opening_time", (0.05, 0.2), group="fill")
    if levels(nominal) >= LEVELS:
        yield term("dead_band", "", [Parameter("valve_dead_band", 0.0)], {"valve_dead_band": 0.0})


def levels(experiments: Sequence[Experiment]) -> int:
    """Return how many highest inputs, which differ by more than 10 %, the driven recordings have."""
    highest = sorted(abs(e.level) if e.nominal else
               max((abs(t.peak) for t in e.traces.values()), default=0.0)
               for e in experiments if e.excitation != "release")  # fmt: skip
    return sum(value > 1.1 * below for below, value in pairwise([0.0, *highest]))


def tried(name: str, parameter: str, grid: Sequence[float], **options: Any) -> Term:
    """Return a term of one parameter whose law has no derivative where it has no effect, for the values of a grid."""
    return term(name, "", [Parameter(parameter, grid[0])], {}, grid=tuple({parameter: v} for v in grid), **options)


def shows_curvature(chamber: ActuationInput, driven: Sequence[Experiment]) -> bool:
    """Return whether the recordings can show the curvature of an input's torque law: its values come down to half of
    the highest one, in frames that are compared. Otherwise differences between recordings would pass for it. A pulse or
    a step whose pressure was not measured begins at 0.
    """
    values = [np.abs(trace(e.time[np.isfinite(e.compared).any(axis=(1, 2))]))
              for e in driven if (trace := e.driving(chamber.name)) is not None]  # fmt: skip
    values += [np.array([0.0, abs(e.level)]) for e in driven if e.nominal]
    highest = max((v.max(initial=0.0) for v in values), default=0.0)
    return highest > 0.0 and min(float(v.min(initial=np.inf)) for v in values) <= WIDE * highest


def torque_laws(start: str, chamber: ActuationInput, highest: float) -> Iterator[Term]:
    """Yield the terms of one pressure chamber's torque law, for recordings up to the pressure `highest` [Pa]; `start`
    is the prefix of its parameters.
    """
    group = f"{start}torque"
    if chamber.torque.size < 2 or not chamber.torque[1:].any():
        for name in ("torque_2", "torque_3"):
            yield term(name, start, [Parameter(start + name, 0.0)], {start + name: 0.0}, group=group)
        limit, time = f"{start}inflation_limit", f"{start}inflation_time"
        yield term("wall", start, [Parameter(limit, 2.0 * highest), Parameter(time, 0.05)], {}, group=group,
                   grid=tuple({limit: f * highest, time: t} for f in (1.5, 4.0) for t in (0.02, 0.2)))
        yield term("bounded_wall", start, [held(f"{start}inflation_jm", 20.0)], {}, needs=f"{start}wall",
                   grid=tuple({f"{start}inflation_jm": v} for v in (20.0, 60.0)))
    yield branch("swell", start, f"{start}swell_share", f"{start}swell_time", (0.1, 0.5, 2.0), needs=f"{start}torque_2")


def places(model: Model, experiments: Sequence[Experiment]) -> Iterator[Term]:
    """Yield the error of the base, and the places of all markers but the last, for recordings of positions."""
    if all(e.without_positions for e in experiments):
        return
    now = {n: v for n, v in mechanics_of(model).base_values.items() if n != "base_tilt_z"}
    yield term("base", "", [Parameter(n, v) for n, v in now.items()], now)
    offsets = {f"base_{axis}": 0.0 for axis in "xyz"[: mechanics_of(model).dimension]}
    yield term("origin", "", [Parameter(n, v) for n, v in offsets.items()], offsets)
    if markers := other_markers(model, experiments):
        yield term("markers", "", markers, values_of(markers))


def lengthening(model: Model, experiments: Sequence[Experiment]) -> Iterator[Term]:
    """Yield a segment that lengthens under pressure, or the segments that tendons shorten, for a body of constant
    length in space, or in a plane if its stations move apart by 1 %.
    """
    gains = [f"{start}axial_gain" for start, c in zip(prefixes(model), model.chambers, strict=True)
             if c.uses("axial_gain")]  # fmt: skip
    apart = max([grown(e) for e in experiments if not e.without_positions and len(e.stations) > 1], default=0.0)
    chain = mechanics_of(model)
    if chain.lengthens or not apart > TERMS_OF_CHAINS[type(chain)].grown:
        return
    if gains:
        yield term("lengthening", "", [*(Parameter(n, 0.0) for n in gains), held("axial_stiffness", 1000.0),
                                       held("axial_damping", 10.0)], dict.fromkeys(gains, 0.0),
                   segments=(Extension(1000.0, 10.0),))  # fmt: skip
    elif segments := segments_of_tendons(model):
        stiff = [Parameter(f"{e.name}.axial_stiffness", e.stiffness, prior_std=FIRM * e.stiffness) for e in segments]
        damped = [held(f"{e.name}.axial_damping", e.damping) for e in segments]
        grid = ({n: factor * k for n, k in values_of(stiff).items()} for factor in SOFTER)
        yield term("segments", "", [*stiff, *damped], {}, grid=tuple(grid), segments=segments)


def curved_walls(model: Model, longer: Sequence[Term]) -> Iterator[Term]:
    """Yield a wall that stiffens with the strain, for a body that lengthens or that a term in `longer` lengthens."""
    names = ("axial_stiffening", "axial_cubic_stiffening")
    for needs, segments in (*((t.name, t.segments) for t in longer), ("", model.extensions)):
        curved = tuple(replace(e, stiffening=e.stiffening or 0.0, cubic_stiffening=e.cubic_stiffening or 0.0,
                               stiffens_bending=model.space is not None) for e in segments)  # fmt: skip
        if curved:
            yield term("wall_stiffening", "", [Parameter(n, 0.0) for n in names], dict.fromkeys(names, 0.0),
                       needs=needs, segments=curved)  # fmt: skip
