"""Made-up days of a coarse arm: each parameter of the mounting is shifted by a known amount, drawn from its prior."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pliant.adaptation import adapt_model, parts_of_day, posterior_of
from pliant.adaptation.mounting import mounting_parameters, of_mounting
from pliant.identification import Experiment, FitResult, Parameter, predict
from pliant.identification.parameters import apply
from pliant.identification.uncertainty import Covariance
from pliant.model import Model, Station, chain_model
from pliant.simulation import Trace

TIMES = np.arange(0.0, 6.0, 0.05)  # s
EDGES = np.array([0.3, 0.4, 1.5, 1.6, 2.5, 2.6, 3.6, 3.7, 4.6, 4.7])
LEVELS = np.array([0.0, 6e4, 6e4, 1.2e5, 1.2e5, 2e4, 2e4, 9e4, 9e4, 0.0])  # Pa
NOISE, STEP = 2e-4, 1e-2  # m, s
BODY = {"stiffness": 0.6, "damping": 0.05, "torque_1": 1.2e-6}
DOUBT = 0.03  # of each parameter of the body, from the earlier fit


def arm() -> Model:
    """A chain of two links under gravity, seen at its middle and its tip."""
    model = chain_model(length=0.2, mass=0.08, links=2, stiffness=1.0, damping=0.1, torque=[1e-6], gravity=[0.0, -9.81],
                        stations=(Station("mid", 0, 0.1), Station("tip", 1, 0.1)))  # fmt: skip
    return apply(model, BODY)


def known(model: Model) -> FitResult:
    """The earlier fit, with independent errors of the body's parameters."""
    std = DOUBT * np.array(list(BODY.values()))
    spread = Covariance(tuple(BODY), np.diag(std**2), np.diag(std**2), np.zeros(3, bool), 0.0, 100.0)
    listed = tuple(Parameter(n, v, std=s) for (n, v), s in zip(BODY.items(), std, strict=True))
    return FitResult(model, listed, "", {"old": NOISE}, 1, 0.0, True, spread, time_step=STEP)


def off(seed: int) -> dict[str, float]:
    """Errors of the mounting's parameters on a day of known shifts, in standard errors."""
    rng = np.random.default_rng([seed, 9])
    model = arm()
    result = known(model)
    posterior = posterior_of(result, {"old"})
    blank = np.zeros((TIMES.size, 2, 2)) + 0.05 * TIMES[:, None, None]
    exp = Experiment("day", TIMES, blank, ("mid", "tip"), "trace", Trace(EDGES, LEVELS))
    mounting = mounting_parameters(model, [exp], {})
    true = dict(zip(BODY, rng.multivariate_normal(posterior.prior.mean, posterior.prior.covariance), strict=True))
    for p in mounting:
        while not p.lower <= (value := rng.normal(p.prior, p.prior_std)) <= p.upper:
            pass
        true[p.name] = value
    motion = predict(apply(model, {n: v for n, v in true.items() if n not in ("base_x", "base_y", "start")}), exp, true,
                     STEP)["position"]  # fmt: skip
    exp = replace(exp, position=motion + NOISE * rng.standard_normal(motion.shape))
    found = adapt_model(result, posterior, parts_of_day([exp], 20.0))
    return {p.name: (p.value - true[p.name]) / p.std for p in found.result.parameters
            if of_mounting(p.name) and p.free and p.std}  # fmt: skip


@pytest.mark.slow
def test_shifts_of_every_parameter_of_the_mounting_lie_within_two_standard_errors():
    rows = [off(seed) for seed in range(100)]
    z = np.array([v for row in rows for v in row.values()])
    assert len({len(row) for row in rows}) == 1
    assert 0.93 <= np.mean(np.abs(z) <= 2.0) <= 0.98  # measured: 0.973


def test_a_day_of_known_shifts_is_found():
    z = off(3)
    assert {"base_x", "base_y", "base_angle", "tip.along", "rest_angle_1", "tip_mass", "start"} <= set(z)
    assert np.sqrt(np.mean(np.square(list(z.values())))) < 2.0
