"""A recording becomes an experiment; where its points sit on the body; what is refused."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import xarray as xr

from pliant.errors import InputError
from pliant.identification import Experiment, experiment, fit, predict
from pliant.identification.edges import edges
from pliant.identification.initial_guess import registered
from pliant.model import Model, Station
from pliant.preprocessing.align import align
from pliant.preprocessing.rest import rest_window
from pliant.recording import make_recording
from pliant.simulation import Trace

T = np.arange(0.0, 1.0, 0.02)


def planar(**changes: Any) -> xr.Dataset:
    """A planar recording of two stations that sway."""
    sway = np.sin(9 * np.maximum(T - 0.1, 0))
    position = np.stack([np.stack([-0.01 * k * sway, 0.05 * k + 0 * T], axis=-1) for k in (1, 2)], axis=1)
    return make_recording(**{"time": T, "position": position, "station": ["mid", "tip"], "frame": "planar", **changes})


def test_a_measured_pressure_makes_a_trace_a_nominal_one_a_pulse() -> None:
    measured = experiment("a", planar(pressure=np.ones(3), pressure_time=np.array([0.0, 0.1, 0.2])))
    assert (measured.excitation, measured.own_parameters) == ("trace", ())
    nominal = experiment("a", planar(nominal_pressure=2e4))
    assert (nominal.excitation, nominal.level) == ("pulse", 2e4)
    assert nominal.own_parameters == ("a.start", "a.stop")
    assert experiment("a", planar(), excitation="release").own_parameters == ("a.release",)
    assert nominal.travel == pytest.approx(0.02, rel=0.05)


def test_spikes_decide_neither_travel_nor_edges_nor_rest() -> None:
    t = np.arange(0.0, 4.0, 0.01)
    swing = 0.3 * np.interp(t, [0.8, 0.95, 2.5, 2.65], [0.0, 1.0, 1.0, 0.0]) + 2e-4 * np.sin(60 * t)
    place = np.stack([0.1 * np.sin(swing), 0.1 * np.cos(swing)], axis=-1)[:, None]
    spiked = place.copy()
    spiked[[20, 45, 310], 0, 0] += 0.2  # three marker swaps: before, and long after the pulse
    made = {"station": ["tip"], "frame": "planar", "nominal_pressure": 2e4}
    clean, faulty = (make_recording(t, p, **made) for p in (place, spiked))
    one, other = (experiment("a", ds) for ds in (clean, faulty))
    assert other.travel == pytest.approx(one.travel, rel=1e-6)
    assert edges(other) == pytest.approx(edges(one), abs=0.011)
    assert rest_window(faulty) == pytest.approx(rest_window(clean), abs=0.011)


def test_stations_are_used_in_the_order_asked_for() -> None:
    exp = experiment("a", planar(nominal_pressure=2e4), stations=("tip", "mid"))
    np.testing.assert_array_equal(exp.last_station, planar()["position"].sel(station="mid").values)
    with pytest.raises(InputError, match="has no station 'top'; it has mid, tip"):
        experiment("a", planar(nominal_pressure=2e4), stations=("top",))


def test_one_of_several_pressures_must_be_chosen() -> None:
    two = planar(pressure=np.ones((T.size, 2)), pressure_time=T, chamber=["left", "right"])
    with pytest.raises(InputError, match=r"several pressures \(left, right\)"):
        experiment("a", two)
    assert experiment("a", two.isel(chamber=[1])).pressure is not None


def test_what_cannot_be_an_experiment_is_refused() -> None:
    with pytest.raises(InputError, match="neither a measured pressure nor a nominal level"):
        experiment("a", planar())
    tracked = make_recording(T, np.zeros((T.size, 1, 3)), nominal_pressure=2e4)
    with pytest.raises(InputError, match="align it first"):
        experiment("a", tracked)
    good = experiment("a", planar(nominal_pressure=2e4))
    for changes, sentence in (
        ({"name": "a.b"}, "without a dot"), ({"name": ""}, "without a dot"),
        ({"level": 0.0}, "needs its nominal level"), ({"level": float("nan")}, "needs its nominal level"),
        ({"excitation": "trace"}, "set excitation to 'trace' if, and only if"),
        ({"held": good.position[0]}, "held is for a release only, not for a pulse"),
        ({"position": good.position[:-1]}, "positions must be"),
        ({"position": good.position * 0}, "never moves"),
        ({"position": good.position * np.where(T < 0.1, 1, np.nan)[:, None, None]}, "seen in fewer than 10 frames"),
        ({"position": good.position * np.array([np.nan, 1])[:, None]}, "'mid' was seen in fewer than 10 frames"),
    ):
        with pytest.raises(InputError, match=sentence):
            replace(good, **changes)


def seen_at(model: Model, points: tuple[Station, ...], name: str = "t", *, like: Any) -> Experiment:
    """An experiment that shows `points` of the model."""
    return like(model.with_(stations=points), name)


def test_a_point_is_fixed_to_the_link_that_it_lies_beside(truth: Model, traced: Any) -> None:
    body = truth.with_(base_length=0.03)
    points = (Station("foot", -1, 0.01, 0.01), Station("low", 0, 0.02, -0.01), Station("mid", 1, 0.02, 0.01),
              Station("tip", 2, 0.04, 0.012))
    exp = seen_at(body, points, like=traced)
    model = registered(body.with_(stations=()), [exp], {})
    assert [s.name for s in model.stations] == ["foot", "low", "mid", "tip"]
    for found, true in zip(model.stations, points, strict=True):
        assert found.link == true.link
        assert found[2:] == pytest.approx(true[2:], abs=1e-6)


def test_link_tips_are_known_by_name_and_the_last_station_is_the_tip(truth: Model, traced: Any) -> None:
    tips = truth.with_(stations=())
    assert registered(tips, [traced(tips)], {}).stations == tips.points
    short = seen_at(truth, (Station("cap", 1, 0.02),), like=traced)  # lies beside link 2, but nothing follows it
    assert registered(tips, [short], {}).stations[0].link == 2


def test_a_base_among_the_stations_does_no_harm(truth: Model, traced: Any) -> None:
    exp = seen_at(truth, (Station("base", -1, 0.0), Station("tip", 2, 0.03)), like=traced)
    found = fit([exp], truth.with_(stations=(), stiffness=1.4), ["stiffness"], time_step=1e-3, starts=1)
    assert found.values["stiffness"] == pytest.approx(0.9, rel=1e-3)
    assert found.rmse["t"] < 1e-6


def test_a_coordinate_that_is_zero_throughout_does_not_spoil_the_fit(truth: Model, traced: Any) -> None:
    exp = traced(truth)
    deep = np.concatenate([exp.position, np.zeros((*exp.position.shape[:2], 1))], axis=-1)
    base = np.zeros((exp.time.size, 1, 3))
    flat = make_recording(
        exp.time, np.concatenate([base, deep], axis=1), station=["base", *exp.stations],
        pressure=exp.pressure.pressure, pressure_time=exp.pressure.time,
    )
    aligned = align(flat, tangent=[0.0, 1.0, 0.0])
    again = experiment("t", aligned, stations=exp.stations)
    found = fit([again], truth.with_(stiffness=1.4, damping=2e-3), ["stiffness", "damping"], time_step=2e-4, starts=1)
    assert found.values == pytest.approx({"stiffness": 0.9, "damping": 6e-3}, rel=1e-4)


def test_own_values_overrule_shared_ones_and_known_ones_overrule_both(truth: Model, traced: Any) -> None:
    exp = traced(truth)
    shared = predict(truth, exp, {"stiffness": 0.9}, 1e-3)["position"]
    own = predict(truth, exp, {"stiffness": 0.5, "t.stiffness": 0.9, "other.stiffness": 0.1}, 1e-3)["position"]
    known = predict(truth, replace(exp, known={"stiffness": 0.9}), {"t.stiffness": 0.4}, 1e-3)["position"]
    np.testing.assert_array_equal(own, shared)
    np.testing.assert_array_equal(known, shared)
    assert np.abs(shared - exp.position).max() < 1e-5


def test_the_frame_of_a_recording_may_be_offset_and_its_clock_late(truth: Model, traced: Any) -> None:
    exp = traced(truth)
    late = Trace(exp.pressure.time - 0.03, exp.pressure.pressure)
    off = replace(exp, position=exp.position + np.array([1e-3, -2e-3]), pressure=late)
    found = fit([off], truth, ["stiffness", "t.base_x", "t.base_y", "t.start"], time_step=1e-3, starts=1)
    expected = {"stiffness": 0.9, "t.base_x": 1e-3, "t.base_y": -2e-3, "t.start": 0.03}
    assert found.values == pytest.approx(expected, rel=2e-3)


def test_the_body_rests_under_its_load_before_the_pulse(truth: Model, pulse: Any) -> None:
    hanging = truth.with_(gravity=[4.0, -6.0])
    out = predict(hanging, pulse(hanging), {"p.start": 0.1234, "p.stop": 0.6012}, 1e-3)
    early = out["position"][:10]
    np.testing.assert_allclose(early, np.broadcast_to(early[0], early.shape), atol=1e-12)
    assert out["pressure"][:10].max() == 0
    assert out["pressure"].max() == pytest.approx(1e5, rel=1e-3)
