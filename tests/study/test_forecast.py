"""Cases that were not recorded: chambers driven as no recording drove them."""

from __future__ import annotations

import numpy as np
import pytest

from pliant.actuators import chen2018
from pliant.errors import InputError
from pliant.failures import Failures
from pliant.identification import Experiment, FitResult
from pliant.model import Space, Station, Tendon, chain_model
from pliant.simulation import Pulse, Trace, simulate
from pliant.study.forecast import check_forecasts, other_pressures, run_forecasts, tip_lacks
from pliant.study.schema import ForecastEntry, Study
from pliant.view.rows import known_unit

pytestmark = pytest.mark.slow  # kernels of their own are compiled first

TIME = np.arange(0.0, 1.0, 0.01)
SEEN = np.stack([np.sin(TIME), 1.0 + 0.0 * TIME], axis=-1)[:, None]


def recorded(**drives: list[float]) -> Experiment:
    knots = np.array([0.0, 0.1, 0.6, 0.7])
    traces = {c: Trace(knots, np.array(p)) for c, p in drives.items()}
    return Experiment("r", TIME, SEEN, ("tip",), "trace", drives=traces)


def test_chambers_follow_the_course_of_the_one_that_moved_most():
    """From where each began to the pressure that is asked for; those not named stay as they began."""
    like = recorded(left=[1e3, 5e4, 5e4, 1e3], right=[2e3, 2.1e3, 2e3, 1.9e3], third=[0.0, 0.0, 0.0, 0.0])
    case = other_pressures(like, {"right": 3e4, "third": 4.9e4})
    found = {c: t.pressure for c, t in case.drives.items()}
    np.testing.assert_allclose(found["left"], 1e3)
    np.testing.assert_allclose(found["right"], [2e3, 3e4, 3e4, 2e3])
    np.testing.assert_allclose(found["third"], [0.0, 4.9e4, 4.9e4, 0.0])
    assert case.pressure is case.drives["third"]  # the one that moves most now


def test_a_chamber_that_no_recording_drove_begins_at_none():
    case = other_pressures(recorded(left=[0.0, 5e4, 5e4, 0.0]), {"right": 3e4})
    np.testing.assert_allclose(case.drives["right"].pressure, [0.0, 3e4, 3e4, 0.0])


def test_one_chamber_needs_no_name_in_the_recording():
    single = Experiment("r", TIME, SEEN, ("tip",), "trace", Trace([0.0, 0.1, 0.6], np.array([0.0, 4e4, 2e4])))
    np.testing.assert_allclose(other_pressures(single, {"chamber": 8e4}).pressure.pressure, [0.0, 8e4, 4e4])


def test_pressures_go_with_a_measured_pressure():
    pulse = Experiment("r", TIME, SEEN, ("tip",), "pulse", level=1e4)
    study = Study.model_construct(forecasts={"f": ForecastEntry(like="r", pressures={"chamber": 1e4})})
    with pytest.raises(InputError, match="forecast f: pressures needs a measured pressure, but 'r' is a pulse"):
        check_forecasts(study, {"r": pulse})


def test_a_forecast_is_by_the_fit_that_it_names():
    """Of two models, one with half the torque: it rests half as far; a fit that failed is named."""
    model = chen2018.model(damping=0.1)
    seen = simulate(model, Pulse(4e4, 0.1, 2.0), times=TIME)["station_position"].values
    like = Experiment("r", TIME, seen, tuple(s.name for s in model.points), "step", level=4e4)
    results = {name: FitResult(m, (), "", {"r": 1e-3}, 1, 0.0, converged=True)
               for name, m in (("", model), ("half", model.with_(torque=0.5 * model.torque)))}  # fmt: skip
    entries = {"own": ForecastEntry(like="r"), "other": ForecastEntry(like="r", fit="half"),
               "none": ForecastEntry(like="r", fit="gone")}  # fmt: skip
    failures = Failures("first", lambda _line: None)
    made = run_forecasts(Study.model_construct(forecasts=entries, time_step=5e-3), {"r": like}, results, failures)
    full, half = (f.tip[-1, 0] - f.tip[0, 0] for f in made)
    assert half == pytest.approx(0.5 * full, rel=0.02)
    reason = "the forecast uses fit gone, which could not be computed: correct this fit first"
    assert [(f.fit, f.reason) for f in failures] == [("gone", reason)]


def test_the_band_of_a_forecast_grows_beyond_the_taught_levels():
    """A law that curves: nothing is lacking at rest or where the level was taught, the more the further beyond."""
    model = chen2018.model(torque=[6e-7, 1e-12])
    fitted = FitResult(model, (), "", {"r": 1e-3}, 1, 0.0, converged=True)

    def case(level):
        return Experiment("r", TIME, SEEN, (model.points[-1].name,), "step", level=level)

    own = {"start": 0.1, "r.start": 0.1}
    lacks = [tip_lacks(fitted, case(p), own, [case(5e4), case(1e5)], 2e-3) for p in (1e5, 1.2e5, 1.4e5)]
    assert np.abs([row[:10] for row in lacks]).max() < 1e-12
    ends = [np.abs(row[-1]).max() for row in lacks]
    assert ends[0] < 1e-6
    assert ends[2] > 2 * ends[1] > 1e-4


def test_a_forecast_of_a_tendon_is_in_its_own_unit():
    """`pressure_unit` scales pressures, not a tension or a displacement."""
    tendons = [Tendon.at_azimuth(0.3, np.ones(2), name="pull", lever=8e-3),
               Tendon.at_azimuth(2.0, np.ones(2), name="long", lever=8e-3, driven_by="displacement",
                                 line_stiffness=2e3, pretension=2.0)]  # fmt: skip
    model = chain_model(length=0.2, mass=0.05, links=2, joint_placement="midsegment", stiffness=0.3, damping=4e-3,
                        space=Space(), chambers=tendons, stations=[Station("tip", 1, 0.1)])  # fmt: skip
    knots = np.array([0.0, 0.1, 0.6, 0.7])
    drives = {"pull": Trace(knots, np.array([0.0, 1.0, 1.0, 0.0])),
              "long": Trace(knots, np.array([0.0, 1e-3, 1e-3, 0.0]))}  # fmt: skip
    seen = simulate(model, list(drives.values()), times=TIME)["station_position"].values
    like = Experiment("r", TIME, seen, ("tip",), "trace", drives=drives)
    entry = ForecastEntry(like="r", pressures={"pull": 2.0, "long": 3e-3}, pressure_unit="kPa")
    study = Study.model_construct(forecasts={"f": entry})
    result = FitResult(model, (), "", {"r": 1e-3}, 1, 0.0, converged=True)
    failures = Failures("", lambda _: None)
    (found,) = run_forecasts(study, {"r": like}, {"": result}, failures)
    assert found.stated == {"pull.tension": 2.0, "long.displacement": 3e-3}
    names = (*found.stated, "left.pressure", "left.valve_rise_time")
    assert [known_unit(name) for name in names] == ["N", "m", "Pa", "s"]
    inputs = [Trace(knots, np.array([0.0, p, p, 0.0])) for p in (2.0, 3e-3)]
    run = simulate(model, inputs, times=TIME)["station_position"].values[:, 0]
    np.testing.assert_allclose(found.tip, run, atol=1e-4)
