"""What the scripts beside this one share: exported fingers in a MuJoCo world, and films of it drawn by matplotlib.

Everything that moves is MuJoCo's; nothing here needs OpenGL. A film shows the geoms' outlines in parallel projection.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

import mujoco
import numpy as np
from matplotlib import animation
from scipy.spatial import ConvexHull

import pliant
from pliant.exporters.mjcf import branches, control, controls
from pliant.exporters.randomisation import draw_models
from pliant.identification import FitResult
from pliant.plotting import new_figure, style
from pliant.validation.sides import fit_named
from pliant.validation.store import load_outcome

Array = np.ndarray
RATE = 25  # pictures a second
ORIGIN = np.zeros(3)
RING = np.linspace(0.0, 2.0 * np.pi, 25)  # rad
HIGHEST = 300e3  # Pa, end of the controls' range
STEP = 5e-4  # s, of MuJoCo: contacts are stiffer than bodies


class Finger(NamedTuple):
    """An exported body and the prefix that its names have in the world."""

    model: pliant.Model
    prefix: str


def asked(title: str) -> tuple[pliant.Model, FitResult, Path]:
    """Model, fit and the folder for film and figure, from the command line."""
    parser = argparse.ArgumentParser(description=title)
    parser.add_argument("result", nargs="?", type=Path, default=Path("results/demo"), help="folder of `pliant run`")
    parser.add_argument("--fit", default="", help="name of a fit of that run; of the demo: softening")
    parser.add_argument("-o", "--output", type=Path, default=Path(), help="folder for film and figure")
    given = parser.parse_args()
    fit = fit_of(given.result, given.fit)
    given.output.mkdir(parents=True, exist_ok=True)
    return fit.model, fit, given.output


def fit_of(folder: Path, name: str) -> FitResult:
    """The fit of this name among the results of a run, or the first."""
    try:
        return fit_named(load_outcome(folder).fits, name).result
    except pliant.InputError as error:
        sys.exit(str(error))


def bodies(model: pliant.Model, fit: Any, count: int, seed: int = 1) -> list[Finger]:
    """As many fingers, each a body that the recordings would allow as well."""
    return [Finger(m, f"finger{k + 1}_") for k, m in enumerate(draw_models(model, fit, count, seed))]


def empty_world(gravity: tuple[float, float, float] = (0.0, 0.0, -9.81), time_step: float = STEP) -> Any:
    """A world of gravity whose contacts do not creep, with a time step, s."""
    world = mujoco.MjSpec()
    world.option.timestep, world.option.gravity = time_step, gravity
    world.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    world.option.cone, world.option.impratio = mujoco.mjtCone.mjCONE_ELLIPTIC, 50.0
    return world


def attach(
    world: Any, body: Any, finger: Finger, axes: Array, *, at: Array = ORIGIN, radius: float, friction: float | None,
) -> None:
    """Put an exported finger on a body of the world; the columns of `axes` are its x, y and z there.

    Without a friction its skin touches nothing.
    """
    with TemporaryDirectory() as folder:
        path = Path(folder) / "finger.xml"
        pliant.export(finger.model, "mjcf", path, time_step=world.option.timestep, radius=radius, highest=HIGHEST)
        own = mujoco.MjSpec.from_file(str(path))
    own.option = world.option
    for geom in own.geoms:
        if friction is None:
            geom.contype, geom.conaffinity = 0, 0
        else:
            geom.friction[0], geom.condim = friction, 4
    turn = np.empty(4)
    mujoco.mju_mat2Quat(turn, np.asarray(axes, dtype=float).ravel())
    body.add_frame(pos=at, quat=turn).attach_body(own.body("base"), finger.prefix, "")


def press(d: Any, finger: Finger, pressure: float) -> None:
    """Command a pressure, Pa: each control takes its own power of it."""
    for name, _, power in controls(finger.model):
        d.actuator(finger.prefix + name).ctrl[0] = control(pressure, power)


def place_at_rest(m: Any, d: Any, finger: Finger) -> None:
    """The finger in its shape without pressure and gravity of the world, its memory relaxed."""
    q = pliant.equilibrium(finger.model)
    for name in ("q", *(branch.name for branch in branches(finger.model))):
        for i in range(finger.model.n):
            d.joint(f"{finger.prefix}{name}_{i + 1}").qpos[0] = q[i]
    mujoco.mj_forward(m, d)


class Camera:
    """A parallel projection, and what it sees of a world at some instants."""

    def __init__(self, m: Any, right: Array, up: Array) -> None:
        self.m, self.axes = m, np.stack([np.asarray(right, dtype=float), np.asarray(up, dtype=float)])
        self.ahead = np.cross(*self.axes)
        self.times: list[float] = []
        self.poses: list[tuple[Array, Array]] = []
        self.told: list[str] = []

    def take(self, d: Any, told: str = "") -> None:
        """Keep a picture, where one is due."""
        if d.time + 1e-9 >= len(self.times) / RATE:
            self.times.append(d.time)
            self.poses.append((d.geom_xpos.copy(), d.geom_xmat.copy().reshape(-1, 3, 3)))
            self.told.append(told)

    def draw(self, ax: Any, k: int, limits: tuple[float, float, float, float]) -> None:
        """Picture `k` on an axes, limits in m."""
        ax.clear()
        ax.set(xlim=limits[:2], ylim=limits[2:], aspect="equal", xticks=[], yticks=[])
        ax.grid(visible=False)
        place, turn = self.poses[k]
        for g in sorted(range(self.m.ngeom), key=lambda g: float(place[g] @ self.ahead)):
            kind = mujoco.mjtGeom(int(self.m.geom_type[g]))
            if kind == mujoco.mjtGeom.mjGEOM_PLANE:
                ax.axhline(float(place[g] @ self.axes[1]), color="0.15", linestyle="-", linewidth=1.0)
                continue
            seen = self.outline(kind, self.m.geom_size[g], place[g], turn[g])
            grey = str(self.m.geom_rgba[g, 0])
            ax.fill(*seen[ConvexHull(seen).vertices].T, facecolor=grey, edgecolor="0.15", linewidth=0.8, linestyle="-",
                    zorder=3)  # fmt: skip
        ax.set_title(f"{self.times[k]:.2f} s   {self.told[k]}", loc="left")

    def outline(self, kind: Any, size: Array, place: Array, turn: Array) -> Array:
        """Points (K, 2) of the picture whose hull is the geom's."""
        ring = np.stack([np.cos(RING), np.sin(RING)], axis=1)
        if kind == mujoco.mjtGeom.mjGEOM_SPHERE:
            return place @ self.axes.T + size[0] * ring
        if kind == mujoco.mjtGeom.mjGEOM_CAPSULE:
            ends = [(place + side * size[1] * turn[:, 2]) @ self.axes.T for side in (-1, 1)]
            return np.concatenate([end + size[0] * ring for end in ends])
        if kind == mujoco.mjtGeom.mjGEOM_CYLINDER:
            own = np.concatenate([np.column_stack([size[0] * ring, np.full(RING.size, z * size[1])]) for z in (-1, 1)])
        else:
            own = np.array([[i, j, k] for i in (-1, 1) for j in (-1, 1) for k in (-1, 1)]) * size
        return (place + own @ turn.T) @ self.axes.T

    def film(self, path: Path, limits: tuple[float, float, float, float], height: float = 4.0) -> None:
        """Write all pictures as .gif, or as .mp4 where ffmpeg is."""
        with style():
            width = height * (limits[1] - limits[0]) / (limits[3] - limits[2])
            figure, ax = new_figure(1, 1, height=height, width=width)

            def draw(k: int) -> list[Any]:
                self.draw(ax, k, limits)
                return []

            made = animation.FuncAnimation(figure, draw, frames=len(self.times))
            made.save(str(path), writer="pillow" if path.suffix == ".gif" else "ffmpeg", fps=RATE, dpi=100)


def contact_force(m: Any, d: Any, geom: int) -> Array:
    """Sum (3,) of the forces that everything else puts on a geom, N."""
    total, force = np.zeros(3), np.zeros(6)
    for k in range(d.ncon):
        pair = d.contact[k].geom
        if geom in pair:
            mujoco.mj_contactForce(m, d, k, force)
            here = d.contact[k].frame.reshape(3, 3).T @ force[:3]
            total += here if pair[1] == geom else -here
    return total

