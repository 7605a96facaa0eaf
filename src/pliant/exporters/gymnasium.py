"""Environments of Gymnasium on the stepped model: ``pliant/Reach-v0`` and ``pliant/Track-v0``.

Importing this module registers them. A model is a `Model` or a model file; with the standard errors of its fit, every
episode draws its parameters anew.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from pliant.errors import InputError, SimulationError
from pliant.identification.parameters import KNOWN
from pliant.model import Model, load_model
from pliant.simulation import Stepper, state
from pliant.simulation.levels import typical_pressure

try:
    import gymnasium
    from gymnasium import spaces
except ImportError:
    raise InputError("Gymnasium is not installed: pip install 'pliant[gym]'") from None

Array = np.ndarray


class Task(NamedTuple):
    """How an episode runs."""

    step: float = 1e-3  # s, of the model
    period: float = 0.02  # s, between actions
    duration: float = 2.0  # s
    noise: float = 0.0  # rad, standard deviation of the angles that are observed; 0: perfect
    frequency: float = 0.5  # Hz, of the path that is tracked


class TipEnv(gymnasium.Env[Array, Array]):
    """The tip of a bending body is to be where it is asked for, by pressure.

    Action: pressures of the chambers (C,), -1 for none and 1 for `highest`. Observation: joint angles (n,) [rad], their
    rates times the period (n,), tip and target (2,) in parts of the body's length, commanded pressures (C,) in parts of
    `highest`. Reward: minus the distance of the tip from its target in parts of the body's length; an episode ends
    early where the model gives way, with -10.

    Parameters
    ----------
    model : Model, str or Path
    highest : float
        Largest pressure, Pa; default twice the pressure that bends the body by half a radian.
    standard_errors : mapping
        By the names of model fields (``stiffness``, ``damping``, ...), SI: each episode draws a factor for the field
        from a normal distribution of this standard error over the field's mean.
    moving : bool
        Whether the target moves along the body's reachable curve, or stands.
    task : Task
    render_mode : None
        No rendering; `pliant` draws trajectories.
    """

    metadata: dict[str, Any] = {"render_modes": []}  # noqa: RUF012  Gymnasium's own way

    def __init__(
        self, model: Model | str | Path, *, highest: float = 0.0, standard_errors: Mapping[str, float] | None = None,
        moving: bool = False, task: Task | None = None, render_mode: None = None,
    ) -> None:
        self.model = model if isinstance(model, Model) else load_model(model)
        self.task, self.moving, self.render_mode = task or Task(), moving, render_mode
        self.highest = highest or 2.0 * typical_pressure(self.model)
        self.errors = checked_errors(self.model, standard_errors or {})
        if not self.highest > 0:
            raise InputError("no pressure bends this model: there is nothing to reach")
        self._steps = max(1, round(self.task.period / self.task.step))
        n, C = self.model.n, len(self.model.chambers)
        self.action_space = spaces.Box(-1.0, 1.0, (C,), np.float32)
        self.observation_space = spaces.Box(-np.inf, np.inf, (2 * n + 4 + C,), np.float32)
        self._stepper = Stepper(self.model, self.task.step, np.zeros(C))
        self._levels, self._tips = self.reachable()
        self._target, self._phase, self._command = self._tips[0], 0.0, np.zeros(C)

    def reachable(self) -> tuple[Array, Array]:
        """Pressures (K,) [Pa] of the first chamber and the tips (K, 2) [m] at rest under them."""
        C = len(self.model.chambers)
        levels, tips = [], []
        for level in np.linspace(0.0, 0.8 * self.highest, 33):
            try:
                q = state.equilibrium(self.model, level * np.eye(1, C)[0])
            except SimulationError:
                break
            levels.append(level)
            tips.append(state.tips(self.model, state.absolute(self.model, q))[-1])
        return np.array(levels), np.array(tips)

    def target_at(self, phase: float) -> Array:
        """The point (2,) [m] of the reachable curve, 0 its beginning and 1 its end."""
        along = np.linspace(0.0, 1.0, len(self._tips))
        return np.array([np.interp(phase, along, self._tips[:, k]) for k in range(2)])

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Array, dict[str, Any]]:
        """Begin at rest without pressure, before another target and, with standard errors, with another body."""
        super().reset(seed=seed, options=options)
        if self.errors:
            self._stepper = Stepper(self.drawn(), self.task.step, np.zeros(len(self.model.chambers)))
        else:
            self._stepper.reset(np.zeros(len(self.model.chambers)))
        self._phase = float(self.np_random.uniform(0.0, 1.0))
        self._target, self._command = self.target_at(self._phase), np.zeros(len(self.model.chambers))
        return self.observation(), self.info()

    def drawn(self) -> Model:
        """The model with its uncertain parameters drawn anew, each never less than a tenth of what it was."""
        changed = {}
        for name, error in self.errors.items():
            value = np.asarray(getattr(self.model, name), dtype=float)
            changed[name] = value * max(1.0 + error * self.np_random.standard_normal(), 0.1)
        return self.model.with_(**changed)

    def observation(self) -> Array:
        """What the agent sees."""
        angle, rate = self._stepper.angle, self._stepper.rate
        if self.task.noise:
            angle = angle + self.task.noise * self.np_random.standard_normal(angle.shape)
        q, length = state.joint_angles(self.model, angle), self.model.length
        tip = state.tips(self.model, angle)[-1]
        rates = state.joint_rates(rate) * self.task.period
        seen = (q, rates, tip / length, self._target / length, self._command / self.highest)
        return np.concatenate(seen).astype(np.float32)

    def info(self) -> dict[str, Any]:
        """Where the tip and its target are, m."""
        return {"tip": self._stepper.tips()[-1], "target": self._target.copy(), "time": self._stepper.time}

    def step(self, action: Array) -> tuple[Array, float, bool, bool, dict[str, Any]]:
        """Hold the pressures for one period."""
        self._command = 0.5 * (np.clip(np.asarray(action, dtype=float), -1.0, 1.0) + 1.0) * self.highest
        lost = False
        try:
            for _ in range(self._steps):
                self._stepper.step(self._command)
        except SimulationError:
            lost = True
            self._stepper.reset(np.zeros_like(self._command))
        if self.moving:
            turn = 2.0 * np.pi * self.task.frequency * self._stepper.time
            self._target = self.target_at(0.5 - 0.5 * np.cos(turn + np.pi * self._phase))
        apart = float(np.linalg.norm(self._stepper.tips()[-1] - self._target)) / self.model.length
        late = self._stepper.time >= self.task.duration - 0.5 * self.task.step
        return self.observation(), -10.0 if lost else -apart, lost, late, self.info()


def checked_errors(model: Model, errors: Mapping[str, float]) -> dict[str, float]:
    """Relative standard errors by field of the model; parameters of a fit that are no fields are refused."""
    found = {}
    for name, error in errors.items():
        if name not in ("stiffness", "damping", "link_mass", "tip_mass", "rest_angle"):
            known = "known to a fit, but no" if name in KNOWN else "no"
            raise InputError(f"{name!r} is {known} field that an episode can draw: use stiffness, damping, link_mass, "
                             "tip_mass or rest_angle")  # fmt: skip
        size = float(np.mean(np.abs(getattr(model, name))))
        if not (np.isfinite(error) and error >= 0 and size > 0):
            raise InputError(f"a standard error must be a finite number >= 0 of a field that is not zero, got {name}")
        found[name] = error / size
    return found


for _name, _moving in (("Reach", False), ("Track", True)):
    gymnasium.register(f"pliant/{_name}-v0", "pliant.exporters.gymnasium:TipEnv", kwargs={"moving": _moving})
