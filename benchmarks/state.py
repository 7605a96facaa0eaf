"""Rates, filter time and contact on virtual actuators: the numbers of docs/real_time.md.

    python benchmarks/state.py rates      # filter and smoother against differences behind the best low-pass
    python benchmarks/state.py speed      # compiled time of a frame, and of one call of the running filter
    python benchmarks/state.py contact b  # five minutes of free motion, then pokes, obstacles, free motion

The models in benchmarks/models come from six free pulses of each actuator (benchmarks/models/identify.py); the last two
pulses of `rates` are none of them. The noise is that of actuator a.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path

import numpy as np
from scipy.signal import butter, lfilter

from pliant.model import load_model
from pliant.runtime import Estimator, Noise, estimate, find_contact, free_motion, rows_of
from pliant.runtime.mapping import poke_of
from pliant.runtime.sight import sight_of
from pliant.study.dense import body_of_fibre
from pliant.study.schema import Fibre
from pliant.testbed.contact import Circle
from pliant.testbed.laboratory import RECORD, SUPPLY_STEP, Laboratory, generate, record, run_rod
from pliant.testbed.rod import actuator
from pliant.testbed.scenarios import Command, Scenario, pulse, scenario
from pliant.testbed.stepping import simulate
from pliant.testbed.truth import joint_rates
from pliant.testbed.valve import supply_pressure

NOISE = Noise(angle=9e-4, torque=2e-5, wander=3e-3, unrest=30.0, initial_disturbance=0.01)
OPTIONS = {  # latency [s] and softening [1/(N m)], fitted with each model
    "a": {"latency": 5.333e-3, "softening": 0.505}, "b": {"latency": 4.226e-3, "softening": 0.474},
    "c": {"latency": 5.726e-3, "softening": 0.566},
}  # fmt: skip
FIBRE = Fibre(body_length=0.17, cap_curvature=50.0, cap_length=0.03, gauge_length=2.4e-3)
RATE = 75.0
CASES = (
    "pulse_60", "pulse_119", "pulse_180", "pulse_240", "pulse_119_short", "pulse_90_1000ms", "pulse_210_2000ms",
)  # fmt: skip


def model(name):
    return load_model(Path(__file__).parent / "models" / f"{name}.json")


def true_rates(motion, chain, at):
    """Joint rates (T, n) of the chain whose nodes lie on the rod."""
    return joint_rates(motion, chain.base_length + np.append(0.0, np.cumsum(chain.link_length)), at)


def rates():
    for name in "abc":
        chain, rod, lab = model(name), actuator(name), Laboratory()
        for case in map(scenario, CASES):
            motion = run_rod(case, rod, lab)
            at = np.arange(0.0, case.duration - 5e-4, 1 / RATE)
            seen = body_of_fibre(record(motion, rod, lab, at, seed=1, attrs={"scenario": case.name}), FIBRE)[0]
            truth = true_rates(motion, chain, at)
            found = estimate(seen, chain, noise=NOISE, **OPTIONS[name])
            angle = sight_of(seen, chain, NOISE).value
            for column in angle.T:
                gap = np.isnan(column)
                column[gap] = np.interp(np.flatnonzero(gap), np.flatnonzero(~gap), column[~gap])
            differences = np.diff(angle, axis=0, prepend=angle[:1]) * RATE
            error = lambda x, t=truth: np.sqrt(np.mean((x - t)[20:] ** 2))  # noqa: E731
            usual = min(error(lfilter(*butter(2, f / (0.5 * RATE)), differences, axis=0)) for f in (8, 12, 16, 20, 30))
            print(f"{name} {case.name:<16} differences {usual:.3f} rad/s, over filter "
                  f"{usual / error(found.joint_rate.values):.2f}, over smoother "
                  f"{usual / error(found.smooth_joint_rate.values):.2f}, NIS {found.attrs['nis_ratio']:.2f}, "
                  f"correlation {found.attrs['innovation_correlation']:+.2f}")


def speed():
    from pliant.equations._compiled import twin
    from pliant.runtime import loops
    from pliant.runtime.estimation import chain_of
    from pliant.runtime.scratch import make_scratch
    from pliant.simulation import state

    for name, chain in (("with memory", model("a")), ("without", model("a").with_(memory=type(model("a").memory)()))):
        n, rows = chain.n, np.array([(loops.JOINT, i, 0.0, 0.0) for i in range(chain.n)])
        scratch, P = make_scratch(chain, NOISE.states(chain), n), NOISE.initial(chain)
        q = np.zeros(n)
        own = [state.absolute(chain, q), np.zeros(n), np.zeros(n), P, state.relaxed(chain, q)]
        many = twin(loops.many_frames, n)
        call = (*own, chain_of(chain), 1.0 / RATE, 0.05, (*NOISE.densities(chain), np.zeros(1)), chain.link_length,
                chain.first_joint, rows, chain.rest_angle.copy(), np.full(n, NOISE.angle**2), np.empty(n), scratch)
        many(1, 3, *call)
        for steps in (1, 2, 3):
            spent = []
            for _ in range(200):
                began = time.process_time()
                many(50, steps, *call)
                spent.append((time.process_time() - began) / 50)
            print(f"{name}: frame of {steps} steps and {n} angles: median {1e6 * np.median(spent):.1f} us, "
                  f"least {1e6 * min(spent):.1f} us")
    filter_ = Estimator(model("a"), NOISE, latency=4e-3)
    rows, spent = rows_of(model("a"), model("a").points[-2:]), []
    for k in range(2000):
        began = time.perf_counter()
        filter_.push_frame(k / RATE, rows, np.full(len(rows), np.nan) if not len(rows) else seen_at_rest(rows),
                           np.full(len(rows), 1e-7))
        spent.append(time.perf_counter() - began)
    print(f"one call of the running filter, from Python: median {1e6 * np.median(spent[100:]):.0f} us")


def seen_at_rest(rows):
    from pliant.runtime import loops
    from pliant.simulation import state

    chain = model("a") if not hasattr(seen_at_rest, "chain") else seen_at_rest.chain
    seen_at_rest.chain = chain
    seen, slopes = np.empty(len(rows)), np.empty((len(rows), chain.n))
    loops.observe(state.absolute(chain, np.zeros(chain.n)), chain.link_length, chain.first_joint, rows, seen, slopes)
    return seen


def random_pulses(seed, duration=60.0):
    """The paper's pressures for random times."""
    rng, t, points = np.random.default_rng([77, seed]), 0.3, []
    while t < duration - 4.0:
        level, width = rng.choice([60e3, 119e3, 180e3, 240e3]), rng.uniform(0.5, 2.76)
        points += [(t, level), (t + width, 0.0)]
        t += width + rng.uniform(0.6, 2.0)
    return Scenario(f"random_{seed}", "", duration, Command("steps", tuple(points)))


def seen(case, name):
    made = generate(case, name, 1)
    return body_of_fibre(made.recording, FIBRE)[0], made.truth


def posted(name, share):
    """A post that mid-body meets at this share of its way under 119 kPa, where the bare body would move on."""
    made = generate("pulse_119", name, 1).truth
    t, x = made["time"].values, made["position"].values
    i = int(np.argmin(np.abs(made["arc_length"].values - 0.085)))
    rest, held = x[:5, i].mean(axis=0), x[(t > 2.0) & (t < 2.8), i].mean(axis=0)
    j = int(np.argmin(np.abs(x[:, i] - rest - share * (held - rest)).sum(axis=1)))
    along = x[j, i + 1] - x[j, i - 1]
    side = np.array([-along[1], along[0]]) / np.linalg.norm(along)
    post = Circle(tuple(rest + share * (held - rest) + 0.013 * side), 0.008)
    return Scenario(f"mid_{share}", "", 4.5, scenario("pulse_119").command, (post,), step=1e-4)


def poked(name, newton, begin, stop):
    """Shape while 119 kPa hold and a force across the tip pushes from `begin` to `stop`."""
    case = Scenario(f"poke_{newton}_{begin}", "", 4.0, pulse(119e3, 3.5, start=0.2))
    rod, lab = actuator(name), Laboratory()
    at = np.arange(0.0, case.duration - 0.5 * RECORD, 1 / RATE)
    end = run_rod(case, rod, lab).position[round(2.0 / RECORD)]
    side = np.array([end[-4, 1] - end[-1, 1], end[-1, 0] - end[-4, 0]]) / np.linalg.norm(end[-1] - end[-4])
    fine = max(1, round(case.step / SUPPLY_STEP))
    t = np.arange(round(case.duration / case.step) * fine + 1) * case.step / fine
    loads = np.zeros(((t.size - 1) // fine, 4))
    loads[:, 0] = supply_pressure(case.command, t, lab.valve)[fine::fine]
    clock = t[fine::fine]
    loads[(clock >= begin) & (clock < stop), 1:3] = newton * side
    motion = simulate(rod, loads, case.step, stride=max(1, round(RECORD / case.step)))
    return body_of_fibre(record(motion, rod, lab, at, seed=1, attrs={"scenario": case.name}), FIBRE)[0]


def pokes(name, chain, learnt, options):
    """Forces across the tip, both ways, at three moments of the hold."""
    for newton in (0.02, 0.05):
        late, wrong, away = [], [], []
        for begin in (2.0, 2.5, 3.0):
            for sign in (1.0, -1.0):
                found = find_contact(poked(name, sign * newton, begin, begin + 0.4), chain, free=learnt, **options)
                alarms = np.array(found.attrs["alarm_s"])
                late += list(1e3 * (alarms[(alarms > begin) & (alarms < begin + 0.4)][:1] - begin))
                t = found["time"].values
                hold = found["in_contact"].values & (t > begin + 0.15) & (t < begin + 0.4)
                size = np.linalg.norm(found["contact_force"].values[hold], axis=1)
                wrong += list(np.abs(size - newton) / newton)
                away += list(0.17 - found["contact_arc_length"].values[hold])
        told = f", place {1e3 * np.median(away):.1f} mm, force {100 * np.median(wrong):.0f} %" if wrong else ""
        after = np.sort(late).round()
        print(f"{name} tip, {1e3 * newton:.0f} mN: {len(late)} of 6 found after {after} ms{told}", flush=True)


def contact(name, minutes=5):
    chain, options = model(name), OPTIONS[name] | {"noise": NOISE}
    learnt = free_motion([seen(random_pulses(k), name)[0] for k in range(5)], chain, **options)
    pokes(name, chain, learnt, options)
    cases = [*map(scenario, ("contact_circle", "contact_wall", "contact_spring")), posted(name, 0.6), posted(name, 0.8)]
    for case in cases:
        body, truth = seen(case, name)
        found = find_contact(body, chain, free=learnt, **options)
        size = np.linalg.norm(truth["force"].values, axis=2)
        total, t = truth["force"].values.sum(axis=1), truth["time"].values
        strength = np.linalg.norm(total, axis=1)
        began = t[np.argmax(strength > 0.1)]
        late = [1e3 * (a - began) for a in found.attrs["alarm_s"]]
        hold = (t > 1.0) & (t < 2.8) & found["in_contact"].values
        told = f"{name} {case.name}: up to {strength.max():.2f} N, alarms {np.round(late)} ms after 0.1 N"
        if hold.any():
            arc = (size * truth["arc_length"].values).sum(axis=1)[hold] / size.sum(axis=1)[hold]
            error = np.abs(np.linalg.norm(found["contact_force"].values[hold], axis=1) / strength[hold] - 1.0)
            place = 1e3 * np.median(np.abs(found["contact_arc_length"].values[hold] - arc))
            told += f", at {1e3 * np.median(arc):.0f} mm, place {place:.1f} mm, force {100 * np.median(error):.0f} %"
        print(told + surface(found, case), flush=True)
    alarms = [len(find_contact(seen(random_pulses(k), name)[0], chain, free=learnt, **options).attrs["alarm_s"])
              for k in range(100, 100 + minutes)]
    print(f"{name}: {sum(alarms)} false alarms in {minutes} min of other free motion")


def surface(found, case):
    """How far the map's surface points lie from the obstacle's surface."""
    point, thing = poke_of(found, half_width=0.005).point, case.obstacles[0]
    if not len(point):
        return ", no point on the map"
    if isinstance(thing, Circle):
        gap = np.linalg.norm(point - thing.centre, axis=1) - thing.radius
    else:
        gap = point @ np.array(thing.normal) - thing.offset
    return (f", map: {len(gap)} points, RMS {1e3 * np.sqrt(np.mean(gap**2)):.1f} mm, "
            f"median {1e3 * np.median(np.abs(gap)):.1f} mm")


if __name__ == "__main__":
    what = sys.argv[1] if len(sys.argv) > 1 else "rates"
    {"rates": rates, "speed": speed}.get(what, lambda: contact(*sys.argv[2:3], *map(int, sys.argv[3:4])))()
