"""A batch gives the numbers of single runs, whatever is side by side with what."""

from __future__ import annotations

import numpy as np
import pytest

from pliant.batch import simulate_batch
from pliant.batch.samples import gather
from pliant.errors import InputError, SimulationError
from pliant.identification.parameters import apply
from pliant.model import Chamber, Extension, Memory, Space, Valve, chain_model
from pliant.simulation import Chirp, Pulse, Trace, equilibrium, modes, simulate
from pliant.simulation.time_step import resolving_step

pytestmark = pytest.mark.slow  # kernels of their own are compiled first

TIMES = np.arange(61) / 75.0
EVERYTHING = ("joint_angle", "joint_rate", "tip_position")


def check_same(batch, models, pressures, **options):
    for i, model in enumerate(models):
        alone = simulate(model, pressures[i], times=TIMES, **options)
        for name in EVERYTHING:
            a, b = alone[name].values, batch[name].values[i]
            assert np.abs(a - b).max() <= 1e-12 * max(1.0, np.abs(a).max()), (i, name)


def test_parameters_of_one_model(paper):
    rng = np.random.default_rng(1)
    values = {
        "stiffness": rng.uniform(1.2, 2.0, 19), "damping_3": rng.uniform(4e-3, 1e-2, 19),
        "torque_1": rng.uniform(5e-7, 7e-7, 19), "tip_mass": rng.uniform(0, 8e-3, 19),
        "mass": rng.uniform(0.05, 0.08, 19),
        "gain": rng.uniform(0.8, 1.1, 19), "base_angle": rng.uniform(-0.2, 0.2, 19), "stiffness_2": np.full(19, 1.9),
    }
    pulse = Pulse(9e4, 0.1, 0.3)
    batch = simulate_batch(paper, pulse, parameters=values, times=TIMES, variables=EVERYTHING)
    models = [apply(paper, {name: v[i] for name, v in values.items()}) for i in range(19)]
    check_same(batch, models, [pulse] * 19)
    assert batch.attrs["failed_samples"] == 0
    assert np.isnan(batch["failed_at"]).all()


def test_a_batch_without_a_step_takes_what_its_models_need(paper):
    """And gives a row for every millisecond, whatever the step."""
    ringing, pulse = paper.with_(damping=1e-5), Pulse(9e4, 0.01)
    batch = simulate_batch([paper, ringing], pulse, duration=0.1)
    assert batch.attrs["step_s"] == resolving_step(ringing) < resolving_step(paper) == 1e-3
    assert batch.sizes["time"] == 101
    alone = simulate(paper, pulse, times=batch.time.values, time_step=batch.attrs["step_s"])
    assert np.abs(alone.joint_angle.values - batch.joint_angle.values[0]).max() < 1e-12


def test_models_with_everything(awkward):
    valves = [Valve(), Valve(rise_time=0.03, fall_time=0.05), Valve(natural_frequency=6.0), Valve(dead_time=0.013)]
    models = [awkward.with_(valve=v, stiffness=awkward.stiffness * k) for v in valves for k in (1.0, 1.3, 1.7)]
    trace = Trace([0.0, 0.1, 0.1, 0.33, 0.5], [0.0, 2e4, 5e4, 6e4, 1e4])
    batch = simulate_batch(models, trace, times=TIMES, time_step=2e-3, variables=EVERYTHING)
    check_same(batch, models, [trace] * len(models), time_step=2e-3)


def test_chambers_that_swell(awkward):
    models = [awkward.with_(swell_share=share, swell_time=t) for share, t in ((0.0, 1.0), (0.4, 0.2), (0.8, 0.05))]
    pulse = Pulse(4e4, 0.1, 0.3)
    batch = simulate_batch(models, pulse, times=TIMES, time_step=2e-3, variables=EVERYTHING)
    check_same(batch, models, [pulse] * 3, time_step=2e-3)
    assert np.abs(batch["joint_angle"].values[0] - batch["joint_angle"].values[2]).max() > 1e-4
    again = simulate_batch(
        models[0], pulse, parameters={"swell_share": [0.0, 0.4, 0.8], "swell_time": [1.0, 0.2, 0.05]}, times=TIMES,
        time_step=2e-3, variables=EVERYTHING,
    )
    assert again.equals(batch)


def test_chambers_that_inflate(awkward):
    walls = ((0.0, 0.1, 0.0), (9e4, 0.05, 0.0), (2e5, 0.02, 0.0), (3e4, 0.05, 1.5))
    models = [awkward.with_(inflation_limit=limit, inflation_time=t, inflation_jm=jm) for limit, t, jm in walls]
    pulse = Pulse(4e4, -0.1, 0.3)  # they start at rest under pressure
    batch = simulate_batch(models, pulse, times=TIMES, time_step=2e-3, variables=EVERYTHING)
    check_same(batch, models, [pulse] * 4, time_step=2e-3)


def test_own_pressures_with_and_without_common_edges(paper):
    same = [Pulse(1e4 * k, 0.1, 0.4) for k in range(1, 11)]
    check_same(simulate_batch(paper, same, times=TIMES, variables=EVERYTHING), [paper] * 10, same)
    other = [
        Pulse(8e4, 0.0317, 0.2), Pulse(8e4, 0.05, 0.3), Chirp(2e4, 5e4, 0.5, 4.0, 0.7), Chirp(1e4, 4e4, 1.0, 3.3, 0.6),
        Trace([0.0, 0.2, 0.6], [0.0, 7e4, 0.0]), *[Pulse(5e4, 0.1 + 1.3e-3 * k) for k in range(6)],
    ]
    check_same(simulate_batch(paper, other, times=TIMES, variables=EVERYTHING), [paper] * len(other), other)


def test_initial_states(paper):
    rng = np.random.default_rng(2)
    q, dq = rng.uniform(-0.2, 0.2, (9, 5)), rng.uniform(-1, 1, (9, 5))
    batch = simulate_batch(paper, [Pulse(1e4)] * 9, times=TIMES, initial_angle=q, initial_rate=dq, variables=EVERYTHING)
    for i in (0, 4, 8):
        alone = simulate(paper, Pulse(1e4), times=TIMES, initial_angle=q[i], initial_rate=dq[i])
        assert batch["joint_angle"].values[i] == pytest.approx(alone["joint_angle"].values, abs=1e-13)
        assert batch["joint_rate"].values[i] == pytest.approx(alone["joint_rate"].values, abs=1e-11)


def test_more_links_than_a_straight_line_is_written_for(paper):
    from pliant.actuators import chen2018

    model = chen2018.model(links=10)
    batch = simulate_batch([model] * 3, Pulse(5e4, 0.1), times=TIMES[:20], variables=EVERYTHING)
    alone = simulate(model, Pulse(5e4, 0.1), times=TIMES[:20])
    assert batch["tip_position"].values[2] == pytest.approx(alone["tip_position"].values, abs=1e-13)


@pytest.mark.parametrize("threads", [1, 2, 5])
def test_threads_change_no_bit(paper, threads):
    stiffness = np.linspace(1.2, 2.0, 43)
    runs = [
        simulate_batch(paper, Pulse(9e4), parameters={"stiffness": stiffness}, times=TIMES[:10], threads=t)
        for t in (1, threads)
    ]
    assert runs[0].identical(runs[1])


def test_a_sample_does_not_feel_its_neighbours(paper):
    stiffness = np.linspace(1.2, 2.0, 11)
    whole = simulate_batch(paper, Pulse(9e4), parameters={"stiffness": stiffness}, times=TIMES[:10])
    alone = simulate_batch(paper, Pulse(9e4), parameters={"stiffness": stiffness[9:10]}, times=TIMES[:10])
    assert np.array_equal(whole["tip_position"].values[9], alone["tip_position"].values[0])


def test_failures_are_told_and_stay_where_they_are(paper):
    levels = [Pulse(1e4), Pulse(1e9), Pulse(2e4)]
    with pytest.raises(SimulationError, match=r"1 of 3 samples fail, sample 1 at 0\.0"):
        simulate_batch(paper, levels, times=TIMES)
    marked = simulate_batch(paper, levels, times=TIMES, failures="mark")
    assert marked.attrs["failed_samples"] == 1
    assert np.isfinite(marked["failed_at"].values).tolist() == [False, True, False]
    assert np.isnan(marked["tip_position"].values[1]).all()
    good = simulate(paper, Pulse(2e4), times=TIMES)
    assert np.array_equal(marked["joint_angle"].values[2], good["joint_angle"].values)


def test_models_that_remember(paper):
    slow = paper.with_(memory=Memory(creep_share=(0.2,), creep_time=(0.3,)))
    models = [slow.with_(stiffness=k) for k in np.linspace(1.4, 1.7, 9)]
    batch = simulate_batch(models, Pulse(9e4), times=TIMES, variables=EVERYTHING, threads=2)
    check_same(batch, models, [Pulse(9e4)] * 9)
    marked = simulate_batch(models[:3], [Pulse(1e4), Pulse(1e9, 0.1), Pulse(2e4)], times=TIMES, failures="mark")
    assert np.isfinite(marked["failed_at"].values).tolist() == [False, True, False]
    assert 0.1 < float(marked["failed_at"][1]) < 0.2


def test_first_frequencies_are_those_of_the_modes(awkward, paper):
    for model in (awkward, paper):
        models = [model.with_(stiffness=model.stiffness * k) for k in (1.0, 1.2, 2.0)]
        samples = gather(models, None, 1)
        found = samples.first_frequency()
        assert found.max() <= samples.highest_first_frequency() <= 2.0 * found.max()
        assert found == pytest.approx([modes(m)[0][0] for m in models], rel=1e-10)


@pytest.mark.parametrize(("change", "sentence"), [
    ({"parameters": {"stifness": np.ones(3)}}, "'stifness'"),
    ({"parameters": {"stiffness": np.ones((3, 4))}}, "shape"),
    ({"parameters": {"stiffness": np.array([1.0, np.nan])}}, "in 1 of 2 samples it is not"),
    ({"parameters": {"stiffness": np.array([1.0, -1.0])}}, "positive"),
    ({"parameters": {"stiffness": np.ones(3), "damping": np.ones(4)}}, "same number of samples"),
    ({"variables": ("energy",)}, "unknown variable"),
    ({"device": "tpu"}, "device must be one of cpu, gpu, jax, got 'tpu'"),
    ({"time_step": 0.1}, "too long"),
    ({"time_step": -1.0}, "positive"),
    ({"initial_angle": np.zeros(3)}, "initial angles and rates must have the shape"),
    ({"failures": "hide"}, "'raise' or 'mark'"),
])
def test_refusals(paper, change, sentence):
    with pytest.raises(InputError, match=sentence):
        simulate_batch(paper, Pulse(1e4), **{"times": TIMES, **change})


def test_models_of_different_chains_are_refused(paper, awkward):
    with pytest.raises(InputError, match="must share n"):
        simulate_batch([paper, awkward], Pulse(1e4), times=TIMES)


def test_a_batch_beats_the_loop(paper):
    """Loose on purpose: a busy machine; the benchmark gives the number."""
    from time import perf_counter

    stiffness = np.linspace(1.3, 2.0, 64)
    times = np.linspace(0, 2, 20)

    def batch():
        return simulate_batch(paper, Pulse(9e4), parameters={"stiffness": stiffness}, times=times, threads=1)

    def one():
        return simulate(paper, Pulse(9e4), times=times)

    def fastest(job, count):
        took = []
        for _ in range(count):
            began = perf_counter()
            job()
            took.append(perf_counter() - began)
        return min(took[1:])

    assert fastest(batch, 6) / 64 < fastest(one, 20) / 2


def test_bodies_of_several_chambers(paper):
    """Their parameters are those of a fit, each chamber by its name."""
    gains = np.repeat([1.0, 0.0], [2, paper.n - 2])
    low, high = Chamber([6e-7], joint_gain=gains, name="low"), Chamber([-5e-7], joint_gain=1 - gains, name="high")
    body = paper.with_(chambers=(low, high))
    inputs = (Pulse(9e4, 0.1, 0.3), Trace([0.0, 0.2, 0.4], [0.0, 6e4, 1e4]))
    values = {"stiffness": np.array([1.4, 1.6, 1.9]), "high.torque_1": np.array([-5e-7, 3e-7, 1e-7])}
    batch = simulate_batch(body, inputs, parameters=values, times=TIMES, variables=EVERYTHING)
    models = [apply(body, {name: v[i] for name, v in values.items()}) for i in range(3)]
    check_same(batch, models, [inputs] * 3)
    own = [inputs, inputs[::-1]]
    check_same(simulate_batch(models[:2], own, times=TIMES, variables=EVERYTHING), models[:2], own)
    with pytest.raises(InputError, match="needs 2 pressure input"):
        simulate_batch(body, inputs[:1], times=TIMES)
    with pytest.raises(InputError, match="need one set of pressures, or one for each sample, got 2"):
        simulate_batch(models, own, times=TIMES)
    strong = (Pulse(9e6, 0.1, 0.3), inputs[1])
    marked = simulate_batch([body, body.with_(damping=0.0)], strong, times=TIMES, failures="mark")
    assert np.isfinite(marked["failed_at"].values).tolist() == [False, True]
    assert np.isnan(marked["tip_position"].values).all(axis=(1, 2, 3)).tolist() == [False, True]


@pytest.mark.parametrize("memory", [Memory(), Memory(slip_share=(0.2,), slip_angle=(0.02,))], ids=["none", "slip"])
def test_bodies_that_lengthen_have_the_bits_of_single_runs(paper, memory):
    """One chamber or two, one pressure or one each, from given starts too; parameters are those of a fit."""
    beside = Chamber.at_offset(2e-4, 0.02, np.ones(paper.n))
    halves = (Extension(150.0, 0.5, 0.0, 0.08, "near"), Extension(120.0, 0.4, 0.08, None, "far"))
    body = paper.with_(chambers=(beside,), extensions=halves, memory=memory)
    own = [Pulse(9e4, 0.1, 0.3), Trace([0.0, 0.2, 0.4], [0.0, 6e4, 1e4]), Pulse(5e4, 0.0, 0.5)]
    values = {"stiffness": np.array([1.4, 1.6, 1.9]), "far.axial_stiffness": np.array([90.0, 130.0, 100.0])}
    models = [apply(body, {name: v[i] for name, v in values.items()}) for i in range(3)]
    every = (*EVERYTHING, "axial_strain", "axial_strain_rate")

    def same(batch, models, inputs, **start):
        assert list(batch.segment.values) == ["near", "far"]
        for i, model in enumerate(models):
            alone = simulate(model, inputs[i], times=TIMES, **start)
            for name in every:
                np.testing.assert_array_equal(batch[name].values[i], alone[name].values, err_msg=f"{name} of {i}")

    same(simulate_batch(body, own, parameters=values, times=TIMES, variables=every), models, own)
    start = {"initial_angle": np.append(np.full(paper.n, 0.02), [0.05, -0.01]),
             "initial_rate": np.append(np.full(paper.n, -0.1), [0.2, 0.1])}  # fmt: skip
    same(simulate_batch(models, own[0], times=TIMES, variables=every, **start), models, own[:1] * 3, **start)
    pair = body.with_(chambers=(beside, Chamber.at_offset(2e-4, -0.02, np.ones(paper.n), name="other")))
    same(simulate_batch([pair] * 2, own[:2], times=TIMES, variables=every), [pair] * 2, [own[:2]] * 2)
    with pytest.raises(InputError, match="must share the names of their segments"):
        simulate_batch([body, body.with_(extensions=halves[:1])], own[0], times=TIMES)
    with pytest.raises(InputError, match="unknown variable 'axial_strain'"):
        simulate_batch(paper, own[0], times=TIMES, variables=("axial_strain",))


def test_a_law_of_two_powers_rests_under_its_pressure_and_says_its_units(paper):
    law, levels = paper.with_(torque=[1e-6, 4e-12]), (5e4, 9e4)
    runs = [Pulse(level, -1.0, 9.0) for level in levels]
    batch = simulate_batch(law, runs, times=TIMES, time_step=2e-3, variables=EVERYTHING)
    for k, level in enumerate(levels):
        np.testing.assert_allclose(batch["joint_angle"][k, 0], equilibrium(law, level), atol=1e-12)
    assert [batch[name].attrs["units"] for name in EVERYTHING] == ["rad", "rad/s", "m"]
    assert all(batch[name].attrs["long_name"] not in ("", "rad", "rad/s", "m") for name in batch.data_vars
               if name != "failed_at")  # fmt: skip
    assert batch["link"].values.tolist() == [1, 2, 3, 4, 5]


@pytest.mark.parametrize("memory", [Memory(), Memory(slip_share=(0.2,), slip_angle=(0.02,))], ids=["none", "slip"])
def test_a_failure_is_told_with_its_time(paper, memory):
    """The pressure that no spring holds comes at 0.05 s; the step that fails ends soon after."""
    soft = paper.with_(stiffening=-0.45, memory=memory)
    runs = [Pulse(1e4, 0.05, 1.0), Pulse(1e9, 0.05, 1.0)]
    batch = simulate_batch(soft, runs, times=np.arange(31) / 100, time_step=2e-3, failures="mark")
    assert np.isnan(batch["failed_at"][0])
    assert 0.05 < float(batch["failed_at"][1]) < 0.12


@pytest.mark.slow  # compiles the march in space
def test_bodies_in_space_have_the_bits_of_single_runs():
    red, blue = (Chamber([2e-6], joint_gain=np.sin(a), cross_gain=-np.cos(a), name=n)
                 for a, n in ((1.5, "red"), (3.6, "blue")))  # fmt: skip
    body = chain_model(length=0.3, mass=0.1, links=2, stiffness=0.5, damping=5e-3, gravity=(1.0, 0.5, -9.81),
                       chambers=(red, blue), space=Space(stiffness_ratio=1.2))  # fmt: skip
    inputs = (Pulse(3e4, 0.1, 0.3), Trace([0.0, 0.2, 0.4], [0.0, 2e4, 1e4]))
    values = {"stiffness_ratio": np.array([1.1, 0.8]), "blue.torque_1": np.array([1e-6, 3e-6])}
    batch = simulate_batch(body, inputs, parameters=values, times=TIMES, variables=EVERYTHING, time_step=1e-3)
    assert list(batch.axis.values) == ["x", "y", "z"]
    for i in range(2):
        alone = simulate(apply(body, {name: v[i] for name, v in values.items()}), inputs, times=TIMES, time_step=1e-3)
        for name in ("joint_angle_x", "joint_angle_y", "joint_rate_x", "joint_rate_y", "tip_position"):
            np.testing.assert_array_equal(batch[name].values[i], alone[name].values, err_msg=name)
    assert np.abs(batch.joint_angle_y).max() > 0.01
    with pytest.raises(InputError, match="must share their joint coordinates"):
        simulate_batch([body, body.with_(space=Space(twist_ratio=0.7, radius=0.01))], inputs, times=TIMES)


def test_every_name_of_a_fit_is_a_batch_parameter(paper):
    """Names without an array in the vectors of a planar batch change its models one by one."""
    model = paper.with_(
        memory=Memory((0.1,), (0.3,), (0.1,), (0.01,), boucwen_share=0.1),
        valve=Valve(rise_time=0.02, fall_time=0.02, rise_rate=1e7), gravity=[0.0, -9.81],
    )
    values = {"creep_share_1": 0.2, "creep_time_1": 0.2, "slip_share_1": 0.2, "slip_angle_1": 0.02,
              "boucwen_share": 0.2, "valve_rise_rate": 1e6, "gravity_angle": 0.2, "stiffness": 1.6}  # fmt: skip
    for name, value in values.items():
        given = {name: np.array([value])}
        batch = simulate_batch(model, Pulse(3e4), parameters=given, times=TIMES[:10], time_step=2e-3)
        alone = simulate(apply(model, {name: value}), Pulse(3e4), times=TIMES[:10], time_step=2e-3)
        plain = simulate(model, Pulse(3e4), times=TIMES[:10], time_step=2e-3)
        np.testing.assert_allclose(batch.tip_position.values[0], alone.tip_position.values, atol=1e-12, err_msg=name)
        assert np.abs(alone.tip_position.values - plain.tip_position.values).max() > 1e-9, name
    with pytest.raises(InputError, match="unknown batch parameter 'stifness'"):
        simulate_batch(model, Pulse(3e4), parameters={"stifness": [1.0]}, times=TIMES[:10])
    with pytest.raises(InputError, match="needs a chain in space"):
        simulate_batch(model, Pulse(3e4), parameters={"stiffness_ratio": [1.0]}, times=TIMES[:10])
