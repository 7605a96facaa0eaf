"""The terms that a search may add to a model: each with its parameters, and the values at which it has no effect."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from pliant.identification.chamber_parameters import has_effect, prefixes
from pliant.identification.experiment import Experiment
from pliant.identification.parameters import Parameter
from pliant.model import Chamber, Extension, Model, Tendon

NO_SHARE = 1e-6  # fraction at which a hysteresis branch or a late part of the pressure has no effect
TIMES = (0.1, 0.7, 5.0)  # s, of creep
LENGTHENING = "body"  # name of the segment that lengthens


class Term(NamedTuple):
    """A term that a search may add to a model.

    Attributes
    ----------
    name, title : str
    adds : tuple of Parameter
        The parameters of the term. Their values are the start of a fit.
    null : mapping
        Values (SI) at which the term has no effect, by parameter; the derivatives are taken there. Parameters without an
        entry keep the value of `grid` or of `adds`. Of a term that replaces a parameter: factors on its value.
    grid : tuple of mappings
        Values of the parameters that have no effect of their own there, such as times: each is tried.
    replaces : tuple of str
        Parameters that the term's parameters replace.
    group : str
        Alternatives have the same group: a model has one of them at most. Default: the name.
    needs : str
        Name of a term without which this one has no meaning.
    extension : Extension or None
        Segment that the model needs for this term, so that its body lengthens.
    """

    name: str
    title: str
    adds: tuple[Parameter, ...]
    null: Mapping[str, float]
    grid: tuple[Mapping[str, float], ...] = ({},)
    replaces: tuple[str, ...] = ()
    group: str = ""
    needs: str = ""
    extension: Extension | None = None

    def model(self, model: Model) -> Model:
        """Return the model, with the segment that lengthens if the term needs one."""
        return model if self.extension is None else model.with_(extensions=(self.extension,))

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
        return [p.with_(value=float(np.clip(values.get(p.name, row.get(p.name, p.value)), p.lower, p.upper)))
                for p in self.adds]


def free(name: str, value: float, **options: Any) -> Parameter:
    """Return a free parameter with a start value (SI)."""
    return Parameter(name, value, **options)


def held(name: str, value: float) -> Parameter:
    """Return a parameter that is held constant (SI)."""
    return Parameter(name, value, free=False)


def terms_for(model: Model, experiments: Sequence[Experiment]) -> tuple[Term, ...]:
    """Return the terms that may be added to a model for these recordings, in plane or space, for chambers and tendons.

    Parameters
    ----------
    model : Model
        The model of the parent: its chambers, tendons, segments and space decide which terms exist.
    experiments : sequence of Experiment
        Training recordings.
    """
    return (*springs(model), *relaxation(), *friction(model), *inputs(model, experiments), *places(model, experiments),
            *lengthening(model))  # fmt: skip


def springs(model: Model) -> Iterator[Term]:
    """Yield the terms of the joints' springs. Laws that lose all stiffness at a large bend are not among them."""
    yield Term("softening", "springs that soften or stiffen, within a bound",
               (free("stiffening", 0.0), held("stiffening_bound", 0.75)), {"stiffening": 0.0})
    yield Term("cubic", "springs that stiffen with the square of the bend",
               (free("cubic_stiffening", 0.05, lower=0.0),), {"cubic_stiffening": 0.0})
    if model.n > 1:
        each = [f"stiffness_{i + 1}" for i in range(model.n)]
        ratio = model.stiffness / model.stiffness.mean()
        yield Term("joints", "stiffness of each joint", tuple(Parameter(n, shrink=0.3) for n in each),
                   {n: float(r) for n, r in zip(each, ratio, strict=True)}, replaces=("stiffness",), group="joints")
    if model.space is not None:
        yield Term("directions", "another stiffness about y", (free("stiffness_ratio", 1.0),),
                   {"stiffness_ratio": model.space.stiffness_ratio})


def relaxation() -> Iterator[Term]:
    """Yield creep of the joints, one branch and a second one."""
    yield branch("creep", "creep", "creep_share_1", "creep_time_1", TIMES)
    yield branch("creep_2", "second creep branch", "creep_share_2", "creep_time_2", (0.3, 2.0, 15.0))._replace(
        needs="creep")


def friction(model: Model) -> Iterator[Term]:
    """Yield friction of the joints: two laws, of which a model has one."""
    yield branch("slip", "internal friction", "slip_share_1", "slip_angle_1", (0.003, 0.02, 0.1))._replace(
        group="friction")


def branch(name: str, title: str, share: str, inner: str, grid: Sequence[float], start: float = 0.1) -> Term:
    """Return a term of a fraction `share` without effect at 0, and an inner time or angle that is tried on a grid."""
    return Term(name, title, (free(share, start), free(inner, grid[0])), {share: NO_SHARE},
                tuple({inner: v} for v in grid))


def inputs(model: Model, experiments: Sequence[Experiment]) -> Iterator[Term]:
    """Yield the terms of the inputs: torque laws of chambers, lags of valves, clock and sensor."""
    moving = [e for e in experiments if e.excitation != "release"]
    if not moving:
        return
    for start, chamber in zip(prefixes(model), model.chambers, strict=True):
        if not isinstance(chamber, Tendon):
            yield from torque_laws(start, chamber, experiments)
    if all(e.poses for e in moving):
        return
    if any(has_effect("valve_rise", c) for c in model.chambers):
        yield Term("lag", "lag of the input", (free("valve_rise", 0.02), free("valve_fall", 0.02)),
                   {"valve_rise": 0.0, "valve_fall": 0.0})
        yield branch("settle", "late settling of the input", "valve_settle_share", "valve_settle_time",
                     (0.3, 1.0, 3.0))._replace(group="settle")
    if any(e.excitation == "trace" for e in moving):
        yield Term("clock", "offset of the input's clock", (free("start", 0.0),), {"start": 0.0})


def torque_laws(start: str, chamber: Chamber, experiments: Sequence[Experiment]) -> Iterator[Term]:
    """Yield the terms of one pressure chamber's torque law; `start` is the prefix of its parameters."""
    group = f"{start}torque"
    title = f" of {chamber.name}" if start else ""
    if chamber.torque.size < 2 or not chamber.torque[1]:
        yield Term(f"{start}torque_2", f"curvature of the torque law{title}", (free(f"{start}torque_2", 0.0),),
                   {f"{start}torque_2": 0.0}, group=group)
        yield Term(f"{start}torque_3", f"odd cubic torque law{title}", (free(f"{start}torque_3", 0.0),),
                   {f"{start}torque_3": 0.0}, group=group)
    yield branch(f"{start}swell", f"late part of the torque{title}", f"{start}swell_share", f"{start}swell_time",
                 (0.1, 0.5, 2.0))._replace(needs=f"{start}torque_2")


def places(model: Model, experiments: Sequence[Experiment]) -> Iterator[Term]:
    """Yield errors of the base tangent and of the last station's position, for recordings of few stations."""
    if all(e.without_positions for e in experiments):
        return
    if model.space is None:
        yield Term("base", "error of the base tangent", (free("base_angle", model.base_angle),),
                   {"base_angle": model.base_angle})
    else:
        tilt = model.space.base_tilt
        names = ["base_tilt_x", "base_tilt_y"]
        yield Term("base", "error of the base tangent", tuple(free(n, float(t)) for n, t in zip(names, tilt, strict=False)),
                   {n: float(t) for n, t in zip(names, tilt, strict=False)})


def lengthening(model: Model) -> Iterator[Term]:
    """Yield a segment that lengthens under pressure, for models whose body has a constant length."""
    gains = [f"{start}axial_gain" for start, c in zip(prefixes(model), model.chambers, strict=True)
             if not isinstance(c, Tendon)]  # fmt: skip
    if model.extensions or not gains:
        return
    yield Term("lengthening", "a body that lengthens",
               (*(free(n, 0.0) for n in gains), held("axial_stiffness", 1000.0), held("axial_damping", 10.0)),
               dict.fromkeys(gains, 0.0), extension=Extension(1000.0, 10.0, name=LENGTHENING))
