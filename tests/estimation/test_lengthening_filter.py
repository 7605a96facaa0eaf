"""The filter on bodies that lengthen: on motions of LSODA from random starts, and its measurement by complex steps."""

from __future__ import annotations

import numpy as np
import pytest
from oracles.derivatives import complex_step

import pliant
from pliant.cli.estimate import report
from pliant.equations.observation import observe_rows
from pliant.errors import InputError
from pliant.estimation import KalmanFilter, Noise, estimate, rows_of
from pliant.estimation.offline import frame_of, mean_bounds
from pliant.mechanics import mechanics_of
from pliant.model import Chamber, Extension, Memory, Station, chain_model
from pliant.recording import make_recording
from pliant.simulation import Pulse, Trace, equilibrium
from pliant.validation.use_figures import estimate_overview

pytestmark = pytest.mark.slow  # kernels of their own are compiled first

H, FRAMES = 1 / 75, 40
TIME, CLOCK = H * np.arange(FRAMES), np.linspace(0.0, 1.0, 2001)
TRACES = [Trace([0.0, 0.1, 0.14, 1.0], [0.0, 0.0, p, p]) for p in (4e4, 2.5e4)]
NOISE = Noise(position=3e-4, torque=1e-6, initial_angle=0.02, initial_rate=0.1)  # known torques, an unknown start
NAMES = ["link_1", "link_2", "link_3"]


@pytest.fixture(scope="module")
def arm():
    """Chambers on both sides of three links; a joint lies in each of the two segments, a link in both."""
    left, right = (Chamber.at_offset(2e-4, r, np.ones(3), name=n) for r, n in ((0.02, "left"), (-0.02, "right")))
    return chain_model(
        length=0.2, mass=0.1, links=3, stiffness=1.0, damping=0.01, chambers=(left, right), gravity=[0.0, 9.81],
        base_length=0.01,
        extensions=(Extension(150.0, 0.5, 0.0, 0.1, "near"), Extension(120.0, 0.4, 0.1, None, "far")),
    )


def seen(run, rng, noise=NOISE.position):
    """The link tips of a motion with noise, and its pressures, as a recording."""
    tips = run.tip_position.values + noise * rng.standard_normal(run.tip_position.shape)
    pressure = np.stack([trace(CLOCK) for trace in TRACES], axis=1)
    return make_recording(
        TIME[: len(tips)], tips, station=NAMES, frame="planar", pressure=pressure, pressure_time=CLOCK,
        chamber=["left", "right"],
    )


@pytest.mark.slow
def test_errors_of_strains_are_as_large_as_the_filter_says(arm):
    """30 motions of LSODA from starts drawn as the noise says: squared errors over variances, and innovations, are 1.

    In the first frames: later the torques, which the truth knows and the filter does not quite, are all that is left.
    """
    rest, errors, later, innovations = equilibrium(arm), [], [], []
    for seed in range(30):
        rng = np.random.default_rng(seed)
        run = pliant.simulate(
            arm, TRACES, times=TIME[:16], method="LSODA", rtol=1e-7,
            initial_rate=from_links(0.1 * rng.standard_normal(5)),
            initial_angle=rest + from_links(0.02 * rng.standard_normal(5)),
        )
        found = estimate(seen(run, rng), arm, noise=NOISE, time_step=5e-4, pressure_window=0.0)
        for name in ("axial_strain", "axial_strain_rate"):
            off = found[name].values - run[name].values
            errors.append((off / found[f"{name}_sd"].values)[[1, 3, 6]] ** 2)
        off = found.smooth_axial_strain.values - run.axial_strain.values
        later.append((off / found.smooth_axial_strain_sd.values)[[1, 3, 6]] ** 2)
        innovations.append(found.attrs["nis_ratio"])
    low, high = mean_bounds(np.ones(30))  # the strains of one moment, which are not independent, count as one
    for squares in (errors[::2], errors[1::2], later):
        mean = np.mean(squares, axis=(0, 2))
        assert (low < mean).all(), mean
        assert (mean < high).all(), mean
    low, high = mean_bounds(np.full(30 * 15, 6))
    assert low < np.mean(innovations) < high


def from_links(x):
    """Changes of joint angles, strains behind them, from those of absolute angles."""
    return np.append(np.diff(x[:3], prepend=0.0), x[3:])


@pytest.mark.parametrize("memory", [Memory(), Memory(creep_share=(0.2,), creep_time=(0.3,))], ids=["none", "creep"])
def test_a_known_start_follows_lsoda(arm, memory):
    body = arm.with_(memory=memory)
    run = pliant.simulate(body, TRACES, times=TIME, method="LSODA", rtol=1e-8)
    known = Noise(position=3e-4, torque=1e-5, initial_angle=1e-4, initial_rate=1e-3)
    found = estimate(seen(run, np.random.default_rng(1)), body, noise=known, time_step=1e-3, pressure_window=0.0)
    low, high = found.attrs["nis_bounds"]
    assert low < found.attrs["nis_ratio"] < high
    assert float(run.axial_strain.max()) > 0.1
    np.testing.assert_allclose(found.axial_strain, run.axial_strain, atol=2e-4)
    np.testing.assert_allclose(found.tip_position, run.tip_position, atol=1e-4)
    assert found.axial_strain.dims == ("time", "segment")
    assert list(found.segment.values) == ["near", "far"]
    largest = 100.0 * float(run.axial_strain.max())
    assert report(found)["largest_axial_strain_percent"] == pytest.approx(largest, rel=0.01)
    drawn = estimate_overview(found).axes
    assert [line.get_label() for line in drawn[3].lines] == ["near", "far"]
    assert drawn[3].get_xlabel() == "time (s)"


def test_a_pull_that_the_model_does_not_know_is_found(arm):
    """A third chamber pushes the far segment alone by 2.4 N from the start; the filter's model has none."""
    push = Chamber((1e-6,), joint_gain=np.zeros(3), axial_gain=[0.0, 100.0], name="push")
    truth = arm.with_(chambers=(*arm.chambers, push))
    run = pliant.simulate(
        truth, [*TRACES, Pulse(2.4e4, -1.0, 9.0)], times=TIME, method="LSODA", rtol=1e-8,
        initial_angle=equilibrium(arm),
    )
    noise = Noise(position=3e-4, torque=1e-5, initial_angle=1e-3, initial_rate=1e-2, initial_disturbance=0.2)
    found = estimate(seen(run, np.random.default_rng(2)), arm, noise=noise, time_step=2e-3, pressure_window=0.0)
    last, sd = found.axial_disturbance[-1].values, found.axial_disturbance_sd[-1].values
    assert found.axial_disturbance.units == "N"
    assert (np.abs(last - [0.0, 2.4]) < 3.0 * sd).all()
    assert (sd < 0.1).all()
    assert (np.abs(found.disturbance[-1]) < 3.0 * found.disturbance_sd[-1]).all()


def test_what_a_frame_sees_is_where_the_stations_are(arm):
    body = arm.with_(stations=(Station("cap", 2, 0.05, 0.01), Station("middle", 1, 0.03, -0.004)), base_angle=0.2)
    rows = rows_of(body, body.points, angle=True)
    frame, x = frame_of(body, rows, np.zeros(6), np.ones(6)), np.array([0.3, 0.7, 1.2, 0.15, -0.05])
    value, H = np.empty(6), np.empty((6, 5))
    observe_rows(x, frame, mechanics_of(body).sight(np.complex128), value, H)

    def places(at):
        where, angle = mechanics_of(body).stations(at)
        return np.concatenate([where, angle[:, None]], axis=1).ravel()

    np.testing.assert_allclose(value, places(x), atol=1e-15)
    np.testing.assert_allclose(H, complex_step(places, x), atol=1e-15)


@pytest.mark.slow
def test_a_running_filter_finds_what_the_record_does(arm):
    """Frames one by one, one of them late."""
    run = pliant.simulate(arm, TRACES, times=TIME, method="LSODA")
    record = seen(run, np.random.default_rng(3))
    whole = estimate(record, arm, noise=NOISE, time_step=2e-3, pressure_window=0.0)
    live, rows = KalmanFilter(arm, NOISE, time_step=2e-3), rows_of(arm, arm.points)
    tips = record["position"].values
    events = sorted([(t, 0, k) for k, t in enumerate(CLOCK[: CLOCK.searchsorted(TIME[-1])])]
                    + [(t + 0.03 * (k == 20), 1, k) for k, t in enumerate(TIME)])  # fmt: skip
    for _, frame, k in events:
        if frame:
            live.push_frame(TIME[k], rows, tips[k].ravel(), np.full(6, NOISE.position**2))
        else:
            live.push_pressure(CLOCK[k], [trace(CLOCK[k]) for trace in TRACES])
    assert live.counts.late == 1
    found = live.state(TIME[-1])
    np.testing.assert_allclose(found.strain, whole.axial_strain[-1], atol=5e-5)
    np.testing.assert_allclose(found.strain_rate, whole.axial_strain_rate[-1], atol=2e-3)
    assert found.angle.shape == found.rest_shift.shape == (3,)
    assert found.covariance.shape == (10, 10)
    assert found.consistent


def test_a_dense_curve_of_a_body_that_lengthens_is_refused(arm):
    curve = np.zeros((2, 12, 2)) + np.linspace(0.0, 0.21, 12)[:, None] * [0.0, 1.0]
    record = make_recording([0.0, 1.0], curve, station=[f"p{k}" for k in range(12)], frame="planar")
    with pytest.raises(InputError, match="dense curve does not show which of its points belong to which link"):
        estimate(record, arm, pressure=[Pulse(0.0)] * arm.actuation.count, noise=NOISE)
