"""Straight-line twins: the same numbers as the loops, for every number of links, real and complex."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest

from pliant.compiler import trace
from pliant.compiler.choose import straight, twin
from pliant.compiler.trace import BOUNDED, recording
from pliant.compiler.trace import planar_workspace as workspace
from pliant.equations import energy, motion
from pliant.equations.elastic import ROWS
from pliant.equations.symbols import Body, Joints, Slopes
from pliant.mechanics import mechanics_of
from pliant.numerics.trig import cos_sin


def arguments(rng: np.random.Generator, n: int) -> dict[str, object]:
    l = rng.uniform(0.02, 0.05, n)
    c = rng.uniform(0.3, 1.0, n) * l
    m = rng.uniform(0.01, 0.02, n)
    B, h = np.zeros((n, n)), np.zeros(n)
    from pliant.equations.inertia import body_constants

    body_constants(l, m, c, 0.007, B, h)
    body = Body(B, m * l**2 / 12, h, 3.0, -9.0)
    sizes = {"hardening": (ROWS, n), "spin": 2}
    joints = Joints(0.2, *(rng.uniform(0.5, 1.5, sizes.get(f, n)) for f in Joints._fields[1:]))
    joints = joints._replace(theta0=0.3 * rng.normal(size=n), D=joints.D * 0.01)
    return {
        "phi": rng.normal(size=n), "w": 5 * rng.normal(size=n),
        "h": 2e-3, "torque": np.full(n, 0.08), "body": body, "joints": joints, "work": workspace(n),
        "out": Slopes(np.zeros(n), np.zeros((n, n)), np.zeros((n, n))),
    }


def call(kernel: object, function: object, given: dict[str, object]) -> None:
    names = kernel.__code__.co_varnames[: kernel.__code__.co_argcount]
    function(*(given[name] for name in names))


@pytest.mark.parametrize("n", [1, 2, 5, 8])
@pytest.mark.parametrize("kernel", [motion.step, motion.acceleration_jacobian])
def test_straight_line_gives_the_numbers_of_the_loops(rng, n, kernel):
    one = arguments(rng, n)
    two = {k: v.copy() if isinstance(v, np.ndarray) else v for k, v in one.items()}
    two["work"], two["out"] = workspace(n), Slopes(*map(np.zeros_like, one["out"]))
    call(kernel, kernel, one)
    call(kernel, straight(kernel, n, 0, 1, 0, BOUNDED), two)
    pairs = [(one[name], two[name]) for name in ("phi", "w")] + list(zip(one["out"], two["out"], strict=True))
    for a, b in pairs:
        np.testing.assert_allclose(b, a, rtol=1e-11, atol=1e-11 * (1 + np.abs(a).max()))
    if kernel is motion.step:
        np.testing.assert_allclose(two["work"].a, one["work"].a, rtol=1e-11)


def test_a_square_root_is_computed_only_where_a_spring_is_bounded(rng):
    """Without a bound a step has no square root, and the numbers of a bound R = 0 to the bit."""
    roots = [sum(what == "sqrt" for what, _ in recording(motion.step, 5, 0, 1, 0, laws).rows) for laws in (0, BOUNDED)]
    assert roots == [0, 5]
    given = arguments(rng, 5)
    given["joints"].hardening[-1] = 0.0
    less = given["joints"]._replace(hardening=given["joints"].hardening[:-1].copy())
    results = []
    for laws, joints in ((BOUNDED, given["joints"]), (0, less)):
        one = {**given, "phi": given["phi"].copy(), "w": given["w"].copy(), "joints": joints, "work": workspace(5)}
        call(motion.step, straight(motion.step, 5, 0, 1, 0, laws), one)
        results.append([*one["phi"], *one["w"]])
    assert results[0] == results[1]


def test_arguments_of_other_sizes_are_refused(rng):
    with pytest.raises(RuntimeError, match="no machine code"):
        call(motion.step, straight(motion.step, 3), arguments(rng, 23))


def test_march_is_the_same_by_either_twin(rng):
    from pliant.actuators import chen2018
    from pliant.simulation import Pulse, march_loops
    from pliant.simulation.drive import drive

    model = chen2018.model()
    times = np.linspace(0.0, 1.0, 101)
    plan = drive(model, Pulse(119e3, 0.12), times, 1e-3)
    found = []
    for march in (twin(march_loops.march), twin(march_loops.march, model.n)):
        out = march_loops.rows_for(101, 5, (5, 0), 2)
        start = (np.zeros(5), np.zeros(5))
        march(*start, plan.steps, mechanics_of(model).body, mechanics_of(model).joints, workspace(5), out)
        found.append(out)
    assert np.abs(found[0].phi).max() > 0.1
    np.testing.assert_allclose(found[1].phi, found[0].phi, atol=1e-12)
    np.testing.assert_allclose(found[1].energy, found[0].energy, rtol=1e-10, atol=1e-16)


@pytest.mark.parametrize("segments", [0, 2])
def test_work_of_a_step_to_the_last_bit(rng, segments):
    n = 5
    given = trace.extensible_arguments(n, segments) if segments else trace.example_arguments(n)
    w, torque, turn, D = (rng.normal(size=n + segments) for _ in range(4))
    joints, work = given["joints"]._replace(D=D), given["work"]._replace(a=turn)
    totals = np.zeros((2, 3))
    for take, total in zip((energy.add_step_work, straight(energy.add_step_work, n, segments)), totals, strict=True):
        take(w, 1e-3, torque, joints, work, total)
    assert totals[0, 0] != 0.0
    assert (totals[0] == totals[1]).all()


def test_equal_operations_are_written_once_and_dead_ones_not_at_all():
    made = trace.recording(motion.step, 2)
    needed = [made.rows[row] for row in made.needed]
    assert len(set(needed)) == len(needed)
    assert sum(what == "cos" for what, _ in needed) == 2
    assert not any("work.A" in what for what, _ in needed)
    assert {where.partition("[")[0] for where, _ in made.stores} == {"phi", "w", "work.a"}


def test_cosine_and_sine_to_the_last_bits(rng):
    x = np.concatenate([np.linspace(-20, 20, 20001), rng.uniform(-1e5, 1e5, 20000), np.arange(-8, 9) * np.pi / 4])
    c, s = cos_sin(x)
    assert max(np.abs(c - np.cos(x)).max(), np.abs(s - np.sin(x)).max()) < 3e-16
    assert np.isnan(cos_sin(np.nan)).all()


@pytest.mark.slow
def test_straight_line_is_cached_for_a_fresh_process():
    script = (
        "from pliant.actuators import chen2018\n"
        "from pliant.simulation import Pulse, march_loops, simulate\n"
        "from pliant.compiler.choose import twin\n"
        "simulate(chen2018.model(), Pulse(1e5), duration=0.1)\n"
        "print(sum(twin(march_loops.march, 5).stats.cache_hits.values()))\n"
    )
    for _ in range(2):
        out = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert int(out.stdout) == 1
