"""The numbers of a comparison, held to motions whose numbers are known."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest

from pliant.identification import Experiment
from pliant.simulation import Trace
from pliant.validation.metrics import METRICS, compare, extension, response

T = np.arange(0.0, 4.0, 0.01)
START, STOP, STEADY = 0.3, 2.5, 0.02
FREQUENCY, RATIO = 4.0, 0.06
DIRECTION = np.array([-0.8, 0.6])
PAIRS = ("frequency_hz", "damping_ratio", "overshoot_percent", "steady_state_mm")


def swing(frequency: float = FREQUENCY, ratio: float = RATIO, steady: float = STEADY) -> np.ndarray:
    """Path (T, 2) of a point under a pulse: it rings towards its plateau, and rings again about its rest."""
    sigma, omega = ratio / np.sqrt(1 - ratio**2) * 2 * np.pi * frequency, 2 * np.pi * frequency

    def towards(t: np.ndarray) -> np.ndarray:
        return np.where(t > 0, 1 - np.exp(-sigma * np.maximum(t, 0)) * np.cos(omega * t), 0.0)

    u = steady * (towards(T - START) - towards(T - STOP))
    return np.array([0.01, 0.1]) + u[:, None] * DIRECTION


def pulse(path: np.ndarray | None = None, **changes: Any) -> Experiment:
    """The experiment that shows the path of one point."""
    path = swing() if path is None else path
    entries = {"excitation": "pulse", "level": 2e4, **changes}
    return Experiment("p", T, path[:, None], ("tip",), **entries)


def test_a_perfect_model_leaves_nothing() -> None:
    exp = pulse()
    m = compare(exp, exp.position, 0.1)
    assert m["rmse_mm"] == m["max_mm"] == m["steady_state_error_mm"] == 0
    assert m["fit_percent"] == 100
    assert (m["frames"], m["points_not_seen"]) == (T.size, 0)
    for name in PAIRS:
        assert m[name]["measured"] == m[name]["modelled"]


def test_a_warm_up_that_the_model_does_not_follow_is_no_error_of_the_steady_state() -> None:
    """Displacements of body and model count from the first frame that is compared."""
    trace = Trace(np.array([0.0, START, START + 1e-3, STOP, STOP + 1e-3]), np.array([0.0, 0.0, 2e4, 2e4, 0.0]))
    exp = pulse(excitation="trace", level=0.0, pressure=trace, warm_up=0.2)
    modelled = exp.position.copy()
    modelled[exp.warming] += 0.03
    m = compare(exp, modelled, 0.1)
    assert m["steady_state_mm"]["measured"] == pytest.approx(1e3 * STEADY, rel=0.01)
    assert m["steady_state_error_mm"] == 0
    assert m["max_mm"] == 0


def test_a_constant_offset_is_measured_in_mm_in_travels_and_in_lengths() -> None:
    exp = pulse()
    m = compare(exp, exp.position + np.array([3e-3, 4e-3]), 0.1)
    assert m["rmse_mm"] == pytest.approx(5.0)
    assert m["max_mm"] == pytest.approx(5.0)
    assert m["rmse_percent_of_length"] == pytest.approx(5.0)
    assert m["travel_mm"] == pytest.approx(1e3 * np.linalg.norm(swing() - swing()[0], axis=1).max())
    assert m["rmse_percent_of_travel"] == pytest.approx(500 / m["travel_mm"])
    assert m["steady_state_error_mm"] == pytest.approx(0, abs=1e-9)  # a displacement: the offset drops out


def test_the_mean_of_the_measured_motion_has_a_fit_of_zero() -> None:
    exp = pulse()
    mean = np.broadcast_to(exp.position.mean(axis=0), exp.position.shape)
    assert compare(exp, mean, 0.1)["fit_percent"] == pytest.approx(0, abs=1e-9)


def test_traits_of_a_ringing_pulse() -> None:
    m = compare(pulse(), swing(3.6, 0.08, 0.025)[:, None], 0.1)
    assert m["frequency_hz"]["measured"] == pytest.approx(FREQUENCY, rel=1e-3)
    assert m["frequency_hz"]["modelled"] == pytest.approx(3.6, rel=1e-3)
    assert m["damping_ratio"]["measured"] == pytest.approx(RATIO, rel=2e-2)
    assert m["damping_ratio"]["modelled"] == pytest.approx(0.08, rel=2e-2)
    assert m["steady_state_mm"]["measured"] == pytest.approx(20, rel=2e-2)
    assert m["steady_state_error_mm"] == pytest.approx(5, rel=4e-2)
    overshoot = 100 * np.exp(-np.pi * RATIO / np.sqrt(1 - RATIO**2))
    assert m["overshoot_percent"]["measured"] == pytest.approx(overshoot, rel=4e-2)


def test_a_motion_that_creeps_has_neither_frequency_nor_overshoot() -> None:
    def towards(t: np.ndarray) -> np.ndarray:
        return np.where(t > 0, 1 - np.exp(-np.maximum(t, 0) / 0.2), 0.0)

    slow = np.array([0.0, 0.1]) + (STEADY * (towards(T - START) - towards(T - STOP)))[:, None] * DIRECTION
    m = compare(pulse(), slow[:, None], 0.1)
    assert m["frequency_hz"]["modelled"] is m["damping_ratio"]["modelled"] is m["overshoot_percent"]["modelled"] is None
    assert m["steady_state_mm"]["modelled"] == pytest.approx(20, rel=1e-2)
    assert m["frequency_hz"]["measured"] == pytest.approx(FREQUENCY, rel=1e-3)


def test_points_that_were_not_seen_are_counted_and_left_out(rng: np.random.Generator) -> None:
    path = swing()
    path[rng.random(T.size) < 0.2] = np.nan
    path[3] = np.nan
    exp = pulse(path)
    m = compare(exp, swing()[:, None] + np.array([0, 1e-3]), 0.1)
    assert m["points_not_seen"] == np.isnan(path[:, 0]).sum() > 50
    assert m["rmse_mm"] == pytest.approx(1.0)
    assert m["frequency_hz"]["measured"] == pytest.approx(FREQUENCY, rel=2e-3)
    json.dumps(m, allow_nan=False)


def test_stations_count_alike() -> None:
    both = np.stack([swing(), swing() + 0.1], axis=1)
    exp = Experiment("p", T, both, ("mid", "tip"), "pulse", level=2e4)
    off = both + np.array([[0.0, 0.0], [2e-3, 0.0]])
    assert compare(exp, off, 0.1)["rmse_mm"] == pytest.approx(2 / np.sqrt(2))


def test_a_release_settles_where_it_comes_to_rest() -> None:
    omega, sigma = 2 * np.pi * FREQUENCY, RATIO * 2 * np.pi * FREQUENCY
    u = np.where(T > START, STEADY * (1 - np.exp(-sigma * (T - START)) * np.cos(omega * (T - START))), 0.0)
    exp = pulse(u[:, None] * DIRECTION, excitation="release")
    m = compare(exp, exp.position, 0.1)
    assert m["steady_state_mm"]["measured"] == pytest.approx(20, rel=1e-2)
    assert m["frequency_hz"]["measured"] == pytest.approx(FREQUENCY, rel=1e-3)
    assert m["overshoot_percent"]["measured"] is None


def test_a_measured_pressure_says_where_the_plateau_is() -> None:
    trace = Trace([0.0, START, START + 0.005, STOP, STOP + 0.005, 4.0], [0, 0, 2e4, 2e4, 0, 0])
    exp = pulse(excitation="trace", pressure=trace, level=0.0)
    found = response(exp, exp.last_station)
    assert found["steady_state_mm"] == pytest.approx(20, rel=1e-2)
    assert found["frequency_hz"] == pytest.approx(FREQUENCY, rel=1e-3)
    without = pulse(excitation="trace", pressure=Trace([0.0, 4.0], [0.0, 0.0]), level=0.0)
    assert response(without, without.last_station)["steady_state_mm"] is None
    assert compare(without, without.position, 0.1)["steady_state_error_mm"] is None


def test_a_pressure_at_its_height_for_one_frame_has_no_overshoot() -> None:
    at = float(T[np.searchsorted(T, START + 0.5)])
    peak = Trace([0.0, at - 0.002, at, at + 0.002, 4.0], [0, 0, 2e4, 0, 0])
    exp = pulse(excitation="trace", pressure=peak, level=0.0)
    found = response(exp, exp.last_station)
    assert found["overshoot_percent"] is None
    assert found["steady_state_mm"] is not None


def test_ringing_is_told_at_two_amplitudes() -> None:
    """A linear swing rings alike at both; the path that the model takes may differ."""
    m = compare(pulse(swing(ratio=0.08)), swing(frequency=5.0, ratio=0.1)[:, None], 0.1)
    for size in ("large", "small"):
        assert m[f"frequency_{size}_hz"]["measured"] == pytest.approx(FREQUENCY, rel=0.05)
        assert m[f"frequency_{size}_hz"]["modelled"] == pytest.approx(5.0, rel=0.05)
        assert m[f"damping_ratio_{size}"]["measured"] == pytest.approx(0.08, rel=0.1)
        assert m[f"damping_ratio_{size}"]["modelled"] == pytest.approx(0.1, rel=0.1)
    assert m["swing_large_mm"]["measured"] > 3 * m["swing_small_mm"]["measured"] > 0
    assert m["joint_rmse_mrad"] is None


def test_joints_that_err_against_each_other_are_told_where_the_tip_hides_it() -> None:
    """Three stations: the second chord is turned by 20 mrad, the third back again."""
    lean = 0.1 * np.linspace(0, 1, T.size)
    angle = np.stack([lean, 2 * lean, 3 * lean], axis=1)

    def chain(direction: np.ndarray) -> np.ndarray:
        return np.cumsum(0.05 * np.stack([-np.sin(direction), np.cos(direction)], axis=-1), axis=1)

    exp = Experiment("p", T, chain(angle), ("a", "b", "tip"), "trace", Trace([0.0, 4.0], [0.0, 1e4]))
    m = compare(exp, chain(angle + np.array([0.0, 0.02, 0.0])), 0.15)
    assert m["joint_rmse_mrad"] == pytest.approx([0.0, 20.0, 20.0], abs=1e-9)
    assert m["joint_steady_error_mrad"] == pytest.approx([0.0, 20.0, -20.0], abs=1e-9)
    assert m["rmse_mm"] < 1.01


def test_every_number_has_a_definition() -> None:
    m = compare(pulse(), swing()[:, None], 0.1)
    assert set(m) <= set(METRICS)
    assert set(METRICS) - set(m) == {"within_band_percent", "fitted_edges_s"}  # of predictions alone
    without = {name for name, metric in METRICS.items() if not metric.formula}
    assert without == {"frames", "points_not_seen", "fitted_edges_s"}  # counts, times


def test_formulas_say_what_is_computed() -> None:
    """Those of the errors, term by term, on numbers that no symmetry helps."""
    rng = np.random.default_rng(3)
    exp = pulse()
    model = exp.position + 1e-3 * rng.standard_normal(exp.position.shape)
    m = compare(exp, model, 0.1)
    r, seen = model, exp.position
    e = np.sqrt(np.mean(np.sum((r - seen) ** 2, axis=2)))
    travel = np.linalg.norm(seen[:, -1] - np.median(seen[:5, -1], axis=0), axis=1).max()
    assert m["rmse_mm"] == pytest.approx(1e3 * e)
    assert m["rmse_percent_of_travel"] == pytest.approx(100 * e / travel)
    assert m["rmse_percent_of_length"] == pytest.approx(100 * e / 0.1)
    assert m["travel_mm"] == pytest.approx(1e3 * travel)
    spread = np.sum((seen - seen.mean(axis=0)) ** 2)
    assert m["fit_percent"] == pytest.approx(100 * (1 - np.sqrt(np.sum((r - seen) ** 2) / spread)))


@pytest.mark.parametrize("growth", [0.0, 0.05])
def test_a_body_that_lengthens_is_told_and_one_that_only_bends_is_not(growth: float) -> None:
    """Two arcs of 0.1 m that bend by 1 rad each and grow meanwhile."""
    turn = np.linspace(1e-4, 1.0, T.size)
    radius = 0.1 * (1 + growth * turn) / turn
    c, s = np.cos(turn), np.sin(turn)
    first = np.stack([-radius * (1 - c), radius * s], axis=1)
    second = np.stack([first[:, 0] * c - first[:, 1] * s, first[:, 0] * s + first[:, 1] * c], axis=1)
    path = np.stack([first, first + second], axis=1)
    found = extension(Experiment("e", T, path, ("mid", "tip"), "pulse", level=1e4), 0.5 * path)
    assert found["extension_percent"] == pytest.approx(100 * growth, rel=0.03, abs=0.02)
    assert found["extension_mm"] == pytest.approx(2 * found["extension_percent"], rel=1e-2, abs=0.02)
    assert found["extension_modelled_mm"] == pytest.approx(0.5 * found["extension_mm"], rel=1e-9, abs=1e-12)
    assert extension(pulse(), pulse().position)["extension_mm"] is None  # one point: its tilt would pass for growth


def test_a_body_that_lengthens_while_it_hardly_bends_is_told() -> None:
    """It lengthens by 38 % straight on and comes back, then bends: where its tip is farthest, nothing has grown."""
    grown = 0.38 * np.exp(-(((T - T[T.size // 4]) / 0.1) ** 2))
    turn = np.where(T[T.size // 2] < T, 2.0 * (T - T[T.size // 2]) / np.ptp(T), 0.0) + 1e-6
    reach = 0.1 * (1 + grown)
    first = np.stack([-(1 - np.cos(turn)) / turn, np.sin(turn) / turn], axis=1) * (0.5 * reach)[:, None]
    whole = np.stack([-(1 - np.cos(2 * turn)) / turn, np.sin(2 * turn) / turn], axis=1) * (0.5 * reach)[:, None]
    path = np.stack([first, whole], axis=1)
    exp = Experiment("e", T, path, ("mid", "tip"), "pulse", level=1e4)
    assert extension(exp, path)["extension_mm"] == pytest.approx(38.0, rel=0.06)
    shorter = Experiment("e", T, path[:, :] / (1 + grown)[:, None, None] ** 2, ("mid", "tip"), "pulse", level=1e4)
    assert extension(shorter, path)["extension_percent"] == pytest.approx(100 * (1 / 1.38 - 1), rel=0.08)


def test_a_pressure_on_its_own_clock_is_judged_on_that_of_the_shape() -> None:
    """The log is 0.7 s late: read as it stands, its plateau would lie in the ring-down."""
    late = Trace(np.array([0.0, START, START + 0.005, STOP, STOP + 0.005, 4.0]) + 0.7, [0, 0, 2e4, 2e4, 0, 0])
    exp = pulse(excitation="trace", pressure=late, level=0.0)
    right = compare(exp.synchronised({"start": -0.7}), exp.position, 0.1)
    assert right["steady_state_mm"]["measured"] == pytest.approx(20, rel=1e-2)
    assert right["overshoot_percent"]["measured"] == pytest.approx(82.8, rel=4e-2)
    own = exp.synchronised({"start": 5.0, "p.start": -0.7})  # its own value overrules the shared one
    assert compare(own, exp.position, 0.1) == right
    assert compare(pulse(excitation="trace", pressure=late, level=0.0, known={"start": -0.7}).synchronised({}),
                   exp.position, 0.1) == right  # fmt: skip


def test_the_end_of_a_plateau_is_the_mean_of_whole_periods_before_it() -> None:
    """A plateau that creeps: its end is the median of one period of 0.25 s, the shortest that holds 0.2 s."""
    creep = 1e-3 * np.clip(T - START, 0, STOP - START)
    late = (T > STOP - 0.25) & (T < STOP)
    path = swing(ratio=0.3) + creep[:, None] * DIRECTION
    found = response(pulse(path), path)
    assert found["steady_state_mm"] == pytest.approx(20 + 1e3 * np.median(creep[late]), abs=0.02)


def test_the_step_of_an_angle_sensor_is_told_in_degrees() -> None:
    step = np.radians(0.5)
    angle = step * np.round(0.4 * np.sin(5 * T) / step)
    exp = Experiment("a", T, np.full((T.size, 1, 2), np.nan), ("tip",), "trace", Trace([0.0, 4.0], [0.0, 1e4]),
                     angle=angle[:, None], angle_reference="rest")  # fmt: skip
    found = compare(exp, exp.compared + np.radians(1.0), 0.1)
    assert found["sensor_step_deg"] == pytest.approx(0.5)
    assert found["rmse_deg"] == pytest.approx(1.0)
    assert found["travel_deg"] == pytest.approx(np.degrees(exp.travel))


def test_a_body_that_shortens_by_more_than_it_lengthens_is_told_so() -> None:
    length = 0.1 * (1 + 0.05 * np.exp(-(((T - 1.0) / 0.2) ** 2)) - 0.2 * np.exp(-(((T - 3.0) / 0.2) ** 2)))
    path = np.stack([np.zeros((T.size, 2)), np.stack([0 * T, 0 * T], axis=1)], axis=1)
    path[:, 0, 1], path[:, 1, 1] = 0.5 * length, length
    found = extension(Experiment("e", T, path, ("mid", "tip"), "pulse", level=1e4), 0.5 * path)
    assert found["extension_percent"] == pytest.approx(-20, abs=0.4)
    assert found["extension_mm"] == pytest.approx(-20, abs=0.4)
    assert found["extension_modelled_mm"] == pytest.approx(0.5 * found["extension_mm"])


@pytest.mark.parametrize("stations", [1, 2])
def test_two_stations_make_a_joint_and_one_makes_none(stations: int) -> None:
    lean = 0.1 * np.sin(T)[:, None] * np.arange(1, stations + 1)
    off = lean + 0.01 * np.arange(1, stations + 1) ** 2

    def chain(direction: np.ndarray) -> np.ndarray:
        return np.cumsum(0.05 * np.stack([-np.sin(direction), np.cos(direction)], axis=-1), axis=1)

    names = ("mid", "tip")[-stations:]
    exp = Experiment("p", T, chain(lean), names, "trace", Trace([0.0, 4.0], [0.0, 1e4]))
    found = compare(exp, chain(off), 0.1)
    assert found["joint_rmse_mrad"] == (None if stations == 1 else pytest.approx([10.0, 30.0]))
    assert found["joint_steady_error_mrad"] == (None if stations == 1 else pytest.approx([10.0, 30.0]))
