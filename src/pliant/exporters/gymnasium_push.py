"""Gymnasium environment ``pliant/Push-v0``, in which a planar actuator pushes a puck to a target,
simulated by MuJoCo.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

import gymnasium
import numpy as np
from gymnasium import spaces

from pliant.errors import InputError
from pliant.exporters.fibre_view import FibreView
from pliant.exporters.gymnasium import (
    LOST,
    Array,
    EpisodeTask,
    checked_task,
    highest_pressure,
    on_curve,
    planar_model,
    reachable,
)
from pliant.exporters.mjcf import CAN, branches, control, controls, mjcf, number
from pliant.exporters.provenance import Provenance
from pliant.exporters.randomisation import Fit, draw_models
from pliant.mechanics import mechanics_of
from pliant.model import Model
from pliant.model.features import missing, named
from pliant.plugins import optional
from pliant.simulation import state
from pliant.text import listed

PUCK = 0.10  # radius of the puck, as a fraction of the body's length
SKIN = 0.05  # radius of the body, as a fraction of its length
FRICTION = 0.4  # friction coefficient of the table under the puck
NEAR = 0.1  # weight in the reward of the distance from the tip to the puck


class PushEnv(gymnasium.Env[Array, Array]):
    """Gymnasium environment in which pressures move a planar actuator that pushes a puck on a table to a target.

    Action: pressures of the chambers (C,), scaled so that -1 is 0 Pa and 1 is `highest`. Observation: joint angles (n,)
    [rad], their rates times the period (n,), then tip, puck, the puck's velocity times the period and the target (2
    each), all divided by the body's length, and the commanded pressures (C,) divided by `highest`. Reward: minus the
    distance of the puck from its target and a tenth of the tip's distance from the puck, divided by the body's length.
    If the simulation becomes unstable, the episode ends with the reward -10.

    Parameters
    ----------
    model : Model, str or Path
    highest, fit, task, render_mode
        As in `pliant.exporters.gymnasium.TipVectorEnv`. The task's `time_step` is MuJoCo's.

    Raises
    ------
    InputError
        When MuJoCo is not installed, or the model has a feature that MJCF cannot express.
    """

    metadata: dict[str, Any] = {"render_modes": []}  # noqa: RUF012  Gymnasium's own way

    def __init__(
        self, model: Model | str | Path, *, highest: float = 0.0, fit: Fit | None = None,
        task: EpisodeTask | None = None, render_mode: None = None,
    ) -> None:
        self.mujoco = optional("mujoco", "pliant/Push-v0 needs MuJoCo: pip install mujoco")
        self.model = planar_model(model)
        self.fit, self.task, self.render_mode = fit, checked_task(task or EpisodeTask()), render_mode
        if lost := missing(self.model, CAN - {"lengthening"}):  # the environment has angles alone
            raise InputError(f"{listed(named(self.model, lost))}: not expressible in MuJoCo, which simulates "
                             "the puck: use a model without this feature")  # fmt: skip
        self.highest = highest_pressure(self.model, highest, "cannot push")
        n, C, t = self.model.n, self.model.actuation.count, self.task
        self.action_space = spaces.Box(-1.0, 1.0, (C,), np.float32)
        self.observation_space = spaces.Box(-np.inf, np.inf, (2 * n + 8 + C,), np.float32)
        self._steps = max(1, round(t.period / t.time_step))
        self._fibre = FibreView(self.model, 1, self._steps * t.time_step) if t.observe == "fibre" else None
        self._late = min(round(self._fibre.sensor.latency / t.time_step), self._steps) if self._fibre else 0
        self._curve = reachable(self.model, self.highest)
        self._controls = controls(self.model)
        self._worlds: list[tuple[Any, Model]] = []

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None,  # noqa: ARG002  Gymnasium's own
    ) -> tuple[Array, dict[str, Any]]:
        """Start a new episode: the actuator at rest, the puck next to its tip, and the target further along the tip's
        path.

        If a fit is given, a new body is used.
        """
        super().reset(seed=seed)
        rng = self.np_random
        if seed is not None or not self._worlds:
            bodies = draw_models(self.model, self.fit, self.task.bodies, rng) if self.fit else [self.model]
            worlds = (world(m, self.task.time_step, self.highest) for m in bodies)
            self._worlds = [(self.mujoco.MjModel.from_xml_string(w), m) for w, m in zip(worlds, bodies, strict=True)]
        self._m, self._own = self._worlds[int(rng.integers(len(self._worlds)))]
        self._d = self.mujoco.MjData(self._m)
        self._joints = [self._m.joint(f"q_{i + 1}").id for i in range(self.model.n)]
        rest = state.equilibrium(self._own, np.zeros(self.model.actuation.count))
        self._d.qpos[self._m.jnt_qposadr[self._joints]] = rest
        for branch in branches(self._own):
            names = [f"{branch.name}_{i + 1}" for i in range(self.model.n)]
            self._d.qpos[[self._m.joint(name).qposadr[0] for name in names]] = rest
        self._puck = np.array([self._m.joint(axis).qposadr[0] for axis in ("puck_x", "puck_y")])
        self._speed = np.array([self._m.joint(axis).dofadr[0] for axis in ("puck_x", "puck_y")])
        start, self._target = self.places(float(rng.uniform(0.15, 0.4)), float(rng.uniform(0.3, 0.7)))
        self._d.qpos[self._puck] = start
        self._command, self._elapsed = np.zeros(self.model.actuation.count), 0
        if self._fibre:
            self._fibre.reset(np.arange(1), rng)
        self._before = self.angle()
        self.mujoco.mj_forward(self._m, self._d)
        return self.observation(self.angle()), self.info()

    def places(self, where: float, further: float) -> tuple[Array, Array]:
        """Return the puck's start and target, each (2,) [m]. Each lies in front of a point of the tip's path.

        The start belongs to the fraction `where` of the path, the target to the fraction `further` of the rest.
        """
        at = where * (len(self._curve) - 1)
        k = min(int(at), len(self._curve) - 2)
        ahead = self._curve[k + 1] - self._curve[k]
        ahead = ahead / max(float(np.linalg.norm(ahead)), 1e-12)
        start = self._curve[k] + (PUCK + SKIN) * self.model.length * ahead
        end = where + further * (1.0 - where)
        target = on_curve(self._curve, end) + (PUCK + SKIN) * self.model.length * ahead
        return start, target

    def angle(self) -> Array:
        """Return the present absolute angles (n,) [rad] of the simulated actuator's n links."""
        return mechanics_of(self._own).coordinates(self._d.qpos[self._m.jnt_qposadr[self._joints]])

    def observation(self, angle: Array) -> Array:
        """Return the observation (2 n + 8 + C,) at the absolute link angles (n,) [rad]: n joint angles, their changes
        in one period, tip (2), puck (2), the puck's motion in one period (2), target (2) and C commands. Lengths are
        divided by the body's length, commands by the highest pressure.
        """
        m, fibre, L = self.model, self._fibre, self.model.length
        seen = fibre.see(angle[None], self.np_random)[0] if fibre else angle
        q = mechanics_of(m).joint_angles(seen)
        rate = self._d.qvel[self._m.jnt_dofadr[self._joints]] * self.task.period
        turn = q - mechanics_of(m).joint_angles(self._before) if fibre else rate
        self._before = seen
        tip, puck = mechanics_of(m if fibre else self._own).tips(seen)[-1], self._d.qpos[self._puck]
        speed = self._d.qvel[self._speed] * self.task.period
        rows = (q, turn, tip / L, puck / L, speed / L, self._target / L, self._command / self.highest)
        return np.concatenate(rows).astype(np.float32)

    def info(self) -> dict[str, Any]:
        """Return Gymnasium's info dict: positions (2,) [m] of tip, puck and target, and the time [s]."""
        tip = mechanics_of(self._own).tips(self.angle())[-1]
        return {
            "tip": tip, "puck": self._d.qpos[self._puck].copy(), "target": self._target.copy(),
            "time": self._elapsed * self._steps * self.task.time_step,
        }

    def step(self, action: Array) -> tuple[Array, float, bool, bool, dict[str, Any]]:
        """Hold the pressures of the action (C,) in C chambers for one period. Return observation, reward, the flags
        `terminated` and `truncated`, and the info dict.
        """
        self._command = 0.5 * (np.clip(np.asarray(action, dtype=float), -1.0, 1.0) + 1.0) * self.highest
        for name, chamber, power in self._controls:
            self._d.actuator(name).ctrl[0] = control(self._command[chamber], power)
        self.mujoco.mj_step(self._m, self._d, self._steps - self._late)
        angle = self.angle()
        self.mujoco.mj_step(self._m, self._d, self._late)
        self._elapsed += 1
        lost = bool(self._d.warning[self.mujoco.mjtWarning.mjWARN_BADQACC].number > 0)
        seen, info = self.observation(angle if self._late else self.angle()), self.info()
        apart = np.linalg.norm(info["puck"] - info["target"]) + NEAR * np.linalg.norm(info["tip"] - info["puck"])
        late = info["time"] >= self.task.duration - 0.5 * self.task.time_step
        return seen, LOST if lost else -float(apart) / self.model.length, lost, bool(late), info


def world(model: Model, time_step: float, highest: float) -> str:
    """Return the MJCF text of a world that contains the actuator and a puck that rubs on a table."""
    provenance = Provenance(model, "mjcf", "pliant/Push-v0")
    root = ET.fromstring(mjcf(model, provenance, time_step=time_step, radius=SKIN * model.length, highest=highest))  # noqa: S314  our own text
    radius, mass = PUCK * model.length, float(np.sum(model.link_mass))
    place, key = root.find("worldbody"), root.find("keyframe")
    assert place is not None
    if key is not None:  # it holds the state of the body without the puck
        root.remove(key)
    puck = ET.SubElement(place, "body", name="puck", gravcomp="1")
    rub = number(FRICTION * 9.81 * mass)
    for axis, along in (("x", "1 0 0"), ("y", "0 1 0")):
        ET.SubElement(puck, "joint", name=f"puck_{axis}", type="slide", axis=along, frictionloss=rub)
    ET.SubElement(puck, "geom", name="puck", type="cylinder", size=number(radius, radius), mass=number(mass))
    return ET.tostring(root, encoding="unicode")
