"""Store and compare the numbers that pliant computes for random models, to see whether a change of code changed them.

Run `python benchmarks/same_numbers.py store FILE` before the change, and `python benchmarks/same_numbers.py compare
FILE` after it. Models are drawn with a seed: 1 to 8 links, fixed or lengthening, one or two chambers, hysteresis
states, gravity, and 1 to 3 links in space with twists, segments and tendons. `--demo` adds the numbers of `pliant
demo`. A difference is reported relative to the largest entry.
"""

from __future__ import annotations

import json
import sys
import tempfile
import warnings
from pathlib import Path

import numpy as np
import xarray as xr
from harness import parser_of

import pliant
from pliant.contact.locate import moment_arms
from pliant.contact.residual import static_residual
from pliant.model import Extension, Memory, Tendon, Valve
from pliant.recording import make_recording

SEED, MODELS, IN_SPACE, STEP = 20261123, 24, 8, 2.5e-4  # step in s
Numbers = dict[str, np.ndarray]


def random_model(rng: np.random.Generator, k: int) -> pliant.Model:
    """Return the k-th model: its options cycle, and its numbers are random."""
    n = 1 + k % 8
    chambers = [
        pliant.Chamber(
            name=f"c{c}", torque=[rng.uniform(3e-7, 9e-7), 2e-12 * (k % 2)], joint_gain=rng.uniform(0.6, 1.2, n),
            valve=Valve(rise_time=0.03 * (k % 3 > 0), fall_time=0.04 * (k % 3 > 0)),
            axial_gain=[40.0] if k % 3 == 1 else [0.0],
        )
        for c in range(1 + (k % 5 == 4))
    ]
    memory = Memory(creep_share=[0.2, 0.1], creep_time=[0.2, 2.0]) if k % 4 == 3 else Memory()
    extensions = [Extension(stiffness=120.0, damping=0.5)] if k % 3 == 1 else []
    return pliant.Model(
        link_length=rng.uniform(0.02, 0.05, n), link_mass=rng.uniform(0.005, 0.02, n),
        stiffness=rng.uniform(0.8, 2.0, n), damping=rng.uniform(2e-3, 9e-3, n), rest_angle=rng.uniform(-0.1, 0.1, n),
        stiffening=-0.2 * (k % 2), cubic_stiffening=0.3 * (k % 7 == 2), mass_at=("rod", "tip")[k % 2],
        tip_mass=0.004 * (k % 3), base_length=0.01 * (k % 2), base_angle=0.05 * (k % 3),
        gravity=(1.5 * (k % 2), -9.7 * (k % 4 > 0)), chambers=chambers, memory=memory,
        extensions=extensions, stations=[("a", n - 1, 0.01, 0.003), ("b", 0, 0.02, -0.002), ("base", -1, 0.005, 0.0)],
    )


def random_body(rng: np.random.Generator, k: int) -> pliant.Model:
    """Return the k-th model of a chain in space: its options cycle, and its numbers are random."""
    n = 1 + k % 3
    space = {"stiffness_ratio": rng.uniform(0.7, 1.4), "rest_turn": rng.uniform(-0.2, 0.2, (n, 3)),
             "base_tilt": rng.uniform(-0.3, 0.3, 3), "radius": 0.008, "twist_ratio": 0.7 * (k % 2)}  # fmt: skip
    chambers = [
        pliant.Chamber(name=f"c{c}", torque=[rng.uniform(3e-7, 9e-7)], joint_gain=rng.uniform(0.6, 1.2, n),
                       cross_gain=rng.uniform(-0.5, 0.5, n), axial_gain=[40.0 * (k % 4 == 1)])
        for c in range(1 + k % 2)
    ]  # fmt: skip
    if k % 4 == 2:
        chambers = [Tendon(name="cable", lever=0.01, joint_gain=1.0, cross_gain=0.4)]
    hysteresis = {"creep_share": [0.2], "creep_time": [0.3], "slip_share": [0.1], "slip_angle": [0.02]}
    memory = Memory(**hysteresis if k % 4 == 3 else {})
    return pliant.Model(
        link_length=rng.uniform(0.02, 0.05, n), link_mass=rng.uniform(0.005, 0.02, n),
        stiffness=rng.uniform(0.8, 2.0, n), damping=rng.uniform(2e-3, 9e-3, n), tip_mass=0.004 * (k % 3),
        gravity=(1.5 * (k % 2), 0.4, -9.7), chambers=chambers, memory=memory, space=space,
        extensions=[Extension(stiffness=120.0, damping=0.5)] if k % 4 == 1 else [],
        stations=[("a", n - 1, 0.01, 0.003, 0.002), ("b", 0, 0.02, -0.002, 0.0), ("base", -1, 0.005, 0.0, 0.0)],
    )


def of_dataset(data: xr.Dataset) -> Numbers:
    """Return numeric variables of a dataset."""
    return {name: np.asarray(v.values, dtype=float) for name, v in data.data_vars.items() if v.dtype.kind in "fiub"}


def of_model(model: pliant.Model) -> Numbers:
    """Return equilibrium, modes, motion, linear model, contact, estimate and exports of one model."""
    C = len(model.chambers)
    levels = [(40e3 + 15e3 * c) * (1e-4 if model.actuation.tendons else 1.0) for c in range(C)]  # Pa or N
    pressure = np.array(levels) if C > 1 else levels[0]
    rest = pliant.equilibrium(model, pressure)
    numbers: Numbers = {"rest": rest, **dict(zip(("frequency", "damping"), pliant.modes(model), strict=True))}
    inputs = [pliant.Pulse(level=p, start=0.05, width=0.3) for p in levels]
    motion = pliant.simulate(model, inputs if C > 1 else inputs[0], times=np.arange(121) * 2.5e-3, time_step=STEP)
    numbers |= {f"motion/{k}": v for k, v in of_dataset(motion).items()}
    linear = pliant.linearise(model, pressure)
    numbers |= {"linear/A": linear.A, "linear/B": linear.B, "linear/C": linear.C}
    stepper = pliant.Stepper(model, STEP)
    for _ in range(50):
        stepper.step(pressure)
    numbers |= {"stepper/angle": stepper.angle.copy(), "stepper/tips": stepper.tips()}
    x = np.tile(np.append(stepper.angle, stepper.strain), (3, 1))
    held = np.tile(np.atleast_1d(pressure), (3, 1))
    numbers["residual"] = static_residual(model, x, held if C > 1 else held[:, 0])
    last = np.array([model.n - 1])
    numbers["arms"] = moment_arms(model, x, last, np.array([0.01]))
    return {**numbers, **estimated(model, motion, C), **exported(model)}


def estimated(model: pliant.Model, motion: xr.Dataset, C: int) -> Numbers:
    """Return states that the filter estimates from the motion of the observed points."""
    noise = 1e-4 * np.random.default_rng(3).standard_normal(motion.station_position.shape)
    if model.actuation.tendons:
        return {}
    shown = make_recording(
        motion.time.values, motion.station_position.values + noise, station=[p.name for p in model.points],
        frame="planar" if model.space is None else "spatial",
        pressure_time=motion.time.values, pressure=motion.pressure.values, source="benchmark",
        **({"chamber": [c.name for c in model.chambers]} if C > 1 else {}),
    )
    shown = shown.isel(station=slice(0, 2))
    try:
        found = pliant.estimate(shown, model, time_step=STEP)
    except pliant.PliantError as error:
        return {f"estimate refused: {error}"[:60]: np.zeros(1)}
    return {f"estimate/{k}": v for k, v in of_dataset(found).items()}


def exported(model: pliant.Model) -> Numbers:
    """Return the bytes of the text exports."""
    numbers: Numbers = {}
    with tempfile.TemporaryDirectory() as folder:
        for target, ending in (("c99", ".c"), ("jax", ".py"), ("mjcf", ".xml"), ("urdf", ".urdf")):
            try:
                pliant.export(model, target, Path(folder) / f"{target}{ending}")
            except (pliant.PliantError, TypeError) as error:
                numbers[f"export/{target} refused: {str(error)[:40]}"] = np.zeros(1)
                continue
            endings = (".c", ".h", ".py", ".xml", ".urdf")
            texts = (p for p in Path(folder).rglob("*") if p.is_file() and p.suffix in endings)
            for path in sorted(texts):
                content = path.read_bytes().replace(folder.encode(), b"")  # stated in the command of the file
                numbers[f"export/{path.name}"] = np.frombuffer(content, dtype=np.uint8).astype(float)
    return numbers


def of_demo() -> Numbers:
    """Return metrics of the bundled demo, as in its file."""
    from typer.testing import CliRunner

    from pliant.cli import app

    with tempfile.TemporaryDirectory() as folder:
        done = CliRunner().invoke(app, ["demo", "-o", folder, "--quiet"])
        if done.exit_code:
            raise SystemExit(done.output)
        return flat("demo", json.loads((Path(folder) / "metrics.json").read_text(encoding="utf-8")))


def flat(name: str, value: object) -> Numbers:
    """Return numbers of nested lists and dicts by their path."""
    if isinstance(value, dict):
        return {k: v for key, part in value.items() for k, v in flat(f"{name}/{key}", part).items()}
    if isinstance(value, list):
        return {k: v for i, part in enumerate(value) for k, v in flat(f"{name}/{i}", part).items()}
    return {name: np.array([float(value)])} if isinstance(value, int | float) else {}


def everything(demo: bool) -> Numbers:
    """Return all numbers by their names."""
    rng, numbers = np.random.default_rng(SEED), {}
    for k in range(MODELS):
        model = random_model(rng, k)
        numbers |= {f"{k:02d}/{name}": value for name, value in of_model(model).items()}
    for k in range(IN_SPACE):
        numbers |= {f"space {k:02d}/{name}": value for name, value in of_model(random_body(rng, k)).items()}
    return numbers | (of_demo() if demo else {})


def compare(before: Numbers, after: Numbers, allowed: float) -> int:
    """Print the differences, and return the number of differences beyond `allowed`."""
    bad = [f"only {'after' if name in after else 'before'}: {name}" for name in sorted(before.keys() ^ after.keys())]
    rounded, worst = 0, 0.0
    for name in sorted(before.keys() & after.keys()):
        a, b = before[name], after[name]
        if a.shape != b.shape:
            bad.append(f"shape {a.shape} -> {b.shape}: {name}")
        elif not np.array_equal(a, b, equal_nan=True):
            off = float(np.nanmax(np.abs(a - b))) / (float(np.nanmax(np.abs(a))) or 1.0)
            rounded, worst = rounded + 1, max(worst, off)
            if not off <= allowed or (np.isnan(a) != np.isnan(b)).any():
                bad.append(f"differs by {off:.2e}: {name}")
    for line in bad:
        print(line)
    print(f"{len(before)} arrays, {rounded} of them not equal bit for bit, by at most {worst:.2e}; {len(bad)} bad")
    return len(bad)


def main() -> None:
    """Store or compare the numbers."""
    parser = parser_of(__doc__, allowed=1e-12)
    parser.add_argument("what", choices=("store", "compare"))
    parser.add_argument("file", type=Path)
    parser.add_argument("--demo", action="store_true")
    asked = parser.parse_args()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        numbers = everything(asked.demo)
    if asked.what == "store":
        np.savez_compressed(asked.file, **{k.replace("/", "|"): v for k, v in numbers.items()})
        print(f"stored {len(numbers)} arrays")
    else:
        with np.load(asked.file) as stored:
            before = {k.replace("|", "/"): stored[k] for k in stored.files}
        sys.exit(compare(before, numbers, asked.allowed) > 0)


if __name__ == "__main__":
    main()
