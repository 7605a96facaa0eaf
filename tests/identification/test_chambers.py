"""Several chambers through a fit: the truth found again, what was never driven apart, names, energy."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from pliant.errors import FitError, InputError
from pliant.identification import Experiment, Parameter, design, fit, identifiability
from pliant.identification.chamber_parameters import has_effect
from pliant.identification.design import Candidate, information_gain
from pliant.identification.drives import at_rest, findings_of_chambers, hardly_driven
from pliant.identification.from_recording import experiment
from pliant.identification.parameters import apply, check_names
from pliant.identification.prediction import predict
from pliant.identification.sensitivity import sensitivities
from pliant.model import Chamber, Model, Space, Station, Tendon, Valve, chain_model
from pliant.model.actuation import Actuation
from pliant.recording.schema import make_recording
from pliant.simulation import Pulse, Trace, simulate

TIMES = np.arange(0.0, 1.2, 0.01)
NOISE = 1e-4  # m


@pytest.fixture(scope="module")
def body() -> Model:
    """Two antagonistic chambers along three links, one stronger and faster than the other."""
    return Model(
        link_length=[0.05, 0.04, 0.03], link_mass=[0.02, 0.015, 0.012], stiffness=0.9, damping=6e-3,
        chambers=(
            Chamber(torque=[6e-7], valve=Valve(rise_time=0.03, fall_time=0.05), name="left"),
            Chamber(torque=[4e-7], joint_gain=-1.0, valve=Valve(rise_time=0.05, fall_time=0.02), name="right"),
        ),
        stations=(Station("mid", 1, 0.03, 0.008), Station("tip", 2, 0.03, -0.005)),
    )


def made(model: Model, name: str, levels: dict[str, list[float]], seed: int = 0, noise: float = NOISE) -> Experiment:
    """An experiment whose chambers follow `levels` at five times, by LSODA, with noise."""
    knots = np.array([0.1, 0.2, 0.55, 0.65, 0.9])
    drives = {c: Trace(knots, np.array(p, dtype=float)) for c, p in levels.items()}
    inputs = [drives.get(c.name, Pulse(0.0)) for c in model.chambers]
    run = simulate(model, inputs, times=TIMES, method="LSODA", rtol=1e-8)
    seen = np.asarray(run["station_position"].values)
    seen = seen + noise * np.random.default_rng(seed).standard_normal(seen.shape)
    return Experiment(name, TIMES, seen, ("mid", "tip"), "trace", drives=drives)


FREE = ["stiffness", "damping", "left.torque_1", "right.torque_1", "left.valve_rise_time", "right.valve_rise_time",
        "left.valve_fall_time", "right.valve_fall_time"]  # fmt: skip
ALONE = {"l": {"left": [0, 9e4, 9e4, 0, 0], "right": [0, 0, 0, 0, 0]}, "r": {"right": [0, 1e5, 1e5, 0, 0]}}


def test_two_antagonistic_chambers_are_found_again_within_their_intervals(body: Model) -> None:
    both = {"left": [0, 8e4, 8e4, 2e4, 0], "right": [0, 0, 9e4, 9e4, 0]}
    seen = [made(body, n, p, k) for k, (n, p) in enumerate({**ALONE, "both": both}.items())]
    start = apply(body, {"stiffness": 0.7, "damping": 4e-3, "valve_rise_time": 0.02, "valve_fall_time": 0.02})
    found = fit(seen, start, FREE, time_step=2e-3, starts=1)
    truth = dict(zip(FREE, (0.9, 6e-3, 6e-7, 4e-7, 0.03, 0.05, 0.05, 0.02), strict=True))
    assert found.converged
    for p in found.parameters:
        if p.free:
            assert p.std is not None
            assert p.value == pytest.approx(truth[p.name], abs=4.0 * p.std + 2e-3 * truth[p.name])
            assert p.std < 0.2 * truth[p.name]  # an interval that says something
    assert [c.torque[0] for c in found.model.chambers] == [found.values[f"{n}.torque_1"] for n in ("left", "right")]
    assert found.model.chambers[1].valve.rise_time == found.values["right.valve_rise_time"]
    assert any(n == "In r no pressure drives left: assumed constant at 0 Pa." for n in found.notes)
    held_out = made(body, "new", {"left": [0, 4e4, 9e4, 9e4, 0], "right": [0, 7e4, 0, 5e4, 0]}, noise=0.0)
    seen_there = predict(found.model, held_out, found.values, 2e-3)
    assert seen_there["pressure"].shape == (TIMES.size, 2)
    error = np.linalg.norm(seen_there["position"] - held_out.position, axis=-1)
    assert np.sqrt(np.mean(error**2)) < 0.01 * held_out.travel


def test_torques_begin_where_each_chamber_is_driven_alone(body: Model) -> None:
    from pliant.identification.initial_guess import prepare

    blank = body.with_(chambers=tuple(Chamber(torque=[0.0], joint_gain=c.joint_gain, name=c.name)
                                      for c in body.chambers))  # fmt: skip
    seen = [made(body, n, p, noise=0.0) for n, p in ALONE.items()]
    _, filled = prepare(seen, blank, ["left.torque_1", "right.torque_1"])
    assert [p.value for p in filled] == pytest.approx([6e-7, 4e-7], rel=0.15)


def test_chambers_that_were_never_driven_apart_are_named(body: Model) -> None:
    body = apply(body, {"valve_rise_time": 0.03, "valve_fall_time": 0.05})  # valves that differ would tell them apart
    same = [0, 8e4, 8e4, 0, 0]
    together = made(body, "t", {"left": same, "right": [0.5 * p for p in same]})
    told = identifiability([together], body, ["left.torque_1", "right.torque_1"], time_step=2e-3)
    assert not told.identifiable
    assert "chambers left and right were never driven separately: their gains cannot be distinguished" in str(told)
    with pytest.raises(FitError, match="never driven separately"):
        fit([together], body, ["left.torque_1", "right.torque_1"])
    idle = made(body, "i", {"left": same})
    assert "chamber right is driven in no recording" in str(identifiability([idle], body, ["right.torque_1"]))
    apart = [together, made(body, "l", ALONE["l"])]
    assert identifiability(apart, body, ["left.torque_1", "right.torque_1"], time_step=2e-3).identifiable


def test_chambers_that_were_hardly_driven_or_hardly_apart_are_named(body: Model) -> None:
    """As a transducer shows them: no command leaves a little noise, one command two edges that differ."""
    idle = made(body, "i", {"left": [0, 9e4, 9e4, 0, 0], "right": [0, 8e2, 0, 8e2, 0]})
    found = fit([idle], body, ["left.torque_1", "right.torque_1"], time_step=2e-3, starts=1)
    note = "Chamber right was hardly driven: its pressure changes by only 0.89 % as much as that of left"
    assert any(n.startswith(note) for n in found.notes)
    same = made(body, "s", {"left": [0, 8e4, 8e4, 2e3, 0], "right": [0, 7.5e4, 8e4, 0, 0]})
    apart = "Chambers left and right turn the same joints and were hardly driven separately"
    found = fit([same], body, ["left.torque_1", "right.torque_1"], time_step=2e-3, starts=1)
    assert any(n.startswith(apart) for n in found.notes)
    both = ["left.torque_1", "right.torque_1"]
    again = fit([same, made(body, "l", ALONE["l"])], body, both, time_step=2e-3, starts=1)
    assert not any("hardly" in n for n in again.notes)


@pytest.mark.parametrize(
    "name", ["left.torque_1", "right.torque_2", "right.valve_rise_time", "left.joint_gain_2", "torque_1"]
)
def test_derivatives_by_parameters_of_chambers_agree_with_differences(body: Model, name: str) -> None:
    exp = made(body, "e", {"left": [0, 8e4, 8e4, 2e4, 0], "right": [0, 0, 9e4, 9e4, 0]}, noise=0.0)
    values = {"left.torque_1": 6e-7, "right.torque_2": 1e-12, "right.valve_rise_time": 0.05, "left.joint_gain_2": 0.8}
    values = {name: values.get(name, 5e-7)}
    size, step = abs(values[name]), 2e-3
    _, slope = sensitivities(body, exp, values, {name: size}, step)
    up, down = (predict(body, exp, {name: values[name] + s * 1e-4 * size}, step)["position"] for s in (1, -1))
    differences = (up - down) / 2e-4
    assert np.abs(differences).max() > 0
    np.testing.assert_allclose(size * slope[0][..., :2], differences, atol=1e-5 * np.abs(differences).max())


def test_names_of_chambers_are_checked(body: Model) -> None:
    seen = [made(body, n, p) for n, p in ALONE.items()]
    for name, sentence in {
        "middle.torque_1": "no recording, station or chamber is called 'middle'",
        "left.stiffness": "'left' is a chamber, and no chamber has a parameter 'stiffness'",
        "gain": "name the chamber of a gain, such as left.gain",
        "left.joint_gain_4": "the model has joints 1 to 3",
    }.items():
        with pytest.raises(InputError, match=sentence):
            fit(seen, body, [name])
    with pytest.raises(InputError, match="names a chamber and a recording or station"):
        fit([made(body, "left", ALONE["l"])], body, ["stiffness"])
    drives = {"up": Trace([0.0, 1.0], [0.0, 1e4])}
    strange = Experiment("u", TIMES, seen[0].position, ("mid", "tip"), "trace", drives=drives)
    with pytest.raises(InputError, match="drives the chamber 'up', but model 'model' has left, right"):
        fit([strange], body, ["stiffness"])
    unsaid = Experiment("u", TIMES, seen[0].position, ("mid", "tip"), "pulse", level=1e5)
    with pytest.raises(InputError, match="does not state which of the chambers left, right"):
        fit([unsaid], body, ["stiffness"])


def test_a_shared_value_holds_for_all_chambers_and_a_chambers_own_overrules_it(body: Model) -> None:
    moved = apply(body, {"valve_rise_time": 0.07, "right.valve_rise_time": 0.01, "torque_2": 1e-12})
    assert [c.valve.rise_time for c in moved.chambers] == [0.07, 0.01]
    assert [c.torque[1] for c in moved.chambers] == [1e-12, 1e-12]
    assert apply(moved, {"stiffness": 0.5}).chambers == moved.chambers


def test_a_free_law_and_all_gains_of_a_chamber_share_a_scale(body: Model) -> None:
    seen = [made(body, n, p, k) for k, (n, p) in enumerate(ALONE.items())]
    free = ["right.torque_1", *(Parameter(f"right.joint_gain_{i}", -0.9) for i in (1, 2, 3))]
    found = fit(seen, body, free, time_step=2e-3, starts=1)
    gains = found.model.chambers[1].joint_gain
    assert gains.mean() == pytest.approx(-0.9, rel=1e-3)
    assert found.values["right.torque_1"] * gains.mean() == pytest.approx(-4e-7, rel=0.01)
    assert any("joints' gains is held constant" in note for note in found.notes)


def test_chambers_of_a_recording_drive_those_of_the_model_by_name_or_index() -> None:
    pressure = np.stack([np.linspace(0, 1e4, 20), np.linspace(0, 5e4, 20)], axis=1)
    time = np.linspace(0.0, 1.0, 20)
    seen = np.zeros((20, 1, 2))
    seen[:, 0, 0] = np.linspace(0, 0.01, 20)
    ds = make_recording(
        time, seen, station=["tip"], frame="planar", pressure=pressure, pressure_time=time, chamber=["a", "b"]
    )
    exp = experiment("e", ds, drive={"left": "b", "right": 0})
    assert exp.drives["left"].pressure[-1] == 5e4
    assert exp.drives["right"].pressure[-1] == 1e4
    assert exp.pressure is exp.drives["left"]  # the one that moves most
    assert exp.synchronised({"start": 0.1}).drives["right"].time[0] == 0.1
    with pytest.raises(InputError, match="no chamber 'c' to drive 'left': it has a, b"):
        experiment("e", ds, drive={"left": "c"})
    with pytest.raises(InputError, match="state with drive which of them drives which"):
        experiment("e", ds)


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_no_closed_cycle_of_two_pressures_gains_energy(body: Model, seed: int) -> None:
    """The work of both torques, by quadrature of the motion, is what the dampers took: nothing comes from nowhere."""
    rng = np.random.default_rng(seed)
    times = np.linspace(0.0, 4.0, 4001)
    knots = np.linspace(0.0, 2.5, 12)
    inputs = [Trace(knots, np.concatenate([[0.0], rng.uniform(0, 1e5, 10), [0.0]])) for _ in body.chambers]
    run = simulate(body, inputs, times=times, method="midpoint", time_step=5e-4)
    rate = run["joint_rate"].values
    gains = np.stack([c.joint_gain for c in body.chambers])
    laws = np.stack([c.torque_at(run["pressure"].values[:, k]) for k, c in enumerate(body.chambers)], axis=1)
    power, loss = np.sum(laws @ gains * rate, axis=1), rate**2 @ body.damping
    put_in, lost = (float(np.sum(0.5 * (p[1:] + p[:-1]) * np.diff(times))) for p in (power, loss))
    held = run["kinetic_energy"] + run["elastic_energy"]
    assert lost > 0
    assert put_in == pytest.approx(lost + float(held[-1] - held[0]), rel=5e-3)
    assert float(run["input_work"][-1]) == pytest.approx(put_in, rel=5e-3)
    assert float(held[-1]) < 1e-3 * float(held.max())  # the cycle is closed: what came in went into the dampers
    assert put_in > 0


@pytest.mark.slow
def test_the_next_recording_drives_the_chamber_of_which_least_is_known(body: Model) -> None:
    """One chamber pressed hard, the other hardly. What a recording adds is that of LSODA's differences."""
    weak = {"left": [0, 9e4, 9e4, 0, 0], "right": [0, 6e3, 6e3, 0, 0]}
    apart = {"left": [0, 0, 0, 0, 0], "right": [0, 0, 5e3, 5e3, 0]}
    seen = [made(body, "weak", weak), made(body, "apart", apart, 1)]
    found = fit(seen, body, ["stiffness", "left.torque_1", "right.torque_1"], time_step=2e-3, starts=1)
    proposals = design(found, seen, time_step=2e-3).proposals
    assert "right" in proposals[0].words.partition(":")[0]
    assert {p.words.partition(":")[0] for p in proposals} == {"left", "right", "left, right"}
    again = Candidate("again", seen[0].drives["left"], 1.2, 9e4, ("left",))
    sizes = {name: abs(found.values[name]) for name in ("stiffness", "left.torque_1", "right.torque_1")}

    def moved(name: str, share: float) -> np.ndarray:
        other = apply(found.model, {name: found.values[name] * (1 + share)})
        inputs = [again.pressure, Pulse(0.0)]
        return simulate(other, inputs, times=TIMES, method="LSODA", rtol=1e-9)["station_position"].values.ravel()

    J = np.array([(moved(name, 1e-3) - moved(name, -1e-3)) / 2e-3 for name in sizes])
    noise = np.sqrt(np.mean([v**2 for v in found.rmse.values()]) / 2)
    assert found.covariance is not None
    exact = J @ J.T / noise**2 / max(1.0, found.covariance.correlated / 0.01)
    gain = information_gain(found, seen, again, sizes, 2e-3)
    np.testing.assert_allclose(gain, exact, rtol=0.02, atol=1e-3 * exact.max())


def test_inputs_that_nothing_drives_are_told_by_their_kind_and_unit() -> None:
    along = {"joint_gain": [-1.0], "cross_gain": [0.0], "lever": 0.01}
    inputs = Actuation((Tendon(**along, name="m1"), Tendon(**along, name="m2"), Chamber(torque=[6e-7], name="left")), 1)
    driven = SimpleNamespace(name="r", drives={"m1": None})
    tension = "no tension drives m2: assumed constant at 0 N."
    pressure = "no pressure drives left: assumed constant at 0 Pa."
    assert at_rest(SimpleNamespace(actuation=inputs), driven) == f"In r {tension} In r {pressure}"


def test_tendons_that_recordings_do_not_tell_apart_are_called_tendons() -> None:
    along = {"joint_gain": [-1.0], "cross_gain": [0.0], "lever": 0.01}
    chamber = Chamber(torque=[6e-7], name="left")
    inputs = Actuation((Tendon(**along, name="m1"), Tendon(**along, name="m2"), chamber), 1)
    model = SimpleNamespace(actuation=inputs, chambers=inputs.inputs)
    pull = Trace([0.0, 1.0, 2.0], [0.0, 1.0, 0.0])
    exp = SimpleNamespace(time=np.linspace(0.0, 2.0, 9), drives={"m1": pull})
    assert findings_of_chambers(["m2.lever"], model, [exp]) == "tendon m2 is driven in no recording"
    both = SimpleNamespace(time=exp.time, drives={"m1": pull, "m2": pull, "left": pull})
    apart = "were never driven separately: their gains cannot be distinguished"
    assert findings_of_chambers(["m1.lever", "m2.lever"], model, [both]) == f"tendons m1 and m2 {apart}"
    assert findings_of_chambers(["m1.lever", "left.torque_1"], model, [both]) == f"inputs m1 and left {apart}"
    weak = SimpleNamespace(time=exp.time, drives={"m1": pull, "m2": Trace(pull.time, 0.01 * np.array(pull.pressure))})
    [note] = hardly_driven(["m2.lever"], model, [weak])
    assert note.startswith("Tendon m2 was hardly driven: its tension changes by only 1 % as much as that of m1")


@pytest.mark.parametrize(("name", "who"), [
    ("pull.torque_1", "torque_1 .* a tendon driven by its tension: use lever, .*friction, taper, spacing$"),
    ("long.torque_2", "torque_2 has no effect on 'long', a tendon driven by its displacement: use lever, line"),
    ("pull.line_stiffness", "line_stiffness has no effect on 'pull', a tendon driven by its tension"),
    ("long.saturating_lever", "saturating_lever has no effect on 'long'"),
    ("bellows.lever", "lever has no effect on 'bellows', a chamber driven by its pressure: use torque_<k>$"),
])  # fmt: skip
def test_a_parameter_that_changes_nothing_is_refused(name: str, who: str) -> None:
    ahead = {"joint_gain": [-1.0, -1.0], "cross_gain": [0.0, 0.0], "lever": 0.01}
    pull, long = Tendon(**ahead, name="pull"), Tendon(**ahead, name="long", driven_by="displacement",
                                                      line_stiffness=2e3)  # fmt: skip
    bellows = Chamber(torque=[2e-6], joint_gain=[1.0, 1.0], name="bellows")
    model = chain_model(length=0.2, mass=0.05, links=2, stiffness=0.3, damping=4e-3, space=Space(),
                        chambers=[pull, long, bellows])  # fmt: skip
    with pytest.raises(InputError, match=f"parameter {name}: {who}"):
        check_names([Parameter(name)], model, set(), set())
    shared = name.partition(".")[2]
    check_names([Parameter(shared), Parameter("pull.lever"), Parameter("bellows.valve_rise_time")], model, set(), set())
    alone = model.with_(chambers=[next(c for c in model.chambers if c.name == name.partition(".")[0])])
    with pytest.raises(InputError, match=f"parameter {shared}: {who}"):
        check_names([Parameter(shared)], alone, set(), set())


def test_torque_laws_have_an_effect_on_chambers_alone() -> None:
    ahead = {"joint_gain": [-1.0, -1.0], "cross_gain": [0.0, 0.0]}
    inputs = [Tendon(**ahead, lever=0.01, name="pull"), Chamber(torque=[2e-6], joint_gain=[1.0, 1.0], name="bellows")]
    model = chain_model(length=0.2, mass=0.05, links=2, stiffness=0.3, damping=4e-3, space=Space(), chambers=inputs)
    assert [c.name for c in model.chambers if has_effect("torque_1", c)] == ["bellows"]
    assert [c.name for c in model.chambers if has_effect("gain_x", c)] == ["pull", "bellows"]


def test_kept_chambers_are_those_of_the_same_values():
    chambers = tuple(Chamber([1e-6], np.ones(2), name=n) for n in ("left", "right"))
    body = chain_model(length=0.1, mass=0.02, links=2, stiffness=0.5, damping=1e-3, torque=[1e-6]).with_(
        chambers=chambers)  # fmt: skip
    kept: dict = {}
    first = apply(body, {"stiffness": 0.5, "left.gain": 2.0, "right.gain": 3.0}, kept)
    other = apply(body, {"stiffness": 0.5, "left.gain": 2.5, "right.gain": 3.0}, kept)
    assert other.chambers[1] is first.chambers[1]
    assert [float(c.joint_gain.mean()) for c in other.chambers] == [2.5, 3.0]
    again = apply(body, {"stiffness": 0.5, "left.gain": 2.0, "right.gain": 3.0})
    assert again.chambers == first.chambers
