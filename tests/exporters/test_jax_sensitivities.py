"""Derivatives through an exported JAX module are the sensitivities by which the package fits: from rest, under steps of
the inputs, in the plane and in space, through slip and tendons with friction."""

from __future__ import annotations

import numpy as np
import pytest
from jax_arms import combined, jax_arm, levels

from pliant.exporters.jax_module import parameter_slopes
from pliant.exporters.provenance import Uncertainty
from pliant.identification import Experiment, sensitivities
from pliant.mechanics import mechanics_of
from pliant.simulation import Trace

LEAST = 1e-2  # of the longest column: what counts as the length of a shorter one, both by the size of their parameters
H, HELD, BLOCKS = 1e-3, 5, 12  # s; steps between the jumps of the inputs, which are frames too


def fitted_values(model):
    """Fitted parameters of a model by name, at its own values."""
    m = model.memory
    values = {"stiffness": model.stiffness[0], "damping": model.damping[0], "tip_mass": model.tip_mass or 1e-3}
    for k, (share, time) in enumerate(zip(m.creep_share, m.creep_time, strict=True), 1):
        values |= {f"creep_share_{k}": share, f"creep_time_{k}": time}
    for k, (share, angle) in enumerate(zip(m.slip_share, m.slip_angle, strict=True), 1):
        values |= {f"slip_share_{k}": share, f"slip_angle_{k}": angle}
    if m.boucwen_share:
        values |= {f"boucwen_{k}": getattr(m, f"boucwen_{k}") for k in ("share", "beta", "gamma", "exponent")}
    if model.space:
        gravity = {f"gravity_{axis}": model.gravity[k] for k, axis in ((0, "x"), (2, "z"))}
        values |= {"stiffness_ratio": model.space.stiffness_ratio, **gravity}
    if model.actuation.tendons_rub:
        values |= {"friction": 0.2, "entry_friction": 0.27}
    if model.extensions:
        values |= {f"{model.extensions[-1].name}.axial_stiffness": model.extensions[-1].stiffness}
    chamber = model.chambers[0]
    prefix = "" if model.actuation.count == 1 else f"{chamber.name}."
    if chamber.kind == "pressure":
        values |= {f"{prefix}torque_1": chamber.torque[0]}
    if chamber.valve.rise_time:
        values |= {f"{prefix}valve_rise_time": chamber.valve.rise_time}
    return {name: float(value) for name, value in values.items()}


CASES = [("plane", "all", "plain"), ("flat_longer", "slip", "plain"), ("twisting", "creep", "lag"),
         ("pulled", "none", "lag")]  # fmt: skip


@pytest.mark.slow  # JAX compiles the motion and its derivative
@pytest.mark.parametrize(("body", "past", "inputs"), CASES)
def test_derivatives_are_the_sensitivities_of_fits(body, past, inputs, tmp_path):
    jax = pytest.importorskip("jax", reason="jax is not installed: pip install -e '.[jax]'")
    model = combined(body, past, inputs)
    rows = levels(model, BLOCKS + 1)[1:]
    edges = H * HELD * np.arange(BLOCKS + 1)
    drives = {name: Trace(np.repeat(edges, 2)[1:-1], np.repeat(rows[:, c], 2)) for c, name in
              enumerate(model.actuation.names)}  # fmt: skip
    dimension, names = mechanics_of(model).dimension, [p.name for p in model.points]
    still = np.cumsum(np.full((edges.size, len(names), dimension), 1e-3), axis=0)
    exp = Experiment("r", edges, still, tuple(names), excitation="trace", drives=drives)
    values = fitted_values(model)
    sizes = {name: abs(value) for name, value in values.items()}
    wanted_rows, wanted = sensitivities(model, exp, values, sizes, H)
    wanted_rows, wanted = wanted_rows[..., :dimension], wanted[..., :dimension]
    lengths = {name: np.abs(column).max() for name, column in zip(sizes, wanted, strict=True)}
    longest = max(lengths[name] * size for name, size in sizes.items())
    known = Uncertainty(tuple(values), np.array(list(values.values())), np.eye(len(values)))
    slopes = parameter_slopes(model, known, 1e-4 * np.abs(known.mean))
    with jax.enable_x64(True):
        arm, jnp = jax_arm(model, tmp_path), jax.numpy

        def places(parameters):
            start = arm.rest(parameters, rows[0])
            _, states = arm.rollout(parameters, start, np.repeat(rows, HELD, axis=0), H)
            frames = jax.tree_util.tree_map(lambda a, b: jnp.concatenate([a[None], b[HELD - 1 :: HELD]]), start, states)
            return jax.vmap(lambda s: arm.observe(parameters, s)["position"])(frames)

        own = {k: jnp.asarray(v) for k, v in arm.parameters.items()}
        moved = jax.jit(lambda way: jax.jvp(places, (own,), (way,)))
        for k, name in enumerate(values):
            way = {p: jnp.asarray(slopes[p][k]) if p in slopes else 0.0 * v for p, v in own.items()}
            reached, slope = map(np.asarray, moved(way))
            np.testing.assert_allclose(reached, wanted_rows, atol=1e-12)
            assert lengths[name] > 0.0, name
            assert np.abs(slope - wanted[k]).max() < 1e-8 * max(lengths[name], LEAST * longest / sizes[name]), name
