"""Days of virtual arms whose truth is known, and the verdicts on them.

Each arm has six joints whose springs stiffen, and gains that differ along the body; the model has three joints with
linear springs. On each day every parameter of the mounting is shifted by an amount drawn from its prior, all inputs by
a common factor (5 %), and the body by 2 %. ``python tests/adaptation/virtual_days.py 20`` prints how often
each verdict is given, for 20 arms each; a kind and a case may follow, as in ``3 "plane;plane, one stiffness"``.
"""

from __future__ import annotations

import sys
from collections import Counter
from dataclasses import dataclass, replace

import numpy as np

from pliant.adaptation import Adaptation, adapt_model, parts_of_day, posterior_of
from pliant.adaptation.mounting import mounting_parameters
from pliant.errors import PliantError
from pliant.identification import Experiment, FitResult, Parameter, fit, predict
from pliant.identification.parameters import apply
from pliant.model import Chamber, Model, Station, chain_model
from pliant.simulation import Trace

STEP, RATE, NOISE, TOP = 1e-2, 20.0, 2e-4, 1e5  # s, Hz, m, Pa
NAMES = ("low", "middle", "tip")
JOINTS = ("stiffness_1", "stiffness_2", "stiffness_3")
OF_FRAMES = ("base_x", "base_y", "base_z", "start")  # parameters of a recording, not of a model
KINDS = ("plane", "plane, one stiffness", "space")
CASES = ("re-mounted", "one joint", "all joints", "another robot")
FACTORS = (0.6, 1.4)


@dataclass(frozen=True)
class Arm:
    """A virtual arm."""

    length: float
    mass: float
    stiffness: np.ndarray  # (3,) of the thirds of the body, as joints of the model
    damping: float
    bend: float  # rad, at the highest pressure
    stiffening: float
    gains: np.ndarray  # (6,) of the joints
    azimuth: float
    torque: float  # of a unit gain, N m/Pa
    space: bool
    midsegment: bool = False  # whether joints lie in the middles of their segments, else at their starts

    @classmethod
    def drawn(cls, seed: int, space: bool) -> Arm:
        rng = np.random.default_rng([seed, int(space), 77])
        k = rng.uniform(0.4, 0.9)
        length, mass, stiffness = rng.uniform(0.15, 0.25), rng.uniform(0.05, 0.12), k * rng.uniform(0.8, 1.2, 3)
        damping, bend = k * rng.uniform(0.04, 0.1), rng.uniform(0.5, 0.9)
        return cls(length, mass, stiffness, damping, bend, rng.uniform(0.0, 0.3), rng.uniform(0.9, 1.1, 6),
                   rng.uniform(0.0, 2 * np.pi), bend / 3 * float(stiffness.mean()) / TOP, space)  # fmt: skip

    def model(self, links: int, gain: float = 1.0) -> Model:
        """The arm with six links, or a start of the model with three."""
        per, true = links // 3, links == 6
        along = self.length / links * (0.5 if self.midsegment else 1.0)
        stations = tuple(Station(n, (k + 1) * per - 1, along) for k, n in enumerate(NAMES))
        torque = [gain * self.torque]
        gains = self.gains if true else np.ones(3)
        form = {"stiffening": self.stiffening} if true else {}
        common = {"length": self.length, "mass": self.mass, "links": links, "damping": self.damping * per,
                  "stiffness": np.repeat(self.stiffness if true else np.full(3, self.stiffness.mean()), per) * per,
                  "stations": stations, "joint_placement": "midsegment" if self.midsegment else "base", **form}
        if not self.space:
            return chain_model(**common, torque=torque, joint_gain=gains, gravity=[0.0, -9.81])
        angles = self.azimuth + np.array([0.0, 1.9])
        inputs = tuple(Chamber(name=n, torque=torque, joint_gain=np.cos(a) * gains, cross_gain=np.sin(a) * gains)
                       for n, a in zip("ab", angles, strict=True))  # fmt: skip
        return chain_model(**common, space=True, chambers=inputs, gravity=[0.0, 0.0, 9.81])


def blank(name: str, seconds: float, space: bool, rng: np.random.Generator) -> Experiment:
    """A recording without positions, under random steps of the inputs."""
    edges, levels, now = [0.0], [np.zeros(2)], 0.2
    while now < seconds:
        edges += [now, now + 0.1]
        levels += [levels[-1], np.where(rng.random(2) < 0.25, 0.0, rng.uniform(0.2, 1.0, 2)) * TOP]
        now += rng.uniform(0.6, 1.6)
    time, inputs = np.arange(0.0, seconds, 1 / RATE), np.array(levels)
    traces = [Trace(np.array(edges), inputs[:, k]) for k in range(2)]
    position = np.zeros((time.size, 3, 3 if space else 2)) + 0.02 * time[:, None, None]
    if space:
        return Experiment(name, time, position, NAMES, "trace", drives=dict(zip("ab", traces, strict=True)))
    return Experiment(name, time, position, NAMES, "trace", traces[0])


def recorded(exp: Experiment, model: Model, values: dict[str, float], rng: np.random.Generator) -> Experiment:
    """The recording of an arm."""
    placed = apply(model, {n: v for n, v in values.items() if n not in OF_FRAMES})
    position = predict(placed, exp, values, STEP)["position"]
    return replace(exp, position=position + NOISE * rng.standard_normal(position.shape))


def identified(arm: Arm, seed: int, one_stiffness: bool = False) -> tuple[FitResult, list[Experiment]]:
    """The model of the first day, from three recordings of 8 s."""
    rng = np.random.default_rng([seed, 1])
    exps = [recorded(blank(f"r{k}", 8.0, arm.space, rng), arm.model(6), {}, rng) for k in range(3)]
    gains = ["a.gain_x", "a.gain_y", "b.gain_x", "b.gain_y"] if arm.space else ["torque_1"]
    stiffness = ["stiffness"] if one_stiffness else list(JOINTS)
    start = arm.model(3)
    free = [*stiffness, "damping", *gains, *([] if arm.space else ["base_angle"])]
    values = dict.fromkeys([*stiffness], float(arm.stiffness.mean())) | {"damping": arm.damping, "base_angle": 0.0}
    if arm.space:
        values |= {f"{c.name}.gain_{axis}": float(np.mean(g)) + 0.05 for c in start.chambers
                   for axis, g in (("x", c.joint_gain), ("y", c.cross_gain))}  # fmt: skip
    else:
        values["torque_1"] = float(start.chambers[0].torque[0])
    listed = [Parameter(n, values[n]) for n in free]
    return fit(exps, start, listed, time_step=STEP, starts=1, max_evaluations=60, tolerance=1e-5), exps


def changed_arm(arm: Arm, case: str, seed: int) -> tuple[Arm, tuple[str, ...]]:
    """The arm of the other day, and the names of the joints whose stiffness changed."""
    factor = FACTORS[(seed // 3) % 2]
    if case == "another robot":
        return Arm.drawn(seed + 5000, arm.space), ()
    names = {"one joint": JOINTS[seed % 3 : seed % 3 + 1], "all joints": JOINTS}.get(case, ())
    factors = np.where(np.isin(JOINTS, names), factor, 1.0)
    return replace(arm, stiffness=arm.stiffness * factors), tuple(names)


def other_day(arm: Arm, case: str, seed: int) -> tuple[Experiment, tuple[str, ...]]:
    """A recording of 14 s of the other day, and the joints that changed."""
    rng = np.random.default_rng([seed, CASES.index(case), 2])
    arm, names = changed_arm(arm, case, seed)
    arm = replace(arm, stiffness=arm.stiffness * (1 + 0.02 * rng.standard_normal(3)),
                  damping=arm.damping * (1 + 0.02 * rng.standard_normal()))  # fmt: skip
    model = arm.model(6, gain=float(np.exp(0.05 * rng.standard_normal())))
    exp = blank("day", 14.0, arm.space, rng)
    values = {}
    for p in mounting_parameters(model, [exp], {}):
        while not p.lower <= (value := rng.normal(p.prior, p.prior_std)) <= p.upper:
            pass
        values[p.name] = value
    return recorded(exp, model, values, rng), names


def verdicts(kind: str, seed: int, cases: tuple[str, ...] = CASES) -> dict[str, tuple[Adaptation, tuple[str, ...]]]:
    """The verdicts on days of one arm by case, each with the joints that changed."""
    arm = Arm.drawn(seed, kind == "space")
    old, exps = identified(arm, seed, kind == "plane, one stiffness")
    posterior = posterior_of(old, {e.name for e in exps})
    found = {}
    for case in cases:
        exp, names = other_day(arm, case, seed)
        day = parts_of_day([exp], 10.0)
        found[case] = adapt_model(old, posterior, day, earlier=lambda: exps), names
    return found


def named(adaptation: Adaptation, names: tuple[str, ...]) -> bool:
    """Whether a verdict names what changed, and nothing else."""
    return set(adaptation.changed) in ({*names}, {"stiffness"} if len(names) == 3 else {*names})


def main(count: int, kinds: tuple[str, ...] = KINDS, cases: tuple[str, ...] = CASES) -> None:
    """Print how often each verdict is given."""
    table: Counter[tuple[str, str, str]] = Counter()
    for kind in kinds:
        for seed in range(count):
            try:
                days = verdicts(kind, seed, cases)
            except PliantError as error:
                table[kind, "any", "arm not identified"] += 1
                print(kind, seed, error)
                continue
            for case, (found, names) in days.items():
                verdict = "same arm" if found.verdict in ("same arm", "re-mounted") else found.verdict
                right = " (named)" if found.verdict == "changed body" and named(found, names) else ""
                table[kind, case, verdict + right] += 1
                print(kind, seed, case, names, "->", found.verdict, found.changed,
                      [f"{1e3 * e.after:.2f}" for e in found.errors], flush=True)  # fmt: skip
    for (kind, case, verdict), n in sorted(table.items()):
        print(f"{kind:22} {case:14} {verdict:24} {n}")


if __name__ == "__main__":
    main(int(sys.argv[1]), tuple(sys.argv[2].split(";")) if len(sys.argv) > 2 else KINDS,
         tuple(sys.argv[3].split(";")) if len(sys.argv) > 3 else CASES)  # fmt: skip
