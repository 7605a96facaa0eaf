"""Numbers, thinned curves, metrics and stored results against small cases worked out by hand."""

from __future__ import annotations

import json
from dataclasses import fields, replace

import numpy as np
import pytest

from pliant.errors import InputError
from pliant.failures import NotComputed
from pliant.identification import Band, Experiment
from pliant.preprocessing.sync import Delay
from pliant.recording import make_recording
from pliant.reduction import links_of
from pliant.selection import ModelSelection, SelectionStep, TriedTerm
from pliant.simulation import Trace
from pliant.validation import curves, draw, metrics
from pliant.validation.metrics import (
    change,
    compare,
    definitions,
    extension,
    extreme_frames,
    growth,
    on_window,
    response,
)
from pliant.validation.outcome import (
    Clocks,
    WiringRow,
    Wirings,
    in_recorded_axes,
    turned_band,
    turned_forecast,
    turned_record,
    turned_shape,
)
from pliant.validation.selection_figures import chain_through
from pliant.validation.store import (
    experiment_of,
    forecast_dataset,
    forecast_of,
    groups_of,
    recorded,
    save_results,
    selection_of,
    shape_of,
    shaped,
)
from pliant.validation.wording import clip, digits, metric_label, readable, sized

T = np.arange(0.0, 4.0, 0.01)


# axes


def test_results_in_the_axes_of_mirrored_recordings(outcome, shape):
    names = {r.name for f in outcome.fits for r in f.records}
    whole = replace(outcome, shape=replace(shape, name="low"))
    like = {"heavy": "low"}
    assert in_recorded_axes(whole, like, dict.fromkeys(names, 1)) is whole
    turned = in_recorded_axes(whole, like, {**dict.fromkeys(names, 1), "low": -1})
    mirror = np.array([-1.0, 1.0])
    for before, after in zip(whole.fits, turned.fits, strict=True):
        for a, b in zip(before.records, after.records, strict=True):
            sign = mirror if a.name == "low" else 1.0
            np.testing.assert_allclose(b.modelled, a.modelled * sign)
            np.testing.assert_allclose(b.experiment.position, a.experiment.position * sign)
            if a.body is not None:
                np.testing.assert_allclose(b.body, a.body * sign)
            assert b.metrics == a.metrics
    np.testing.assert_allclose(turned.forecasts[0].tip, whole.forecasts[0].tip * mirror)
    np.testing.assert_allclose(turned.shape.position, shape.position * mirror)
    kept = in_recorded_axes(whole, like, {**dict.fromkeys(names, 1), "let go/": -1})
    assert kept.forecasts[0] is whole.forecasts[0]
    assert kept.shape is whole.shape


def test_a_turned_shape_has_the_links_of_its_mirror_image(shape):
    turned = turned_shape(shape)
    names = [f"p{i}" for i in range(shape.arc_length.size)]
    ds = make_recording(np.arange(40) / 20, turned.position, station=names, frame="planar", arc_length=shape.arc_length)
    links = links_of(ds, 3)
    for name in ("base", "tips", "rest_angle", "joint_angle"):
        np.testing.assert_allclose(getattr(turned.links, name), getattr(links, name), atol=1e-9, err_msg=name)
    np.testing.assert_allclose(turned.curvature, -shape.curvature)
    np.testing.assert_allclose(turned.rest_curvature, -shape.rest_curvature)
    mirror = np.array([-1.0, 1.0])
    for a, b in zip(chain_through(turned), chain_through(shape), strict=True):
        np.testing.assert_allclose(a, b * mirror, atol=1e-9)


def test_a_turned_band_keeps_its_lower_limit_below(outcome):
    at = np.array([[[1.0, 2.0]]])
    band = turned_band(Band(at, at, at - np.array([0.1, 0.2]), at + np.array([0.3, 0.4]), 0.95))
    np.testing.assert_allclose(band.position, [[[-1.0, 2.0]]])
    np.testing.assert_allclose(band.lower, [[[-1.3, 1.8]]])
    np.testing.assert_allclose(band.upper, [[[-0.9, 2.4]]])
    record = outcome.fits[0].records[1]
    assert turned_record(record).band is None
    np.testing.assert_allclose(turned_forecast(outcome.forecasts[0]).tip[:, 1], outcome.forecasts[0].tip[:, 1])


# curves


def test_a_line_is_thinned_to_the_extremes_of_each_stretch():
    time, value = np.arange(12.0), np.array([0, 5, 1, 2, -3, 4, 7, 7.5, 1, np.nan, np.nan, 9.0])
    assert curves.thin(time, value, 12)[0] is time
    t, y = curves.thin(time, value, 6)  # three stretches of four: least, greatest and where a gap begins
    assert t.tolist() == [0, 1, 4, 7, 8, 9, 11]
    np.testing.assert_array_equal(y, value[[0, 1, 4, 7, 8, 9, 11]])
    t, _ = curves.thin(np.arange(1202.0), np.sin(np.arange(1202.0)))
    assert t.size < 1202
    assert curves.thin(np.arange(1200.0), np.zeros(1200))[0].size == 1200


def test_autocorrelation_by_hand():
    value = np.array([3.0, -1, np.nan, 2, 0, 1, -2, 4])
    lag, found = curves.autocorrelation(0.5 * np.arange(8), value)
    r = np.nan_to_num(value - np.nanmean(value))
    np.testing.assert_allclose(found, [1.0, r[:-1] @ r[1:] / (r @ r), r[:-2] @ r[2:] / (r @ r)])
    np.testing.assert_allclose(lag, [0.0, 0.5, 1.0])
    still = curves.autocorrelation(np.arange(8.0), np.full(8, 2.0))
    assert [a.tolist() for a in still] == [[0.0] * 3] * 2
    assert not curves.autocorrelation(np.arange(8.0), np.full(8, np.nan))[1].any()
    assert curves.autocorrelation(np.arange(1603.0), np.sin(np.arange(1603.0)))[0].size == 401


def test_what_is_chosen_of_many():
    assert curves.evenly_spaced(7, 3) == [1, 4, 6]
    assert curves.evenly_spaced(12) == [1, 3, 5, 7, 9, 11]
    assert curves.evenly_spaced(3, 3) == [0, 1, 2]
    path = np.stack([np.array([np.nan, 0, 1, 2, 3.1, 6, 5, 2.0]), np.zeros(8)], axis=1)
    assert curves.instants(path) == [1, 3, 5]  # at none, a third, two thirds (passed with the whole) and all of the way
    assert curves.instants(path, 3) == [1, 4, 5]
    assert curves.instants(np.zeros((4, 2))) == [0]
    bent = Experiment("p", T, np.stack([T, 0.0 * T], axis=1)[:, None], ("tip",), "pulse", level=1e4)
    assert curves.axes_of(bent) == (("x", "y"), "mm", 1e3)
    assert curves.axes_of(angle_of(T)) == (("angle",), "deg", pytest.approx(180 / np.pi))


def test_laws_have_the_levels_that_their_records_reach(outcome):
    title, chamber, marks = curves.laws_of(outcome.fits[0])[0]
    assert title == outcome.fits[0].title
    assert chamber is outcome.fits[0].result.model.chambers[0]
    assert marks == {1e4: "train", 2e4: "held_out", 0.0: "held_out"}


# figures that are drawn


def test_figures_of_a_study_by_name(outcome, shape):
    whole = replace(outcome, shape=shape)
    names = [n for n, _ in draw.figures_of(whole, ["low", "let go/"], only=False)]
    assert names == [
        "linear-low-motion",
        "linear-low-residual",
        "linear-low-path",
        "linear-let go/-motion",
        "linear-let go/-residual",
        "linear-let go/-path",
        "square-low-motion",
        "square-low-residual",
        "square-low-path",
        "compare-low",
        "torque",
        "order-bending",
        "shape-bending",
        "forecast-heavy",
    ]
    assert [n for n, _ in draw.figures_of(whole, ["let go/"], only=True)] == [
        f"linear-let go/-{k}" for k in ("motion", "residual", "path")
    ]
    taken: set[str] = set()
    assert len(draw.file_name("x" * 200, taken)) == 80
    assert draw.file_name("x" * 200, taken) == "x" * 80 + "-2"
    assert draw.file_name("X" * 80, taken) == "X" * 80 + "-3"
    bare = replace(
        outcome.fits[0], result=replace(outcome.fits[0].result, parameters=outcome.fits[0].result.parameters[:2])
    )
    assert draw.moves_torque([outcome.fits[0]])
    assert not draw.moves_torque([bare])


@pytest.mark.parametrize(("width", "good"), [(60.0, True), (400.0, True), (59.9, False), (400.1, False)])
def test_figures_are_sixty_to_four_hundred_millimetres_wide(outcome, tmp_path, width, good, monkeypatch):
    from pliant.errors import InputError
    from pliant.plotting import WIDTH
    from pliant.validation import figures

    seen = []
    monkeypatch.setattr(
        figures, "save", lambda figure, folder, name, kinds: seen.append((WIDTH.get(), name, kinds)) or ()
    )
    monkeypatch.setattr(
        draw, "figures_of", lambda shown, records, *, only: [(f"{len(shown.fits)}-{only}-{len(records)}", object)]
    )
    if not good:
        with pytest.raises(InputError, match="must be 60 to 400 mm"):
            list(draw.draw_figures(outcome, tmp_path, width_mm=width))
        return
    list(draw.draw_figures(outcome, tmp_path, width_mm=width, kinds=["svg", "png", "svg"]))
    list(draw.draw_figures(outcome, tmp_path, records=["low"], all_fits=True))
    assert seen[0] == (pytest.approx(width / 25.4), "1-False-3", ["svg", "png"])
    assert seen[1] == (7.16, "2-True-1", ["pdf"])
    failed = NotComputed("prediction", "linear", "gone", "it buckles", "held_out")
    lacking = replace(outcome, fits=(replace(outcome.fits[0], not_computed=(failed,)),))
    with pytest.raises(
        InputError, match="no figure of record 'gone' can be drawn: Fit linear: the prediction of record gone"
    ):
        list(draw.draw_figures(lacking, tmp_path, records=["gone"]))


# lengths


def test_the_longest_frames_are_one_in_fifty_and_five_at_least():
    for count, taken in ((100, 5), (250, 5), (1000, 20), (1030, 21)):
        length = np.arange(count, dtype=float)
        assert sorted(extreme_frames(length).tolist()) == list(range(count - taken, count))
        assert sorted(extreme_frames(-length).tolist()) == list(range(count - taken, count))
    both = np.concatenate([np.zeros(50), np.full(50, 1.0), np.full(50, -1.0)])
    assert both[extreme_frames(both)].tolist() == [1.0] * 5  # as far to both sides: longer
    both[100:] = -1.01
    assert both[extreme_frames(both)].tolist() == [-1.01] * 5
    found = change(np.array([2.0, 2, 2, 2, 2, 9, 3, 3, 3]), np.array([6, 7, 8]), ("mm", "percent"))
    assert found == {"mm": pytest.approx(1000.0), "percent": pytest.approx(50.0)}


def test_growth_needs_two_points_ten_frames_and_motion():
    place = np.zeros((10, 2, 2))
    place[:, 0, 1], place[:, 1, 1] = 0.1, 0.2 + np.linspace(0, 0.02, 10)
    found = growth(place, ("a", "b"))
    assert found["a"] == pytest.approx(1e3 * (np.median(place[5:, 1, 1]) - np.median(place[:5, 1, 1])))
    assert found["b"] == pytest.approx(found["a"] / np.median(place[:5, 1, 1]) / 10)
    three = np.concatenate([place, np.tile([0.0, 0.4], (10, 1, 1))], axis=1)  # its last point never moves
    for lacking in (place[:9], place[:, :1], np.tile(place[:1], (10, 1, 1)), three):
        assert growth(lacking, ("a", "b")) == {"a": None, "b": None}
    exp = Experiment("e", np.arange(30) / 10, np.tile(place, (3, 1, 1)), ("mid", "tip"), "pulse", level=1e4)
    assert extension(exp, exp.position)["extension_modelled_mm"] == pytest.approx(
        extension(exp, exp.position)["extension_mm"]
    )


# metrics


def angle_of(values, excitation="trace", **more):
    trace = (
        {"pressure": Trace([0.0, 1.0, 1.01, 3.0, 3.01, 4.0], [0, 0, 1e4, 1e4, 0, 0])} if excitation == "trace" else more
    )
    return Experiment(
        "a",
        T,
        np.full((T.size, 1, 2), np.nan),
        ("tip",),
        excitation,
        angle=np.asarray(values)[:, None],
        angle_reference="rest",
        **trace,
    )


def test_traits_of_a_plateau_in_degrees():
    angle = np.where((T > 1.0) & (T < 3.0), 0.2, 0.0)
    angle[(T > 1.3) & (T < 1.5)] = 0.26  # the first peak, in the plateau's first half
    angle[(T > 2.2) & (T < 2.5)] = 0.3  # a later one does not count
    angle[(T > 2.795) & (T < 3.0)] = 0.22  # the last fifth of a second is the steady end
    exp = angle_of(angle)
    found = response(exp, exp.compared[:, 0])
    assert found["steady_state_deg"] == pytest.approx(np.degrees(0.22))
    assert found["overshoot_percent"] == pytest.approx(100 * (0.26 / 0.22 - 1))
    assert found["frequency_hz"] is found["damping_ratio"] is None
    flat = np.where((T > 1.0) & (T < 3.0), 0.2, 0.0)
    assert response(angle_of(flat), flat[:, None])["overshoot_percent"] is None  # no peak is none
    lost = exp.compared[:, 0].copy()
    lost[T < 0.5] = np.nan
    assert response(exp, lost)["steady_state_deg"] == pytest.approx(np.degrees(0.22))
    on = on_window(exp, T)
    assert (T[on][0], T[on][-1]) == (pytest.approx(1.01), pytest.approx(3.0))
    soft = replace(exp, pressure=Trace([0.0, 1.0, 2.0, 4.0], [0, 0, 1e4, 1e4]))
    assert T[on_window(soft, T)][0] == pytest.approx(1.9, abs=0.011)  # above nine tenths of the highest
    assert on_window(replace(exp, pressure=Trace([0.0, 4.0], [0.0, 0.0])), T) is None
    m = compare(exp, exp.compared + 0.01, 0.1)
    assert [m["rmse_deg"], m["max_deg"]] == pytest.approx([np.degrees(0.01)] * 2)
    assert m["rmse_percent_of_travel"] == pytest.approx(100 * 0.01 / exp.travel)
    assert m["travel_deg"] == pytest.approx(np.degrees(exp.travel))
    assert m["points_not_seen"] == 0
    assert "rmse_percent_of_length" not in m
    assert set(m) - {"fitted_edges_s"} <= set(definitions(turns=True))
    assert not any(k.endswith("_mm") for k in definitions(turns=True))
    assert definitions(turns=False)["rmse_mm"].startswith("Euclidean distance")


def test_a_release_ends_in_its_last_fifth_of_a_second():
    path = np.stack([0.02 * np.exp(-T), np.full(T.size, 0.1)], axis=1)
    path[T > 3.785] = [0.012, 0.1]
    exp = Experiment("r", T, path[:, None], ("tip",), "release")
    found = response(exp, path)
    start = np.median(path[:5, 0])
    assert found["steady_state_mm"] == pytest.approx(1e3 * (start - 0.012), rel=1e-6)
    assert found["overshoot_percent"] is None


def test_joint_errors_at_the_end_and_swings_of_steps():
    lean = 0.1 * np.sin(T)[:, None] * np.array([1.0, 2.0])
    off = lean + np.where(T > 3.795, 0.02, 0.01)[:, None] * np.array([1.0, 1.0])

    def chain(direction):
        return np.cumsum(0.05 * np.stack([-np.sin(direction), np.cos(direction)], axis=-1), axis=1)

    exp = Experiment("p", T, chain(lean), ("mid", "tip"), "pulse", level=1e4)
    on = (T > 1.0) & (T < 3.0)
    made = metrics.swing_metrics(exp, chain(off), on)
    assert made["joint_steady_error_mrad"] == pytest.approx([10.0, 0.0], abs=1e-9)  # at the end of the plateau
    made = metrics.swing_metrics(exp, chain(off), None)
    assert made["joint_steady_error_mrad"] == pytest.approx([20.0, 0.0], abs=1e-9)  # at that of the record
    assert (
        metrics.swing_metrics(exp, chain(off), np.zeros(T.size, bool))["joint_steady_error_mrad"]
        == made["joint_steady_error_mrad"]
    )
    gone = exp.position.copy()
    gone[T > 3.7] = np.nan
    lost = Experiment("p", T, gone, ("mid", "tip"), "pulse", level=1e4)
    assert metrics.swing_metrics(lost, chain(off), None)["joint_steady_error_mrad"] is None
    assert metrics.swing_metrics(lost, chain(off), None)["joint_rmse_mrad"] == pytest.approx([10.0, 0.0], abs=1e-9)
    wound = chain(np.array([[3.0, -3.0]]))
    np.testing.assert_allclose(metrics.chord_angles(wound), [[3.0, 2 * np.pi - 6.0]])
    step = Experiment("p", T, chain(lean), ("mid", "tip"), "step", level=1e4)
    swings = metrics.two_amplitudes(step, step.last_station)
    assert set(swings.values()) == {None}


# outcomes


def test_wirings_say_who_won_and_by_how_much():
    rows = (
        WiringRow("a", 1.234, 0.0),
        WiringRow("b", 2.5, 17.6),
        WiringRow("c", 9.0, 99.0),
        WiringRow("d", None, None, "no"),
    )
    won = Wirings("fit", rows)
    assert won.winner is rows[0]
    assert won.sentence == (
        "Wiring 'a' fits the training records best, with an error of 1.23 % of the peak displacement. The second best "
        "of 3 is 'b' with 2.50 %; its 2 ln L is lower by 18."
    )
    assert "The second best of 2 is 'b'" in Wirings("fit", rows[:2]).sentence
    assert Wirings("fit", rows[:1]).sentence.endswith(". No other wiring could be fitted.")
    assert Wirings("fit", (rows[0], rows[3])).sentence.endswith(". No other wiring could be fitted.")
    assert Wirings.from_dict(won.to_dict()) == won
    assert Wirings.from_dict(None) is None


def test_what_could_not_be_computed_stands_in_the_rows(outcome):
    band = NotComputed("band", "linear", "low", "singular", "train")
    gone = NotComputed("prediction", "linear", "gone", "it buckles", "held_out")
    fit = replace(outcome.fits[0], not_computed=(band, gone, gone, NotComputed("fit", "linear", "", "x")))
    assert fit.missing == (gone, gone)
    rows = fit.record_dicts()
    assert rows["low"]["not_computed"] == band.sentence
    assert rows["low"]["rmse_mm"] == outcome.fits[0].records[0].metrics["rmse_mm"]
    assert rows["gone"] == {"role": "held_out", "not_computed": f"{gone.sentence} {gone.sentence}"}
    whole = replace(outcome, fits=(fit, outcome.fits[1]), failed=(NotComputed("fit", "x", "", "y"),))
    assert len(whole.not_computed) == 5
    made = whole.to_dict()
    assert made["records"]["gone"]["fit"] == "linear"
    assert made["records"]["low"]["fit"] == "linear"
    assert made["schema_version"] == 1
    card = whole.card()
    assert list(card.rows[0][:1]) == ["low"]
    assert card.rows[0][3:] == [
        f"{outcome.fits[0].records[0].metrics[k]:.3g}" for k in ("rmse_mm", "rmse_percent_of_travel", "max_mm")
    ]
    assert next(row for row in card.rows if row[3] == "not computed")[:3] == ["gone", fit.title, "held out"]
    assert card.lines[0] == "Held out, in one sentence."
    assert replace(whole, headline=None).card().lines == whole.verdict
    assert not whole.turns


def test_clocks_are_those_of_the_recording(rng):
    time = np.arange(100) / 50
    course = np.sin(9 * time)
    ds = make_recording(
        time, course[:, None, None] * np.array([0.01, 0.02]), frame="planar", pressure=course**2, pressure_time=time
    )
    found = Clocks.of(ds, Delay(0.1, 0.01, 2e-3, 1e-3, 0.9, 3.0, 0.1))
    assert (found.delay, found.drift) == (0.1, 2e-3)
    assert found.motion.shape == found.pressure.shape == (100,)
    assert abs(np.corrcoef(found.motion, course)[0, 1]) == pytest.approx(1.0)
    np.testing.assert_array_equal(found.clock, time)


# what is stored


def same(a, b):
    if isinstance(a, np.ndarray):
        return isinstance(b, np.ndarray) and np.array_equal(a, b, equal_nan=True)
    if isinstance(a, tuple):
        return isinstance(b, tuple) and len(a) == len(b) and all(same(x, y) for x, y in zip(a, b, strict=True))
    return type(a) is type(b) and a == b


def test_a_dense_shape_comes_back_field_by_field(outcome, shape, tmp_path):
    save_results(replace(outcome, shape=shape), tmp_path)
    again = shape_of(groups_of(tmp_path))
    for part in ("order", "links"):
        a, b = getattr(shape, part), getattr(again, part)
        for f in fields(a):
            assert same(getattr(a, f.name), getattr(b, f.name)), (part, f.name)
    assert (again.name, again.tip_status) == (shape.name, shape.tip_status)
    for name in ("arc_length", "position", "curvature", "rest_curvature"):
        np.testing.assert_array_equal(getattr(again, name), getattr(shape, name))
    made = shaped(shape)
    assert made["/shape_order"]["max_error"].attrs["units"] == "m"
    assert "tips" not in json.loads(made["/shape_links"].attrs["json"])


@pytest.mark.parametrize("columns", [1, 2])
def test_a_forecast_comes_back_with_its_unit(outcome, columns):
    forecast = outcome.forecasts[0]
    cut = replace(
        forecast,
        tip=forecast.tip[:, :columns],
        half_width=0.1 + forecast.tip[:, :columns],
        interval={"frequency_hz": 0.2},
    )
    ds = forecast_dataset(cut)
    assert {ds[k].attrs["units"] for k in ("tip", "half_width")} == {"rad" if columns == 1 else "m"}
    entry = {"title": cut.title, "stated": cut.stated, **cut.numbers, "half_width_95": cut.interval}
    again = forecast_of(cut.name, entry, ds)
    for f in fields(cut):
        assert same(getattr(again, f.name), getattr(cut, f.name)), f.name
    bare = forecast_dataset(forecast)
    assert "half_width" not in bare
    assert forecast_of("x", {**entry}, bare).half_width is None


def test_a_model_selection_comes_back(outcome):
    fit = replace(outcome.fits[0], name="model_selection")
    trial = TriedTerm("creep", "creep", 0.2, 0.1, 0.3, "better")
    steps = (SelectionStep("", "first", "begins", ("a",), 0.5, {"x": 3.0}, {"x": 4.0}, (trial,)),
             SelectionStep("creep", "creep", "joins", ("a", "b"), 0.1, {"x": 1.0}, {"x": 2.0}))
    selection = ModelSelection(steps, ("creep",), "it wins", fit.result, 7.0)
    again = selection_of(json.loads(json.dumps(selection.to_dict())), [outcome.fits[0], fit])
    assert again == selection
    assert selection_of(None, [fit]) is None
    with pytest.raises(InputError, match="earlier version"):
        selection_of({"chosen": "linear", "stages": {}, "reason": ""}, [fit])


def test_an_experiment_comes_back_with_its_inputs():
    path = np.random.default_rng(2).normal(size=(T.size, 2, 2))
    for more in (
        {"level": 2e4, "excitation": "pulse"},
        {"excitation": "trace", "pressure": Trace([0.0, 4.0], [0.0, 1e4])},
    ):
        exp = Experiment("p", T, path, ("mid", "tip"), **more)
        again = experiment_of(recorded(exp))
        assert (again.level, again.excitation, again.x_sign, again.stations) == (
            exp.level,
            exp.excitation,
            1,
            exp.stations,
        )
        np.testing.assert_array_equal(again.position, path)
        if exp.pressure is not None:
            np.testing.assert_array_equal(again.pressure.pressure, exp.pressure.pressure)
            np.testing.assert_array_equal(again.pressure.time, exp.pressure.time)
    drives = {"pull": Trace([0.0, 1.0], [3.0, 3.0])}
    lone = Experiment("p", T[:1], np.ones((1, 1, 3)), ("tip",), "trace", drives=drives, poses=True)
    assert experiment_of(recorded(lone)).poses
    angles = angle_of(0.1 * np.sin(T))
    again = experiment_of(recorded(angles))
    assert again.position.shape == (T.size, 1, 2)
    assert again.without_positions
    np.testing.assert_array_equal(again.angle, angles.angle)


# words


def test_words_and_digits():
    assert clip("x" * 60) == "x" * 60
    assert clip("x" * 61) == "x" * 59 + "…"
    assert clip("a\n b\t c", 5) == "a b c"
    assert readable("link_5__x") == "link 5 x"
    assert readable("_") == "_"
    assert [digits(v, 2) for v in (0.001234, 12.0, 123.0, True)] == ["0.0012", "12", "123", "–"]
    assert digits(2.5, 3, "+") == "+2.50"
    assert digits(2.5, zeros=False) == "2.5"
    assert digits(1.0, 2) == "1.0"
    assert digits(0.5e-7) == "5.00e-8".replace("-", "\N{MINUS SIGN}")
    assert sized({"rmse_deg": 1.0}, "rmse") == (1.0, "°")
    assert sized({"rmse_mm": 2.0}, "rmse") == (2.0, "mm")
    assert sized({}, "rmse") == (None, "mm")
    assert metric_label("frequency_hz") == ("frequency", "Hz")
    assert metric_label("rmse_percent_of_travel") == ("RMSE / peak displacement", "%")
