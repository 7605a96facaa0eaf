"""Step-by-step simulation of many chains at once, which keep their state between the calls."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from operator import attrgetter
from typing import Any, Protocol

import numpy as np

from pliant.batch import simd_loops, space_loops
from pliant.batch.samples import ALIKE, check_alike
from pliant.batch.simd_loops import Commanded, Lane
from pliant.batch.space_lanes import scratch_of
from pliant.compiler import WIDTH
from pliant.compiler.choose import lane_twin
from pliant.compiler.simd import aligned
from pliant.errors import InputError, SimulationError
from pliant.mechanics import mechanics_of
from pliant.model import Model
from pliant.model.features import FIRST_ORDER, VALVES, Consumer
from pliant.simulation import Stepper, state
from pliant.simulation.chamber_course import lag_of
from pliant.simulation.solve import check_step
from pliant.simulation.stepper import STEPPER

Array = np.ndarray


BATCH_STEPPER = Consumer(
    "a batch that is simulated step by step", STEPPER.can, remedy={k: STEPPER.remedy[k] for k in VALVES - FIRST_ORDER},
)
SHAPE: dict[str, Callable[[Model], Any]] = {
    "the number of their coordinates": attrgetter("size"), "the space they move in": lambda m: m.space is None,
}


class BatchStepper(Protocol):
    """Step-by-step simulator of `size` chains, which keep their states between the calls."""

    size: int

    @property
    def position(self) -> Array:
        """Coordinates (size, N) of the chains, as those of `Stepper.position`."""

    @property
    def velocity(self) -> Array:
        """Rates (size, N) of the coordinates."""

    def reset(self, which: Array, bodies: Array) -> None:
        """Restart the chains with the indices `which` (M,) at rest without pressure, as the models with the indices
        `bodies` (M,).
        """

    def hold(self, pressure: Array, steps: int) -> Array:
        """Advance all chains by `steps` time steps under constant inputs (size, C). Return for each chain whether it
        failed, as booleans (size,).
        """


def batch_stepper(models: Sequence[Model], size: int, time_step: float) -> BatchStepper:
    """Return a step-by-step simulator of `size` chains, all of which start with the first of `models`.

    Raises
    ------
    InputError
        When the models differ in kind, the `time_step` [s] is too long for one, or `Stepper` does not support a valve.
    """
    for model in models:
        BATCH_STEPPER.check(model)
    first = models[0]
    Stepper(first, time_step, np.zeros(first.actuation.count))  # a step that it refuses is refused
    alike = {k: of for k, of in ALIKE.items() if k != "memory" or not all(m.memory for m in models)}
    check_alike(models, alike | SHAPE)
    if len({m.actuation.count for m in models}) > 1:
        raise InputError("the models of a batch must have equally many chambers: simulate others in a separate batch")
    for model in models[1:]:
        check_step(model, time_step, "midpoint")
    kinds = {(mechanics_of(m).simd, mechanics_of(m).sizes) for m in models}
    simd = kinds.pop()[0] if len(kinds) == 1 else ""
    return STEPPERS[simd](models, size, time_step)


def check_commands(pressure: Array, shape: tuple[int, int]) -> None:
    """Raise InputError unless there is a pressure for each of N chains and C chambers; `shape` is (N, C)."""
    if np.shape(pressure) != shape:
        raise InputError(
            f"expected pressures {shape} of {shape[0]} chains and {shape[1]} chambers, got shape {np.shape(pressure)}"
        )


class LanePool:
    """Step-by-step simulator of many chains without hysteresis, `WIDTH` at once in each SIMD vector."""

    def __init__(self, models: Sequence[Model], size: int, time_step: float, pool: dict[str, Array]) -> None:
        self.size, self._pool = size, pool
        groups = -(-size // WIDTH)
        C, N = len(models[0].chambers), pool["gain"].shape[-1]
        lanes_last = {k: aligned((groups, *a.shape[1:], WIDTH)) for k, a in pool.items() if k not in OF_CHAMBERS}
        chambers = {k: np.zeros((groups, WIDTH, *a.shape[1:])) for k, a in pool.items() if k in OF_CHAMBERS}
        self._arrays = a = lanes_last | chambers
        self._state = a["state"]
        self._chambers = Commanded(
            np.zeros((groups, WIDTH, C)), a["law"], a["gain"], a["rubber"], a["valve"],
            a["pressure"], a["slow"], np.zeros((WIDTH, N)),
        )
        self._h = aligned((1, WIDTH))
        self._h[:] = time_step
        self._failed = np.zeros((groups, WIDTH), dtype=np.int64)
        every = np.arange(groups * WIDTH)
        self.reset(every, np.zeros_like(every))

    @property
    def position(self) -> Array:
        """Return the coordinates (size, N) of the chains, in the plane the absolute angles [rad] of their links."""
        return np.moveaxis(self._state[:, 0], -1, 1).reshape(-1, self._state.shape[2])[: self.size]

    @property
    def velocity(self) -> Array:
        """Return the rates (size, N) of the coordinates."""
        return np.moveaxis(self._state[:, 1], -1, 1).reshape(-1, self._state.shape[2])[: self.size]

    def reset(self, which: Array, bodies: Array) -> None:
        """Restart M of the chains at rest without pressure. The chain with index which[k] receives the model with index
        bodies[k], for k from 0 to M - 1.
        """
        group, lane = np.divmod(which, WIDTH)
        for name, array in self._pool.items():
            if name in OF_CHAMBERS:
                self._arrays[name][group, lane] = array[bodies]
            else:
                self._arrays[name][group, ..., lane] = array[bodies]

    def hold(self, pressure: Array, steps: int) -> Array:
        """Advance all chains by `steps` time steps under constant pressures (size, C) [Pa] in C chambers. Return for
        each chain whether it failed, as booleans (size,).
        """
        command = self._chambers.command
        check_commands(pressure, (self.size, command.shape[-1]))
        command.reshape(-1, command.shape[-1])[: self.size] = pressure
        self.advance(steps)
        return np.asarray(self._failed.ravel()[: self.size] > 0)

    def advance(self, steps: int) -> None:
        """Advance all chains by `steps` time steps under the commands, and note in `_failed` which of them fail."""
        raise NotImplementedError


class OnLanes(LanePool):
    """Simulator of chains in the plane."""

    def __init__(self, models: Sequence[Model], size: int, time_step: float) -> None:
        super().__init__(models, size, time_step, pool_of(models))
        n, a = models[0].n, self._arrays
        self._samples = Lane((a["B"], a["I"], a["h"], a["gravity"]), a["joints"], a["place"])
        self._scratch = tuple(aligned(shape) for shape in ((n, n, WIDTH), (n, n, WIDTH), (7, n + 1, WIDTH)))
        self._hold = lane_twin(simd_loops.hold_lanes, *mechanics_of(models[0]).sizes)

    def advance(self, steps: int) -> None:
        self._hold(self._h, steps, self._chambers, self._samples, self._state, self._scratch, self._failed)


class OnSpaceLanes(LanePool):
    """Simulator of chains in space without tendons."""

    def __init__(self, models: Sequence[Model], size: int, time_step: float) -> None:
        super().__init__(models, size, time_step, space_pool_of(models))
        chain, a = mechanics_of(models[0]), self._arrays
        self._groups = [
            tuple(type(record)(*(a[f"{part}.{k}"][group] for k in record._fields))
                  for part, record in (("body", chain.body), ("joints", chain.joints)))
            for group in range(len(self._state))
        ]  # fmt: skip
        self._work = scratch_of(chain)
        self._hold = lane_twin(space_loops.hold_in_space, *chain.sizes)

    def advance(self, steps: int) -> None:
        for group, chain in enumerate(self._groups):
            state, failed = self._state[group], self._failed[group]
            self._hold(self._h, steps, group, self._chambers, state, chain, self._work, failed)


OF_CHAMBERS = frozenset({"law", "gain", "rubber", "valve", "pressure", "slow"})  # arrays with the coordinates last


def pool_of(models: Sequence[Model]) -> dict[str, Array]:
    """Return, by name, the constants and rest states of several models in a plane, the models along the first axis."""
    rows: list[dict[str, Array]] = []
    for m in models:
        body, joints = mechanics_of(m).body, mechanics_of(m).joints
        rows.append({
            **chambers_at_rest(m), "B": body.B, "I": body.I, "h": body.h, "gravity": np.array([body.gx, body.gy]),
            "joints": np.stack([joints.theta0, joints.K, joints.D, np.zeros(m.n), *joints.hardening]),
            "place": np.array([*m.link_length, *m.first_joint, joints.base_angle]),
        })  # fmt: skip
    return pooled(rows)


def space_pool_of(models: Sequence[Model]) -> dict[str, Array]:
    """Return, by name, the constants and rest states of several models in space, the models along the first axis."""
    return pooled([
        chambers_at_rest(m) | {f"{part}.{k}": np.asarray(value) for part, record in
                               (("body", mechanics_of(m).body), ("joints", mechanics_of(m).joints))
                               for k, value in record._asdict().items()}
        for m in models
    ])  # fmt: skip


def chambers_at_rest(model: Model) -> dict[str, Array]:
    """Return the state of a model at rest without pressure, and the constants and states of its chambers, by name."""
    drive, none = model.actuation.kernel(), np.zeros(model.actuation.count)
    x = mechanics_of(model).coordinates(state.equilibrium(model, none))
    return {
        "state": np.stack([x, 0.0 * x]), "law": drive.law, "gain": drive.gain, "rubber": drive.rubber,
        "valve": np.array([lag_of(c.valve) for c in model.chambers]), "pressure": none,
        "slow": model.actuation.rest_state(none),
    }


def pooled(rows: list[dict[str, Array]]) -> dict[str, Array]:
    """Return the arrays of several models by name, the models along the first axis; torque laws have one length."""
    longest = max(row["law"].shape[1] for row in rows)
    for row in rows:
        row["law"] = np.pad(row["law"], ((0, 0), (0, longest - row["law"].shape[1])))
    return {name: np.stack([row[name] for row in rows]) for name in rows[0]}


class OneByOne:
    """Step-by-step simulator of many chains that share no SIMD vector, each simulated by a `Stepper` of its own: with
    hysteresis or tendons, in the plane with segments that lengthen, or with bounded springs in some chains alone.
    """

    def __init__(self, models: Sequence[Model], size: int, time_step: float) -> None:
        self.size = size
        self._models, self._time_step = models, time_step
        self._time_steppers = [self._new(0) for _ in range(size)]

    def _new(self, body: int) -> Stepper:
        model = self._models[body]
        return Stepper(model, self._time_step, np.zeros(model.actuation.count))

    @property
    def position(self) -> Array:
        """Return the coordinates (size, N) of the chains: angles [rad], then strains."""
        return np.stack([s.position for s in self._time_steppers])

    @property
    def velocity(self) -> Array:
        """Return the rates (size, N) of the coordinates."""
        return np.stack([s.velocity for s in self._time_steppers])

    def reset(self, which: Array, bodies: Array) -> None:
        """Restart M of the chains at rest without pressure. The chain with index which[k] receives the model with index
        bodies[k], for k from 0 to M - 1.
        """
        for i, body in zip(which.tolist(), bodies.tolist(), strict=True):
            if self._time_steppers[i].model is self._models[body]:
                self._time_steppers[i].reset(np.zeros(len(self._models[body].chambers)))
            else:
                self._time_steppers[i] = self._new(body)

    def hold(self, pressure: Array, steps: int) -> Array:
        """Advance all N chains by `steps` time steps under constant pressures (N, C) [Pa] in C chambers. Return for
        each chain whether it failed, as booleans (N,).
        """
        failed = np.zeros(len(self._time_steppers), dtype=bool)
        check_commands(pressure, (failed.size, self._models[0].actuation.count))
        for i, (stepper, p) in enumerate(zip(self._time_steppers, pressure, strict=True)):
            try:
                stepper.step(p, steps)
            except SimulationError:
                failed[i] = True
        return failed


STEPPERS: dict[str, Callable[[Sequence[Model], int, float], BatchStepper]] = {
    "plane": OnLanes, "space": OnSpaceLanes, "": OneByOne,
}  # by `Mechanics.simd`
