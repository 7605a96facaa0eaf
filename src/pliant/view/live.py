"""A model that runs behind the live page: in short steps, pulled by hand, driven by sliders or a recording."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, NamedTuple
from warnings import catch_warnings, simplefilter

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from pliant.errors import InputError, SimulationError
from pliant.identification import Experiment
from pliant.identification.parameters import apply
from pliant.mechanics import mechanics_of
from pliant.model import Model, Station
from pliant.simulation import Stepper
from pliant.simulation.balance import EnergyWarning
from pliant.simulation.time_step import shared_step
from pliant.units import shown_in

Array = np.ndarray
SHORTEST = 1e-4  # s, of a step: a page cannot follow many more
TINY = 1e-9  # s, that a sum of frames may lack of a step
LATEST = 0.1  # s of motion that one frame of the page may catch up with
WIDE = 1.959964  # standard errors to each side of a 95 % interval
FACTORS = (0.5, 2.0)  # of stiffness and damping, where a model comes without intervals
PULL = 1.5  # stiffness of the thread between hand and body, in those of a joint over the body's length squared
Finite = Annotated[float, Field(allow_inf_nan=False)]


class Slider(NamedTuple):
    """One number of the model that the page may change."""

    name: str
    value: float
    low: float
    high: float
    unit: str


class Pull(BaseModel):
    """A hand at a point of the body."""

    model_config = ConfigDict(extra="forbid")
    link: int = Field(ge=0)
    share: float = Field(ge=0.0, le=1.0)  # of the link's length
    x_mm: Finite  # where the hand is
    y_mm: Finite
    z_mm: Finite = 0.0  # of a body in space


class Wish(BaseModel):
    """A request of the page; entries that it does not name stay as they are."""

    model_config = ConfigDict(extra="forbid")
    pressure_kpa: list[Annotated[float, Field(ge=-2000.0, le=2000.0)]] | None = None  # tendons: N, mm, rad
    gravity: Annotated[list[Annotated[float, Field(ge=-30, le=30)]], Field(min_length=2, max_length=3)] | None = None
    parameters: dict[str, Finite] | None = None
    speed: float | None = Field(None, ge=0.0, le=1.0)
    pull: Pull | None = None
    record: str | None = None
    reset: bool = False


class Played(NamedTuple):
    """Contents of the live page: a model, its adjustable parameters, recordings to play under it."""

    model: Model
    sliders: tuple[Slider, ...]
    records: Mapping[str, Experiment]
    start: float = 0.0  # s, that the pressure's clock is behind the shape's, as fitted
    log: Path | None = None  # of a control loop that is watched
    touch: float = 0.0  # N m, from which on a joint's torque is taken for a touch there


def sliders_of(model: Model, parameters: tuple[Any, ...] = ()) -> tuple[Slider, ...]:
    """Fitted parameters within their 95 % intervals; of a bare model, factors on stiffness and damping."""
    known = [p for p in parameters if p.free and p.std and p.value is not None and moves(model, p.name, p.value)]
    if known:
        return tuple(Slider(p.name, p.value, max(p.value - WIDE * p.std, p.lower), min(p.value + WIDE * p.std, p.upper),
                            p.unit) for p in known)
    return tuple(Slider(f"{name} x", 1.0, *FACTORS, "") for name in ("stiffness", "damping"))


def moves(model: Model, name: str, value: float) -> bool:
    """Whether a parameter belongs to the model, and not to one recording."""
    try:
        return apply(model, {name: 1.01 * value}) != model
    except (InputError, KeyError):
        return False


def step_of(model: Model) -> float:
    """Length of a step, s: what the model needs, as far as a page can follow."""
    return max(shared_step([model]), SHORTEST)


class Job(NamedTuple):
    """A request that needs a new stepper: numbers of the model, a start from rest, a recording."""

    changed: dict[str, Any]
    pressure: Array  # Pa, behind the valves when the job was taken
    restart: bool
    record: str | None
    other_record: bool  # whether `record` was asked for


class Live:
    """One running model; each page has its own.

    `ask` only notes what takes long to do. `job` takes it over, `prepare` does it, on another thread if need be, and
    `take` puts the result in the place of what runs; `build` does all three.

    Parameters
    ----------
    played : Played

    Raises
    ------
    InputError
        When the model cannot be stepped, as `Stepper`.
    """

    def __init__(self, played: Played) -> None:
        self.played = played
        self.model = played.model
        self.stepper = Stepper(self.model, step_of(self.model))
        self.chambers = self.model.actuation.count
        self.command = np.zeros(self.chambers)
        self.speed, self.debt, self.message = 1.0, 0.0, ""
        self.pull: Pull | None = None
        self.force = np.zeros(mechanics_of(self.model).dimension)
        self.factor = np.array([shown_in(unit)[0] for unit in self.model.actuation.units])
        self.record: Experiment | None = None
        self.changed: dict[str, Any] = {}
        self.sliders = {s.name: s for s in played.sliders}
        self.by_hand = np.zeros(self.chambers)  # Pa, what the sliders ask for while no recording is played
        self.pending = self.restarting = self.other_record = False
        self.next_record: str | None = None

    def ask(self, wish: Wish) -> None:
        """Note what the page asks for, and do what is done in no time."""
        if wish.pressure_kpa is not None and len(wish.pressure_kpa) == self.chambers:
            sent = np.array(wish.pressure_kpa) / self.factor
            pressed = np.array(self.model.actuation.units) == "Pa"
            self.by_hand[:] = np.where(pressed, np.maximum(sent, 0.0), sent)
            self.command[:] = self.by_hand
        if wish.speed is not None:
            self.speed = wish.speed
        if "pull" in wish.model_fields_set:
            self.pull = wish.pull
        if "record" in wish.model_fields_set:
            self.next_record, self.other_record, self.restarting = wish.record, True, True
        numbers = {n: v for n, v in (wish.parameters or {}).items() if n in self.sliders}
        gravity = {} if wish.gravity is None else {"gravity": np.array(wish.gravity)}
        self.changed |= {**gravity, **numbers}
        self.restarting |= wish.reset
        self.pending |= bool(numbers or gravity or self.restarting)

    def job(self) -> Job:
        """Take over what was noted; of several wishes for one thing the last."""
        job = Job(dict(self.changed), self.stepper.pressure, self.restarting, self.next_record,
                  self.other_record)
        self.pending = self.restarting = self.other_record = False
        return job

    def prepare(self, job: Job) -> tuple[Model, Stepper] | str:
        """The model of a job and its stepper; where there can be none, the sentence that says why. Changes nothing."""
        numbers = {n: float(np.clip(v, self.sliders[n].low, self.sliders[n].high))
                   for n, v in job.changed.items() if n in self.sliders}
        model = self.played.model
        pressure = np.zeros_like(job.pressure) if job.restart else job.pressure
        try:
            for name in ("stiffness", "damping"):
                if (factor := numbers.pop(f"{name} x", None)) is not None:
                    model = model.with_(**{name: factor * getattr(model, name)})
            model = apply(model, numbers)
            if "gravity" in job.changed:
                model = model.with_(gravity=job.changed["gravity"])
            return model, Stepper(model, step_of(model), pressure)
        except (InputError, SimulationError) as error:
            return str(error)

    def take(self, job: Job, made: tuple[Model, Stepper] | str) -> None:
        """Go on with what was prepared: from rest where that was asked for, else with the same motion."""
        if isinstance(made, str):
            self.message = made
            return
        model, stepper = made
        if job.restart:
            self.debt = 0.0
        else:
            stepper.restore(self.stepper.snapshot())
        if job.other_record:
            self.record = self.played.records.get(job.record or "")
            self.command[:] = self.by_hand
        self.model, self.stepper = model, stepper

    def build(self) -> None:
        """Do what was noted, at once."""
        if self.pending:
            job = self.job()
            self.take(job, self.prepare(job))

    def restart(self, pressure: float) -> None:
        """Back to rest."""
        self.stepper.reset(np.full(self.chambers, pressure))
        self.debt = 0.0

    def advance(self, elapsed: float) -> None:
        """Move on by `elapsed` [s] of the wall's clock, slowed by the speed."""
        self.debt = min(self.debt + self.speed * elapsed, LATEST)
        with catch_warnings():
            simplefilter("ignore", EnergyWarning)  # a hand that pulls brings energy
            while self.debt >= self.stepper.length - TINY:
                self.debt -= self.stepper.length
                self.one()

    def one(self) -> None:
        """One step: the hand's push, then the pressure's."""
        if self.record is not None:
            self.play(self.record)
        try:
            self.push()
            self.stepper.step(self.command)
        except SimulationError as error:
            self.message, self.pull = f"{error} The body is back at rest.", None
            self.command[:] = self.by_hand[:] = 0.0
            self.restart(0.0)

    def play(self, exp: Experiment) -> None:
        """The recorded pressure at this instant; from the beginning once it has ended."""
        if self.stepper.time > np.ptp(exp.time):
            self.restart(0.0)
        if exp.pressure is not None:
            now = np.array([exp.time[0] + self.stepper.time - self.played.start])
            traces = [exp.driving(name) for name in self.model.actuation.names]
            self.command[:] = [float(t(now)[0]) if t else 0.0 for t in traces]

    def push(self) -> None:
        """The impulse of the hand's thread over a step: M dv = h J'F."""
        self.force[:] = 0.0
        if self.pull is None or self.pull.link >= self.model.n:
            return
        m, x, i = self.model, self.stepper.position, self.pull.link
        chain, hand = mechanics_of(m), Station("hand", i, self.pull.share * float(m.link_length[i]))
        start, end = chain.nodes(x)[i + 1 : i + 3]
        at = start + self.pull.share * (end - start)
        stiffness = PULL * float(m.stiffness.mean()) / (m.n * m.length**2)
        hand_at = 1e-3 * np.array([self.pull.x_mm, self.pull.y_mm, self.pull.z_mm])[: chain.dimension]
        gap = np.clip(hand_at - at, -m.length, m.length)
        self.force[:] = stiffness * gap
        push = chain.position_jacobian(x, hand).T @ self.force
        self.stepper.velocity[:] += self.stepper.length * np.linalg.solve(chain.inertia(x), push)

    def frame(self) -> dict[str, Any]:
        """Return the present state for drawing: mm, kPa (tendons: N, mm, rad), N."""
        m, t = self.model, self.stepper.time
        joints = mechanics_of(m).nodes(self.stepper.position)
        message, self.message = self.message, ""
        measured = None
        if self.record is not None and not self.record.without_positions:
            k = int(np.abs(self.record.time - self.record.time[0] - t).argmin())
            measured = [[None if not np.isfinite(v) else round(1e3 * float(v), 3) for v in p]
                        for p in self.record.position[k]]
        return {"t": round(t, 6), "body": np.round(1e3 * joints, 3).tolist(), "message": message, "measured": measured,
                "kpa": np.round(self.factor * self.stepper.pressure, 4).tolist(),
                "command": np.round(self.factor * self.command, 4).tolist(), "force": np.round(self.force, 5).tolist()}
