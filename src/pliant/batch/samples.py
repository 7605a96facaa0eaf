"""Model parameters of many chains, stored as arrays with the samples along the last axis."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from operator import attrgetter
from typing import Any

import numpy as np

from pliant.errors import InputError, SimulationError
from pliant.identification.names import find_path
from pliant.mechanics.springs import small_motions, springs_of
from pliant.model import Model, Valve, fixed_length
from pliant.model import model as model_fields
from pliant.model.chamber import RUBBER, grown, remembering
from pliant.model.inertia import inertia_constants
from pliant.simulation import state

Array = np.ndarray
SCALARS = (*model_fields.SCALARS, *RUBBER)
PER_LINK = (*model_fields.PER_LINK, "joint_gain")
ALIKE = {name: attrgetter(name) for name in ("n", "mass_at", "memory")}  # of all models of a batch
LAG = {f"valve_{field}": field for field in ("rise_time", "fall_time", "dead_time")}  # of a batch's valves


@dataclass(frozen=True)
class Samples:
    """Model parameters of N chains of n links each, as arrays with the samples along the last axis.

    Attributes
    ----------
    template : Model
        Model with everything that the samples share, such as number of links and mass distribution.
    values : dict
        Arrays by field of `Model`: per link (n, N), torque (k, N), gravity (2, N), scalars (N,).
    valves : tuple of Valve
        One for each sample.
    """

    template: Model
    values: dict[str, Array]
    valves: tuple[Valve, ...]

    @property
    def size(self) -> int:
        """Return the number of samples, N."""
        return len(self.valves)

    def model(self, i: int) -> Model:
        """Return sample `i` as a `Model`."""
        return self.template.with_(**{k: v[..., i] for k, v in self.values.items()}, valve=self.valves[i])

    def inertia(self) -> tuple[Array, Array, Array]:
        """Return the inertia constants of N chains of n links: coupling matrix B (n, n, N) and rotary inertias (n, N)
        [kg m^2], and first moments h (n, N) [kg m].
        """
        v, rod = self.values, self.template.mass_at == "rod"
        return inertia_constants(v["link_length"], v["link_mass"], v["tip_mass"], rod=rod, tip_inertia=v["tip_inertia"])

    def torque_at(self, pressure: Array) -> Array:
        """Return the static torque (N,) [N m] of each sample at its pressure (N,) [Pa]."""
        powers = np.arange(1, len(self.values["torque"]) + 1)
        torque = np.sum(self.values["torque"] * pressure ** powers[:, None], axis=0)
        return grown(torque, pressure, self.values)

    @property
    def remembering(self) -> Array:
        """Return for each of N samples whether its torque depends on past pressures, by lag or wall dynamics."""
        return remembering(self.values)

    def rest(self, pressure: Array) -> Array:
        """Return the equilibrium angles (n, N) [rad] of the n joints of N samples under pressures (N,) [Pa] and
        gravity.
        """
        if not self.values["gravity"].any():
            q = springs_of(self.values).bend(self.values["joint_gain"] * self.torque_at(pressure))
            if not np.isfinite(q).all():
                raise SimulationError(
                    f"in {int((~np.isfinite(q).all(axis=0)).sum())} of {self.size} samples the softening springs "
                    "cannot balance the pressure: lower the pressure, or the magnitude of the stiffening"
                )
            return q
        known: dict[bytes, Array] = {}
        q = np.empty((self.template.n, self.size))
        for i in range(self.size):  # where samples differ in the pressure alone, one search serves all
            key = b"".join(np.ascontiguousarray(v[..., i]).tobytes() for v in (*self.values.values(), pressure))
            if key not in known:
                known[key] = state.equilibrium(self.model(i), float(pressure[i]))
            q[:, i] = known[key]
        return q

    def absolute(self, q: Array) -> Array:
        """Return the absolute angles (n, N) [rad] of the n links of N samples, from joint angles q (n, N) [rad]."""
        return self.values["base_angle"] + np.cumsum(q + self.values["rest_angle"], axis=0)

    def small_motions(self) -> tuple[Array, Array]:
        """Return the inertia and stiffness matrices (N, n, n) of N samples with n joints each, for small motions about
        the equilibrium without pressure.
        """
        q = self.rest(np.zeros(self.size))
        return small_motions(self.inertia(), self.values["gravity"], springs_of(self.values), q, self.absolute(q))

    def first_frequency(self) -> Array:
        """Return the lowest undamped natural frequency (N,) [Hz] of each sample at rest without pressure."""
        M, K = self.small_motions()
        inverse = np.linalg.inv(np.linalg.cholesky(M))
        squared = np.linalg.eigvalsh(inverse @ K @ np.swapaxes(inverse, 1, 2))[:, 0]
        return np.sqrt(np.maximum(squared, 0.0)) / (2 * np.pi)

    def highest_first_frequency(self) -> float:
        """Return an upper bound [Hz] of the first natural frequencies of all samples."""
        M, K = self.small_motions()
        squared = K.sum(axis=(1, 2)) / M.sum(axis=(1, 2))  # Rayleigh quotient of equal joint angles
        return float(np.sqrt(max(0.0, squared.max())) / (2 * np.pi))


def gather(models: Model | Sequence[Model], parameters: Mapping[str, Any] | None, size: int) -> Samples:
    """Return `Samples` of a list of models, or of one model. One model is repeated `size` times, or once for each
    sample in the arrays of `parameters`.
    """
    for model in (models,) if isinstance(models, Model) else models:
        fixed_length(model)
    if isinstance(models, Model):
        return repeated(models, parameters or {}, size)
    if parameters:
        raise InputError("give a list of models, or one model with parameters, not both")
    models = tuple(models)
    if not models:
        raise InputError("a batch needs at least one model")
    template = models[0]
    check_alike(models, ALIKE)
    values: dict[str, Array] = {}
    longest = max(m.torque.size for m in models)
    for name in (*PER_LINK, *SCALARS, "gravity"):
        values[name] = np.stack([own_value(m, name) for m in models], axis=-1)
    values["torque"] = np.stack([np.pad(m.torque, (0, longest - m.torque.size)) for m in models], axis=-1)
    return Samples(template, values, tuple(m.valve for m in models))


def check_alike(models: Sequence[Model], shared: Mapping[str, Callable[[Model], Any]]) -> None:
    """Raise InputError if the models of a batch differ in one of the properties `shared`, given by name."""
    for name, of in shared.items():
        if any(of(m) != of(models[0]) for m in models):
            raise InputError(f"the models of a batch must share {name}: simulate others in a separate batch")


def repeated(model: Model, parameters: Mapping[str, Any], size: int) -> Samples:
    """Return `Samples` of one model. Arrays in `parameters`, (N,) for N samples or (N, n) for the n links of each,
    replace the model's values.
    """
    arrays = {name: np.asarray(value, dtype=float) for name, value in parameters.items()}
    lengths = {a.shape[0] for a in arrays.values() if a.ndim} | ({size} if size > 1 else set())
    if len(lengths) > 1:
        raise InputError(f"all parameters and pressures of a batch need the same number of samples, got {lengths}")
    count = lengths.pop() if lengths else 1
    values = {}
    for name in (*PER_LINK, *SCALARS, "gravity", "torque"):
        default = np.asarray(own_value(model, name), dtype=float)
        values[name] = np.repeat(default[..., None], count, axis=-1)
    valves: dict[str, Array] = {}
    for name in sorted(arrays, key=lambda name: name[-1].isdigit()):  # what holds for all joints first, then for one
        put(values, valves, name, arrays[name])
    every = {field: np.broadcast_to(a, (count,)) for field, a in valves.items()}
    lag = tuple(
        replace(model.valve, **{f: float(a[i]) for f, a in every.items()}) for i in range(count if every else 1)
    )
    samples = Samples(model, values, lag if every else lag * count)
    check_extremes(samples)
    return samples


def own_value(model: Model, name: str) -> Any:
    """Return the value of the named field of a model or, if it has no such field, of its only chamber."""
    return getattr(model.chamber if name in RUBBER else model, name)


def stored(name: str) -> bool:
    """Return whether `put` has an array for a parameter: one of the links, the springs, the torque law or the valve."""
    path = find_path(name)
    if path and not path.owner and ((path.of_one_joint and path.field in PER_LINK) or path.quantity.per == "power"):
        return True
    return name in ("mass", "gain", "gravity", "torque") or name in LAG or name in (*PER_LINK, *SCALARS)


def put(values: dict[str, Array], valves: dict[str, Array], name: str, given: Array) -> None:
    """Store the values of one parameter, (N,) for N samples or (N, n) for the n links of each, in the dict `values` or,
    if it is one of the valve, in `valves`.
    """
    path = find_path(name)  # names as in a fit, or fields of `Model`
    if path and path.of_one_joint and path.field in values and 1 <= path.number <= len(values[path.field]):
        values[path.field][path.number - 1] = given
    elif path and path.quantity.per == "power":
        missing = path.number - len(values[path.field])
        values[path.field] = np.pad(values[path.field], ((0, max(0, missing)), (0, 0)))
        values[path.field][path.number - 1] = given
    elif name == "mass":
        values["link_mass"] = values["link_mass"] * (given / values["link_mass"].sum(axis=0))
    elif name == "gain":
        values["joint_gain"] = values["joint_gain"] * (given / values["joint_gain"].mean(axis=0))
    elif name in LAG:
        valves[LAG[name]] = given
    elif name in values:
        if given.ndim > 1 and given.T.shape != values[name].shape:
            raise InputError(
                f"batch parameter {name!r} must be an array (samples,), or (samples, links) for a property of each "
                f"link, got shape {given.shape}"
            )
        values[name] = np.broadcast_to(given.T, values[name].shape).copy()
    else:
        known = [*values, "stiffness_<i>", "damping_<i>", "torque_<k>", "mass", "gain", *LAG]
        raise InputError(f"unknown batch parameter {name!r}: use one of {', '.join(known)}")


def initial_values(value: Array, size: int, n: int) -> Array:
    """Return initial angles or rates as an array (size, n) of `size` samples with n coordinates each. A row (n,) counts
    for all samples. Raise InputError for another shape, or for numbers that are not finite.
    """
    a = np.asarray(value, dtype=float)
    if a.shape not in ((n,), (size, n)):
        raise InputError(f"initial angles and rates must have the shape ({n},) or ({size}, {n}), got shape {a.shape}")
    if bad := int((~np.isfinite(a)).sum()):
        raise InputError(f"initial angles and rates must be finite, but {bad} of {a.size} are not: correct them")
    return np.broadcast_to(a, (size, n))


def check_extremes(samples: Samples) -> None:
    """Raise InputError if any sample has a parameter that is not finite or outside the range that a model allows."""
    for name, a in samples.values.items():
        bad = int((~np.isfinite(np.atleast_2d(a)).all(axis=0)).sum())
        if bad:
            raise InputError(
                f"batch parameter {name} must be finite: in {bad} of {samples.size} samples it is not; correct or "
                "remove these samples"
            )
    for extreme in (np.min, np.max):
        samples.template.with_(**{name: extreme(a, axis=-1) for name, a in samples.values.items()})
