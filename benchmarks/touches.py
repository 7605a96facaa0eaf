"""Measure how soon steady touches at many positions and times are detected, and how well they are located.

    python benchmarks/touches.py -o results/touches --seeds 20                # resumes where it stopped
    python benchmarks/touches.py bound                                        # the best result of any detector

A seed is a set of sensors (`seed` of the virtual fibre and gauge) on actuator a, b or c, each with its own model
(examples/state), and some runs. Each run is touched at another node of the last 60 % of the body: at rest, during a
constant pulse, while the pressure rises slowly, and while it is constant again. The forces of 20, 50, 100 and 200 mN
act across the body, in random order, for 0.8 s. The test learns from some minutes of free motion measured by the same
sensors. A simple threshold on the disturbance torques of the same filter serves for comparison. Its value comes from
the same free motion by the same tail for the same rate of false alarms, one an hour (`false_alarms.py` counts them). No
setting was tuned on these seeds; tune only on seeds 0 to 9 and report 10 to 19.
"""

from __future__ import annotations

import sys
import time
from dataclasses import dataclass, replace
from functools import cache

import chunks
import numpy as np
import xarray as xr
from scipy.special import ndtri
from state import FIBRE, LATENCY, NOISE, RATE, REST, model

from pliant.contact import find_contact
from pliant.contact.contact import FilteredFreeMotion, filtered_free_motion, free_motion_for_rate
from pliant.contact.free_motion import blocks, normalised, tail
from pliant.contact.likelihood_ratio import innovation_response
from pliant.contact.locate import moment_arms
from pliant.estimation import estimate
from pliant.estimation.measurement import Measurement, measurement_of
from pliant.study.dense import body_of_fibre
from pliant.sweep.store import Arrays
from pliant.testbed.laboratory import RECORD, SUPPLY_STEP, Laboratory, record
from pliant.testbed.rod import actuator
from pliant.testbed.scenarios import Command
from pliant.testbed.stepping import RodMotion, simulate
from pliant.testbed.valve import supply_pressure

STEP = 5e-4  # s, of the rod
FORCES = (0.02, 0.05, 0.1, 0.2)  # N
ONSETS = (0.8, 3.4, 5.7, 7.9)  # s: at rest, in a hold, on a ramp, in another hold
PHASES = ("rest", "hold", "ramp", "hold again")
ARCS = (0.085, 0.115, 0.145, 0.168)  # m, where the best that a place can be known is told
LASTS, JUDGED = 0.8, (0.3, 0.8)  # s of a touch, and the part of it that places it
LEARN, RUNS, DURATION = 4, 2, 9.2


def moved(name: str, command: Command, duration: float, node: int, force: np.ndarray | None) -> RodMotion:
    """Simulate the rod of an actuator under a command and a force (T, 2) [N] at a node, from touch to touch."""
    fine = round(STEP / SUPPLY_STEP)
    t = np.arange(round(duration / STEP) * fine + 1) * STEP / fine
    loads = np.zeros(((t.size - 1) // fine, 4))
    loads[:, 0] = supply_pressure(command, t, Laboratory().valve)[fine::fine]
    if force is not None:
        loads[:, 1:3] = force
    return simulate(replace(actuator(name), pushed_node=node), loads, STEP, stride=round(RECORD / STEP))


def seen(motion: RodMotion, name: str, seed: int, label: str) -> xr.Dataset:
    """Return the body as the sensors of a seed measure a motion."""
    at = np.arange(0.0, motion.time[-1] - 0.5 * RECORD, 1.0 / RATE)
    raw = record(motion, actuator(name), Laboratory(), at, seed=seed, attrs={"scenario": label})
    return body_of_fibre(raw, FIBRE.model_copy(update={"rest": REST}))[0]


def free_minute(name: str, k: int) -> RodMotion:
    """Return a minute of free motion: pulses, ramps and pauses of random levels and lengths."""
    rng, t, points = np.random.default_rng([79, k]), 0.3, [(0.0, 0.0), (0.3, 0.0)]
    while t < 56.0:
        level, rise, width = rng.uniform(0.0, 200e3), rng.choice([0.002, 0.4, 2.0]), rng.uniform(0.4, 2.5)
        points += [(t + rise, level), (t + rise + width, level)]
        t = t + rise + width
    return moved(name, Command("triangle", tuple((float(a), float(b)) for a, b in points)), 60.0, 0, None)


free = cache(free_minute)  # the minutes that every seed learns from


def touched(name: str, seed: int, run: int) -> tuple[RodMotion, int, np.ndarray]:
    """Return a run with four touches at one node: the motion, the node, and the forces [N] in their order."""
    rng = np.random.default_rng([83, seed, run])
    node, low, high = int(rng.integers(40, 101)), *np.sort(rng.uniform(60e3, 180e3, 2))
    strength = rng.permutation(FORCES) * rng.choice([-1.0, 1.0], 4)
    corners = ((0.0, 0.0), (2.0, 0.0), (2.002, low), (5.0, low), (7.0, high), (DURATION, high))
    command = Command("triangle", corners)
    bare = moved(name, command, DURATION, node, None)
    t = (np.arange(round(DURATION / STEP)) + 1) * STEP
    force = np.zeros((t.size, 2))
    for onset, newton in zip(ONSETS, strength, strict=True):
        along = bare.position[round((onset + 0.4) / RECORD), [max(node - 3, 0), min(node + 1, 101)]]
        side = np.array([along[0, 1] - along[1, 1], along[1, 0] - along[0, 0]])
        force[(t >= onset) & (t < onset + LASTS)] += newton * side / np.linalg.norm(side)
    return moved(name, command, DURATION, node, force), node, strength


@dataclass(frozen=True)
class Touches(chunks.OneByOne):
    """Chunks of one seed each."""

    def work(self, chunk: int) -> Arrays:
        """Return delays, positions and forces (1, runs, touches), and false alarms, of one seed."""
        began, name = time.process_time(), "abc"[chunk % 3]
        chain, options = model(name), {"noise": NOISE, "latency": LATENCY[name]}
        bodies = [seen(free(name, k), name, chunk, f"free_{k}") for k in range(LEARN)]
        shown = filtered_free_motion(bodies, chain, **options)
        learnt = free_motion_for_rate(shown, 1.0)
        plain = Plain.learnt(bodies, chain, options)
        made = {k: np.full((1, RUNS, len(ONSETS)), np.nan) for k in (
            "newton", "place", "delay_ms", "plain_delay_ms", "place_mm", "force_percent")}  # fmt: skip
        early = [0, 0]
        for run in range(RUNS):
            motion, node, strength = touched(name, chunk, run)
            body = seen(motion, name, chunk, f"touch_{run}")
            found = find_contact(body, chain, free=learnt, **options)
            alarms, simple = np.array(found.attrs["alarm_s"]), plain.alarms(body)
            made["newton"][0, run], made["place"][0, run] = strength, motion.arc_length[node]
            for k, onset in enumerate(ONSETS):
                for key, times in (("delay_ms", alarms), ("plain_delay_ms", simple)):
                    inside = times[(times > onset) & (times < onset + LASTS)]
                    made[key][0, run, k] = 1e3 * (inside[0] - onset) if inside.size else np.nan
                made["place_mm"][0, run, k], made["force_percent"][0, run, k] = placed(
                    found, onset, motion.arc_length[node], abs(strength[k]))  # fmt: skip
            for i, times in enumerate((alarms, simple)):
                early[i] += sum(not any(o <= t < o + LASTS + 0.6 for o in ONSETS) for t in times)
        sd = np.array([[place_sd(chain, c, a) for a in ARCS] for c in (learnt.change, sudden_changes(shown))])[None]
        made |= {"place_sd_mm": sd, "seed": np.array([chunk]), "early": np.array([early]),
                 "cpu_s": np.array([time.process_time() - began])}  # fmt: skip
        return made


def sudden_changes(shown: FilteredFreeMotion) -> np.ndarray:
    """Return the covariance (n, n) [N^2 m^2] of apparent torque steps in free motion, from 0.17 s of innovations each.

    They are the best that frames up to 0.17 s after an onset can know of its torques; longer waits add drift.
    """
    answer, made = shown.answer, []
    for part in shown.parts:
        e, R = np.nan_to_num(part.estimated["innovation"].values), answer.response[answer.case(part.motion)]
        T, frames = len(e) - R.shape[1], range(R.shape[1])
        y = sum(np.einsum("tm,tmn->tn", e[j : j + T], R[j : j + T, j]) for j in frames)
        information = sum(np.einsum("tmn,tmk->tnk", R[j : j + T, j], R[j : j + T, j]) for j in frames)
        made.append(np.linalg.solve(information, y[..., None])[..., 0])
    pooled = np.concatenate(made)
    return pooled.T @ pooled / len(pooled)


def place_sd(chain: object, covariance: np.ndarray, arc: float) -> float:
    """Return the smallest standard deviation [mm N] of the position of a force at an arc length [m], times the force.

    The bound of Cramer and Rao for one force across a body at rest, from torques of such a covariance.
    """
    nodes = chain.base_length + np.append(0.0, np.cumsum(chain.link_length))
    angle = np.cumsum(chain.rest_angle)[None]

    def arms(at: float) -> np.ndarray:
        link = min(int(np.searchsorted(nodes, at)) - 1, chain.n - 1)
        return moment_arms(chain, angle, np.array([link]), np.array([at - nodes[link]]))[0, 0, 0]

    slopes = np.stack([arms(arc), (arms(arc + 5e-4) - arms(arc - 5e-4)) / 1e-3])
    return 1e3 * float(np.sqrt(np.linalg.inv(slopes @ np.linalg.solve(covariance, slopes.T))[1, 1]))


@dataclass(frozen=True)
class Plain:
    """The simple test: a threshold on the normalised square of the disturbance torques."""

    chain: object
    options: dict
    covariance: np.ndarray
    threshold: float

    @classmethod
    def learnt(cls, bodies: list[xr.Dataset], chain: object, options: dict) -> Plain:
        """Return scale and threshold from free motion, by the tail that the other test uses."""
        torque = [estimate(b, chain, **options)["disturbance"].values for b in bodies]
        pooled = np.concatenate(torque)
        covariance = pooled.T @ pooled / len(pooled)
        highest = np.concatenate([blocks(normalised(t, covariance), 1.0 / RATE) for t in torque])
        return cls(chain, options, covariance, tail(highest, len(pooled) / RATE, 1.0)[0])

    def alarms(self, body: xr.Dataset) -> np.ndarray:
        """Return the times [s] at which the value exceeds the threshold."""
        found = estimate(body, self.chain, **self.options)
        over = normalised(found["disturbance"].values, self.covariance) > self.threshold
        return found["time"].values[np.flatnonzero(over & ~np.append(False, over[:-1]))]


def placed(found: xr.Dataset, onset: float, arc: float, newton: float) -> tuple[float, float]:
    """Return the error of the position [mm] and of the force [%], medians over the steady part of a touch."""
    t = found["time"].values - onset
    hold = found["in_contact"].values & (t > JUDGED[0]) & (t < JUDGED[1])
    if not hold.any():
        return np.nan, np.nan
    force = np.linalg.norm(found["contact_force"].values[hold], axis=1)
    return (1e3 * (float(np.median(found["contact_arc_length"].values[hold])) - arc),
            100.0 * (float(np.median(force)) / newton - 1.0))  # fmt: skip


def told(s: xr.Dataset) -> None:
    """Print tables by force, with blind seeds separate."""
    newton = np.abs(s["newton"].values)
    for title, seeds in (("seeds 0 to 9", s["seed"].values < 10), ("seeds 10 to 19", s["seed"].values >= 10)):
        print(title)
        for f in FORCES:
            at = (np.abs(newton - f) < 1e-6) & seeds[:, None, None]
            if not at.any():
                continue
            delay, plain, place, force = (
                s[k].values[at] for k in ("delay_ms", "plain_delay_ms", "place_mm", "force_percent"))  # fmt: skip
            near = np.abs(place) <= 5.0
            print(f"  {1e3 * f:3.0f} mN: {np.isfinite(delay).sum()} of {at.sum()} found, after "
                  f"{np.nanmedian(delay):.0f} ms (median), {np.nanquantile(delay, 0.9):.0f} ms (nine in ten), within "
                  f"40 ms {100 * np.mean(delay <= 40):.0f} %; plain: {np.isfinite(plain).sum()} found, after "
                  f"{np.nanmedian(plain):.0f} ms; place within 5 mm {100 * near.mean():.0f} % of all, median error "
                  f"{np.nanmedian(np.abs(place)):.1f} mm, force {np.nanmedian(force):+.0f} %")  # fmt: skip
        print(f"  outside touches {s['early'].values[seeds].sum(axis=0)} alarms (test, plain)")
    for words, best in zip(("half a second later", "from the first 0.17 s"), np.median(s["place_sd_mm"].values, axis=0),
                           strict=True):  # fmt: skip
        print(f"best standard deviation of the place of 50 mN, {words}: " + ", ".join(
            f"{v / 0.05:.0f} mm at {1e3 * a:.0f} mm" for v, a in zip(best, ARCS, strict=True)))
    newton_ok = newton >= 0.05 - 1e-9
    for k, phase in enumerate(PHASES):
        near = np.abs(s["place_mm"].values[:, :, k][newton_ok[:, :, k]]) <= 5.0
        print(f"50 mN and more, {phase}: {100 * near.mean():.0f} % within 5 mm")
    arc = s["place"].values
    for low, high in ((0.068, 0.1), (0.1, 0.135), (0.135, 0.172)):
        at = newton_ok & (arc >= low) & (arc < high)
        err = s["place_mm"].values[at]
        near = 100 * np.mean(np.abs(err) <= 5.0)
        print(f"50 mN and more, {1e3 * low:.0f} to {1e3 * high:.0f} mm from the base: {near:.0f} % of {err.size} "
              f"within 5 mm, median {np.nanmedian(err):+.1f} mm, found {np.isfinite(err).sum()}")


def bound() -> None:
    """Return the shortest delay at which a likelihood ratio of a known signature detects half of all forces across the
    tip.

    Innovations are a sufficient statistic of the frames, so no test of the same frames is quicker under the same noise.
    A false alarm an hour among independent tests of 50 ms each asks for 4.2 standard deviations.
    """
    level = float(ndtri(1.0 - 0.05 / 3600.0))
    for rate in (75.0, 250.0):
        for name in "abc":
            chain = model(name)
            alone = replace(NOISE, torque=1e-7, random_walk=1e-5)
            for words, noise in (("model's errors as the filter has them", NOISE), ("the fibre's noise alone", alone)):
                answer = innovation_response(chain, noise, measured(chain, rate), time_step=5e-3)
                last = chain.n - 1
                J = moment_arms(chain, np.cumsum(chain.rest_angle)[None], np.array([last]),
                                np.array([chain.link_length[last]]))[0, 0, 0]  # fmt: skip
                power = np.cumsum(np.sum((answer.response[0] @ J) ** 2, axis=1))
                found = []
                for f in FORCES[:3]:
                    enough = np.flatnonzero(f * np.sqrt(power) >= level)
                    found.append(f"{1e3 * f:.0f} mN {1e3 * (enough[0] + 1) / rate:.0f} ms" if enough.size
                                 else f"{1e3 * f:.0f} mN never within {1e3 * len(power) / rate:.0f} ms")  # fmt: skip
                print(f"{name}, {rate:.0f} Hz, at rest, {words}: {', '.join(found)}")


def measured(chain: object, rate: float) -> Measurement:
    """Return what a chain shows at some frame rate; the values of the angles themselves do not matter."""
    body = seen(moved("a", Command("steps", ((0.4, 60e3),)), 0.8, 0, None), "a", 1, "bound")
    made = measurement_of(body, chain, NOISE, None)
    return made._replace(time=np.arange(made.time.size) / rate)


def main() -> None:
    """Compute missing seeds, then print the tables; or print the bound."""
    if sys.argv[1:] == ["bound"]:
        bound()
        return
    args = chunks.options(__doc__, "touches", 20).parse_args()
    told(chunks.samples(Touches(args.seeds), {"sweep": "touches"}, args))


if __name__ == "__main__":
    main()
