"""Measure the detection of contacts: touches and obstacles of virtual actuators, pushes of an arm in space.

Touches: each seed is a set of sensors on actuator a, b or c, each with its own model (examples/state). Two runs are
touched at a node of the last 60 % of the body: at rest, during a pulse, while the pressure rises, and while it is
constant again, by 20, 50, 100 and 200 mN across the body for 0.8 s. The test learns from four minutes of free motion of
the same sensors. A threshold on the disturbance torques of the same filter, for the same rate of false alarms (one an
hour), serves for comparison. Alarms in other free motion are counted for `--minutes` of each seed. Settings were tuned
on seeds 0 to 9 alone.

Obstacles: medians during constant pressure, for actuators a / b / c.

In space: an arm of two links and three chambers in MuJoCo, with 0.1 mm of noise; half of the minutes have pushes.

    python benchmarks/contact.py touches obstacles --seeds 3 --minutes 2
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache, partial
from typing import Any

import numpy as np
import xarray as xr
from harness import Case, measured
from state import FIBRE, LATENCY, NOISE, RATE, REST, model, seen_body

from pliant.contact import find_contact, free_motion
from pliant.contact.contact import filtered_free_motion, free_motion_for_rate
from pliant.contact.free_motion import blocks, normalised, tail
from pliant.contact.occupancy_map import probing_contacts_of
from pliant.estimation import estimate
from pliant.exporters.mjcf import controls, mjcf
from pliant.exporters.provenance import Provenance
from pliant.model import Chamber, Model, Space, Station, chain_model
from pliant.recording import make_recording
from pliant.study.dense import body_of_fibre
from pliant.testbed.laboratory import RECORD, SUPPLY_STEP, Laboratory, generate, record
from pliant.testbed.rod import actuator
from pliant.testbed.scenarios import Circle, Command, Scenario, scenario
from pliant.testbed.stepping import RodMotion, simulate
from pliant.testbed.valve import supply_pressure

Array = np.ndarray
STEP, DURATION, LEARN, RUNS = 5e-4, 9.2, 4, 2  # s of the rod, s of a run, minutes, runs of a seed
FORCES = (0.02, 0.05, 0.1, 0.2)  # N
ONSETS, LASTS, STEADY = (0.8, 3.4, 5.7, 7.9), 0.8, 0.3  # s; of a touch; until it is judged for place and force
FRAME, SUBSTEPS, BLUR = 1 / 75, 10, 1e-4  # s, steps of MuJoCo in a frame, m of noise: the arm in space
PUSHES = (0.05, 0.1, 0.2, 0.5)  # N


def moved(name: str, command: Command, duration: float, node: int = 0, force: Array | None = None) -> RodMotion:
    """Simulate the rod of an actuator under a command and a force (T, 2) [N] at a node."""
    fine = round(STEP / SUPPLY_STEP)
    t = np.arange(round(duration / STEP) * fine + 1) * STEP / fine
    loads = np.zeros(((t.size - 1) // fine, 4))
    loads[:, 0] = supply_pressure(command, t, Laboratory().valve)[fine::fine]
    if force is not None:
        loads[:, 1:3] = force
    return simulate(replace(actuator(name), pushed_node=node), loads, STEP, stride=round(RECORD / STEP))


def measured_body(motion: RodMotion, name: str, seed: int, label: str) -> xr.Dataset:
    """Return the body as the sensors of a seed measure a motion."""
    frames = np.arange(0.0, motion.time[-1] - 0.5 * RECORD, 1.0 / RATE)
    raw = record(motion, actuator(name), Laboratory(), frames, seed=seed, attrs={"scenario": label})
    return body_of_fibre(raw, FIBRE.model_copy(update={"rest": REST}))[0]


@cache
def free_minute(name: str, k: int) -> RodMotion:
    """Return a minute of free motion: pulses, ramps and pauses of random levels and lengths."""
    rng, t, points = np.random.default_rng([79, k]), 0.3, [(0.0, 0.0), (0.3, 0.0)]
    while t < 56.0:
        level, rise, width = rng.uniform(0.0, 200e3), rng.choice([0.002, 0.4, 2.0]), rng.uniform(0.4, 2.5)
        points += [(t + rise, level), (t + rise + width, level)]
        t = t + rise + width
    return moved(name, Command("triangle", tuple((float(a), float(b)) for a, b in points)), 60.0)


def touched(name: str, seed: int, run: int) -> tuple[RodMotion, int, Array]:
    """Return a run with four touches at one node: the motion, the node, and the forces [N] in their order."""
    rng = np.random.default_rng([83, seed, run])
    node, low, high = int(rng.integers(40, 101)), *np.sort(rng.uniform(60e3, 180e3, 2))
    strength = rng.permutation(FORCES) * rng.choice([-1.0, 1.0], 4)
    corners = ((0.0, 0.0), (2.0, 0.0), (2.002, low), (5.0, low), (7.0, high), (DURATION, high))
    command = Command("triangle", corners)
    bare = moved(name, command, DURATION, node)
    t = (np.arange(round(DURATION / STEP)) + 1) * STEP
    force = np.zeros((t.size, 2))
    for onset, newton in zip(ONSETS, strength, strict=True):
        along = bare.position[round((onset + 0.4) / RECORD), [max(node - 3, 0), min(node + 1, 101)]]
        side = np.array([along[0, 1] - along[1, 1], along[1, 0] - along[0, 0]])
        force[(t >= onset) & (t < onset + LASTS)] += newton * side / np.linalg.norm(side)
    return moved(name, command, DURATION, node, force), node, strength


@dataclass(frozen=True)
class Threshold:
    """The simple test: a threshold on the normalised square of the disturbance torques."""

    chain: Model
    options: dict[str, Any]
    covariance: Array
    threshold: float

    @classmethod
    def learnt(cls, bodies: list[xr.Dataset], chain: Model, options: dict[str, Any]) -> Threshold:
        """Return scale and threshold from free motion, by the tail that the other test uses."""
        torque = [estimate(b, chain, **options)["disturbance"].values for b in bodies]
        pooled = np.concatenate(torque)
        covariance = pooled.T @ pooled / len(pooled)
        highest = np.concatenate([blocks(normalised(t, covariance), 1.0 / RATE) for t in torque])
        return cls(chain, options, covariance, tail(highest, len(pooled) / RATE, 1.0)[0])

    def alarms(self, body: xr.Dataset) -> Array:
        """Return the times [s] at which the value exceeds the threshold."""
        result = estimate(body, self.chain, **self.options)
        over = normalised(result["disturbance"].values, self.covariance) > self.threshold
        return result["time"].values[np.flatnonzero(over & ~np.append(False, over[:-1]))]


def judged(result: xr.Dataset, onset: float, stop: float, arc: float, newton: float) -> tuple[float, float, float]:
    """Return delay [s], place error [m] and force error of one contact; NaN where there is none."""
    t, alarms = result["time"].values, np.array(result.attrs["alarm_s"])
    inside = alarms[(alarms > onset) & (alarms < stop)]
    delay = inside[0] - onset if inside.size else np.nan
    hold = result["in_contact"].values & (t > onset + STEADY) & (t < stop)
    if not hold.any():
        return delay, np.nan, np.nan
    force = np.linalg.norm(result["contact_force"].values[hold], axis=1)
    return delay, float(np.median(result["contact_arc_length"].values[hold]) - arc), np.median(force) / newton - 1.0


@cache
def touches(seeds: int, minutes: int) -> tuple[Array, Array]:
    """Return rows (force, delay, delay of the threshold, place, force error), and false alarms of both tests."""
    rows, alarms = [], np.zeros(2)
    for seed in range(seeds):
        name = "abc"[seed % 3]
        chain, options = model(name), {"noise": NOISE, "latency": LATENCY[name]}
        bodies = [measured_body(free_minute(name, k), name, seed, f"free_{k}") for k in range(LEARN)]
        learnt = free_motion_for_rate(filtered_free_motion(bodies, chain, **options), 1.0)
        simple = Threshold.learnt(bodies, chain, options)
        for run in range(RUNS):
            motion, node, strength = touched(name, seed, run)
            body = measured_body(motion, name, seed, f"touch_{run}")
            result, plain = find_contact(body, chain, free=learnt, **options), simple.alarms(body)
            for onset, newton in zip(ONSETS, np.abs(strength), strict=True):
                late = plain[(plain > onset) & (plain < onset + LASTS)] - onset
                delay, *errors = judged(result, onset, onset + LASTS, motion.arc_length[node], newton)
                rows.append((newton, delay, late[0] if late.size else np.nan, *errors))
        for k in range(minutes):
            body = measured_body(free_minute(name, 1000 + k), name, seed, f"minute_{k}")
            result = find_contact(body, chain, free=learnt, **options)
            alarms += len(result.attrs["alarm_s"]), simple.alarms(body).size
    return np.array(rows), alarms


def middle(values: Array, scale: float) -> float | None:
    """Return the median of the known values times a scale; None if none is known."""
    return scale * float(np.nanmedian(values)) if np.isfinite(values).any() else None


def of_force(newton: float, seeds: int, minutes: int) -> dict[str, object]:
    """Return the row of one strength of touches."""
    rows = touches(seeds, minutes)[0]
    _, delay, late, place, force = rows[np.isclose(rows[:, 0], newton)].T
    return {
        "alarms": f"{np.isfinite(delay).sum()} of {delay.size}", "delay, median (ms)": middle(delay, 1e3),
        "placed within 5 mm, %": 100 * float(np.mean(np.abs(place) <= 5e-3)),
        "force error, median, %": middle(force, 100),
        "alarms of a threshold": f"{np.isfinite(late).sum()} of {late.size}",
    }


def false_alarms(seeds: int, minutes: int) -> dict[str, object]:
    """Return the alarms of both tests in free motion that they did not learn from."""
    ours, simple = touches(seeds, minutes)[1]
    return {"alarms": f"{ours:.0f} in {seeds * minutes} min", "alarms of a threshold": f"{simple:.0f}"}


def random_pulses(seed: int, duration: float = 60.0) -> Scenario:
    """Return a command of the paper's pressures for random times."""
    rng, t, points = np.random.default_rng([77, seed]), 0.3, []
    while t < duration - 4.0:
        level, width = rng.choice([60e3, 119e3, 180e3, 240e3]), rng.uniform(0.5, 2.76)
        points += [(t, level), (t + width, 0.0)]
        t += width + rng.uniform(0.6, 2.0)
    return Scenario(f"random_{seed}", "", duration, Command("steps", tuple(points)), rate=RATE)


@cache
def learnt_free(name: str) -> tuple[Model, dict[str, Any]]:
    """Return the model of an actuator and the options of `find_contact`, with what five free minutes teach."""
    chain, options = model(name), {"noise": NOISE, "latency": LATENCY[name]}
    bodies = [seen_body(random_pulses(k), name)[0] for k in range(5)]
    return chain, options | {"free": free_motion(bodies, chain, **options)}


def posted(name: str) -> Scenario:
    """Return a post that mid-body touches at 0.6 of its free displacement under 119 kPa."""
    truth = generate("pulse_119", name, 1).truth
    t, x = truth["time"].values, truth["position"].values
    i = int(np.argmin(np.abs(truth["arc_length"].values - 0.085)))
    rest, bent = x[:5, i].mean(axis=0), x[(t > 2.0) & (t < 2.8), i].mean(axis=0)
    j = int(np.argmin(np.abs(x[:, i] - rest - 0.6 * (bent - rest)).sum(axis=1)))
    along = x[j, i + 1] - x[j, i - 1]
    side = np.array([-along[1], along[0]]) / np.linalg.norm(along)
    post = Circle(tuple(rest + 0.6 * (bent - rest) + 0.013 * side), 0.008)
    return Scenario("mid_body", "", 4.5, scenario("pulse_119").command, (post,), time_step=1e-4)


def obstacle(kind: str, seeds: int, minutes: int) -> dict[str, object]:  # noqa: ARG001
    """Return place and force errors and the error of the map at one obstacle, for the three actuators."""
    rows = []
    for name in "abc":
        case = posted(name) if kind == "mid_body" else scenario(kind)
        chain, options = learnt_free(name)
        body, truth = seen_body(replace(case, rate=RATE), name)
        result = find_contact(body, chain, **options)
        size, total = np.linalg.norm(truth["force"].values, axis=2), truth["force"].values.sum(axis=1)
        strength, t = np.linalg.norm(total, axis=1), truth["time"].values
        hold = (t > 1.0) & (t < 2.8) & result["in_contact"].values
        arc = (size * truth["arc_length"].values).sum(axis=1)[hold] / size.sum(axis=1)[hold]
        force = np.linalg.norm(result["contact_force"].values[hold], axis=1) / strength[hold] - 1.0
        point, thing = probing_contacts_of(result, half_width=0.005).point, case.obstacles[0]
        gap = (np.linalg.norm(point - thing.centre, axis=1) - thing.radius if isinstance(thing, Circle)
               else point @ np.array(thing.normal) - thing.offset)  # fmt: skip
        place = result["contact_arc_length"].values[hold] - arc
        rows.append((np.median(strength[hold]), 1e3 * np.median(place), 100 * np.median(force),
                     1e3 * np.sqrt(np.mean(gap**2))))  # fmt: skip
    names = ("force (N)", "place error (mm)", "force error (%)", "rms error of the contact map (mm)")
    return {name: tuple(round(float(v), 1) for v in values) for name, values in zip(names, zip(*rows, strict=True),
                                                                                    strict=True)}  # fmt: skip


@cache
def arm() -> Model:
    """Return the arm in space: two links and three chambers around it."""
    chambers = [Chamber(torque=(2e-6,), joint_gain=np.sin(a), cross_gain=-np.cos(a), name=name)
                for a, name in zip(np.radians([90, 210, 330]), "abc", strict=True)]  # fmt: skip
    return chain_model(
        length=0.3, mass=0.1, links=2, joint_placement="midsegment", stiffness=0.5, damping=5e-3,
        gravity=(0.0, 0.0, -9.81), chambers=chambers, space=Space(radius=0.012),
        stations=[Station("middle", 0, 0.15), Station("tip", 1, 0.075)],
    )  # fmt: skip


Push = tuple[float, float, Array, int, float]  # start, stop, force (3,), link, along


def in_mujoco(seed: int, pushes: tuple[Push, ...] = (), seconds: float = 60.0) -> xr.Dataset:
    """Return a recording of the arm under wandering pressures and pushes."""
    import mujoco

    rng, chain = np.random.default_rng([91, seed]), arm()
    text = mjcf(chain, Provenance(chain, "mjcf", "benchmark"), time_step=FRAME / SUBSTEPS, highest=1e6)
    m = mujoco.MjModel.from_xml_string(text)
    d, clock = mujoco.MjData(m), np.arange(round(seconds / FRAME)) * FRAME
    phase, speed = rng.uniform(0, 2 * np.pi, (3, 2)), rng.uniform(0.2, 0.7, 2)
    waves = np.sin(2 * np.pi * speed * clock[:, None, None] + phase).sum(axis=2)
    levels = (1.0 - np.exp(-clock[:, None])) * (3e4 + 1.2e4 * waves)
    inputs = [(m.actuator(name).id, c) for name, c, _ in controls(chain)]
    sites, points = [m.site(p.name).id for p in chain.points], np.empty((clock.size, 2, 3))
    for k, t in enumerate(clock):
        mujoco.mj_kinematics(m, d)
        points[k] = d.site_xpos[sites]
        for i, c in inputs:
            d.ctrl[i] = levels[k, c]
        for _ in range(SUBSTEPS):
            d.qfrc_applied[:] = 0.0
            for start, stop, force, link, along in pushes:
                if start <= t < stop:
                    body = m.body(f"link_{link + 1}").id
                    point = d.xpos[body] + along * d.xmat[body].reshape(3, 3)[:, 2]
                    mujoco.mj_applyFT(m, d, force, np.zeros(3), point, body, d.qfrc_applied)
            mujoco.mj_step(m, d)
    points += BLUR * rng.standard_normal(points.shape)
    return make_recording(clock, points, station=["middle", "tip"], frame="spatial", pressure=levels,
                          pressure_time=clock, chamber=list("abc"))  # fmt: skip


def random_pushes(seed: int, seconds: float = 60.0) -> tuple[Push, ...]:
    """Return pushes across the arm, of all strengths, at random times, places of the last link and directions."""
    rng, t, pushes = np.random.default_rng([93, seed]), 2.0, []
    while t < seconds - 2.0:
        azimuth, newton = rng.uniform(0, 2 * np.pi), PUSHES[len(pushes) % len(PUSHES)]
        force = newton * np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
        pushes.append((t, t + rng.uniform(0.6, 1.2), force, 1, rng.uniform(0.02, 0.075)))
        t += rng.uniform(2.0, 3.5)
    return tuple(pushes)


@cache
def pushed_in_space(seeds: int, minutes: int) -> tuple[Array, int]:
    """Return rows (force, delay, place, force error) of pushes, and the false alarms in as much free motion."""
    rows, alarms, base = [], 0, arm().link_length[0] + arm().base_length
    for seed in range(seeds):
        learnt = free_motion([in_mujoco(1000 * seed + k) for k in range(2)], arm())
        for k in range(max(minutes, 1)):
            alarms += len(find_contact(in_mujoco(1000 * seed + 100 + k), arm(), free=learnt).attrs["alarm_s"])
            pushes = random_pushes(1000 * seed + k)
            result = find_contact(in_mujoco(1000 * seed + 200 + k, pushes), arm(), free=learnt)
            rows += [(np.linalg.norm(force), *judged(result, start, stop, link * base + along, np.linalg.norm(force)))
                     for start, stop, force, link, along in pushes]  # fmt: skip
    return np.array(rows), alarms


def push(newton: float, seeds: int, minutes: int) -> dict[str, object]:
    """Return the row of one strength of pushes in space."""
    rows, alarms = pushed_in_space(seeds, minutes)
    _, delay, place, force = rows[np.isclose(rows[:, 0], newton)].T
    return {
        "detected": f"{np.isfinite(delay).sum()} of {delay.size}", "delay, median (ms)": middle(delay, 1e3),
        "place error, median (mm)": middle(np.abs(place), 1e3),
        "force error, median (%)": middle(force, 100), "false alarms": alarms,
    }


OBSTACLES = {"post near the tip": "contact_circle", "wall at the tip": "contact_wall", "soft ball": "contact_spring",
             "post at mid-body": "mid_body"}  # fmt: skip
if __name__ == "__main__":
    topics = {
        "touches": [*(Case(f"{1e3 * f:.0f} mN", partial(of_force, f)) for f in FORCES),
                    Case("free motion", false_alarms)],
        "obstacles": [Case(name, partial(obstacle, kind)) for name, kind in OBSTACLES.items()],
        "contact in space": [Case(f"{1e3 * f:.0f} mN in space", partial(push, f)) for f in PUSHES],
    }  # fmt: skip
    measured(__doc__, topics, seeds=20, minutes=60)
