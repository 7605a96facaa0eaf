"""The step in O(n) is the dense step: same answers for any chain, at any step, along a motion, and side by side."""

from __future__ import annotations

import numpy as np
import pytest
from oracles.allocation import allocations
from oracles.chains import random_chain, random_state, workspace

from pliant.compiler.choose import family_of, substitutes, twin
from pliant.compiler.twin import rebuild
from pliant.equations.articulated import step_articulated
from pliant.equations.energy import add_step_work
from pliant.equations.motion import step


def start(rng, n):
    chain = random_chain(rng, n)
    q, dq = random_state(rng, n)
    return chain, chain.phi(q), np.cumsum(dq)


@pytest.mark.parametrize("n", [1, 2, 3, 4, 5, 8, 13, 30, 50])
@pytest.mark.parametrize("h", [1e-5, 1e-3, 1e-2])
def test_one_step(rng, n, h):
    chain, phi, w = start(rng, n)
    w = w * min(1.0, 0.3 / (h * np.abs(w).max()))
    results = []
    for kernel in (step, step_articulated):
        work, moved = workspace(n), (phi.copy(), w.copy())
        twin(kernel)(*moved, h, chain.drive(0.08), chain.body(), chain.joints(), work)
        results.append((*moved, work.a))
    for dense, folded in zip(*results, strict=True):
        np.testing.assert_allclose(folded, dense, rtol=1e-10, atol=1e-10 * np.abs(dense).max())


def test_a_motion_stays_the_same(rng):
    chain, phi, w = start(rng, 12)
    dense, folded = (phi.copy(), 0.1 * w), (phi.copy(), 0.1 * w)
    for _ in range(300):
        for kernel, moved in ((step, dense), (step_articulated, folded)):
            twin(kernel)(*moved, 5e-4, chain.drive(0.05), chain.body(), chain.joints(), workspace(12))
    assert folded[0] == pytest.approx(dense[0], abs=1e-10)
    assert folded[1] == pytest.approx(dense[1], abs=1e-10 * max(1.0, np.abs(dense[1]).max()))


def test_the_plain_text_is_what_is_compiled(rng):
    chain, phi, w = start(rng, 6)
    plain, compiled = (phi.copy(), w.copy()), (phi.copy(), w.copy())
    rest = (1e-3, chain.drive(0.08), chain.body(), chain.joints())
    step_articulated(*plain, *rest, workspace(6))
    twin(step_articulated)(*compiled, *rest, workspace(6))
    np.testing.assert_allclose(compiled[1], plain[1], rtol=1e-12)


def test_long_chains_are_stepped_by_articulated_bodies(rng):
    """What every march takes its steps by: under gravity, with a mass at the tip, and with the springs of a memory."""
    from pliant.simulation.march_loops import march

    chain, phi, w = start(rng, 13)
    chosen = {step: twin(step, 13)}
    assert set(substitutes(march, family_of(13, 0, 1, 0, 0, ""))) == {step, add_step_work}
    assert chosen[step] is twin(step, 12)  # finds its machine code by the size of the chain
    dense, folded = (phi.copy(), 0.1 * w), (phi.copy(), 0.1 * w)
    rest = (1e-3, chain.drive(0.05), chain.body(), chain.joints())
    for _ in range(20):
        step(*dense, *rest, workspace(13))
        chosen[step](*folded, *rest, workspace(13))
    np.testing.assert_allclose(folded[0], dense[0], atol=1e-12)
    np.testing.assert_allclose(folded[1], dense[1], atol=1e-12 * np.abs(dense[1]).max())


def many(count, arguments):
    for _ in range(count):
        step_articulated(*arguments)


def test_no_allocation(rng):
    from numba import njit

    chain, phi, w = start(rng, 9)
    arguments = (phi, w, 1e-4, chain.drive(0.02), chain.body(), chain.joints(), workspace(9))
    compiled = rebuild(many, njit, {"step_articulated": twin(step_articulated)})
    once, often = allocations(compiled, arguments)
    assert once == often
