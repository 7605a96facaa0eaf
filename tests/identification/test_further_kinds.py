"""A fit compares a kind of observation beside positions and angles, given by its row in the registry and its value."""

from __future__ import annotations

import numpy as np
import pytest
from oracles.wire import NAME, add_wire, length

from pliant.errors import InputError
from pliant.identification import Experiment, Parameter, experiment
from pliant.identification.experiment import FurtherRows
from pliant.identification.observation import modelled_rows
from pliant.identification.problem import Problem
from pliant.identification.residuals import Observations
from pliant.model import Model, Station
from pliant.preprocessing.align import align
from pliant.preprocessing.clusters import assemble
from pliant.preprocessing.side import half_turn
from pliant.recording import make_recording
from pliant.simulation import Pulse, Trace, simulate

BODY = Model(
    link_length=[0.05, 0.05], link_mass=0.02, stiffness=[0.5, 0.4], damping=0.004, torque=[3e-6], tip_mass=0.01,
    gravity=[2.0, -9.0], stations=[Station("tip", 1, 0.05)],
)
TIMES, START = np.arange(0.0, 0.4, 0.01), 0.1
FIXED = np.array([[0.03, -0.01]])  # m, where a draw wire to the tip leaves its drum


@pytest.fixture(autouse=True)
def wire(monkeypatch):
    add_wire(monkeypatch)


def recorded(seen, noise=None, **more):
    wires = {NAME: FurtherRows(length(np.moveaxis(seen, -1, 0), FIXED.T), FIXED, noise)}
    return Experiment(
        "e", TIMES, seen, ("tip",), "trace", pressure=Trace([0.0, START, START], [0.0, 0.0, 3e4]),
        **({"further": wires} | more),
    )


@pytest.mark.slow  # loads the compiler of dual numbers
@pytest.mark.parametrize("known", [True, False])
def test_the_length_of_a_wire_has_the_derivative_of_differences(known):
    seen = simulate(BODY, Pulse(3e4, START, 1.0), times=TIMES, time_step=2e-3, check=False).station_position.values
    parameters = [Parameter("stiffness", 0.6), Parameter("damping", 0.005)]
    problem = Problem([recorded(seen, 1e-3 if known else None)], BODY, parameters, 2e-3, "metre")
    observed = problem.observed[0]
    assert observed.count == Observations(recorded(seen, further={}), "metre").count + TIMES.size
    assert ((1, (0, 1, 2)) in observed.unknown_noise()) != known
    rows = np.concatenate([seen, np.zeros((TIMES.size, 1, 1))], axis=2)
    assert np.abs(observed.residual(rows)).max() < 1e-12
    J = problem.data_jacobian(problem.start)
    assert J.shape == (observed.count, 2)
    for k in range(2):
        h = 1e-6 * np.eye(2)[k]
        slope = (problem.data_residual(problem.start + h) - problem.data_residual(problem.start - h)) / 2e-6
        np.testing.assert_allclose(J[:, k], slope, atol=1e-6 * np.abs(slope).max())
        wires = J[observed.station == 1, k]
        assert np.abs(wires).max() > 1e-3


@pytest.mark.parametrize(("weighting", "expected"), [("travel", 1 / 0.02), ("metre", 1.0), ("noise", 1 / 1e-3)])
def test_a_length_weighs_as_a_position_does(rng, weighting, expected):
    seen = np.tile([0.0, 0.1], (TIMES.size, 1, 1))
    seen[20:, 0, 0] = -0.02
    observed = Observations(recorded(seen, 1e-3), weighting)
    assert observed.weight[1, 0] == pytest.approx(expected)
    if weighting != "noise":
        assert observed.weight[0, 0] == observed.weight[1, 0]


def test_modelled_values_are_those_of_each_station(rng):
    rows, fixed = rng.normal(size=(4, 3, 3)), rng.normal(size=(2, 3))
    found = modelled_rows(rows, NAME, fixed, planar=False)
    np.testing.assert_allclose(found[..., 0], np.linalg.norm(rows[:, :2] - fixed, axis=-1), rtol=1e-14)
    assert np.isnan(found[..., 1:]).all()


def test_a_recording_brings_its_wires(rng):
    seen, wires = rng.normal(0.0, 0.01, (TIMES.size, 1, 2)), rng.uniform(0.1, 0.2, (TIMES.size, 1))
    parts = {"pressure": 1e4 * TIMES, "further": {NAME: wires, f"{NAME}_constants": FIXED}}
    found = experiment("e", make_recording(TIMES, seen, frame="planar", **parts)).further[NAME]
    assert np.array_equal(found.values, wires)
    assert np.array_equal(found.constants, FIXED)
    with pytest.raises(InputError, match="a recording with wire_of_tests cannot be turned"):
        half_turn(make_recording(TIMES, seen, frame="planar", **parts))
    raw = make_recording(TIMES, np.pad(seen, ((0, 0), (0, 0), (0, 1))), **parts)
    with pytest.raises(InputError, match="align would lose wire_of_tests"):
        align(raw, origin=[0.0, -0.1, 0.0], tangent="+y", plane="+z", rest=(0.0, 0.1))
    corners = np.array([[0.0, 0.0, 0.0], [0.01, 0.0, 0.0], [0.0, 0.02, 0.0]])
    many = make_recording(TIMES, raw["position"].values + corners, further={NAME: np.tile(wires, 3)})
    with pytest.raises(InputError, match="assembling clusters would lose wire_of_tests"):
        assemble(many, {"tip": ["s000", "s001", "s002"]})
    with pytest.raises(InputError, match=r"'girth' is not a further kind of measurement \(gravity, wire_of_tests\)"):
        make_recording(TIMES, seen, frame="planar", further={"girth": wires})


@pytest.mark.parametrize(("further", "reason"), [
    ({"girth": FurtherRows(np.zeros((TIMES.size, 1)), FIXED)}, "'girth' is not a further kind of measurement in 2"),
    ({NAME: FurtherRows(np.zeros((3, 1)), FIXED)}, r"values and constants of the shapes \(\(40, 1"),
    ({NAME: FurtherRows(np.zeros((TIMES.size, 1)), FIXED[:, :1])}, r"got \(40, 1\) and \(1, 1\)"),
    ({NAME: FurtherRows(np.zeros((TIMES.size, 1)), FIXED, -1.0)}, "noise levels must be positive"),
])  # fmt: skip
def test_values_that_do_not_fit_are_refused(rng, further, reason):
    with pytest.raises(InputError, match=reason):
        recorded(rng.normal(size=(TIMES.size, 1, 2)), further=further)
