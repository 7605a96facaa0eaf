"""Three fingers hold a ball under gravity, and shaken: ``python examples/hand/grasp.py results/demo --fit softening``.

Each finger is a body that the recordings would allow as well, drawn from the fit's covariance. A table carries the ball
while the fingers close, then it sinks away; later the hand is shaken. The world is that of the hand: its acceleration
acts on everything as gravity does. Writes grasp.gif and grasp.png, and says how far the ball moved in the hand.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

import mujoco
import numpy as np
from hand import Camera, Finger, asked, attach, bodies, empty_world, new_figure, place_at_rest, press, style

LEVEL = 170e3  # Pa, that closes the hand
PALM, HEIGHT = 0.088, 0.30  # m, distance of the fingers' bases from the axis and their height
BALL, MASS, DEPTH = 0.04, 0.1, 0.135  # m, kg, m below the palm
CLOSED, GONE, SHAKEN, STILL = 0.7, 1.0, 1.8, 3.3  # s: pressure is there, table is away, the shake begins and ends
END, LET_GO = 3.8, 1.4  # s, the second of the run in which the hand lets go
LIMITS = (-0.14, 0.14, 0.07, 0.35)  # m, of the pictures
SHAKE, FREQUENCY = 5.0, 3.0  # m/s^2, along and across, Hz
GRAVITY = 9.81  # m/s^2


class Held(NamedTuple):
    """What a grasp was like."""

    time: np.ndarray  # (T,) s
    place: np.ndarray  # (T, 3) m, of the ball in the hand
    pressure: np.ndarray  # (T,) Pa
    shake: np.ndarray  # (T,) m/s^2
    camera: Camera

    @property
    def dropped(self) -> float:
        """How far the ball sank below its place on the table, m."""
        return float(self.place[0, 2] - self.place[:, 2].min())


def world(fingers: list[Finger]) -> Any:
    """The hand above a table with a ball."""
    spec = empty_world()
    for k, finger in enumerate(fingers):
        a = 2.0 * np.pi * k / len(fingers)
        out = np.array([np.cos(a), np.sin(a), 0.0])
        axes = np.stack([out, [0.0, 0.0, -1.0], np.cross(out, [0.0, 0.0, -1.0])], axis=1)  # bends towards its own -x
        attach(spec, spec.worldbody, finger, axes, at=PALM * out + [0.0, 0.0, HEIGHT], radius=0.009, friction=1.0)
    spec.worldbody.add_geom(
        name="palm", type=mujoco.mjtGeom.mjGEOM_CYLINDER, size=[PALM, 0.005, 0], pos=[0, 0, HEIGHT + 0.01],
        rgba=[0.75, 0.75, 0.75, 1], contype=0, conaffinity=0,
    )
    ball = spec.worldbody.add_body(name="ball", pos=[0, 0, HEIGHT - DEPTH])
    ball.add_freejoint()
    ball.add_geom(
        name="ball", type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[BALL, 0, 0], mass=MASS, friction=[1.0, 0.002, 1e-4],
        condim=4, rgba=[0.9, 0.9, 0.9, 1],
    )
    table = spec.worldbody.add_body(name="table", mocap=True, pos=[0, 0, HEIGHT - DEPTH - BALL - 0.005])
    table.add_geom(name="table", type=mujoco.mjtGeom.mjGEOM_BOX, size=[0.03, 0.03, 0.005], rgba=[0.6, 0.6, 0.6, 1])
    return spec.compile()


def grasp(fingers: list[Finger], level: float = LEVEL, letting_go: float = np.inf, end: float = END) -> Held:
    """Close, let the table sink, shake; without pressure from `letting_go` [s] on, until the ball is lost."""
    m = world(fingers)
    d = mujoco.MjData(m)
    for finger in fingers:
        place_at_rest(m, d, finger)
    camera = Camera(m, [np.cos(0.4), np.sin(0.4), 0.0], [-0.25 * np.sin(0.4), 0.25 * np.cos(0.4), 0.968])
    rows = []
    while d.time < end and d.body("ball").xpos[2] > 0.0:
        t = d.time
        p = level * float(np.clip(t / (0.8 * CLOSED), 0.0, 1.0)) * (t < letting_go)
        a = SHAKE * np.sin(2 * np.pi * FREQUENCY * (t - SHAKEN)) * (SHAKEN < t < STILL)
        m.opt.gravity[:] = [a, 0.0, -GRAVITY + a]
        d.mocap_pos[0, 2] = HEIGHT - DEPTH - BALL - 0.005 - 0.4 * max(0.0, t - CLOSED)
        for finger in fingers:
            press(d, finger, p)
        mujoco.mj_step(m, d)
        rows.append((t, *d.body("ball").xpos, p, a))
        camera.take(d, f"{1e-3 * p:.0f} kPa" + (", shaken" if a else ""))
    table = np.array(rows)
    return Held(table[:, 0], table[:, 1:4], table[:, 4], table[:, 5], camera)


def figure(held: Held, released: Held, path: Path) -> None:
    """Four pictures, and the ball's height with the pressure held and let go."""
    with style():
        made, axes = new_figure(2, 4, height=4.2, gridspec_kw={"height_ratios": [1.3, 1]})
        shown = ((held, 0.0), (held, CLOSED), (held, 0.5 * (SHAKEN + STILL)), (released, LET_GO + 0.12))
        for ax, (run, t) in zip(axes[0], shown, strict=True):
            run.camera.draw(ax, int(np.searchsorted(run.camera.times, t)), LIMITS)
        grid = axes[1, 0].get_gridspec()
        for ax in axes[1]:
            ax.remove()
        ax = made.add_subplot(grid[1, :])
        for run, label in ((held, "pressure held"), (released, f"let go at {LET_GO} s")):
            ax.plot(run.time, 1e3 * (run.place[:, 2] - HEIGHT), label=label)
        ax.axvspan(SHAKEN, STILL, color="0.92", linewidth=0)
        ax.set(xlabel="time (s)", ylabel="ball against the palm (mm)", ylim=(-200, -100))
        ax.annotate("shaken", (SHAKEN + 0.03, -104), va="top")
        ax.legend(loc="lower right")
        made.savefig(path)


def main() -> None:
    """Grasp, draw, and say what happened."""
    model, fit, folder = asked(__doc__.splitlines()[0])
    fingers = bodies(model, fit, 3)
    held, released = grasp(fingers), grasp(fingers, letting_go=LET_GO)
    held.camera.film(folder / "grasp.gif", LIMITS)
    figure(held, released, folder / "grasp.png")
    move = held.place[held.time > GONE]
    print(f"held at {1e-3 * LEVEL:.0f} kPa: the ball of {1e3 * MASS:.0f} g sinks by {1e3 * held.dropped:.1f} mm and "
          f"moves by {1e3 * np.ptp(move, axis=0).max():.1f} mm in the hand under a shake of {SHAKE:.0f} m/s2")
    print(f"let go at {LET_GO} s: it falls out of the hand within {released.time[-1] - LET_GO:.1f} s")


if __name__ == "__main__":
    main()
