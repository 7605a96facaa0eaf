"""Two bodies crawl as an inchworm does: ``python examples/hand/crawler.py results/demo --fit softening``.

A hinge joins one body's tip to the next one's base; feet are at both ends and at the hinge. A body that bends brings
its feet together. The rear one bends, hands its bend over to the front one, which then straightens: at every moment
the foot that moves has less friction than the two that hold, so the whole goes forward; the front one first, it goes
backward; both together, it stays about where it is. It moves in a vertical plane, as between two panes.
Feet that stick and slip need a short step: at 0.125 ms the ways are those at 0.0625 ms within 1 mm; at 1 ms they are
off by 20 mm, and both together then seem to go forward.
Writes crawler.gif and crawler.png.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

import mujoco
import numpy as np
from hand import Camera, Finger, asked, attach, bodies, empty_world, new_figure, place_at_rest, press, style

LEVEL, PERIOD, CYCLES = 150e3, 3.0, 3  # Pa, s
STEP = 1.25e-4  # s
FOOT = 0.012  # m, radius of a foot
ROUGH, SMOOTH = 0.8, 0.4  # friction of the outer feet and of the middle one
SKIN = 0.006  # m
START = 0.4  # s, to come to rest
LIMITS = (-0.04, 0.42, -0.02, 0.10)  # m, of the pictures
GAITS = {  # phase of the rear and the front body
    "forward": (0.0, 1.0 / 3.0), "backward": (1.0 / 3.0, 0.0), "together": (0.0, 0.0),
}


class Crawl(NamedTuple):
    """How far feet went."""

    time: np.ndarray  # (T,) s
    feet: np.ndarray  # (T, 3) m along the ground: rear, middle, front
    pressure: np.ndarray  # (T, 2) Pa
    camera: Camera

    @property
    def way(self) -> float:
        """Of the middle of all feet from when it was first at rest, m."""
        return float(self.feet[-1].mean() - self.feet[self.time >= START][0].mean())


def foot(body: Any, name: str, place: Any, friction: float) -> None:
    """A ball that touches the ground."""
    body.add_geom(
        name=name, type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[FOOT, 0, 0], pos=place, friction=[friction, 0, 0],
        mass=1e-3, rgba=[0.8, 0.8, 0.8, 1], contype=2, conaffinity=2,
    )


def world(rear: Finger, front: Finger, time_step: float = STEP) -> Any:
    """Both bodies on the ground, with a time step, s."""
    spec = empty_world(time_step=time_step)
    spec.worldbody.add_geom(
        name="ground", type=mujoco.mjtGeom.mjGEOM_PLANE, size=[5, 5, 0.1], friction=[0.01, 0, 0], contype=2,
        conaffinity=2,
    )
    trunk = spec.worldbody.add_body(name="trunk", pos=[0, 0, FOOT])
    for name, axis in (("x", [1, 0, 0]), ("z", [0, 0, 1])):
        trunk.add_joint(name=f"trunk_{name}", type=mujoco.mjtJoint.mjJNT_SLIDE, axis=axis)
    trunk.add_joint(name="trunk_turn", type=mujoco.mjtJoint.mjJNT_HINGE, axis=[0, 1, 0])
    foot(trunk, "foot_rear", [0, 0, 0], ROUGH)
    up, ahead = [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]  # the finger's own x and y: it bends towards -x, to the ground
    axes = np.stack([up, ahead, np.cross(up, ahead)], axis=1)
    attach(spec, trunk, rear, axes, radius=SKIN, friction=None)
    tip = spec.body(f"{rear.prefix}link_{rear.model.n}")
    end = [0.0, float(rear.model.link_length[-1]), 0.0]
    joint = tip.add_body(name="coupling", pos=end)
    joint.add_joint(name="coupling", type=mujoco.mjtJoint.mjJNT_HINGE, axis=[0, 0, 1], damping=1e-4)
    foot(joint, "foot_middle", [0, 0, 0], SMOOTH)
    attach(spec, joint, front, np.eye(3), radius=SKIN, friction=None)
    head = spec.body(f"{front.prefix}link_{front.model.n}")
    foot(head, "foot_front", [0.0, float(front.model.link_length[-1]), 0.0], ROUGH)
    return spec.compile()


def lie_down(m: Any, d: Any) -> None:
    """Turn both bodies until their feet are level."""
    for joint, first, last in (("trunk_turn", "foot_rear", "foot_middle"), ("coupling", "foot_middle", "foot_front")):
        for _ in range(2):  # the first turn shows the sense of the hinge
            chord = d.geom(last).xpos - d.geom(first).xpos
            angle, sense = np.arctan2(chord[2], chord[0]), d.joint(joint).xaxis[1]
            d.joint(joint).qpos[0] += angle * np.sign(sense)
            mujoco.mj_forward(m, d)


def bend(phase: float) -> float:
    """Share of the pressure at a phase of the cycle: up in a third, down in the next, none in the last."""
    p = phase % 1.0
    share = np.clip(3.0 * p if p < 1.0 / 3.0 else 2.0 - 3.0 * p, 0.0, 1.0)
    return float(0.5 - 0.5 * np.cos(np.pi * share))


def crawl(
    rear: Finger, front: Finger, gait: str = "forward", cycles: int = CYCLES, *, time_step: float = STEP,
) -> Crawl:
    """Some cycles of a gait, with a time step, s."""
    m = world(rear, front, time_step)
    d = mujoco.MjData(m)
    for finger in (rear, front):
        place_at_rest(m, d, finger)
    lie_down(m, d)
    camera, rows = Camera(m, [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]), []
    phases = GAITS[gait]
    while d.time < START + cycles * PERIOD + START:
        running = START <= d.time < START + cycles * PERIOD
        now = (d.time - START) / PERIOD
        pressures = [LEVEL * bend(now - phase) if running and now >= phase else 0.0 for phase in phases]
        for finger, p in zip((rear, front), pressures, strict=True):
            press(d, finger, p)
        mujoco.mj_step(m, d)
        rows.append((d.time, *(d.geom(f"foot_{name}").xpos[0] for name in ("rear", "middle", "front")), *pressures))
        camera.take(d, " + ".join(f"{1e-3 * p:.0f}" for p in pressures) + " kPa")
    table = np.array(rows)
    return Crawl(table[:, 0], table[:, 1:4], table[:, 4:], camera)


def figure(runs: dict[str, Crawl], path: Path) -> None:
    """Four pictures of a cycle, and the way of each foot for each gait."""
    with style():
        made, axes = new_figure(3, 2, height=4.6, gridspec_kw={"height_ratios": [1, 1, 2]})
        camera = runs["forward"].camera
        for ax, share in zip(axes[:2].ravel(), (0.0, 1.0 / 3.0, 0.5, 2.0 / 3.0), strict=True):
            camera.draw(ax, int(np.searchsorted(camera.times, START + share * PERIOD)), LIMITS)
        run = runs["forward"]
        for k, name in enumerate(("rear", "middle", "front")):
            axes[2, 0].plot(run.time, 1e3 * (run.feet[:, k] - run.feet[0, k]), label=f"{name} foot")
        for gait, other in runs.items():
            axes[2, 1].plot(other.time, 1e3 * (other.feet.mean(axis=1) - other.feet[0].mean()), label=gait)
        for ax, title in zip(axes[2], ("forward", "mean of the feet"), strict=True):
            ax.set(xlabel="time (s)", ylabel="way (mm)", title=title)
            ax.legend()
        made.savefig(path)


def main() -> None:
    """Crawl, draw, and say how far."""
    model, fit, folder = asked(__doc__.splitlines()[0])
    rear, front = bodies(model, fit, 2)
    runs = {gait: crawl(rear, front, gait) for gait in GAITS}
    runs["forward"].camera.film(folder / "crawler.gif", LIMITS, height=1.6)
    figure(runs, folder / "crawler.png")
    for gait, run in runs.items():
        print(f"{gait}: {1e3 * run.way:+.0f} mm in {CYCLES} cycles of {PERIOD:g} s")


if __name__ == "__main__":
    main()
