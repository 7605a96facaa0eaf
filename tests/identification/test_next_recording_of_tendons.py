"""What to record next of a body that tendons move: each input in its own unit, and all three coordinates."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from pliant.cli.simulate import highest_levels
from pliant.errors import InputError
from pliant.identification import Experiment, fit
from pliant.identification.design import Candidate, check_level, information_gain, limits_of, standard
from pliant.identification.parameters import apply
from pliant.model import Chamber, Model, Space, Station, Tendon, chain_model
from pliant.simulation import Pulse, Trace, simulate

TIMES = np.arange(0.0, 0.6, 0.01)
KNOTS = np.array([0.0, 0.1, 0.2, 0.5])


def arm(*more: Chamber) -> Model:
    """A tendon drawn in by a displacement, a pair on one motor, and further inputs."""
    same = {"lever": 8e-3, "line_stiffness": 2e3, "pretension": 2.0}
    inputs = [
        Tendon.at_azimuth(0.3, np.ones(2), name="long", driven_by="displacement", **same),
        Tendon.at_azimuth(2.0, np.ones(2), name="pair", driven_by="angle", pair=True, pulley=0.01, **same),
    ]
    return chain_model(
        length=0.2, mass=0.05, links=2, joint_placement="midsegment", stiffness=0.3, damping=4e-3, space=Space(),
        gravity=[0.0, 0.0, -9.81], chambers=[*inputs, *more], stations=[Station("tip", 1, 0.1)],
    )


def recorded(model: Model, levels: dict[str, list[float]], noise: float = 2e-4) -> Experiment:
    drives = {name: Trace(KNOTS, np.array(values)) for name, values in levels.items()}
    inputs = [drives.get(name, Pulse(0.0)) for name in model.actuation.names]
    seen = simulate(model, inputs, times=TIMES)["station_position"].values
    seen = seen + noise * np.random.default_rng(1).standard_normal(seen.shape)
    return Experiment("e", TIMES, seen, ("tip",), "trace", drives=drives)


def test_each_input_is_proposed_in_its_unit_up_to_its_own_limit() -> None:
    further = (Chamber(torque=[2e-6], joint_gain=np.ones(2), name="bellows"),
               Tendon.at_azimuth(1.0, np.ones(2), name="short", lever=8e-3, line_stiffness=2e3,
                                 driven_by="displacement"))  # fmt: skip
    model = arm(*further)
    traces = {"long": Trace(KNOTS, [0.0, -4e-3, 1e-3, 0.0]), "bellows": Trace(KNOTS, [0.0, 3e4, 2e4, 0.0]),
              "pair": Trace(KNOTS, [0.0, 0.2, -0.4, 0.0])}  # fmt: skip
    seen = [SimpleNamespace(traces=traces, excitation="pulse", level=0.0)]
    limits = limits_of(model, seen, None)
    assert limits == {"m": 4e-3, "rad": 0.4, "Pa": 3e4}
    assert limits_of(model, seen, {"m": 3e-3}) == {"m": 3e-3, "rad": 0.4, "Pa": 3e4}
    offered = {one.words: one for one in standard(model, seen[0], limits)}
    most = offered["long: pulse, 4 mm for 1 s"], offered["pair: pulse, 0.4 rad for 1 s"]
    assert [one.level for one in most] == [4e-3, 0.4]
    assert offered["bellows: pulse, 30 kPa for 1 s"].level == 3e4
    assert offered["long, short: pulse, 2 mm for 1 s"].chambers == ("long", "short")
    assert {words.partition(":")[0] for words in offered} == {"long", "pair", "bellows", "short", "long, short"}
    for one in offered.values():
        check_level(model, one, limits)
    strong = Candidate("too much", Pulse(6e-3), 1.0, 6e-3, ("short",))
    with pytest.raises(InputError, match="reaches 6 mm, but must not exceed the highest displacement of 4 mm"):
        check_level(model, strong, limits)
    with pytest.raises(InputError, match="give the highest level of each"):
        limits_of(model, seen, 3e-3)
    with pytest.raises(InputError, match="no input of model 'model' has the unit 'N'"):
        limits_of(model, seen, {"N": 3.0})


def test_the_highest_levels_are_read_with_their_units() -> None:
    assert highest_levels("30kPa") == pytest.approx({"Pa": 3e4})
    assert highest_levels("5 N, 3mm,0.4rad") == pytest.approx({"N": 5.0, "m": 3e-3, "rad": 0.4})
    for wrong in ("30", "kPa", "1e-kPa", "3 psi", "3mm,"):
        with pytest.raises(InputError, match=r"as 30kPa or 5N,3mm"):
            highest_levels(wrong)


@pytest.mark.slow
def test_what_a_recording_in_space_adds_is_that_of_all_three_coordinates() -> None:
    """Against differences of LSODA's motions."""
    model = arm()
    seen = recorded(model, {"long": [0.0, 3e-3, 3e-3, 0.0], "pair": [0.0, 0.0, 0.3, 0.0]})
    found = fit([seen], model, ["stiffness", "damping"], time_step=2e-3, starts=1)
    sizes = {name: found.values[name] for name in ("stiffness", "damping")}
    again = Candidate("again", seen.drives["long"], 0.6, 3e-3, ("long",))

    def moved(name: str, share: float) -> np.ndarray:
        other = apply(found.model, {name: found.values[name] * (1 + share)})
        inputs = [again.pressure, Pulse(0.0)]
        return simulate(other, inputs, times=TIMES, method="LSODA", rtol=1e-9)["station_position"].values.ravel()

    J = np.array([(moved(name, 1e-3) - moved(name, -1e-3)) / 2e-3 for name in sizes])
    assert found.covariance is not None
    frames = max(1.0, found.covariance.correlated / 0.01)
    exact = J @ J.T / (found.rmse["e"] ** 2 / 3) / frames
    gain = information_gain(found, [seen], again, sizes, 2e-3)
    np.testing.assert_allclose(gain, exact, rtol=0.03, atol=2e-3 * exact.max())
