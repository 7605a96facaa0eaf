"""Parameters that change when an arm is mounted anew: which they are, and how wide their priors are."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Literal, NamedTuple

import numpy as np

from pliant.identification.chamber_parameters import prefixes
from pliant.identification.experiment import Experiment
from pliant.identification.names import find_path
from pliant.identification.parameters import Parameter
from pliant.mechanics import mechanics_of
from pliant.model import Model
from pliant.model.parts import BODY

TIGHTENED = ("pretension", "imbalance")  # fields of inputs that change when tendons are tightened anew
LEAST_PRETENSION = 1.0  # N: smallest width of the prior of a pretension


class MountingRow(NamedTuple):
    """Width of the prior of a parameter that changes when an arm is mounted anew.

    Attributes
    ----------
    width : float
        Standard deviation, as a multiple of `of`.
    of : str
        "SI": the parameter's SI unit; "length", "mass": those of the body; "joints": the SI unit, for the whole body,
        whose joints share it evenly; "pretension": the largest pretension of a tendon.
    reason : str
    """

    width: float
    of: Literal["SI", "length", "mass", "joints", "pretension"]
    reason: str


MOUNTING = {  # by the name of a parameter without owner and number
    "base_tilt": MountingRow(0.1, "SI", "the base is clamped by eye"),
    "base_angle": MountingRow(0.1, "SI", "the base is clamped by eye"),
    "gravity_angle": MountingRow(0.1, "SI", "the base is clamped by eye"),
    "base_x": MountingRow(0.1, "length", "base or cameras are moved"),
    "base_y": MountingRow(0.1, "length", "base or cameras are moved"),
    "base_z": MountingRow(0.1, "length", "base or cameras are moved"),
    "rest_turn": MountingRow(0.15, "joints", "another shape at rest; a constant torque, as of an input's zero"),
    "rest_angle": MountingRow(0.15, "joints", "another shape at rest; a constant torque, as of an input's zero"),
    "along": MountingRow(0.05, "length", "markers are attached anew"),
    "across": MountingRow(0.05, "length", "markers are attached anew"),
    "aside": MountingRow(0.05, "length", "markers are attached anew"),
    "pretension": MountingRow(0.3, "pretension", "tendons are tightened anew"),
    "imbalance": MountingRow(0.3, "pretension", "tendons are tightened anew; the zero of a motor"),
    "tip_mass": MountingRow(0.1, "mass", "another gripper, cable or marker at the tip"),
    "start": MountingRow(0.05, "SI", "clocks of shape and inputs are started anew"),
    "latency": MountingRow(0.05, "SI", "clocks of shape and inputs are started anew"),
}
COMMON_GAIN = 0.1  # standard deviation of a factor on the gains of all inputs: another sensor, supply or amplifier
COMMON = "common_gain"  # name of that factor in results


def of_mounting(name: str) -> bool:
    """Return whether a parameter of a fit changes when the arm is mounted anew."""
    path = find_path(name)
    return path is not None and path.stem in MOUNTING


def of_geometry(name: str) -> bool:
    """Return whether a parameter of the mounting is one of base, frame, rest shape or markers, which an arm has however
    it is used: not of its load, its clock or its tendons.
    """
    path = find_path(name)
    return path is not None and path.stem in MOUNTING and path.stem not in (*TIGHTENED, "tip_mass", "start", "latency")


def width_of(name: str, model: Model) -> float:
    """Return the standard deviation (SI) of the prior of a mounting parameter, such as ``base_tilt_x``."""
    path = find_path(name)
    if path is None or path.stem not in MOUNTING:
        raise KeyError(f"{name} is not a parameter of the mounting")
    row = MOUNTING[path.stem]
    taut = [abs(c.value_of("pretension")) for c in model.chambers]
    size = {"SI": 1.0, "length": model.length, "mass": float(model.link_mass.sum()), "joints": model.n**-0.5,
            "pretension": max([LEAST_PRETENSION / row.width, *taut])}  # fmt: skip
    return row.width * size[row.of]


def mounting_parameters(
    model: Model, experiments: Sequence[Experiment], values: Mapping[str, float],
) -> list[Parameter]:
    """Return the parameters of the mounting that recordings of a day can show, each free with a wide prior.

    Parameters
    ----------
    model : Model
        The fitted model of the earlier day.
    experiments : sequence of Experiment
        Recordings of the new day.
    values : mapping
        Fitted values (SI) of the earlier day, by name. A mounting parameter without a value there has that of the
        model, or 0.
    """
    means = {**standing(model, experiments), **{n: v for n, v in values.items() if of_mounting(n)}}
    parameters = []
    for name, mean in means.items():
        p = Parameter(name, prior=mean, prior_std=width_of(name, model), source="prior of the mounting")
        parameters.append(p.with_(value=float(np.clip(mean, p.lower, p.upper))))
    return parameters


def standing(model: Model, experiments: Sequence[Experiment]) -> dict[str, float]:
    """Return the values (SI) of a model's mounting parameters that recordings with positions or angles can show."""
    values = {"tip_mass": model.tip_mass} if model.gravity.any() or not all(e.poses for e in experiments) else {}
    if any(e.excitation == "trace" and not e.poses for e in experiments):
        values["start"] = 0.0
    values |= mechanics_of(model).angle_values
    for prefix, chamber in zip(prefixes(model), model.chambers, strict=True):
        values |= {f"{prefix}{name}": chamber.value_of(name) for name in TIGHTENED if chamber.uses(name)}
    return values | (standing_in_frame(model, experiments) if not experiments[0].without_positions else {})


def standing_in_frame(model: Model, experiments: Sequence[Experiment]) -> dict[str, float]:
    """Return the values (SI) of the mounting parameters that positions alone show: base, frame, and marker places."""
    chain = mechanics_of(model)
    fields = ("along", "across", "aside")[: chain.dimension]
    values = {f"base_{axis}": 0.0 for axis in "xyz"[: chain.dimension]} | chain.base_values
    observed = {s for e in experiments for s in e.stations if not e.own_places}
    for point in model.points:
        if point.name in observed:
            values |= {f"{point.name}.{field}": float(getattr(point, field)) for field in fields}
    return values


def common_gain(names: Sequence[str], values: Mapping[str, float]) -> np.ndarray:
    """Return the change (P,) of the parameters `names` with the logarithm of a factor on all inputs, SI.

    A factor g on the values of all inputs is a factor g^k on the k-th coefficient of a torque law, or, where the laws
    are held constant, a factor g on the gains of the joints and on the axial force.
    """
    paths = {n: path for n in names if (path := find_path(n))}
    lawful = {path.owner for path in paths.values() if path.stem == "torque"}

    def power(name: str) -> float:
        path = paths.get(name)
        if path is None or path.part is BODY:
            return 0.0
        if path.stem == "torque":
            return float(path.number)
        gains = ("gain", "gain_x", "gain_y", "joint_gain", "cross_gain", "axial_gain")
        return float(path.stem in gains and not lawful & {"", path.owner})

    return np.array([power(n) * values[n] for n in names])
