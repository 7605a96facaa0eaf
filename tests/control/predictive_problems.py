"""Random problems of predictive control: bodies, limits, states and targets that are feasible.

The bodies have two to six links and one to three chambers, without valve or behind a valve of first or second order,
with or without dead time. Periods are 2 to 10 ms. Slew limits take 0.02 to 2 s from no pressure to the highest. The
state is an equilibrium under random pressures with 0.1 rad and 1 rad/s of noise. The target is the tip under other
random pressures, or the rest without any. Every problem is feasible, since the command may stay constant, and strictly
convex. Solutions are compared with their conditions of optimality, whose multipliers come from SciPy's `nnls`.
"""

from __future__ import annotations

import numpy as np
from scipy.optimize import nnls

from pliant.control import Limits, Mpc, design_outputs
from pliant.control.mpc import QuadraticProgram
from pliant.errors import InputError
from pliant.estimation import State
from pliant.mechanics import mechanics_of
from pliant.model import Chamber, Model, Valve, chain_model
from pliant.simulation import equilibrium

EACH = 10  # problems for each body


def a_valve(rng: np.random.Generator) -> Valve:
    dead = float(rng.choice([0.0, rng.uniform(0.0, 0.02)]))
    lag = rng.uniform(5e-3, 0.1)
    return (
        Valve(dead_time=dead), Valve(rise_time=lag, fall_time=lag, dead_time=dead),
        Valve(natural_frequency=rng.uniform(3.0, 25.0), damping_ratio=rng.uniform(0.5, 1.2), dead_time=dead),
    )[rng.integers(3)]


def a_body(rng: np.random.Generator, highest: float) -> Model:
    """Return a chain whose first mode is at about 1.5 to 12 Hz and which full pressure bends by 0.4 to 2.4 rad."""
    n, length, count = int(rng.integers(2, 7)), rng.uniform(0.05, 0.3), int(rng.integers(1, 4))
    omega, damping, mass = 2 * np.pi * rng.uniform(1.5, 12.0), rng.uniform(0.03, 0.4), 200.0 * length**2
    mass *= rng.uniform(0.3, 3.0)
    stiffness = n * mass * length**2 / 3.0 * omega**2
    law = rng.uniform(0.4, 2.4) / n * stiffness / highest
    gains = [np.ones(n), -np.ones(n), np.where(np.arange(n) < n // 2, 1.0, 0.0)][:count]
    chambers = [Chamber([law], joint_gain=g, valve=a_valve(rng), name=f"c{k}") for k, g in enumerate(gains)]
    return chain_model(
        length=length, mass=mass, links=n, stiffness=stiffness, damping=2 * damping * stiffness / omega,
        chambers=chambers,
    )


def a_state(rng: np.random.Generator, body: Model, pressure: np.ndarray) -> State:
    """Return a state near the equilibrium under a pressure."""
    n, angle = body.n, mechanics_of(body).coordinates(equilibrium(body, pressure))
    none = np.zeros((2, n))
    return State(
        0.0, angle + 0.1 * rng.standard_normal(n), rng.standard_normal(n), *none, np.zeros((2 * n, 2 * n)),
    )


class Checked:
    """A quadratic program whose solutions are checked."""

    def __init__(self, program: QuadraticProgram, highest: np.ndarray, change: np.ndarray) -> None:
        self.program, self.highest, self.change, self.worst = program, highest, change, 0.0

    @property
    def status(self) -> str:
        return self.program.status

    def solve(self, H, g, low, high, start):
        found = self.program.solve(H, g, low, high, start)
        if found is not None:
            rows = np.vstack([np.eye(len(g)), self.change])
            bounds = np.append(0.0 * self.highest, low), np.append(self.highest, high)
            self.worst = max(self.worst, suboptimal(H, g, rows, bounds, found))
        return found


def suboptimal(H, g, rows, bounds, found) -> float:
    """Return the slope of the cost that no active limit balances, relative to the largest slope; or the excess over
    limits.
    """
    value, (low, high) = rows @ found, bounds
    near = 1e-4 * float(np.abs(high).max())  # of the highest pressure
    held = np.vstack([rows[value <= low + near], -rows[value >= high - near]])
    slope, size = H @ found + g, np.abs(H @ found).max() + np.abs(g).max()
    left = nnls(held.T, slope)[1] if len(held) else np.linalg.norm(slope)
    beyond = max(float((low - value).max()), float((value - high).max()), 0.0)
    return max(float(left) / size, beyond / float(np.abs(high).max()))


def tip_at(body: Model, pressure: np.ndarray | float) -> np.ndarray:
    """Return the tip (2,) at equilibrium under a pressure, m."""
    chain = mechanics_of(body)
    return chain.tips(chain.coordinates(equilibrium(body, pressure)))[-1]


def tried(seed: int, problems: int, *, slew: bool, zero: bool) -> dict[str, float]:
    """Return counts over random problems, ten for each body, one after the other."""
    rng, count, failed, refused, worst = np.random.default_rng(seed), 0, 0, 0, 0.0
    while count < problems:
        highest, period = rng.uniform(2e4, 3e5), rng.uniform(2e-3, 1e-2)
        body = a_body(rng, highest)
        C = len(body.chambers)
        steep = highest / np.exp(rng.uniform(np.log(0.02), np.log(2.0)))
        limits = Limits(highest, steep if slew else np.inf)
        outputs = ("tip_x",) if C == 1 else ("tip_x", "tip_y")
        still = tip_at(body, 0.0)
        pressures = np.zeros((EACH, C)) if zero else rng.uniform(0.0, highest, (EACH, C))
        wanted = np.array([tip_at(body, p) for p in pressures])
        try:
            law = Mpc(design_outputs(body, outputs, (wanted - still)[:, : len(outputs)], limits, period), limits)
        except InputError:  # tip_x turns back before full pressure, or a rest is not found
            refused += 1
            continue
        J = law.tuning.stages
        change = np.kron(np.eye(J) - np.eye(J, k=-1), np.eye(C))[: J * C if slew else 0]
        law.program = Checked(law.program, np.full(J * C, highest / 1e3), change)
        for k in range(EACH):
            at = rng.uniform(0.0, highest, C)
            law.step(k * period, a_state(rng, body, at), float(at[0]) if C == 1 else at)
        count, failed, worst = count + EACH, failed + law.failed, max(worst, law.program.worst)
    return {"problems": count, "failed": failed, "bodies_refused": refused, "worst_optimality": worst}
