"""Dual numbers: values as on floats to the bit, derivatives as by complex steps through the plain text."""

from __future__ import annotations

import numpy as np
import pytest
from oracles.space import random_space_chain

from pliant.compiler.choose import dual_twin, twin
from pliant.compiler.duals import SLOTS, WIDTH, duals
from pliant.compiler.trace import BOUNDED
from pliant.compiler.trace import planar_workspace as workspace
from pliant.equations import motion, spatial
from pliant.equations.elastic import ROWS
from pliant.equations.extension import step as extensible_step
from pliant.equations.memory import step_with_memory
from pliant.equations.symbols import Body, ExtensibleBody, ExtensibleJoints, Held, Joints, MemoryLaw, Past

TINY = 1e-30


def leaves(record):
    """Every number and array of records within records."""
    return [leaf for e in record for leaf in (leaves(e) if isinstance(e, tuple) else [e])]


def rebuilt(record, entries):
    """The record with other leaves, taken from an iterator."""
    return type(record)(*(rebuilt(e, entries) if isinstance(e, tuple) else next(entries) for e in record)) if hasattr(
        record, "_fields") else tuple(rebuilt(e, entries) if isinstance(e, tuple) else next(entries) for e in record)


def joints_of(rng, n, more=0):
    rows = {name: rng.uniform(0.5, 1.5, n + more * (name in "KD")) for name in Joints._fields[1:]}
    rows |= {"theta0": 0.3 * rng.normal(size=n), "D": 0.01 * rows["D"], "hardening": rng.uniform(0.5, 1.5, (ROWS, n))}
    rows["spin"] = rows["spin"][:2]
    return Joints(0.2, **{name: rows[name] for name in Joints._fields[1:]})


def plain(rng):
    n = 3
    body = Body(rng.uniform(1e-5, 2e-5, (n, n)) + 1e-4 * np.eye(n), rng.uniform(1e-5, 2e-5, n), rng.uniform(0, 1e-3, n),
                3.0, -9.0)  # fmt: skip
    given = (rng.normal(size=n), rng.normal(size=n), 2e-3, rng.uniform(0, 0.1, n), body, joints_of(rng, n))
    return motion.step, (*given, workspace(n)), n, 0


def lengthening(rng):
    n, S = 2, 2
    l = rng.uniform(0.02, 0.05, n + 1)
    share = np.array([[1.0, 0.0], [0.6, 0.4], [0.0, 1.0]])
    B = 1e-4 * np.outer(l, l) + 1e-5 * np.eye(n + 1)
    body = ExtensibleBody(B, l, rng.uniform(0, 1e-3, n + 1), share, 3.0, -9.0)
    x, v = rng.normal(size=n + S), rng.normal(size=n + S)
    joints = ExtensibleJoints(*joints_of(rng, n, S)[:6], np.zeros(0), rng.normal(size=2))
    given = (0.1 * x, v, 1e-3, rng.uniform(0, 0.1, n + S), body, joints)
    return motion.step, (*given, workspace(n, S)), n, S


def remembering(rng):
    _, (phi, w, h, torque, body, joints, work), n, _ = plain(rng)
    slip = np.array([0.2, 0.1]), np.array([1e-5, 0.5])
    memory = MemoryLaw(np.array([0.3]), np.array([0.4]), *slip, 0.2, 90.0, 40.0, 1.5)
    rows = {name: np.zeros(n) for name in Held._fields[:-1]} | {"K": joints.K.copy(), "theta0": joints.theta0.copy()}
    held = Held(**rows, springs=joints._replace(theta0=rows["theta0"], K=rows["K"]))
    past = Past(memory, 0.01 * rng.normal(size=(n, 4)), held)
    return step_with_memory, (phi, w, h, torque, body, joints, past, work), None, 0


def in_space(rng):
    chain = random_space_chain(rng, 2, twist=True)
    return spatial.step, (chain.x, chain.v, 1e-3, rng.normal(0, 0.01, 6), *chain[:2], chain.work()), None, 0


@pytest.mark.parametrize("case", [plain, lengthening, remembering, pytest.param(in_space, marks=pytest.mark.slow)])
def test_values_are_those_of_floats_and_slopes_those_of_complex_steps(rng, case):
    kernel, given, links, segments = case(rng)
    numbers = [np.array(leaf, dtype=float) for leaf in leaves(given)]
    slopes = [rng.normal(size=(*a.shape, WIDTH)) * (np.abs(a)[..., None] + 1e-3) for a in numbers]
    dual = [duals(a, d) for a, d in zip(numbers, slopes, strict=True)]
    shared(given, dual)
    dual_twin(kernel, links, segments, laws=BOUNDED)(*rebuilt(given, iter(dual)))

    real = [a.copy() if a.ndim else float(a) for a in numbers]
    shared(given, real)
    twin(kernel, links, segments, laws=BOUNDED)(*rebuilt(given, iter(real)))
    text = extensible_step if segments else kernel
    for k in range(WIDTH):
        tilted = [a + 1j * TINY * d[..., k] for a, d in zip(numbers, slopes, strict=True)]
        shared(given, tilted)
        text(*rebuilt(given, iter(tilted)))
        for place in (0, 1):  # angles and rates, advanced in place
            np.testing.assert_array_equal(dual[place][..., 0], real[place])
            expected = tilted[place].imag / TINY
            least = 1e-11 * np.abs(expected).max()
            np.testing.assert_allclose(dual[place][..., WIDTH + k], expected, rtol=1e-10, atol=least)


def shared(given, numbers):
    """Let the springs of `Held` be its own K and theta0, as the step with memory has them."""
    if len(given) == 8:
        names = ["phi", "w", "q", "dq", "creep_slope", "creep_offset", "slope", "offset", "K", "theta0"]
        first = len(leaves(given[:6])) + len(MemoryLaw._fields) + 1
        springs = first + len(names)
        numbers[springs + Joints._fields.index("K")] = numbers[first + names.index("K")]
        numbers[springs + Joints._fields.index("theta0")] = numbers[first + names.index("theta0")]


def test_a_dual_begins_where_a_register_may_be_loaded_from():
    for shape in ((), (3,), (2, 5)):
        made = duals(np.ones(shape), np.ones((*shape, 2)))
        assert made.shape == (*shape, SLOTS)
        assert made.__array_interface__["data"][0] % (8 * WIDTH) == 0
