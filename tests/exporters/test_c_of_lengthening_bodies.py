"""Bodies in a plane that lengthen, as C: the steps of `Stepper`, and what they tell of their state."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from binding import Arm
from target_models import EVERY_BRANCH, flat_longer

import pliant
from pliant.exporters.c99 import code
from pliant.exporters.provenance import Provenance
from pliant.mechanics import mechanics_of
from pliant.model import Chamber, Extension, Memory, Model, Valve
from pliant.simulation import Stepper

JOINTS = Memory((0.1,), (0.5,), (0.1,), (0.02,), boucwen_share=0.1)
AXIAL = Memory(axial_creep_share=(0.2,), axial_creep_time=(0.4,), axial_slip_share=(0.1,), axial_slip_strain=(0.01,))
VALVES = [Valve(), Valve(rise_time=0.03, fall_time=0.05), Valve(rise_time=0.02, rise_rate=4e5, fall_rate=8e5)]
LINKS = (2, 3, 2, 3, 2, 2)
SEGMENTS = (1, 2, 1, 2, 1, 1)
MEMORIES = (Memory(), Memory(), JOINTS, EVERY_BRANCH, AXIAL, EVERY_BRANCH)


def random_body(rng: np.random.Generator, kind: int) -> Model:
    """Links, segments, springs, laws, valves and memories as they come; what `kind` says of each."""
    n, S = LINKS[kind], SEGMENTS[kind]
    length, curved = rng.uniform(0.02, 0.05, n), kind in (1, 3, 5)
    edges = [0.005, *np.sort(rng.uniform(0.02, 0.02 + length[0], S - 1)), None]
    law = rng.uniform([-0.5, 0.1, 0.2], [0.3, 0.9, 0.8], (S, 3)) if curved else np.full((S, 3), None)
    segments = tuple(
        Extension(rng.uniform(40, 90), rng.uniform(0.02, 0.1), edges[s], edges[s + 1], f"s{s}", *law[s])
        for s in range(S)
    )
    chambers = tuple(
        Chamber(
            [rng.uniform(4e-7, 8e-7), 1e-13][: 1 + kind % 2], rng.uniform(0.7, 1.2, n), valve,
            axial_gain=rng.uniform(10, 40, S), swell_share=0.2 * (kind % 2), name=name,
        )
        for name, valve in (("near", VALVES[kind % 3]), ("far", VALVES[(kind + 1) % 3]))
    )  # fmt: skip
    return Model(
        link_length=length, link_mass=rng.uniform(0.008, 0.02, n), stiffness=rng.uniform(0.8, 1.6, n),
        damping=rng.uniform(2e-3, 8e-3, n), rest_angle=rng.uniform(-0.2, 0.2, n), chambers=chambers,
        stiffening=rng.uniform(-0.3, 0.1, n), cubic_stiffening=0.1, stiffening_bound=0.75 * (kind % 2),
        mass_at=("rod", "tip")[kind % 2], tip_mass=0.004, tip_inertia=2e-6, base_length=0.015,
        base_angle=rng.uniform(-0.5, 0.5),
        gravity=rng.uniform(-9, 9, 2), extensions=segments, memory=MEMORIES[kind], name="random",
        stations=[("middle", 0, 0.01, 0.004), ("base", -1, 0.01, 0.002), ("tip", n - 1, 0.02)],
    )  # fmt: skip


def follows_the_stepper(model: Model, arm: Arm, rng: np.random.Generator, steps: int) -> Stepper:
    """Both under the same random pressures, a new level every fifth of a second, without a difference but rounding."""
    stepper = Stepper(model, 1e-3, np.zeros(2))
    assert arm.angle == pytest.approx(stepper.position, abs=1e-14)
    levels = np.repeat(rng.uniform(0.0, 1e5, (steps // 200 + 1, 2)), 200, axis=0)[:steps]
    seen, wanted = np.empty((2, steps, 2, model.size))
    for k, pressures in enumerate(levels):
        assert arm.step(*pressures) == 0
        stepper.step(pressures)
        seen[k], wanted[k] = (arm.angle, arm.rate), (stepper.position, stepper.velocity)
    worst = np.abs(seen - wanted).max(axis=(0, 2))
    assert max(worst[0], 1e-3 * worst[1]) < 1e-12
    assert np.ptp(wanted[:, 0], axis=0)[-len(model.extensions) :].min() > 0.01  # the segments move
    return stepper


@pytest.mark.slow  # compiles a step for each size and law, and C of 60 to 150 kB
@pytest.mark.parametrize("kind", range(6))
def test_the_steps_of_the_stepper(kind, rng, tmp_path):
    model = random_body(rng, kind)
    arm = Arm(model, tmp_path)
    stepper = follows_the_stepper(model, arm, rng, 6000)
    chain = mechanics_of(model)
    places, angles = chain.stations(arm.angle)
    poses = arm.ask("stations", (3, 3))[0]
    assert poses[:, :2] == pytest.approx(places, abs=1e-14)
    assert poses[:, 2] == pytest.approx(angles, abs=1e-14)
    assert arm.ask("tips", (model.n, 2))[0] == pytest.approx(chain.tips(arm.angle), abs=1e-14)
    assert arm.ask("joint_angles", (model.size,))[0] == pytest.approx(chain.joint_coordinates(arm.angle), abs=1e-14)
    energies = list(chain.energy(arm.angle, arm.rate))
    assert arm.ask("energy", (3,))[0] == pytest.approx(energies, abs=1e-14)
    if model.memory:
        first = 2 * model.size + 3 * 2  # behind angles, rates, pressures and the slow states of two chambers
        states = np.array(arm.state[first : first + stepper.memory.size]).reshape(stepper.memory.shape)
        assert states == pytest.approx(stepper.memory, abs=1e-12)
        assert np.abs(states).max() > 1e-3


def test_one_link_and_one_segment(rng, tmp_path):
    """The smallest body that lengthens, so that `make test` sees a mistake of the translation."""
    model = flat_longer(1)
    follows_the_stepper(model, Arm(model, tmp_path), rng, 400)


@pytest.mark.slow
def test_dead_time_delays_the_axial_force(tmp_path):
    """A whole number of steps later, the segments move as without dead time."""
    model = flat_longer(1)
    late = model.with_(chambers=[replace(c, valve=replace(c.valve, dead_time=0.003)) for c in model.chambers])
    folders = [tmp_path / name for name in ("prompt", "late")]
    for folder in folders:
        folder.mkdir()
    prompt, delayed = (Arm(m, folder) for m, folder in zip((model, late), folders, strict=True))
    rows = []
    for _ in range(200):
        assert (prompt.step(5e4, 2e4), delayed.step(5e4, 2e4)) == (0, 0)
        rows.append((prompt.angle, delayed.angle))
    seen, later = np.moveaxis(np.array(rows), 1, 0)
    assert np.ptp(seen[:, -1]) > 0.01
    assert later[3:] == pytest.approx(seen[:-3], abs=1e-14)


@pytest.mark.slow
def test_single_precision_follows_double(tmp_path):
    model = flat_longer(2).with_(memory=EVERY_BRANCH)
    arm, stepper = Arm(model, tmp_path, precision="single"), Stepper(model, 1e-3, np.zeros(2))
    worst = 0.0
    for k in range(2000):
        p = 6e4 * (k // 500 % 2)
        assert arm.step(p, 0.5 * p) == 0
        stepper.step(np.array([p, 0.5 * p]))
        worst = max(worst, *np.abs(arm.angle - stepper.position))
    assert worst < 1e-3
    assert np.abs(stepper.position).max() > 0.05


def test_a_step_that_fails_says_so(tmp_path):
    """A segment that is pushed together to below 5 % of its length, as `Stepper` refuses it."""
    model = flat_longer(1)
    arm = Arm(model.with_(chambers=[replace(c, axial_gain=-40.0) for c in model.chambers]), tmp_path)
    assert -1 in [arm.step(1e7, 1e7) for _ in range(50)]
    arm.library.arm_init(arm.state)
    assert arm.step(1e3, 0.0) == 0


def test_the_header_names_strains_and_their_memory():
    model = flat_longer(2).with_(memory=EVERY_BRANCH)
    made = code(model, Provenance(model, "c99", "x"), time_step=1e-3, precision="double", pressure=0.0, prefix="arm")
    assert "arm_real angle[4]; /* rad, strains 1, absolute angle" in made.header
    assert "of each joint; 1, creep_1, creep_2, slip_1, slip_2 of each segment */" in made.header
    for row in ("axial_stiffness[2]; /* N */", "axial_slip_strain[2]; /* 1 */", "axial_cubic_stiffening[2]; /* 1 */"):
        assert row in made.header
    assert "linearise" not in made.header + made.source


def test_what_cannot_be_carried_is_refused_by_name(tmp_path):
    model = flat_longer(1)
    first = replace(model.chambers[0], valve=Valve(natural_frequency=9.0))
    with pytest.raises(pliant.InputError, match="second-order valve of a: not expressible in c99"):
        pliant.export(model.with_(chambers=[first, model.chambers[1]]), "c99", tmp_path / "a.c")
    assert not list(tmp_path.iterdir())
