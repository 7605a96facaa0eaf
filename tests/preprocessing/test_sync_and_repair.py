"""Clocks brought together, and repairs: all counted."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from pliant.errors import InputError
from pliant.preprocessing.lag_model import first_component
from pliant.preprocessing.repair import undo_orientation_jumps
from pliant.preprocessing.sync import shift_pressure, sync
from pliant.recording import make_recording

TIME = np.arange(1000) / 100
CLOCK = np.arange(0, 10, 0.004)


def pulses(t):
    return 1e5 * (((t > 1) & (t < 3)) | ((t > 5) & (t < 6.2)) | (t > 8.1)).astype(float)


def ringing(delay):
    """A 5 Hz body with 10 % damping that answers the pulses after `delay`."""
    dt, q, v, out = 1e-3, 0.0, 0.0, []
    w = 2 * np.pi * 5
    for t in np.arange(0, 10, dt):
        v += dt * (w * w * (pulses(t - delay) * 1e-7 - q) - 0.2 * w * v)
        q += dt * v
        out.append(q)
    return np.interp(TIME, np.arange(0, 10, dt), out)


def body(course, rng, noise=2e-5):
    position = np.zeros((len(TIME), 3, 3))
    position[..., 1] = course[:, None] * [0, 0.3, 1]
    position[..., 0] = [0, 0.1, 0.2]
    return make_recording(TIME, position + noise * rng.normal(size=position.shape),
                          pressure=pulses(CLOCK), pressure_time=CLOCK)  # fmt: skip


@pytest.mark.parametrize("delay", [-0.42, 0.0, 0.137, 3.8, -7.3])
def test_the_offset_of_a_ringing_body_is_found_whatever_its_size(rng, delay):
    ds = body(ringing(0.0), rng)
    ds = shift_pressure(ds, -delay)
    found = sync(ds)
    assert found.delay_s == pytest.approx(delay, abs=0.004)
    assert 0 < found.uncertainty_s < 0.01
    assert found.frequency_hz == pytest.approx(5, rel=0.02)
    assert f"{1e3 * found.delay_s:+.1f}" in found.summary()


@pytest.mark.parametrize(("begin", "logged"), [(1.771e9, 1.771e9), (0.0, 1.771e9), (1.771e9, 0.0)])
def test_the_offset_is_found_where_clocks_count_since_1970(rng, begin, logged):
    ds = body(ringing(0.137), rng)
    plain = sync(ds, drift=True)
    ds = shift_pressure(ds, logged)
    ds = ds.assign_coords(time=("time", ds["time"].values + begin, ds["time"].attrs))
    found = sync(ds, drift=True)
    assert found.delay_s - (begin - logged) == pytest.approx(plain.delay_s, abs=1e-3)
    assert 0 < found.uncertainty_s < 0.002
    assert found.drift == plain.drift == 0.0


def test_a_drift_is_found_where_clocks_count_since_1970(rng):
    ds = shift_pressure(body(ringing(0.3), rng, noise=1e-6), 0.0, 1 / 1.002 - 1)
    ds = shift_pressure(ds, 1.771e9).assign_coords(time=("time", ds["time"].values + 1.771e9, ds["time"].attrs))
    found = sync(ds, drift=True)
    assert found.drift == pytest.approx(0.002, abs=4 * found.drift_uncertainty)
    moved = shift_pressure(ds, found.delay_s, found.drift)
    np.testing.assert_allclose(moved["pressure_time"].values - 1.771e9, CLOCK + 0.3, atol=0.006)


def test_the_lag_of_an_over_damped_body_is_not_taken_for_an_offset(rng):
    """A body whose response takes 0.4 s, first order: its correlation with the pressure is best 0.3 s late."""
    slow = np.zeros(len(TIME))
    for i in range(1, len(TIME)):
        slow[i] = slow[i - 1] + 0.01 / 0.4 * (1e-7 * pulses(TIME[i - 1]) - slow[i - 1])
    found = sync(body(slow, rng))
    assert abs(found.delay_s) < 0.01


def test_a_drift_is_found_where_edges_allow(rng):
    ds = body(ringing(0.3), rng, noise=1e-6)
    ds = shift_pressure(ds, 0.0, 1 / 1.002 - 1)
    found = sync(ds, drift=True)
    assert found.drift == pytest.approx(0.002, abs=4 * found.drift_uncertainty)
    assert found.drift_uncertainty < 5e-4
    moved = shift_pressure(ds, found.delay_s, found.drift)
    np.testing.assert_allclose(moved["pressure_time"].values, CLOCK + 0.3, atol=0.006)
    assert sync(body(ringing(0.3), rng), drift=True).drift == 0.0


def test_the_pressure_is_shifted(rng):
    ds = body(ringing(0.5), rng)
    shifted = shift_pressure(ds, sync(ds).delay_s)
    assert abs(sync(shifted).delay_s) < 0.005
    assert "clock of the pressure moved" in shifted.attrs["history"]
    assert ds["pressure_time"].values[0] == 0.0


def test_what_a_log_lacks_is_told(rng):
    ds = body(ringing(0.2), rng)
    keep = (CLOCK > 1.5) & ~((CLOCK > 3.5) & (CLOCK < 4.3))
    found = sync(ds.isel(pressure_time=keep))
    assert found.delay_s == pytest.approx(0.2, abs=0.005)
    told = found.summary()
    assert "the pressure log has 1 gap(s), the longest 0.8" in told
    assert "the pressure is already high when its log begins" in told
    assert "covers 83 % of the shape's frames" in told


def test_a_slow_pressure_leaves_doubt_and_says_so(rng):
    """Where nothing is fast, hysteresis of a few per cent looks like a delay."""
    ramp = np.interp(CLOCK, [0, 1, 5, 9, 10], [0, 0, 1e5, 0, 0])
    ds = body(1e-7 * np.interp(TIME, CLOCK, ramp), rng)
    ds["pressure"].values[:] = ramp
    found = sync(ds)
    assert found.uncertainty_s > 0.05
    assert any(w.startswith("WARNING: the offset is uncertain by") for w in found.warnings)


def test_offsets_that_cannot_be_found_are_refused(rng):
    ds = body(ringing(0.0), rng)
    with pytest.raises(InputError, match="lacks one"):
        sync(ds.drop_vars("pressure"))
    with pytest.raises(InputError, match="constant"):
        sync(ds.assign(pressure=ds["pressure"].copy(data=np.zeros(len(CLOCK)))))
    with pytest.raises(InputError, match="no offset between the clocks"):
        sync(body(np.zeros(len(TIME)), rng))
    with pytest.raises(InputError, match="increase largest_s"):
        sync(body(ringing(0.29), rng), largest_s=0.3)
    periodic = ds.copy(deep=True)
    periodic["pressure"].values[:] = 1e5 * (np.sin(2 * np.pi * 0.5 * CLOCK) > 0)
    periodic["position"].values[..., 1] = 0.01 * (np.sin(2 * np.pi * 0.5 * TIME) > 0)[:, None]
    with pytest.raises(InputError, match="equally well"):
        sync(periodic)


def test_orientations_of_a_symmetric_cluster_are_made_one(rng):
    turn = Rotation.from_rotvec(np.linspace(0, 1, 200)[:, None] * [0.6, 0, 0.8])
    symmetric = Rotation.from_euler("z", 120, degrees=True)
    q = turn.as_quat()
    q[50:60], q[60:80] = (turn * symmetric).as_quat()[50:60], (turn * symmetric.inv()).as_quat()[60:80]
    q[90:95] *= -1
    ds = make_recording(np.arange(200), np.zeros((200, 1, 3)), quaternion=q[:, None])
    fixed = undo_orientation_jumps(ds)
    error = Rotation.from_quat(fixed["quaternion"].values[:, 0]) * turn.inv()
    assert error.magnitude().max() < 0.02
    assert "s000 30" in fixed.attrs["history"]


def test_a_jump_that_stays_is_no_reason_to_turn_half_the_recording():
    """After a single jump nothing tells which side is right: the side with more frames wins, and it is told."""
    q = np.tile([0.0, 0, 0, 1], (100, 1))
    q[70:] = [1, 0, 0, 0]
    fixed = undo_orientation_jumps(make_recording(np.arange(100), np.zeros((100, 1, 3)), quaternion=q[:, None]))
    assert "s000 30" in fixed.attrs["history"]
    np.testing.assert_allclose(np.abs(fixed["quaternion"].values[:, 0, 3]), 1)


def test_the_common_course_leaves_out_stations_that_are_often_lost():
    time = np.arange(200) / 50
    course = np.sin(7 * time)
    values = np.outer(course, [1.0, -2.0, 0.5, 3.0]) + 4.0
    values[40:, 3] = np.nan  # seen too seldom to judge all columns by it
    values[:10, :3] = np.nan
    found, seen = first_component(values)
    assert np.flatnonzero(~seen).tolist() == list(range(10))
    assert abs(np.corrcoef(found[seen], course[seen])[0, 1]) == pytest.approx(1.0, abs=1e-12)
    assert np.std(found[seen]) == pytest.approx(np.std(course[seen]) * np.sqrt(1 + 4 + 0.25), rel=1e-9)
    with pytest.raises(InputError, match="in which every station is seen"):
        first_component(np.where(np.arange(200)[:, None] % 2 == [0, 1], values[:, :2], np.nan))


def test_clocks_of_tensions_and_motor_angles_are_compared_as_those_of_pressures():
    """The same course as a pressure, as a tension, and as both of them with a motor that rests."""
    bent = body(ringing(0.3), np.random.default_rng(7))
    found = sync(bent)
    course = pulses(CLOCK) * 5e-5
    given = {"position": bent["position"].values, "time": TIME, "input_time": CLOCK}
    pulled = make_recording(actuation=course[:, None], input_names=["m1"], input_kind=["tension"], **given)
    told = sync(pulled)
    assert told.delay_s == pytest.approx(found.delay_s, abs=1e-9)
    assert told.summary().startswith("the tension's clock is moved by +29")
    assert "the tension log covers 97 % of the shape's frames" in told.summary()
    both = make_recording(
        actuation=np.stack([course, 0.2 + 0.0 * CLOCK], axis=1), input_names=["m1", "m2"],
        input_kind=["tension", "angle"], pressure=pulses(CLOCK), pressure_time=CLOCK, **given,
    )
    assert sync(both).delay_s == pytest.approx(found.delay_s, abs=1e-3)
    moved = shift_pressure(both, 0.3, 1e-3)
    for name in ("input_time", "pressure_time"):
        np.testing.assert_allclose(moved[name], CLOCK * 1.001 + 0.3)
    assert moved["input_time"].attrs == both["input_time"].attrs
    assert "clock of the input moved by +300.00 ms" in moved.attrs["history"]
    np.testing.assert_array_equal(moved["actuation"], both["actuation"])
    apart = both.assign_coords(input_time=both["input_time"].copy(data=CLOCK + 1.0))
    np.testing.assert_array_equal(shift_pressure(apart, 0.3)["input_time"], CLOCK + 1.0)
    with pytest.raises(InputError, match="pressure or other inputs, but the recording lacks one"):
        sync(make_recording(TIME, bent["position"].values))
