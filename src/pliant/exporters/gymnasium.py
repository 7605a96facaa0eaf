"""Gymnasium environments for learning to control the tip of a model: ``pliant/Reach-v0`` and ``pliant/Track-v0``.

Importing this module registers them. A model is a `Model` or a model file. If its fit is given, every episode uses
another body, drawn from the fit's covariance. ``gymnasium.make_vec`` constructs one batch of the requested number of
bodies, which are simulated together by SIMD instructions; Python handles whole arrays.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from pliant.batch.stepper import batch_stepper
from pliant.errors import InputError, SimulationError
from pliant.exporters.randomisation import Fit, draw_models
from pliant.mechanics import mechanics_of
from pliant.model import Model
from pliant.model.file import model_of
from pliant.model.space import require_planar
from pliant.simulation import state
from pliant.simulation.state import first_alone, typical_pressure
from pliant.testbed.fibre import FibreSensor

POINTS = 24  # points per link at which the bias is integrated


class FibreView:
    """Simulated fibre sensor that measures the joint angles of N chains with noise, drifting bias and gain error.

    The sensor is that of the virtual laboratory, `pliant.testbed.fibre.FibreSensor`.

    A joint's angle is the curvature integrated along its link. White noise of the gauges accumulates along the link. A
    bias that is smooth along the fibre varies in time, and a gain error scales the angle. Errors out of the plane, and
    lost frames, are not modelled.

    Parameters
    ----------
    model : Model
    size : int
        Number of chains N.
    period : float
        Time between two frames [s].
    sensor : FibreSensor
    """

    def __init__(self, model: Model, size: int, period: float, sensor: FibreSensor | None = None) -> None:
        self.sensor = sensor or FibreSensor()
        self.model, self.size = model, size
        s, lengths = self.sensor, np.asarray(model.link_length, dtype=float)
        self.white = s.noise * np.sqrt(s.spacing * lengths)  # (n,) rad
        starts = model.base_length + np.concatenate([[0.0], np.cumsum(lengths)[:-1]])
        midpoints = (starts[:, None] + lengths[:, None] * (np.arange(POINTS) + 0.5) / POINTS).ravel()
        alike = s.bias**2 * np.exp(-0.5 * ((midpoints[:, None] - midpoints) / s.bias_length) ** 2)
        sums = np.kron(np.eye(model.n), np.ones(POINTS)) * np.repeat(lengths / POINTS, POINTS)
        values, vectors = np.linalg.eigh(sums @ alike @ sums.T)
        self.root = vectors * np.sqrt(np.maximum(values, 0.0))  # (n, n) rad
        self.keep = float(np.exp(-period / s.bias_time))
        self.gain = np.ones((size, 1))
        self.bias = np.zeros((size, model.n))

    def reset(self, which: Array, rng: np.random.Generator) -> None:
        """Draw a new random gain error and a new random bias for each of M chains, whose indices are `which` (M,)."""
        self.gain[which] = 1.0 + self.sensor.gain_error * rng.standard_normal((len(which), 1))
        self.bias[which] = rng.standard_normal((len(which), self.model.n)) @ self.root.T

    def see(self, angle: Array, rng: np.random.Generator) -> Array:
        """Return the link angles (N, n) [rad] that the fibre measures on N chains with n links, and advance its slowly
        drifting bias by one sample.
        """
        turn = np.diff(angle, axis=1, prepend=self.model.base_angle)
        kick = np.sqrt(1.0 - self.keep**2) * rng.standard_normal(turn.shape) @ self.root.T
        self.bias = self.keep * self.bias + kick
        readings = self.gain * turn + self.bias + self.white * rng.standard_normal(turn.shape)
        return np.asarray(self.model.base_angle + np.cumsum(readings, axis=1))


try:
    import gymnasium
    from gymnasium import spaces
    from gymnasium.vector import AutoresetMode, VectorEnv
except ImportError:
    raise InputError("Gymnasium is not installed: pip install 'pliant[gym]'") from None

Array = np.ndarray
LOST = -10.0  # reward if the simulation becomes unstable


class EpisodeTask(NamedTuple):
    """Settings of a learning episode: time step, period of actions, duration, target and observations."""

    time_step: float = 1e-3  # s, time step of the model
    period: float = 0.02  # s, between actions
    duration: float = 2.0  # s
    frequency: float = 0.5  # Hz, of the moving target
    observe: str = "perfect"  # or "fibre": joint angles measured by a shape-sensing fibre
    bodies: int = 64  # number of bodies drawn from the fit at a seed; each episode uses one


class TipVectorEnv(VectorEnv[Array, Array, Array]):
    """Vectorised Gymnasium environment in which pressures move the tips of N planar actuators to their targets.

    Actions: pressures of the chambers (N, C), scaled so that -1 is 0 Pa and 1 is `highest`. Observations (N, 2 n + 4 +
    C): joint angles relative to the rest angles (n) [rad], their rates times the period (n), tip and target (2 each)
    divided by the body's length, commanded pressures (C) divided by `highest`. Reward: minus the distance of the tip
    from its target divided by the body's length. An episode ends early with the reward -10 if the simulation becomes
    unstable. An environment that is done is reset at the next step, whose action and reward have no effect (Gymnasium's
    ``NEXT_STEP``).

    Parameters
    ----------
    num_envs : int
        Number of environments N.
    model : Model, str or Path
    highest : float
        Highest pressure [Pa]; default: twice the pressure that bends the body by half a radian.
    fit : FitResult, path of metrics.json, or mapping
        Fit from which `pliant.exporters.randomisation.draw_models` draws bodies; default: all bodies equal the model.
    moving : bool
        Whether targets move along the body's reachable curve, or are at rest.
    task : EpisodeTask
        With ``observe="fibre"``, angles are measured by the virtual laboratory's fibre with its latency, rates are
        differences of frames, and tips are computed from these angles. Rewards always use the true tip.
    render_mode : None
        There is no rendering.
    """

    metadata: dict[str, Any] = {"render_modes": [], "autoreset_mode": AutoresetMode.NEXT_STEP}  # noqa: RUF012

    def __init__(
        self, num_envs: int = 1, model: Model | str | Path = "", *, highest: float = 0.0, fit: Fit | None = None,
        moving: bool = False, task: EpisodeTask | None = None, render_mode: None = None,
    ) -> None:
        self.model = planar_model(model)
        self.num_envs, self.fit, self.moving, self.render_mode = num_envs, fit, moving, render_mode
        self.task = checked_task(task or EpisodeTask())
        self.highest = highest_pressure(self.model, highest)
        n, C, t = self.model.n, self.model.actuation.count, self.task
        self.single_action_space = spaces.Box(-1.0, 1.0, (C,), np.float32)
        self.single_observation_space = spaces.Box(-np.inf, np.inf, (2 * n + 4 + C,), np.float32)
        self.action_space = gymnasium.vector.utils.batch_space(self.single_action_space, num_envs)
        self.observation_space = gymnasium.vector.utils.batch_space(self.single_observation_space, num_envs)
        self._steps = max(1, round(t.period / t.time_step))
        self._fibre = FibreView(self.model, num_envs, self._steps * t.time_step) if t.observe == "fibre" else None
        self._late = round(self._fibre.sensor.latency / t.time_step) if self._fibre else 0
        if self._late >= self._steps:
            raise InputError(
                f"the period of {t.period:.3g} s between actions must exceed the latency of the fibre: use a longer "
                "period"
            )
        self._curve = reachable(self.model, self.highest)
        self._elapsed, self._done = np.zeros(num_envs, dtype=int), np.zeros(num_envs, dtype=bool)
        self._phase, self._target = np.zeros(num_envs), np.zeros((num_envs, 2))
        self._command, self._before = np.zeros((num_envs, C)), np.zeros((num_envs, n))
        self._bodies: list[Model] = []

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None,
        options: dict[str, Any] | None = None,  # noqa: ARG002  Gymnasium's own
    ) -> tuple[Array, dict[str, Any]]:
        """Start new episodes in all environments, at rest without pressure and with new targets. If a fit is given, a
        `seed` also draws new models from it.
        """
        if seed is not None:
            whole = seed if isinstance(seed, int) else [0 if s is None else s for s in seed]
            self._np_random = np.random.default_rng(whole)
        if seed is not None or not self._bodies:
            drawn = draw_models(self.model, self.fit, self.task.bodies, self.np_random) if self.fit else [self.model]
            self._bodies = drawn
            self._chains = batch_stepper(drawn, self.num_envs, self.task.time_step)
            self._lengths = np.stack([m.link_length for m in drawn])
            self._first = np.stack([m.first_joint for m in drawn])
            self._body = np.zeros(self.num_envs, dtype=int)
        self.begin(np.arange(self.num_envs))
        return self.observations(self._chains.angle), self.info()

    def begin(self, which: Array) -> None:
        """Start a new episode in each of M environments, whose indices are `which` (M,)."""
        self._body[which] = self.np_random.integers(len(self._bodies), size=len(which))
        self._chains.reset(which, self._body[which])
        self._phase[which] = self.np_random.uniform(0.0, 1.0, len(which))
        self._target[which] = on_curve(self._curve, self._phase[which])
        self._command[which], self._elapsed[which], self._done[which] = 0.0, 0, False
        angle = self._chains.angle
        if self._fibre:
            self._fibre.reset(which, self.np_random)
            angle = self._fibre.see(angle, self.np_random)
        self._before[which] = angle[which]

    def tips(self, angle: Array, *, own: bool) -> Array:
        """Return the tip positions (N, 2) [m] of N chains with n links, at their absolute link angles (N, n) [rad].

        With `own`, the lengths of the drawn bodies are used, else those of the model.
        """
        m = self.model
        length = self._lengths[self._body] if own else m.link_length
        first = self._first[self._body] if own else m.first_joint
        x = first[..., 0] - (length * np.sin(angle)).sum(axis=1)
        return np.stack([x, first[..., 1] + (length * np.cos(angle)).sum(axis=1)], axis=1)

    def observations(self, angle: Array) -> Array:
        """Return the observations (N, 2 n + 4 + C) of N chains at their absolute link angles (N, n) [rad]: n joint
        angles, their changes in one period, tip (2), target (2) and C commands. Lengths are divided by the body's
        length, commands by the highest pressure.
        """
        m, fibre = self.model, self._fibre
        angles = fibre.see(angle, self.np_random) if fibre else angle
        q = np.diff(angles, axis=1, prepend=m.base_angle) - m.rest_angle
        turn = angles - self._before if fibre else self._chains.rate * self.task.period
        self._before = angles
        tip, rates = self.tips(angles, own=not fibre), np.diff(turn, axis=1, prepend=0.0)
        rows = (q, rates, tip / m.length, self._target / m.length, self._command / self.highest)
        return np.concatenate(rows, axis=1).astype(np.float32)

    def info(self) -> dict[str, Any]:
        """Return Gymnasium's info dict of N environments: tips and targets (N, 2) [m], and times (N,) [s] since the
        start of each episode.
        """
        every = np.ones(self.num_envs, dtype=bool)
        info = {
            "tip": self.tips(self._chains.angle, own=True), "target": self._target.copy(),
            "time": self._elapsed * self._steps * self.task.time_step,
        }
        return info | {f"_{name}": every for name in info}

    def step(self, actions: Array) -> tuple[Array, Array, Array, Array, dict[str, Any]]:
        """Hold the pressures of the actions (N, C) for one period, in N environments with C chambers. Return
        observations, rewards, the flags `terminated` and `truncated`, and the info dict.
        """
        if not self._bodies:
            raise gymnasium.error.ResetNeeded("reset the environments before the first step")
        self._command = 0.5 * (np.clip(np.asarray(actions, dtype=float), -1.0, 1.0) + 1.0) * self.highest
        over = self._done.copy()
        lost = self._chains.hold(self._command, self._steps - self._late)
        angle = self._chains.angle
        if self._late:
            lost |= self._chains.hold(self._command, self._late)
        self._elapsed += 1
        if over.any():
            self.begin(np.flatnonzero(over))
            lost &= ~over
        if lost.any():
            gone = np.flatnonzero(lost)
            self._chains.reset(gone, self._body[gone])
        now = self._chains.angle
        angle = np.where((over | lost)[:, None], now, angle) if self._late else now
        if self.moving:
            turn = 2.0 * np.pi * self.task.frequency * self._elapsed * self._steps * self.task.time_step
            self._target = on_curve(self._curve, 0.5 - 0.5 * np.cos(turn + np.pi * self._phase))
        apart = np.linalg.norm(self.tips(now, own=True) - self._target, axis=1) / self.model.length
        reward = np.where(over, 0.0, np.where(lost, LOST, -apart))
        time_step = self.task.time_step
        late = ~over & (self._elapsed * self._steps * time_step >= self.task.duration - 0.5 * time_step)
        self._done = lost | late
        return self.observations(angle), reward, lost, late, self.info()


class TipEnv(gymnasium.Env[Array, Array]):
    """Gymnasium environment ``pliant/Reach-v0`` or ``pliant/Track-v0``: pressures move the tip of one planar actuator
    to a target.

    The parameters are those of `TipVectorEnv`.
    """

    metadata: dict[str, Any] = {"render_modes": []}  # noqa: RUF012  Gymnasium's own way

    def __init__(self, model: Model | str | Path, *, render_mode: None = None, **options: Any) -> None:
        self._one = TipVectorEnv(1, model, **options)
        self.render_mode = render_mode
        self.action_space = self._one.single_action_space
        self.observation_space = self._one.single_observation_space

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Array, dict[str, Any]]:
        """Start a new episode, at rest without pressure and with a new target. If a fit is given, the episode uses a
        model drawn from it.
        """
        super().reset(seed=seed)
        observation, info = self._one.reset(seed=seed, options=options)
        return observation[0], alone(info)

    def step(self, action: Array) -> tuple[Array, float, bool, bool, dict[str, Any]]:
        """Hold the pressures of the action (C,) in C chambers for one period. Return observation, reward, the flags
        `terminated` and `truncated`, and the info dict.
        """
        observation, reward, lost, late, info = self._one.step(np.asarray(action)[None])
        return observation[0], float(reward[0]), bool(lost[0]), bool(late[0]), alone(info)


def alone(info: dict[str, Any]) -> dict[str, Any]:
    """Return the info dict of the first environment of a batch, without the arrays' batch dimension."""
    return {name: value[0] for name, value in info.items() if not name.startswith("_")}


def planar_model(model: Model | str | Path) -> Model:
    """Return a planar model, or that of a model file; raise InputError if the body moves in space."""
    planar = model_of(model)
    require_planar(planar, "an environment of Gymnasium")
    return planar


def highest_pressure(model: Model, highest: float) -> float:
    """Return the highest pressure [Pa] of an environment: `highest` or, if it is 0, twice the model's typical pressure.
    Raise InputError if pressure does not bend the model.
    """
    pressure = highest or 2.0 * typical_pressure(model)
    if not pressure > 0:
        raise InputError(
            "pressure does not bend this model, so that it reaches no target: use a model whose chambers have a torque"
        )
    return pressure


def on_curve(curve: Array, phase: float | Array) -> Array:
    """Return points (..., 2) [m] on a curve of K points (K, 2) [m] at `phase` (...), 0 at its start and 1 at its
    end.
    """
    share = np.linspace(0.0, 1.0, len(curve))
    return np.stack([np.interp(phase, share, column) for column in curve.T], axis=-1)


def checked_task(task: EpisodeTask) -> EpisodeTask:
    """Return the settings of an episode unchanged; raise InputError if they are inconsistent."""
    if task.observe not in ("perfect", "fibre"):
        raise InputError(f"observe must be 'perfect' or 'fibre', got {task.observe!r}")
    if not (0 < task.time_step <= task.period <= task.duration and task.bodies >= 1):
        raise InputError(f"a task needs 0 < time_step <= period <= duration and bodies >= 1, got {task}")
    return task


def reachable(model: Model, highest: float) -> Array:
    """Return the static tip positions (K, 2) [m] at K pressures of the first chamber, evenly spaced from 0 to at most
    0.8 times `highest` [Pa].
    """
    tips = []
    for level in np.linspace(0.0, 0.8 * highest, 33):
        try:
            q = state.equilibrium(model, first_alone(model, level))
        except SimulationError:
            break
        tips.append(mechanics_of(model).tips(mechanics_of(model).coordinates(q))[-1])
    return np.array(tips)


for _name, _moving in (("Reach", False), ("Track", True)):
    gymnasium.register(
        f"pliant/{_name}-v0", "pliant.exporters.gymnasium:TipEnv", kwargs={"moving": _moving},
        vector_entry_point="pliant.exporters.gymnasium:TipVectorEnv",
    )
