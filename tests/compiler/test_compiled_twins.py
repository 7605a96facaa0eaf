"""One text, several readings: the compiled twin returns what the plain kernel returns and allocates nothing."""

from __future__ import annotations

import numpy as np
import pytest
from numba.core.errors import NumbaError
from oracles.allocation import allocations
from oracles.chains import SIZES, random_chain, random_state, workspace

from pliant.compiler.choose import twin
from pliant.compiler.twin import callees, compiled_twin, makes_arrays, reached, rebuild
from pliant.equations import chain as chain_kernels
from pliant.equations import chain as velocity
from pliant.equations import chamber, elastic, energy, inertia
from pliant.equations.motion import acceleration, acceleration_jacobian, acceleration_recursive, step
from pliant.equations.symbols import Slopes
from pliant.estimation import kalman_loops
from pliant.identification import follow_loops
from pliant.simulation import march_loops
from pliant.testbed import stepping_loops


def arrays(rng, n):
    """Arguments by name: one set for the plain kernel and an equal one for its twin."""
    chain = random_chain(rng, n)
    q, dq = random_state(rng, n)
    phi, w = chain.phi(q), np.cumsum(dq)
    return chain, q, dq, phi, w


def motion_cases(chain, q, dq, phi, w):
    n, drive = chain.n, chain.drive(0.08)
    system = (chain.body(), chain.joints())
    out = Slopes(np.zeros(n), np.zeros((n, n)), np.zeros((n, n)))
    return [
        (acceleration, (phi, w, drive, *system, workspace(n), np.zeros(n))),
        (acceleration_jacobian, (phi, w, drive, *system, workspace(n), out)),
        (step, (phi, w, 1e-3, drive, *system, workspace(n))),
        (acceleration_recursive, (q, dq, chain.torques(q, dq, 0.08), chain.links(), np.zeros(n))),
    ]


def kinematic_cases(chain, q, dq, phi, w):
    n, l, theta0 = chain.n, chain.l, chain.theta0
    c, s, body = np.cos(phi), np.sin(phi), chain.body()
    pose = [np.zeros(shape) for shape in ((n, 2, 2), (n, 2), (n, 2, 2), (n, 2))]
    return [
        (chamber.torque, (1.5, np.array([0.3, 0.2]))),
        (chain_kernels.forward, (q, theta0, l, *pose)),
        (chain_kernels.tips, (phi, l, 0.1, 0.2, np.zeros((n, 2)))),
        (velocity.body_velocities, (q, dq, theta0, l, np.zeros(n), np.zeros((n, 2)))),
        (velocity.body_hessian, (q, theta0, l, chain.c, np.zeros((n, 2, n, n)))),
        (inertia.inertia_absolute, (c, s, body.B, body.I, np.zeros((n, n)))),
        (inertia.coriolis_absolute, (c, s, body.B, w, np.zeros((n, n)))),
        (elastic.gravity_absolute, (c, s, body, np.zeros(n))),
        (energy.kinetic_energy, (c, s, w, body)),
        (energy.damping_power, (w, chain.joints())),
    ]


def copied(value):
    if isinstance(value, np.ndarray):
        return value.copy()
    if isinstance(value, tuple) and hasattr(value, "_fields"):
        return type(value)(*map(copied, value))
    return value


def flat(values):
    for value in values:
        if isinstance(value, tuple):
            yield from flat(value)
        elif value is not None:
            yield np.asarray(value)


def check_twin(kernel, arguments):
    plain, compiled = [copied(a) for a in arguments], [copied(a) for a in arguments]
    results = kernel(*plain), twin(kernel)(*compiled)
    plain, compiled = list(flat([*plain, results[0]])), list(flat([*compiled, results[1]]))
    assert len(plain) == len(compiled)
    for x, y in zip(plain, compiled, strict=True):
        # LLVM's sine may differ from NumPy's in the last bit; nothing else may
        np.testing.assert_allclose(y, x, rtol=1e-11, atol=1e-13 * max(1e-9, np.abs(x).max()))


@pytest.mark.parametrize("n", SIZES)
def test_twins_of_motion(rng, n):
    for kernel, arguments in motion_cases(*arrays(rng, n)):
        check_twin(kernel, arguments)


@pytest.mark.slow
def test_twins_of_everything_else(rng):
    for kernel, arguments in kinematic_cases(*arrays(rng, 5)):
        check_twin(kernel, arguments)


def many(count, kernel_arguments):
    for _ in range(count):
        step(*kernel_arguments)


def many_jacobians(count, kernel_arguments):
    for _ in range(count):
        acceleration_jacobian(*kernel_arguments)


@pytest.mark.parametrize("loop", [many, many_jacobians])
def test_no_allocation(rng, loop):
    from numba import njit

    cases = dict(motion_cases(*arrays(rng, 5)))
    arguments = cases[step if loop is many else acceleration_jacobian]
    compiled = rebuild(loop, njit, {k.__name__: twin(k) for k in (step, acceleration_jacobian)})
    once, often = allocations(compiled, arguments)
    assert once == often


@pytest.mark.parametrize(
    "loop", [march_loops.march, follow_loops.follow, kalman_loops.filter_record, stepping_loops.march],
    ids=lambda loop: f"{loop.__module__}.{loop.__name__}",
)
def test_loops_over_records_make_no_arrays(loop):
    """Writing whole arrays at once also takes Numba several times as long to compile as loops over them."""
    assert not any(map(makes_arrays, reached(loop)))


def test_callees_are_found_across_files():
    known = {"joint_torques", "joint_tangents", "ldl_factor", "ldl_solve", "centrifugal"}
    assert {f.__name__ for f in callees(step)} == known


def whole(a):
    return a


def part(a):
    return a[1:]


@pytest.mark.parametrize("kernel", [whole, part])
def test_a_kernel_that_hands_an_array_back_is_refused(kernel):
    """Such a kernel counts no references, so the array could be freed under the caller's hands."""
    with pytest.raises((TypeError, NumbaError), match=r"returns an array|Only accept returning of array passed"):
        compiled_twin(kernel, "plain", twin, ())(np.zeros(3))
