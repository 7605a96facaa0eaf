"""One finger presses against a post, beside the virtual laboratory: ``python examples/hand/post.py a``.

The laboratory's actuator, an independent rod with hysteresis and creep, bends against a round post of known place, and
the force is known. The finger is the model that was identified from recordings of that actuator without any contact
(free pulses, triangles, and a thread that pulls at the tip: `examples/state`), exported to MuJoCo, its memory included.
The laboratory's friction is viscous below 1 mm/s, so that a body at rest feels none: MuJoCo's post has none either.
Writes post.gif and post.png, and says by how much the forces differ. With a folder of `pliant run` instead of a letter,
that model presses, beside actuator a.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import mujoco
import numpy as np
from hand import Camera, Finger, attach, contact_force, empty_world, fit_of, new_figure, place_at_rest, press, style

import pliant
from pliant.testbed.laboratory import Laboratory, run_rod
from pliant.testbed.rod import actuator
from pliant.testbed.scenarios import POST, scenario

MODELS = Path(__file__).parents[1] / "state"
CASE = scenario("contact_circle")
(START, LEVEL), (STOP, _) = CASE.command.points  # s, Pa
HELD = (1.0, STOP - 0.1)  # s, in which the force is compared
LIMITS = (-0.12, 0.06, -0.02, 0.19)  # m, of the pictures


class Pressed(NamedTuple):
    """A force against time."""

    time: np.ndarray  # (T,) s
    force: np.ndarray  # (T, 2) N, on the finger

    @property
    def held(self) -> float:
        """Median of its size while the pressure holds, N."""
        inside = (self.time > HELD[0]) & (self.time < HELD[1])
        return float(np.median(np.linalg.norm(self.force[inside], axis=1)))


def laboratory(name: str, end: float = CASE.duration) -> Pressed:
    """What the post does to the virtual actuator, for `end` seconds."""
    motion = run_rod(replace(CASE, duration=end), actuator(name), Laboratory())
    return Pressed(motion.time, motion.force.sum(axis=1))


def in_mujoco(model: pliant.Model, end: float = CASE.duration) -> tuple[Pressed, Camera, Any]:
    """What the post does to the exported finger, for `end` seconds; pictures, and MuJoCo's data at the end."""
    spec, finger = empty_world((0.0, 0.0, 0.0)), Finger(model, "finger_")
    attach(spec, spec.worldbody, finger, np.eye(3), radius=actuator("a").half_width, friction=0.0)
    spec.worldbody.add_geom(
        name="post", type=mujoco.mjtGeom.mjGEOM_CYLINDER, pos=[*POST.centre, 0.0], size=[POST.radius, 0.03, 0.0],
        friction=[0.0, 0.0, 0.0], condim=1, rgba=[0.8, 0.8, 0.8, 1],
        solref=[1e-2, 1.0],  # s: the finger sinks in by 0.3 to 0.5 mm, in the laboratory by 0.3 to 0.4
    )
    m = spec.compile()
    d = mujoco.MjData(m)
    place_at_rest(m, d, finger)
    camera, post, rows = Camera(m, [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]), m.geom("post").id, []
    while d.time < end:
        level = LEVEL if START <= d.time < STOP else 0.0
        press(d, finger, level)
        mujoco.mj_step(m, d)
        rows.append((d.time, *-contact_force(m, d, post)[:2]))
        camera.take(d, f"{1e-3 * level:.0f} kPa   {np.linalg.norm(rows[-1][1:]):.2f} N")
    table: Any = np.array(rows)
    return Pressed(table[:, 0], table[:, 1:]), camera, d


def figure(true: Pressed, made: Pressed, camera: Camera, path: Path) -> None:
    """The finger before and at the post, and both forces."""
    with style():
        drawn, axes = new_figure(1, 3, height=2.4, gridspec_kw={"width_ratios": [1, 1, 2]})
        for ax, t in zip(axes[:2], (0.0, 2.0), strict=True):
            camera.draw(ax, int(np.searchsorted(camera.times, t)), LIMITS)
        for run, label in ((true, "virtual laboratory"), (made, "exported finger")):
            axes[2].plot(run.time, np.linalg.norm(run.force, axis=1), label=label)
        axes[2].axvspan(*HELD, color="0.93", linewidth=0)
        axes[2].set(xlabel="time (s)", ylabel="force of the post (N)", ylim=(0.0, 2.0 * true.held))
        axes[2].legend(loc="lower center")
        drawn.savefig(path)


def main() -> None:
    """Press, draw, compare."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("finger", nargs="?", default="a", help="a, b, c, or the folder of a run")
    parser.add_argument("--fit", default="", help="name of a fit of that run; of the demo: softening")
    parser.add_argument("-o", "--output", type=Path, default=Path(), help="folder for film and figure")
    asked = parser.parse_args()
    asked.output.mkdir(parents=True, exist_ok=True)
    letter = asked.finger if asked.finger in ("a", "b", "c") else "a"
    model = (pliant.load_model(MODELS / f"model_{letter}.json") if asked.finger == letter else
             fit_of(Path(asked.finger), asked.fit).model)  # fmt: skip
    true, (made, camera, _) = laboratory(letter), in_mujoco(model)
    camera.film(asked.output / "post.gif", LIMITS)
    figure(true, made, camera, asked.output / "post.png")
    apart = 100.0 * (made.held / true.held - 1.0)
    print(f"{letter}: laboratory {true.held:.3f} N, MuJoCo {made.held:.3f} N, {apart:+.1f} %")


if __name__ == "__main__":
    main()
