"""Gymnasium environments for learning to control the tip of a model: ``pliant/Reach-v0`` and ``pliant/Track-v0``.

Importing this module registers them. A model is a `Model` or a model file, in the plane or in space. If its fit is
given, every episode uses another body, drawn from the fit's covariance. ``gymnasium.make_vec`` constructs one batch of
the requested number of bodies, which are simulated together, by SIMD instructions or in JAX; Python handles whole
arrays.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from pliant.batch.stepper import BatchStepper, batch_stepper
from pliant.errors import InputError
from pliant.exporters.jax_batch import JaxBodies
from pliant.exporters.randomisation import Fit, draw_models
from pliant.exporters.targets import EpisodeTargets, Tips, highest_inputs, targets_of
from pliant.mechanics import mechanics_of
from pliant.model import Model
from pliant.model.features import IN_SPACE, LENGTHENS, RESTING, Consumer
from pliant.model.file import model_of
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
FIBRE = Consumer(
    "observe='fibre'", RESTING - IN_SPACE - LENGTHENS,
    remedy=dict.fromkeys(IN_SPACE | LENGTHENS, "use observe='perfect': a fibre measures joint angles in the plane of a "
                         "body of constant length"),
)  # fmt: skip
ENGINES: dict[str, Callable[[Sequence[Model], int, float], BatchStepper]] = {"pliant": batch_stepper, "jax": JaxBodies}


class EpisodeTask(NamedTuple):
    """Settings of a learning episode: time step, period of actions, duration, target and observations."""

    time_step: float = 1e-3  # s, time step of the model
    period: float = 0.02  # s, between actions
    duration: float = 2.0  # s
    frequency: float = 0.5  # Hz, of the moving target
    observe: str = "perfect"  # or "fibre": joint angles measured by a shape-sensing fibre
    bodies: int = 64  # number of bodies drawn from the fit at a seed; each episode uses one
    engine: str = "pliant"  # or "jax": the exported JAX module, on the device that JAX uses


class TipVectorEnv(VectorEnv[Array, Array, Array]):
    """Vectorised Gymnasium environment in which pressures move the tips of N actuators to their targets, in the plane
    or in space.

    Actions: inputs (N, C), pressures of chambers or inputs of tendons, scaled so that -1 is 0 and 1 is `highest`.
    Observations (N, 2 K + 2 d + C) of K coordinates in d dimensions: joint angles relative to the rest angles, then
    strains of segments that lengthen (K), their rates times the period (K), tip and target (d each) divided by the
    body's length, commanded inputs (C) divided by `highest`. In space joint angles are those of `simulate`: bends about
    x and y of each joint in turn, then twists. Reward: minus the distance of the tip from its target divided by the
    body's length. An episode ends early with the reward -10 if the simulation becomes unstable. An environment that is
    done is reset at the next step, whose action and reward have no effect (Gymnasium's ``NEXT_STEP``).

    Parameters
    ----------
    num_envs : int
        Number of environments N.
    model : Model, str or Path
    highest : float, or one for each input
        Highest pressure [Pa], or input of a tendon [N, m or rad]; default: see `targets.highest_inputs`, in the plane
        twice the pressure that bends the body by half a radian.
    fit : FitResult, path of metrics.json, or mapping
        Fit from which `pliant.exporters.randomisation.draw_models` draws bodies; default: all bodies equal the model.
    moving : bool
        Whether targets move, or are at rest: in the plane along the curve that the tip reaches under the first
        pressure, in space on the surface that it reaches under inputs which rise one after another.
    task : EpisodeTask
        With ``observe="fibre"``, in the plane only, angles are measured by the virtual laboratory's fibre with its
        latency, rates are differences of frames, and tips are computed from these angles. Rewards always use the true
        tip. With ``engine="jax"`` the bodies are simulated by the module of ``pliant export --to jax``.
    render_mode : None
        There is no rendering.
    """

    metadata: dict[str, Any] = {"render_modes": [], "autoreset_mode": AutoresetMode.NEXT_STEP}  # noqa: RUF012

    def __init__(
        self, num_envs: int = 1, model: Model | str | Path = "", *, highest: float | Sequence[float] = 0.0,
        fit: Fit | None = None, moving: bool = False, task: EpisodeTask | None = None, render_mode: None = None,
    ) -> None:
        self.model = model_of(model)
        self.num_envs, self.fit, self.moving, self.render_mode = num_envs, fit, moving, render_mode
        self.task = t = checked_task(task or EpisodeTask(), self.model)
        self.highest = highest_inputs(self.model, highest)
        n, C, chain = self.model.n, self.model.actuation.count, mechanics_of(self.model)
        self.single_action_space = spaces.Box(-1.0, 1.0, (C,), np.float32)
        width = 2 * chain.size + 2 * chain.dimension + C
        self.single_observation_space = spaces.Box(-np.inf, np.inf, (width,), np.float32)
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
        kind = targets_of(self.model)
        self._targets: EpisodeTargets = kind(self.model, self.highest)
        self._elapsed, self._done = np.zeros(num_envs, dtype=int), np.zeros(num_envs, dtype=bool)
        self._address, self._target = np.zeros((num_envs, kind.width)), np.zeros((num_envs, chain.dimension))
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
        if not self._bodies or (self.fit and seed is not None):
            drawn = draw_models(self.model, self.fit, self.task.bodies, self.np_random) if self.fit else [self.model]
            self._bodies = drawn
            self._chains = ENGINES[self.task.engine](drawn, self.num_envs, self.task.time_step)
            self._tips, self._nominal = Tips(drawn), Tips([self.model])
            self._body = np.zeros(self.num_envs, dtype=int)
        self.begin(np.arange(self.num_envs))
        position = self._chains.position
        tip = self._tips(self._body, position)
        return self.observations(position, tip), self.info(tip)

    def begin(self, which: Array) -> None:
        """Start a new episode in each of M environments, whose indices are `which` (M,)."""
        self._body[which] = self.np_random.integers(len(self._bodies), size=len(which))
        self._chains.reset(which, self._body[which])
        self._address[which] = self.np_random.uniform(0.0, 1.0, (len(which), self._targets.width))
        self._target[which] = self._targets.place(self._address[which])
        self._command[which], self._elapsed[which], self._done[which] = 0.0, 0, False
        if self._fibre:
            self._fibre.reset(which, self.np_random)
            self._before[which] = self._fibre.see(self._chains.position, self.np_random)[which]

    def observations(self, position: Array, tip: Array) -> Array:
        """Return the observations (N, 2 K + 2 d + C) of N chains in d dimensions, from their coordinates (N, K) and
        tips (N, d) [m]: K joint coordinates, their changes in one period, tip (d), target (d) and C commands. Lengths
        are divided by the body's length, commands by the highest inputs.
        """
        m, chain = self.model, mechanics_of(self.model)
        if self._fibre:
            angle = self._fibre.see(position, self.np_random)
            tip, change = self._nominal(np.zeros(self.num_envs, dtype=int), angle), angle - self._before
            self._before = angle
        else:
            angle, change = position, self._chains.velocity * self.task.period
        q, rates = chain.joint_coordinates(angle), chain.joint_rates(change)
        rows = (q, rates, tip / m.length, self._target / m.length, self._command / self.highest)
        return np.concatenate(rows, axis=1).astype(np.float32)

    def info(self, tip: Array) -> dict[str, Any]:
        """Return Gymnasium's info dict of N environments: tips and targets (N, d) [m], and times (N,) [s] since the
        start of each episode.
        """
        every = np.ones(self.num_envs, dtype=bool)
        info = {
            "tip": tip, "target": self._target.copy(),
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
        angle = self._chains.position
        if self._late:
            lost |= self._chains.hold(self._command, self._late)
        self._elapsed += 1
        if over.any():
            self.begin(np.flatnonzero(over))
            lost &= ~over
        if lost.any():
            gone = np.flatnonzero(lost)
            self._chains.reset(gone, self._body[gone])
        now = self._chains.position
        angle = np.where((over | lost)[:, None], now, angle) if self._late else now
        if self.moving:
            turn = 2.0 * np.pi * self.task.frequency * self._elapsed * self._steps * self.task.time_step
            self._target = self._targets.moved(self._address, turn)
        tip = self._tips(self._body, now)
        apart = np.linalg.norm(tip - self._target, axis=1) / self.model.length
        reward = np.where(over, 0.0, np.where(lost, LOST, -apart))
        time_step = self.task.time_step
        late = ~over & (self._elapsed * self._steps * time_step >= self.task.duration - 0.5 * time_step)
        self._done = lost | late
        return self.observations(angle, tip), reward, lost, late, self.info(tip)


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


def checked_task(task: EpisodeTask, model: Model) -> EpisodeTask:
    """Return the settings of an episode unchanged; raise InputError if they are inconsistent, or not for the model."""
    if task.observe not in ("perfect", "fibre"):
        raise InputError(f"observe must be 'perfect' or 'fibre', got {task.observe!r}")
    if task.engine not in ENGINES:
        raise InputError(f"engine must be 'pliant' or 'jax', got {task.engine!r}")
    if task.observe == "fibre":
        FIBRE.check(model)
    if not (0 < task.time_step <= task.period <= task.duration and task.bodies >= 1):
        raise InputError(f"a task needs 0 < time_step <= period <= duration and bodies >= 1, got {task}")
    return task


for _name, _moving in (("Reach", False), ("Track", True)):
    gymnasium.register(
        f"pliant/{_name}-v0", "pliant.exporters.gymnasium:TipEnv", kwargs={"moving": _moving},
        vector_entry_point="pliant.exporters.gymnasium:TipVectorEnv",
    )
