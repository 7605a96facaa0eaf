"""Measure contact detection on virtual actuators: delay, position, force, map and false alarms.

    python benchmarks/contact.py b                        # contacts at the tip, then obstacles and a map of two of them
    python benchmarks/contact.py b --rate 250             # the same with a sensor of 250 Hz
    python benchmarks/contact.py b --minutes 60           # only false alarms in other free motion
    python benchmarks/contact.py space --minutes 5 --seeds 4    # an arm in space: false alarms, pushes and releases

The noise was tuned on actuator a alone. The model's torque error and the criterion for a steady contact were chosen
with b and c in view. Each actuator has its own model in examples/state. The test learns from five minutes of free
motion of the same body.

The arm in space has two links and is moved by three chambers in MuJoCo, which computes hinges one after the other where
pliant's joints swing. Each seed has its own motions, pushes and noise of the measured tips (0.1 mm). The filter has its
default noise, and the test learns from two minutes of free motion. A push begins every 2 to 3.5 s and lasts 0.6 to
1.2 s; as much motion with pushes as without is simulated.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from functools import cache

import numpy as np
from state import LATENCY, NOISE, model, pushed, seen

from pliant.contact import find_contact, free_motion, map_contacts
from pliant.contact.occupancy_map import probing_contacts_of
from pliant.exporters.mjcf import controls, mjcf
from pliant.exporters.provenance import Provenance
from pliant.model import Chamber, Space, Station, chain_model
from pliant.recording import make_recording
from pliant.testbed.laboratory import Laboratory, generate, run_rod
from pliant.testbed.rod import actuator
from pliant.testbed.scenarios import Circle, Command, Scenario, pulse, scenario

HALF_WIDTH = 0.005  # m
LEARN = range(5)
OTHER = 100  # seed of the first minute of other free motion
LENGTH = 0.17  # m
FRAME, SUBSTEPS, BLUR = 1 / 75, 10, 1e-4  # s, steps of MuJoCo in a frame, m of noise: the arm in space
PUSHES = (0.05, 0.1, 0.2, 0.5)  # N
SETTLED = 0.3  # s of a push before it counts for place and force
LET_GO = 0.15  # s after a release, in which it may itself be noticed
HELD = Scenario("held", "", 4.0, pulse(119e3, 3.5, start=0.2))


def random_pulses(seed, rate, duration=60.0):
    """Return a command of the paper's pressures for random times."""
    rng, t, points = np.random.default_rng([77, seed]), 0.3, []
    while t < duration - 4.0:
        level, width = rng.choice([60e3, 119e3, 180e3, 240e3]), rng.uniform(0.5, 2.76)
        points += [(t, level), (t + width, 0.0)]
        t += width + rng.uniform(0.6, 2.0)
    return Scenario(f"random_{seed}", "", duration, Command("steps", tuple(points)), rate=rate)


def posted(name, share):
    """Return a post that mid-body touches at a fraction of its free displacement under 119 kPa."""
    made = generate("pulse_119", name, 1).truth
    t, x = made["time"].values, made["position"].values
    i = int(np.argmin(np.abs(made["arc_length"].values - 0.085)))
    rest, held = x[:5, i].mean(axis=0), x[(t > 2.0) & (t < 2.8), i].mean(axis=0)
    j = int(np.argmin(np.abs(x[:, i] - rest - share * (held - rest)).sum(axis=1)))
    along = x[j, i + 1] - x[j, i - 1]
    side = np.array([-along[1], along[0]]) / np.linalg.norm(along)
    post = Circle(tuple(rest + share * (held - rest) + 0.013 * side), 0.008)
    return Scenario(f"mid_{share}", "", 4.5, scenario("pulse_119").command, (post,), time_step=1e-4)


def poked(name, newton, begin, side, rate):
    """Return the shape under constant 119 kPa while a force along `side` acts on the tip for 0.4 s from `begin`."""
    case = replace(HELD, name=f"poke_{newton}_{begin}")
    return pushed(case, name, lambda t: newton * ((t >= begin) & (t < begin + 0.4))[:, None] * side, rate)


def pokes(name, chain, options, rate):
    """Evaluate forces across the tip in both directions at three times during constant pressure."""
    end = run_rod(HELD, actuator(name), Laboratory()).position[2000]  # at 2 s
    side = np.array([end[-4, 1] - end[-1, 1], end[-1, 0] - end[-4, 0]]) / np.linalg.norm(end[-1] - end[-4])
    for newton in (0.02, 0.05, 0.1):
        late, wrong, away = [], [], []
        for begin in (2.0, 2.5, 3.0):
            for sign in (1.0, -1.0):
                found = find_contact(poked(name, sign * newton, begin, side, rate), chain, **options)
                alarms, t = np.array(found.attrs["alarm_s"]) - begin, found["time"].values - begin
                late += list(1e3 * alarms[(alarms > 0) & (alarms < 0.4)][:1])
                hold = found["in_contact"].values & (t > 0.15) & (t < 0.4)
                wrong += list(np.linalg.norm(found["contact_force"].values[hold], axis=1) / newton - 1.0)
                away += list(LENGTH - found["contact_arc_length"].values[hold])
        told = f", place {1e3 * np.median(away):.1f} mm, force {100 * np.median(wrong):+.0f} %" if wrong else ""
        print(f"{name} tip, {1e3 * newton:.0f} mN: {len(late)} of 6 found after {np.sort(late).round()} ms{told}",
              flush=True)


def obstacles(name, chain, options, rate):
    """Evaluate a post, a wall, a soft ball and a post at mid-body; medians during constant pressure."""
    maps, gaps = [], []
    for case in (*map(scenario, ("contact_circle", "contact_wall", "contact_spring")), posted(name, 0.6),
                 posted(name, 0.8)):
        body, truth = seen(replace(case, rate=rate), name)
        found = find_contact(body, chain, **options)
        size, total = np.linalg.norm(truth["force"].values, axis=2), truth["force"].values.sum(axis=1)
        t, strength = truth["time"].values, np.linalg.norm(total, axis=1)
        least = 0.1 if case.name.startswith("mid") else 0.02
        alarms = 1e3 * (np.array(found.attrs["alarm_s"]) - t[np.argmax(strength > least)])
        hold = (t > 1.0) & (t < 2.8) & found["in_contact"].values
        arc = (size * truth["arc_length"].values).sum(axis=1)[hold] / size.sum(axis=1)[hold]
        force = np.linalg.norm(found["contact_force"].values[hold], axis=1) / strength[hold] - 1.0
        place = found["contact_arc_length"].values[hold] - arc
        poke = probing_contacts_of(found, half_width=HALF_WIDTH)
        gap = distances(poke.point, case.obstacles[0])
        maps.append(poke)
        gaps.append(gap)
        print(f"{name} {case.name}: {np.median(strength[hold]):.2f} N at {1e3 * np.median(arc):.0f} mm, first of "
              f"{alarms.size} alarms {alarms[0]:.0f} ms after {least} N, "
              f"place {1e3 * np.median(place):+.1f} mm, force {100 * np.median(force):+.0f} %, map {len(gap)} points, "
              f"RMS {1e3 * np.sqrt(np.mean(gap**2)):.2f} mm", flush=True)
    chart, both = map_contacts(maps[:2], half_width=HALF_WIDTH), np.concatenate(gaps[:2])
    print(f"{name} map of post and wall: {chart.sizes['touch']} points, RMS {1e3 * np.sqrt(np.mean(both**2)):.2f} mm")


def distances(point, thing):
    """Return the distances [m] of the map's surface points from the surface of the obstacle."""
    if isinstance(thing, Circle):
        return np.linalg.norm(point - thing.centre, axis=1) - thing.radius
    return point @ np.array(thing.normal) - thing.offset


def false_alarms(name, chain, options, rate, minutes):
    """Count alarms in free motion that the test did not learn from."""
    count, highest = 0, 0.0
    for k in range(minutes):
        found = find_contact(seen(random_pulses(OTHER + k, rate), name)[0], chain, **options)
        count, highest = count + len(found.attrs["alarm_s"]), max(highest, float(found["statistic"].max()))
        if (k + 1) % 10 == 0 or k + 1 == minutes:
            print(f"{name}: {count} false alarms in {k + 1} min of other free motion, highest statistic "
                  f"{highest:.2f} of the threshold", flush=True)


@cache
def arm():
    """Return the arm in space: two links and three chambers around it."""
    azimuths = np.radians([90, 210, 330])
    chambers = [Chamber(torque=(2e-6,), joint_gain=np.sin(a), cross_gain=-np.cos(a), name=name)
                for a, name in zip(azimuths, "abc", strict=True)]  # fmt: skip
    return chain_model(
        length=0.3, mass=0.1, links=2, joint_placement="midsegment", stiffness=0.5, damping=5e-3,
        gravity=(0.0, 0.0, -9.81), chambers=chambers, space=Space(radius=0.012),
        stations=[Station("middle", 0, 0.15), Station("tip", 1, 0.075)],
    )  # fmt: skip


def in_mujoco(seed, seconds, pushes=()):
    """Return a recording of the arm under wandering pressures and pushes (start, stop, force (3,), link, along)."""
    import mujoco

    rng, chain = np.random.default_rng([91, seed]), arm()
    text = mjcf(chain, Provenance(chain, "mjcf", "benchmark"), time_step=FRAME / SUBSTEPS, highest=1e6)
    m = mujoco.MjModel.from_xml_string(text)
    d = mujoco.MjData(m)
    clock = np.arange(round(seconds / FRAME)) * FRAME
    phase, speed = rng.uniform(0, 2 * np.pi, (3, 2)), rng.uniform(0.2, 0.7, 2)
    waves = np.sin(2 * np.pi * speed * clock[:, None, None] + phase).sum(axis=2)
    levels = (1.0 - np.exp(-clock[:, None])) * (3e4 + 1.2e4 * waves)
    inputs = [(m.actuator(name).id, c) for name, c, _ in controls(chain)]
    sites, places = [m.site(p.name).id for p in chain.points], np.empty((clock.size, 2, 3))
    for k, t in enumerate(clock):
        mujoco.mj_kinematics(m, d)
        places[k] = d.site_xpos[sites]
        for i, c in inputs:
            d.ctrl[i] = levels[k, c]
        now = [p for p in pushes if p[0] <= t < p[1]]
        for _ in range(SUBSTEPS):
            d.qfrc_applied[:] = 0.0
            for _, _, force, link, along in now:
                body = m.body(f"link_{link + 1}").id
                point = d.xpos[body] + along * d.xmat[body].reshape(3, 3)[:, 2]
                mujoco.mj_applyFT(m, d, force, np.zeros(3), point, body, d.qfrc_applied)
            mujoco.mj_step(m, d)
    places += BLUR * rng.standard_normal(places.shape)
    return make_recording(clock, places, station=["middle", "tip"], frame="spatial", pressure=levels,
                          pressure_time=clock, chamber=list("abc"))  # fmt: skip


def random_pushes(seed, seconds):
    """Return pushes across the arm, of all strengths, at random times, places of the last link and directions."""
    rng, t, pushes = np.random.default_rng([93, seed]), 2.0, []
    while t < seconds - 2.0:
        azimuth, newton = rng.uniform(0, 2 * np.pi), PUSHES[len(pushes) % len(PUSHES)]
        force = newton * np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
        pushes.append((t, t + rng.uniform(0.6, 1.2), force, 1, rng.uniform(0.02, 0.075)))
        t += rng.uniform(2.0, 3.5)
    return pushes


def judged(found, pushes, rows, outside):
    """Append strength, delay, and errors of place and force of each push to `rows`, and alarms at or after releases to
    `outside`.
    """
    alarms, t, base = np.array(found.attrs["alarm_s"]), found["time"].values, arm().link_length[0] + arm().base_length
    late = np.full(alarms.size, np.inf)  # after the last release
    for start, stop, force, link, along in pushes:
        newton, own = np.linalg.norm(force), alarms[(alarms > start) & (alarms < stop)]
        late[alarms >= stop] = alarms[alarms >= stop] - stop
        late[(alarms > start) & (alarms < stop)] = np.nan
        hold = found["in_contact"].values & (t > start + SETTLED) & (t < stop)
        place = found["contact_arc_length"].values[hold] - (link * base + along)
        size = np.linalg.norm(found["contact_force"].values[hold][:, :2], axis=1)
        rows.append((newton, own[0] - start if own.size else np.nan,
                     np.median(np.abs(place)) if hold.any() else np.nan,
                     np.median(size) / newton - 1.0 if hold.any() else np.nan))  # fmt: skip
    outside += list(late[~np.isnan(late)])


def in_space(minutes, seeds):
    """Count false alarms of the arm in space, and evaluate pushes on it."""
    rows, outside, quiet, highest = [], [], 0, 0.0
    for seed in range(seeds):
        learnt = free_motion([in_mujoco(1000 * seed + k, 60.0) for k in range(2)], arm())
        for k in range(minutes):
            found = find_contact(in_mujoco(1000 * seed + 100 + k, 60.0), arm(), free=learnt)
            quiet, highest = quiet + len(found.attrs["alarm_s"]), max(highest, float(found["statistic"].max()))
            pushes = random_pushes(1000 * seed + k, 60.0)
            found = find_contact(in_mujoco(1000 * seed + 200 + k, 60.0, pushes), arm(), free=learnt)
            judged(found, pushes, rows, outside)
        late, released = np.array(outside), len(rows)
        print(f"space, seeds to {seed}: {quiet} false alarms in {(seed + 1) * minutes} min of free motion, highest "
              f"statistic {highest:.2f} of the threshold; {released} releases: {(late < LET_GO).sum()} noticed as a "
              f"contact, {(late >= LET_GO).sum()} false alarms later, after {np.sort(late[late >= LET_GO]).round(2)} s",
              flush=True)  # fmt: skip
    for newton in PUSHES:
        _, delay, place, force = np.array([r for r in rows if abs(r[0] - newton) < 1e-9]).T
        print(f"space, {1e3 * newton:.0f} mN: {np.isfinite(delay).sum()} of {delay.size} found, after "
              f"{1e3 * np.nanmedian(delay):.0f} ms (median), {1e3 * np.nanquantile(delay, 0.9):.0f} ms (nine in ten), "
              f"place {1e3 * np.nanmedian(place):.1f} mm, force {100 * np.nanmedian(force):+.0f} %")


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("actuator", choices=["a", "b", "c", "space"])
    parser.add_argument("--rate", type=float, default=75.0, help="of the sensor, Hz")
    parser.add_argument("--minutes", type=int, default=0, help="only count false alarms, in so many minutes")
    parser.add_argument("--seeds", type=int, default=1, help="sets of motions, pushes and noise of the arm in space")
    args = parser.parse_args()
    if args.actuator == "space":
        in_space(max(args.minutes, 1), args.seeds)
        return
    name, chain = args.actuator, model(args.actuator)
    options = {"noise": NOISE, "latency": LATENCY[name]}
    free = [seen(random_pulses(k, args.rate), name)[0] for k in LEARN]
    options["free"] = free_motion(free, chain, **options)
    if args.minutes:
        false_alarms(name, chain, options, args.rate, args.minutes)
    else:
        pokes(name, chain, options, args.rate)
        obstacles(name, chain, options, args.rate)


if __name__ == "__main__":
    main()
