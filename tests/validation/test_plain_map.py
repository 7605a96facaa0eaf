"""Plain maps from inputs to positions: closed forms, choice on left-out data, and inputs that show too little."""

from __future__ import annotations

import time as clock

import numpy as np
import pytest

from pliant.errors import InputError
from pliant.identification import Experiment
from pliant.identification.experiment import Excitation
from pliant.simulation import Trace
from pliant.simulation.forces import PointForce
from pliant.validation.map_inputs import table_of
from pliant.validation.plain_map import PlainMap, basis_of, candidates, plain_map, training_data

T = np.arange(0.0, 20.0, 0.05)


def wave(seed: int, size: float = 50e3, time: np.ndarray = T) -> Trace:
    """A smooth random pressure, Pa."""
    rng = np.random.default_rng(seed)
    phase, rate = rng.uniform(0.0, 6.0, (2, 4))
    return Trace(time, size * (1.0 + np.sin(np.outer(time, 0.2 + 0.3 * rate) + phase).mean(axis=1)))


def trial(name: str, drives: dict[str, Trace], tip: np.ndarray, time: np.ndarray = T) -> Experiment:
    """An experiment with one station, the tip (T, 2) [m]."""
    return Experiment(name, time, tip[:, None], ("tip",), "trace", drives=drives)


def affine(name: str, seed: int) -> Experiment:
    """A tip that is an affine function of two pressures."""
    left, right = wave(seed), wave(seed + 100)
    tip = np.array([0.01, 0.1]) + 1e-7 * np.outer(left(T), [3.0, 1.0]) - 1e-7 * np.outer(right(T), [2.0, -1.0])
    return trial(name, {"left": left, "right": right}, tip)


def lagging(name: str, seed: int, tau: float = 1.0) -> Experiment:
    """A tip that follows one pressure behind a first-order lag, by fine Euler steps that share no line."""
    pressure = wave(seed)
    fine = np.linspace(0.0, T[-1], 40 * (T.size - 1) + 1)
    state, states = float(pressure(0.0)), []
    for p in pressure(fine):
        states.append(state)
        state += (p - state) * (fine[1] - fine[0]) / tau
    delayed = np.array(states)[::40]
    return trial(name, {"left": pressure}, np.stack([1e-6 * delayed, 0.1 - 2e-7 * delayed], axis=1))


def rms(plain: PlainMap, exp: Experiment) -> float:
    return float(np.sqrt(np.nanmean(np.sum((plain.predict(exp) - exp.compared) ** 2, axis=2))))


@pytest.mark.parametrize("count", [1, 2, 4])
def test_an_affine_system_is_recovered_exactly(count: int) -> None:
    plain = plain_map([affine(f"e{k}", k) for k in range(count)])
    assert (plain.degree, plain.time_constants) == (1, ())
    held_out = affine("held", 50)
    assert rms(plain, held_out) < 1e-6 * held_out.travel
    assert plain.left_out_error < 1e-6 * held_out.travel
    assert plain.coefficients.shape == (3, 2)


def test_a_lag_is_recognised() -> None:
    plain = plain_map([lagging(f"e{k}", k) for k in range(3)])
    assert len(plain.time_constants) == 2
    assert rms(plain, lagging("held", 9)) < 0.01 * lagging("held", 9).travel
    static = plain_map([affine(f"e{k}", k) for k in range(3)])
    assert static.time_constants == ()


def test_a_square_needs_the_second_degree() -> None:
    def squared(name: str, seed: int) -> Experiment:
        p = wave(seed)
        return trial(name, {"left": p}, np.stack([1e-11 * p(T) ** 2, 0.1 + 0 * T], axis=1))

    plain = plain_map([squared(f"e{k}", k) for k in range(3)])
    assert plain.degree == 2
    assert rms(plain, squared("held", 7)) < 1e-4 * squared("held", 7).travel


@pytest.mark.parametrize("count", [2, 4])
def test_the_error_on_left_out_data_is_that_of_explicit_refits(count: int) -> None:
    """The chosen error against least squares on the other frames, a refit for each group of frames."""
    rng = np.random.default_rng(3)
    noisy = []
    for k in range(count):
        exp = affine(f"e{k}", k)
        noisy.append(trial(exp.name, dict(exp.drives), exp.position[:, 0] + 1e-3 * rng.standard_normal((T.size, 2))))
    table, _ = table_of(noisy)
    data = training_data(noisy, table)
    for one in list(candidates(data))[::7]:
        columns = data.chosen_columns(one.time_constants)
        basis = basis_of(columns, one.degree)
        x = basis.terms(columns)
        squares, sizes = [], []
        for g in np.unique(data.group):
            rest, out = data.group != g, data.group == g
            extra = np.sqrt(one.ridge * rest.sum()) * np.eye(x.shape[1])[1:]
            stacked = np.vstack([data.values[rest], np.zeros((len(extra), 2))])
            fitted = np.linalg.lstsq(np.vstack([x[rest], extra]), stacked, rcond=None)[0]
            low, high = columns[rest].min(axis=0), columns[rest].max(axis=0)
            tested = basis.terms(np.clip(columns[out], low, high)) if one.held else x[out]
            squares.append(float(np.sum((tested @ fitted - data.values[out]) ** 2)))
            sizes.append(int(out.sum()))
        each = np.sqrt(np.array(squares) / sizes)
        pooled = np.sqrt(np.sum(squares) / np.sum(sizes))
        expected = np.exp(np.mean(np.log(each))) if count >= 3 else pooled
        assert one.error == pytest.approx(expected, rel=1e-10)


def test_beyond_the_training_range_the_map_extrapolates_and_says_so() -> None:
    train = [affine(f"e{k}", k) for k in range(3)]
    plain = plain_map(train)
    assert plain.outside(train[0]) == 0.0
    high = wave(5, 200e3)
    tip = np.array([0.01, 0.1]) + 1e-7 * np.outer(high(T), [3.0, 1.0])
    far = trial("far", {"left": high, "right": Trace(T, 0 * T)}, tip)
    assert plain.outside(far) > 0.9
    assert rms(plain, far) < 1e-4 * far.travel  # the body itself is affine: the straight line goes on


def saturating(name: str, p: Trace) -> Experiment:
    """A tip that stands at a stop as soon as the pressure exceeds 60 kPa."""
    return trial(name, {"left": p}, np.stack([1e-6 * np.minimum(p(T), 60e3), 0.1 + 0 * T], axis=1))


def test_where_left_out_data_show_it_the_map_keeps_its_value_at_the_edge() -> None:
    plain = plain_map([saturating("a", wave(1)), saturating("b", wave(2)), saturating("c", wave(3, 90e3))])
    assert plain.held
    far = saturating("far", Trace([0.0, 5.0], [0.0, 300e3]))
    assert plain.outside(far) > 0.5
    beyond = T > 5.0
    np.testing.assert_allclose(plain.predict(far)[beyond, 0, 0], 0.06, atol=0.006)
    assert not plain_map([affine(f"e{k}", k) for k in range(3)]).held


def test_inputs_that_always_move_together_are_named_with_their_combination() -> None:
    def pair(name: str, seed: int) -> Experiment:
        left = wave(seed)
        both = {"left": left, "right": Trace(T, 0.5 * left.pressure + 2e3)}
        return trial(name, both, np.stack([1e-7 * left(T), 0.1 + 0 * T], axis=1))

    train = [pair(f"e{k}", k) for k in range(3)]
    plain = plain_map(train)
    note, = plain.notes
    assert "left, right always move together" in note
    assert "right = 0.5 left +2 kPa" in note
    assert "record one of them alone" in note
    assert rms(plain, pair("held", 8)) < 1e-4 * train[0].travel


def test_two_inputs_of_their_own_are_not_said_to_move_together() -> None:
    assert plain_map([affine("a", 1), affine("b", 2)]).notes == ()


def test_an_input_that_never_moves_is_left_out_and_named() -> None:
    still = [trial(e.name, {**e.drives, "third": Trace(T, 100.0 * np.sin(T))}, e.position[:, 0])
             for e in (affine("a", 1), affine("b", 2))]
    plain = plain_map(still)
    assert plain.inputs == ("left", "right")
    assert "Input third never moves in the training recordings" in plain.notes[0]


def decaying(name: str, seed: int, excitation: Excitation = "release") -> Experiment:
    tip = np.stack([0.02 * np.exp(-0.3 * T) * np.cos(3.0 * T), 0.1 + 0 * T], axis=1)
    noise = 1e-5 * np.random.default_rng(seed).standard_normal(tip.shape)
    trace = Trace(T, np.full(T.size, 3e3)) if excitation == "trace" else None
    return Experiment(name, T, (tip + noise)[:, None], ("tip",), excitation, pressure=trace)


@pytest.mark.parametrize("excitation", ["release", "trace"])
def test_without_a_moving_input_the_map_is_the_mean_and_says_so(excitation: Excitation) -> None:
    train = [decaying(f"e{k}", k, excitation) for k in range(2)]
    plain = plain_map(train)
    assert plain.degree == 0
    assert plain.title == "mean of the training frames"
    assert any("No input moves in the training recordings" in note for note in plain.notes)
    expected = np.mean([e.position[:, 0].mean(axis=0) for e in train], axis=0)
    np.testing.assert_allclose(plain.predict(decaying("held", 5, excitation))[:, 0], np.tile(expected, (T.size, 1)))


def test_pulses_of_known_level_are_inputs() -> None:
    def pulse(name: str, level: float) -> Experiment:
        on = (T > 4.0) & (T < 12.0)
        tip = np.stack([1e-6 * level * on, 0.1 + 0 * T], axis=1)
        return Experiment(name, T, tip[:, None], ("tip",), "pulse", level=level)

    plain = plain_map([pulse("a", 20e3), pulse("b", 40e3), pulse("c", 30e3)])
    held = pulse("held", 35e3)
    settled = (T > 6.0) & (T < 11.0)
    np.testing.assert_allclose(plain.predict(held)[settled, 0, 0], 0.035, rtol=0.02)


def test_known_loads_and_forces_are_inputs() -> None:
    def hanging(name: str, mass: float, force: float) -> Experiment:
        base = affine(name, len(name))
        pull = PointForce(np.array([0.0, 10.0, 10.0, 20.0]), np.array([[0, 0], [0, 0], [force, 0], [force, 0]]), "tip")
        tip = base.position[:, 0] + np.outer(mass + 0 * T, [0.0, -0.2])
        tip[T >= 10.0] += [0.01 * force, 0.0]
        return Experiment(name, T, tip[:, None], ("tip",), "trace", drives=base.drives, known={"tip_mass": mass},
                          forces=(pull,))  # fmt: skip

    train = [hanging("a", 0.0, 0.0), hanging("bb", 0.05, 0.5), hanging("ccc", 0.1, 1.0), hanging("dddd", 0.05, 1.0)]
    plain = plain_map(train, degree=1)
    assert set(plain.inputs) == {"left", "right", "force x at tip", "tip_mass"}
    held = hanging("eeeee", 0.08, 0.7)
    assert rms(plain, held) < 1e-3 * held.travel


def test_settled_poses_give_a_static_map() -> None:
    rng = np.random.default_rng(4)
    rows = np.arange(60.0)

    def poses(name: str) -> Experiment:
        a, b = rng.uniform(0.0, 5.0, (2, 60))
        tip = np.stack([1e-3 * a, 2e-3 * b, 0.3 - 1e-3 * a], axis=1)
        return Experiment(name, rows, tip[:, None], ("tip",), "trace", poses=True,
                          drives={"one": Trace(rows, a), "two": Trace(rows, b)})  # fmt: skip

    plain = plain_map([poses("train")])
    assert plain.time_constants == ()
    assert rms(plain, poses("held")) < 1e-6


def test_angles_are_mapped_in_radians() -> None:
    base = [affine(f"e{k}", k) for k in range(3)]

    def turned(e: Experiment) -> Experiment:
        angle = 20.0 * (e.position[..., 0] - 0.01)
        return Experiment(e.name, T, np.full(e.position.shape, np.nan), ("tip",), "trace", drives=e.drives, angle=angle,
                          angle_reference="rest", angles_alone=True)  # fmt: skip

    plain = plain_map([turned(e) for e in base])
    assert plain.unit[0] == "deg"
    assert rms(plain, turned(affine("held", 9))) < 1e-5
    with pytest.raises(InputError, match="does not hold what the plain map was fitted to"):
        plain.predict(affine("held", 9))
    with pytest.raises(InputError, match="cannot mix recordings of positions"):
        plain_map([turned(base[0]), base[1]])


def test_gaps_of_a_station_cost_its_frames_alone() -> None:
    gappy = []
    for k in range(3):
        e = affine(f"e{k}", k)
        both = np.stack([0.5 * e.position[:, 0], e.position[:, 0]], axis=1)
        both[50:90, 0] = np.nan
        both[200 + k, 1, 0] = np.nan
        gappy.append(Experiment(e.name, T, both, ("mid", "tip"), "trace", drives=e.drives))
    plain = plain_map(gappy)
    held = affine("held", 40)
    np.testing.assert_allclose(plain.predict(held)[:, 0], held.position[:, 0], atol=1e-7)
    with pytest.raises(InputError, match="no training experiment"):
        plain.predict(Experiment("odd", T, held.position, ("nose",), "trace", drives=held.drives))


def test_impossible_requests_are_refused() -> None:
    with pytest.raises(InputError, match="at least one training experiment"):
        plain_map([])
    with pytest.raises(InputError, match="must be 1, 2 or 3, got 4"):
        plain_map([affine("a", 1)], degree=4)
    two = plain_map([affine("a", 1)])
    one = Experiment("bare", T, affine("a", 1).position, ("tip",), "trace", pressure=wave(1))
    with pytest.raises(InputError, match="which of the inputs left, right"):
        two.predict(one)


def test_a_long_recording_is_thinned_and_takes_seconds() -> None:
    time = np.arange(0.0, 120.0, 0.01)
    drives = {f"p{k}": wave(k, time=time) for k in range(4)}
    tip = np.stack([1e-7 * sum(d(time) for d in drives.values()), 0.1 + 0 * time], axis=1)
    exp = trial("long", drives, tip, time)
    began = clock.process_time()
    plain = plain_map([exp])
    assert plain.frames == 3000
    assert clock.process_time() - began < 3.0  # 0.4 s, more where the threads of a busy machine wait


def test_the_map_is_shown_with_its_errors() -> None:
    plain = plain_map([affine(f"e{k}", k) for k in range(3)])
    assert "Plain map, linear in the inputs" in repr(plain)
    assert "left-out training data" in repr(plain)
