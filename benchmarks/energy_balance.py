"""Count motions of random models whose energy is not balanced and of which `simulate` says nothing, by time step.

Chains in the plane and in space move freely from random bends and rates, under a pulse of their inputs, or under a
force; with no to strong dampers, tip masses, gravity, and every law: creep, slip, Bouc-Wen, springs that soften and
stiffen, segments that lengthen (with laws of their own), hyperelastic walls, viscoelastic lag, valves, tendons with and
without friction. The balance is that of the returned energies, over the energy exchanged. A motion is unbalanced if
more than 1 % of its energy appears or disappears. A warning is false if the energy is balanced to 1 % and the tip is
within 1 % of that of `method="accurate"`.

Usage: python benchmarks/energy_balance.py [N] [STEPS...] [--seed S]; a step is `default` or a number of milliseconds.
N motions are drawn in the plane and N in space.
"""

from __future__ import annotations

import argparse
import warnings
from collections import Counter
from time import process_time
from typing import Any, NamedTuple

import numpy as np

import pliant
from pliant.errors import PliantError
from pliant.model import Chamber, Extension, Memory, Model, Space, Tendon, Valve
from pliant.simulation import Pulse, state
from pliant.simulation.forces import PointForce
from pliant.simulation.inputs import Input
from pliant.simulation.time_step import AccuracyWarning

Array = np.ndarray
Random = np.random.Generator
DURATION, LIMIT = 0.4, 0.01  # s; of the exchanged energy, and of the length
PARTS = {
    "energy": ("kinetic_energy", "elastic_energy", "gravitational_energy", "memory_energy"),
    "loss": ("dissipated_energy", "memory_dissipation"),
}


class Motion(NamedTuple):
    """A random motion: model, inputs and further arguments of `simulate`."""

    model: Model
    inputs: list[Input]
    more: dict[str, Any]


def within(rng: Random, low: float, high: float) -> float:
    """Return a random number between two bounds, whose logarithm is uniform."""
    return float(10 ** rng.uniform(np.log10(low), np.log10(high)))


def random_memory(rng: Random, *, axial: bool) -> Memory:
    """Return random branches of hysteresis, in half of the cases none."""
    laws = rng.random(5) < 0.3
    values: dict[str, Any] = {}
    if laws[0]:
        values |= {"creep_share": (rng.uniform(0.05, 0.6),), "creep_time": (within(rng, 0.01, 5.0),)}
    if laws[1]:
        values |= {"slip_share": (rng.uniform(0.05, 0.6),), "slip_angle": (within(rng, 2e-3, 0.1),)}
    if laws[2]:
        values |= {"boucwen_share": rng.uniform(0.05, 0.5), "boucwen_beta": within(rng, 5.0, 80.0),
                   "boucwen_gamma": 4.0, "boucwen_exponent": rng.uniform(1.0, 2.0)}  # fmt: skip
    if axial and laws[3]:
        values |= {"axial_creep_share": (0.3,), "axial_creep_time": (within(rng, 0.01, 1.0),)}
    if axial and laws[4]:
        values |= {"axial_slip_share": (0.3,), "axial_slip_strain": (within(rng, 1e-3, 0.02),)}
    return Memory(**values)


def random_springs(rng: Random, stiffness: Array) -> dict[str, Any]:
    """Return a linear spring, one that softens and stiffens again, or one whose change of stiffness is bounded."""
    kind = int(rng.integers(3))
    bent = {} if kind == 0 else {"stiffening": -rng.uniform(0.1, 0.6), "cubic_stiffening": rng.uniform(0.3, 1.0)}
    return {"stiffness": stiffness, **bent, **({"stiffening_bound": 0.5} if kind == 2 else {})}


def random_valve(rng: Random) -> Valve:
    """Return a valve with or without a lag."""
    lag = within(rng, 5e-3, 0.1)
    return (Valve(), Valve(rise_time=lag, fall_time=1.5 * lag), Valve(dead_time=lag, rise_rate=5e6, fall_rate=5e6),
            Valve(natural_frequency=0.3 / lag, damping_ratio=0.5))[int(rng.integers(4))]  # fmt: skip


def random_chamber(rng: Random, stiffness: float, azimuth: float | None, segments: int) -> Chamber:
    """Return a chamber with a random law that bends a joint of this stiffness [N m/rad] by up to half a radian."""
    torque = stiffness * 5e-6
    law = ({"torque": [torque]}, {"torque": [torque, 0.5 * torque * 1e-5]},
           {"torque": [torque], "swell_share": 0.3, "swell_time": 0.1},
           {"torque": [torque], "inflation_limit": 4e5, "inflation_time": 0.03},
           {"torque": [torque], "inflation_limit": 4e5, "inflation_time": 0.03, "inflation_jm": 5.0},
           )[int(rng.integers(5))]  # fmt: skip
    gains = {} if azimuth is None else {"joint_gain": -np.sin(azimuth), "cross_gain": np.cos(azimuth)}
    axial = {"axial_gain": [20.0] * segments} if segments else {}
    return Chamber(**law, **gains, **axial, valve=random_valve(rng), name=f"chamber {azimuth}")


def random_tendon(rng: Random, n: int, azimuth: float, lever: float, stiffness: float) -> Tendon:
    """Return a tendon that is drawn in, or pulled by a tension, with or without friction."""
    elastic = bool(rng.integers(2))
    line = {"line_stiffness": stiffness / lever**2, "pretension": 0.1 * stiffness / lever}
    driven = {"driven_by": "displacement", **line} if elastic else {}
    friction = float(rng.choice([0.0, 0.0, 0.1, 0.3]))
    return Tendon.at_azimuth(azimuth, np.ones(n), lever=lever, friction=friction, name=f"tendon {azimuth}", **driven)


def random_model(rng: Random, *, space: bool) -> Model:
    """Return a chain whose masses and stiffnesses range over two decades."""
    n = int(rng.choice((2, 3))) if space else int(rng.choice((2, 3, 5)))
    length, mass = rng.uniform(0.01, 0.12, n), 10 ** rng.uniform(-2.5, -0.7, n)
    stiffness = within(rng, 0.03, 3.0) * (rng.uniform(0.5, 2.0, n) if rng.random() < 0.5 else np.ones(n))
    segments = int(rng.random() < 0.3)
    damping = float(rng.choice([0.0, 0.0, 1e-4, 1e-3, 1e-2, 0.1]))
    azimuths = (0.3, 2.4, 4.5) if space else (None,)
    if space and not segments and rng.random() < 0.5:
        inputs = [random_tendon(rng, n, azimuth, 0.01, float(stiffness.mean())) for azimuth in azimuths if azimuth]
    else:
        inputs = [random_chamber(rng, float(stiffness.mean()), azimuth, segments) for azimuth in azimuths]
    curve = {"stiffening": -5.0, "cubic_stiffening": 200.0} if rng.random() < 0.5 else {}
    axial = (Extension(within(rng, 30.0, 3e3), float(rng.choice([0.0, 0.1, 1.0])), name="s", **curve),) * segments
    twist = float(rng.choice([0.0, 0.7]))
    return Model(
        link_length=length, link_mass=mass, damping=damping, chambers=tuple(inputs), extensions=axial,
        memory=random_memory(rng, axial=bool(segments) and not space), tip_mass=float(rng.choice([0.0, 0.01, 0.1])),
        gravity=rng.normal(0.0, 1.0, 2 + space) * rng.choice([0.0, 3.0, 9.8]), **random_springs(rng, stiffness),
        **({"space": Space(rng.uniform(0.7, 1.4), twist, radius=0.01)} if space else {}),
    )  # fmt: skip


def random_motion(rng: Random, *, space: bool) -> Motion | None:
    """Return a free or driven motion of a random model; None if the model has no equilibrium."""
    how = int(rng.integers(4))  # two of four: free
    try:
        model = random_model(rng, space=space)
        q = state.equilibrium(model)
    except PliantError:
        return None
    still = [Pulse(0.0, 0.0, 1.0) for _ in model.chambers]
    if how < 2:
        bend, rate = rng.uniform(0.05, 0.8), rng.choice([0.0, 1.5])
        joints = model.size - len(model.extensions)
        more = {"initial_angle": q + bend * np.append(rng.uniform(-1, 1, joints), np.zeros(model.size - joints)),
                "initial_rate": rate * np.append(rng.normal(0, 1, joints), np.zeros(model.size - joints))}  # fmt: skip
        return Motion(model, still, more)
    if how == 2:
        level = {"Pa": 1e5, "N": 20.0 * float(model.stiffness.mean()), "m": 4e-3}
        return Motion(model, [Pulse(rng.uniform(0.1, 1.0) * level[c.unit], 0.02, 0.15) for c in model.chambers], {})
    push = rng.normal(0.0, 1.0, 2 + space) * float(model.stiffness.mean()) / model.length
    pull = PointForce([0.0, 0.05, 0.1, 0.1], [0 * push, push, push, 0 * push], model.points[-1].name)
    return Motion(model, still, {"forces": [pull]})


def imbalance(run: Any) -> float:
    """Return the largest change of the energy that neither inputs nor losses explain, over the exchanged energy."""
    stored = [run[name].values for name in PARTS["energy"] if name in run]
    lost = np.sum([run[name].values for name in PARTS["loss"] if name in run], axis=0)
    excess = np.sum(stored, axis=0) + lost - run["input_work"].values
    exchanged = max(*(np.ptp(one) for one in stored), lost[-1])
    return float(np.abs(excess - excess[0]).max() / exchanged) if exchanged > 1e-15 else 0.0


def tip_is_right(motion: Motion, run: Any) -> bool:
    """Return whether the tip is within 1 % of the length of the accurate one."""
    try:
        best = pliant.simulate(motion.model, motion.inputs, times=run.time.values[::20], method="accurate",
                               tolerance=1e-3, check=False, **motion.more)  # fmt: skip
    except PliantError:
        return False
    apart = run.tip_position.values[::20, -1] - best.tip_position.values[:, -1]
    return bool(np.linalg.norm(apart, axis=-1).max() < LIMIT * motion.model.length)


def judged(motion: Motion, step: float | None) -> tuple[str, float, float]:
    """Return the outcome of a motion at a step [s], its imbalance, and its time over that without the check."""
    clock, spent = [], []
    for check in (False, False, True):  # the first compiles
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            clock.append(process_time())
            try:
                run = pliant.simulate(
                    motion.model, motion.inputs, duration=DURATION, time_step=step, check=check, **motion.more
                )
            except PliantError:
                return "refused", np.nan, np.nan
            spent.append(process_time() - clock[-1])
    missing = imbalance(run)
    warned = any(issubclass(w.category, AccuracyWarning) for w in caught)
    if missing > LIMIT:
        return f"unbalanced, {'reported' if warned else 'NOT reported'}", missing, spent[2] / spent[1]
    if warned:
        return f"balanced, {'FALSE warning' if tip_is_right(motion, run) else 'tip wrong, reported'}", missing, np.nan
    return "balanced", missing, spent[2] / spent[1]


def main() -> None:
    """Print the table of each step."""
    asked = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    asked.add_argument("number", nargs="?", type=int, default=500)
    asked.add_argument("steps", nargs="*", default=["default", "1"])
    asked.add_argument("--seed", type=int, default=1)
    asked.add_argument("--only", choices=("plane", "space"))
    given = asked.parse_args()
    for where in (given.only,) if given.only else ("plane", "space"):
        counts: dict[str, Counter[str]] = {name: Counter() for name in given.steps}
        ratios: dict[str, list[float]] = {name: [] for name in given.steps}
        for number in range(given.number):
            motion = random_motion(np.random.default_rng((given.seed, number)), space=where == "space")
            for name in given.steps if motion else ():
                outcome, missing, ratio = judged(motion, None if name == "default" else 1e-3 * float(name))
                counts[name][outcome] += 1
                ratios[name] += [ratio]
                if "NOT" in outcome or "FALSE" in outcome or (name == "default" and "reported" in outcome):
                    print(f"  {where} {number}, step {name}: {outcome}, {100 * missing:.3g} % of energy", flush=True)
        for name, outcomes in counts.items():
            listed = ", ".join(f"{outcome} {outcomes[outcome]}" for outcome in sorted(outcomes))
            quarters = np.nanquantile(ratios[name], (0.5, 0.9))
            print(f"{where}, step {name}: {listed}; time over that without the check {quarters[0]:.2f} (median), "
                  f"{quarters[1]:.2f} (90 %)", flush=True)  # fmt: skip


if __name__ == "__main__":
    main()
