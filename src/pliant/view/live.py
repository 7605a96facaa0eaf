"""The model behind the live page: it is stepped in real time, driven by sliders or a recording, and can be pulled."""

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
from pliant.model import Model, Station, load_model
from pliant.simulation import Stepper
from pliant.simulation.balance import EnergyWarning
from pliant.simulation.time_step import shared_step
from pliant.units import shown_in
from pliant.validation.store import load_outcome

Array = np.ndarray
SHORTEST = 1e-4  # s, shortest step, since the page cannot show more
TINY = 1e-9  # s, rounding tolerance when frame times are summed to steps
LATEST = 0.1  # s, longest motion that one frame of the page makes up for
FACTORS = (0.5, 2.0)  # range of stiffness and damping for a model without confidence intervals
PULL = 1.5  # stiffness of the spring between hand and body, in units of joint stiffness / (n length^2)
Finite = Annotated[float, Field(allow_inf_nan=False)]


class Slider(NamedTuple):
    """A parameter of the model that a slider on the page changes, with its range and unit."""

    name: str
    value: float
    low: float
    high: float
    unit: str


class Pull(BaseModel):
    """A pull by a spring from a point of the body to the position of a hand, which is the mouse on the page."""

    model_config = ConfigDict(extra="forbid")
    link: int = Field(ge=0)
    share: float = Field(ge=0.0, le=1.0)  # position of the point, as a fraction of the link's length
    x_mm: Finite  # position of the hand
    y_mm: Finite
    z_mm: Finite = 0.0  # for a body in space


class PageRequest(BaseModel):
    """A request of the page; values that it does not contain stay unchanged."""

    model_config = ConfigDict(extra="forbid")
    pressure_kpa: list[Annotated[float, Field(ge=-2000.0, le=2000.0)]] | None = None  # for tendons N, mm or rad
    gravity: Annotated[list[Annotated[float, Field(ge=-30, le=30)]], Field(min_length=2, max_length=3)] | None = None
    parameters: dict[str, Finite] | None = None
    speed: float | None = Field(None, ge=0.0, le=1.0)
    pull: Pull | None = None
    record: str | None = None
    reset: bool = False


class PageContent(NamedTuple):
    """The content of the live page: a model, its adjustable parameters, and recordings whose inputs can drive the
    model.
    """

    model: Model
    sliders: tuple[Slider, ...]
    records: Mapping[str, Experiment]
    start: float = 0.0  # s, fitted offset of the pressure's clock from the shape's
    log: Path | None = None  # log.csv of a control loop to watch
    touch: float = 0.0  # N m, unexplained joint torque above which a touch is shown


def sliders_of(model: Model, parameters: tuple[Any, ...] = ()) -> tuple[Slider, ...]:
    """Return a slider for each fitted parameter that has a 95 % interval, with this interval as its range. If there is
    none, return sliders for factors on stiffness and damping.
    """
    known = tuple(Slider(p.name, p.value, p.interval[0], p.interval[1], p.unit) for p in parameters
                  if p.free and p.std and p.value is not None and p.interval and moves(model, p.name, p.value))
    if known:
        return known
    return tuple(Slider(f"{name} x", 1.0, *FACTORS, "") for name in ("stiffness", "damping"))


def moves(model: Model, name: str, value: float) -> bool:
    """Return True if the parameter `name` changes the model, and False if it belongs to a single recording."""
    try:
        return apply(model, {name: 1.01 * value}) != model
    except (InputError, KeyError):
        return False


def step_of(model: Model) -> float:
    """Return the time step [s] that the model needs, but at least 0.1 ms."""
    return max(shared_step([model]), SHORTEST)


class Job(NamedTuple):
    """Requests of the page that need a new time stepper: changed parameters of the model, a restart from rest, or
    another recording.
    """

    changed: dict[str, Any]
    pressure: Array  # Pa, behind the valves when the job was created
    restart: bool
    record: str | None
    other_record: bool  # whether the request changes `record`


class Live:
    """A running model; each open page has its own.

    `receive` stores requests that take long to fulfil. `job` returns them as a `Job`, `prepare` builds the new model,
    if necessary on another thread, and `replace_model` replaces the running model by it. `build` does all three.

    Parameters
    ----------
    content : PageContent

    Raises
    ------
    InputError
        When the model cannot be stepped; see `Stepper`.
    """

    def __init__(self, content: PageContent) -> None:
        self.content = content
        self.model = content.model
        self.stepper = Stepper(self.model, step_of(self.model))
        self.chambers = self.model.actuation.count
        self.command = np.zeros(self.chambers)
        self.speed, self.debt, self.message = 1.0, 0.0, ""
        self.pull: Pull | None = None
        self.force = np.zeros(mechanics_of(self.model).dimension)
        self.factor = np.array([shown_in(unit)[0] for unit in self.model.actuation.units])
        self.record: Experiment | None = None
        self.changed: dict[str, Any] = {}
        self.sliders = {s.name: s for s in content.sliders}
        self.by_hand = np.zeros(self.chambers)  # Pa, positions of the sliders, used while no recording is played
        self.pending = self.restarting = self.other_record = False
        self.next_record: str | None = None

    def receive(self, request: PageRequest) -> None:
        """Apply the inputs, the speed and the pull of a request at once, and store its other parts until `job` is
        called.
        """
        if request.pressure_kpa is not None and len(request.pressure_kpa) == self.chambers:
            sent = np.array(request.pressure_kpa) / self.factor
            pressed = np.array(self.model.actuation.units) == "Pa"
            self.by_hand[:] = np.where(pressed, np.maximum(sent, 0.0), sent)
            self.command[:] = self.by_hand
        if request.speed is not None:
            self.speed = request.speed
        if "pull" in request.model_fields_set:
            self.pull = request.pull
        if "record" in request.model_fields_set:
            self.next_record, self.other_record, self.restarting = request.record, True, True
        numbers = {n: v for n, v in (request.parameters or {}).items() if n in self.sliders}
        gravity = {} if request.gravity is None else {"gravity": np.array(request.gravity)}
        self.changed |= {**gravity, **numbers}
        self.restarting |= request.reset
        self.pending |= bool(numbers or gravity or self.restarting)

    def job(self) -> Job:
        """Return the stored requests as a `Job` and mark them as done. Of several requests for one value, the last
        counts.
        """
        job = Job(dict(self.changed), self.stepper.pressure, self.restarting, self.next_record,
                  self.other_record)
        self.pending = self.restarting = self.other_record = False
        return job

    def prepare(self, job: Job) -> tuple[Model, Stepper] | str:
        """Return the model that a job requests and a time stepper for it, or an error message. The running model is not
        changed.
        """
        numbers = {n: float(np.clip(v, self.sliders[n].low, self.sliders[n].high))
                   for n, v in job.changed.items() if n in self.sliders}
        model = self.content.model
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

    def replace_model(self, job: Job, prepared: tuple[Model, Stepper] | str) -> None:
        """Replace the running model by a prepared one, from rest if requested, else with the present state
        of motion.
        """
        if isinstance(prepared, str):
            self.message = prepared
            return
        model, stepper = prepared
        if job.restart:
            self.debt = 0.0
        else:
            stepper.restore(self.stepper.snapshot())
        if job.other_record:
            self.record = self.content.records.get(job.record or "")
            self.command[:] = self.by_hand
        self.model, self.stepper = model, stepper

    def build(self) -> None:
        """Apply the stored requests of the page at once, on the thread of the caller."""
        if self.pending:
            job = self.job()
            self.replace_model(job, self.prepare(job))

    def restart(self, pressure: float) -> None:
        """Put the body back to rest at a pressure [Pa]."""
        self.stepper.reset(np.full(self.chambers, pressure))
        self.debt = 0.0

    def advance(self, elapsed: float) -> None:
        """Advance the simulation by `elapsed` [s] of wall time, multiplied by the speed that the page requests."""
        self.debt = min(self.debt + self.speed * elapsed, LATEST)
        with catch_warnings():
            simplefilter("ignore", EnergyWarning)  # a pulling hand adds energy
            while self.debt >= self.stepper.time_step - TINY:
                self.debt -= self.stepper.time_step
                self.advance_step()

    def advance_step(self) -> None:
        """Simulate one time step: apply the pull of the mouse to the joint velocities, then step the model under its
        inputs.
        """
        if self.record is not None:
            self.play(self.record)
        try:
            self.push()
            self.stepper.step(self.command)
        except SimulationError as error:
            self.message, self.pull = f"{error} The body was put back to rest.", None
            self.command[:] = self.by_hand[:] = 0.0
            self.restart(0.0)

    def play(self, exp: Experiment) -> None:
        """Set the commanded pressure to the one recorded at the simulated time. At the end of the recording, start it
        again with the body at rest.
        """
        if self.stepper.time > np.ptp(exp.time):
            self.restart(0.0)
        if exp.pressure is not None:
            now = np.array([exp.time[0] + self.stepper.time - self.content.start])
            traces = [exp.driving(name) for name in self.model.actuation.names]
            self.command[:] = [float(t(now)[0]) if t else 0.0 for t in traces]

    def push(self) -> None:
        """Add the impulse of the spring between hand and body over one time step h to the joint velocities v. The
        change dv solves M dv = h J'F, with the mass matrix M, the Jacobian J of the pulled point and the spring's force
        F.
        """
        self.force[:] = 0.0
        if self.pull is None or self.pull.link >= self.model.n:
            return
        m, x, i = self.model, self.stepper.position, self.pull.link
        chain, hand = mechanics_of(m), Station("hand", i, self.pull.share * float(m.link_length[i]))
        start, end = chain.nodes(x)[i + 1 : i + 3]
        point = start + self.pull.share * (end - start)
        stiffness = PULL * float(m.stiffness.mean()) / (m.n * m.length**2)
        hand_at = 1e-3 * np.array([self.pull.x_mm, self.pull.y_mm, self.pull.z_mm])[: chain.dimension]
        gap = np.clip(hand_at - point, -m.length, m.length)
        self.force[:] = stiffness * gap
        push = chain.position_jacobian(x, hand).T @ self.force
        self.stepper.velocity[:] += self.stepper.time_step * np.linalg.solve(chain.inertia(x), push)

    def frame(self) -> dict[str, Any]:
        """Return the present state for drawing: positions of the joints [mm], inputs [kPa; for tendons N, mm or rad]
        and the force [N] of the pull.
        """
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


def page_content(source: Path, log: Path | None = None, touch: float = 0.0) -> PageContent:
    """Return the content of the live page for a model file or a results folder.

    For a folder it is the model of the first fit, with sliders for its parameters and its recordings.

    Parameters
    ----------
    source : Path
        Model file, or folder written by `pliant run`.
    log : Path, optional
        log.csv of a control loop of the same body, to be watched.
    touch : float
        Unexplained joint torque [N m] above which a touch is shown; see `pliant.view.server.WatchedLoop`.

    Raises
    ------
    InputError
        When the file or folder cannot be read.
    """
    if not source.is_dir():
        model = load_model(source)
        return PageContent(model, sliders_of(model), {}, log=log, touch=touch)
    outcome = load_outcome(source)
    first = outcome.fits[0]
    recordings = {r.name: in_base_frame(r.experiment) for r in first.records}
    return PageContent(outcome.model, sliders_of(outcome.model, first.result.parameters), recordings,
                  first.result.values.get("start", 0.0), log, touch)


def in_base_frame(experiment: Experiment) -> Experiment:
    """Return a stored experiment, which is in the axes of its recording, in the base frame of the model."""
    return experiment.turned() if experiment.x_sign < 0 else experiment
