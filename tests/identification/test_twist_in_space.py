"""Twist is found where a record excites it, and named where none does; the arm is MuJoCo's."""

import numpy as np
import pytest
from benchmark_scripts import loaded

from pliant.errors import FitError
from pliant.identification import Experiment, Parameter, fit, predict
from pliant.identification.parameters import apply
from pliant.model import Space

pytest.importorskip("mujoco")


@pytest.fixture(scope="module")
def bench():
    return loaded("intervals_in_space")


@pytest.fixture(scope="module")
def body(bench):
    """Numbers of an arm, and a record in which a force pulls beside its axis."""
    rng = np.random.default_rng([0, 3])
    truth = bench.drawn(rng, twist=True)
    levels = bench.PULLED["pulled"]
    return truth, bench.record("pulled", bench.seen(truth, levels, bench.FORCE), levels, rng, bench.FORCE)


@pytest.mark.slow
def test_swing_and_twist_under_pressure_and_a_force_move_as_in_mujoco(bench, body):
    """MuJoCo's steps of fourth order are exact here to 1e-10 m; the chain's error falls as the square of its step."""
    truth, record = body
    exact = bench.seen(truth, bench.PULLED["pulled"], bench.FORCE)
    arm = apply(bench.chain(), truth)
    off = [np.sqrt(np.mean((predict(arm, record, {}, step)["position"] - exact) ** 2)) for step in (2e-3, 1e-3)]
    assert off[1] < 3e-6 < 1e-4 * np.ptp(exact)
    assert off[0] / off[1] == pytest.approx(4.0, rel=0.02)


@pytest.mark.slow  # compiles the motion on dual numbers
def test_a_force_beside_the_axis_shows_torsional_stiffness(bench, body):
    truth, record = body
    assert truth["twist_ratio"] < 0.7
    start = [Parameter(n, truth[n], free=False) for n in truth if n not in ("stiffness", "twist_ratio")]
    listed = [*start, Parameter("stiffness", 0.6), Parameter("twist_ratio", 1.0)]
    found = fit([record], bench.chain(), listed, time_step=bench.STEP, starts=1)
    twist = next(p for p in found.parameters if p.name == "twist_ratio")
    assert twist.std < 0.1
    assert abs(twist.value - truth["twist_ratio"]) < 3 * twist.std


@pytest.mark.slow
def test_bending_in_one_plane_does_not_excite_twist(bench, body):
    """A chamber that bends about x alone, seen by stations on the plane: no line of the data depends on twist."""
    _, first = body
    chain = bench.chain().with_(space=Space(twist_ratio=0.8, radius=bench.RADIUS))
    shape = first.position.copy()
    shape[..., 0] = 0.0
    plane = Experiment("flat", first.time, shape, first.stations, "trace", drives={"red": first.drives["green"]})
    with pytest.raises(FitError, match=r"show twist_ratio: twist is not excited.*a known force beside the axis"):
        fit([plane], chain, [Parameter("stiffness", 0.6), Parameter("twist_ratio", 0.8)], time_step=bench.STEP)
