"""Parts of a batch against single models: groups, samples, schedules, what is kept of whom, and what is refused."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from pliant.batch import simd
from pliant.batch.batch import check_choices, check_steps, initial_state, labelled, one_by_one, simulate_batch
from pliant.batch.one_by_one import check_names, dimensions, samples_alone, sets_of
from pliant.batch.samples import gather, repeated
from pliant.batch.simd import Groups, Schedule, constant_arrays, in_groups, outputs
from pliant.batch.stepper import batch_stepper, pool_of
from pliant.compiler import WIDTH
from pliant.errors import InputError, SimulationError
from pliant.identification.parameters import apply
from pliant.mechanics import mechanics_of
from pliant.model import Chamber, Extension, Memory, Valve, chain_model
from pliant.simulation import Pulse, equilibrium, modes
from pliant.simulation.solve import STEPS_PER_PERIOD

pytestmark = pytest.mark.slow  # kernels of their own are compiled first

TIMES = np.arange(9) / 100
PULSE = Pulse(2e4, 0.02)


def marked(count):
    """Samples that are nothing but their count, in groups of eight."""
    return SimpleNamespace(size=count, template=SimpleNamespace(n=2))


@pytest.mark.parametrize(("count", "groups"), [(1, 1), (WIDTH - 1, 1), (WIDTH, 1), (WIDTH + 1, 2), (2 * WIDTH + 3, 3)])
def test_the_last_group_repeats_its_last_sample(count, groups, monkeypatch):
    a = np.arange(3 * count).reshape(3, count)
    made = in_groups(a)
    assert made.shape == (groups, 3, WIDTH)
    for k in range(groups * WIDTH):
        np.testing.assert_array_equal(made[k // WIDTH, :, k % WIDTH], a[:, min(k, count - 1)])
    monkeypatch.setattr(Groups, "prepare", lambda _: None)
    taken = Groups(marked(count), None, None, {})
    assert taken.count == groups
    own, members = taken.members(groups - 1)
    first = (groups - 1) * WIDTH
    assert (own.start, own.stop) == (first, count)
    assert members == [min(k, count - 1) for k in range(first, first + WIDTH)]
    assert list(taken.left) == [*range(groups)]
    assert list(taken.left) == []


def test_rooms_of_what_is_kept():
    made = outputs(marked(3), 5, ("joint_rate", "tip_position"))
    assert {k: v.shape for k, v in made.items()} == {
        "joint_rate": (3, 5, 2),
        "tip_position": (3, 5, 2, 2),
        "failed_at": (3,),
    }
    assert np.isnan(made["failed_at"]).all()


def test_constants_of_samples_are_those_of_their_models(awkward):
    models = [
        awkward.with_(stiffness=awkward.stiffness * k, base_length=0.01 * k, base_angle=0.1 * k) for k in (1.0, 2.0)
    ]
    samples = gather(models, None, 1)
    B, inertia, h, gravity, joints, place = constant_arrays(samples)
    for i, model in enumerate(models):
        chain = mechanics_of(model)
        np.testing.assert_allclose(B[..., i], chain.body.B)
        np.testing.assert_allclose(inertia[..., i], chain.body.I)
        np.testing.assert_allclose(h[..., i], chain.body.h)
        np.testing.assert_allclose(gravity[..., i], model.gravity)
        np.testing.assert_allclose(joints[0, :, i], model.rest_angle)
        np.testing.assert_allclose(joints[1, :, i], model.stiffness)
        np.testing.assert_allclose(joints[2, :, i], model.damping)
        np.testing.assert_allclose(joints[3, :, i], model.joint_gain)
        n = model.n
        np.testing.assert_allclose(place[:, i], [*model.link_length, *model.first_joint, model.base_angle])
        assert place.shape[0] == n + 3
        assert samples.model(i) == model
        np.testing.assert_allclose(
            samples.rest(np.array([1e4, 2e4]))[:, i], equilibrium(model, [1e4, 2e4][i]), atol=1e-9
        )
        q = 0.1 * np.arange(n)
        np.testing.assert_allclose(samples.absolute(np.stack([q, q], 1))[:, i], mechanics_of(model).coordinates(q))


def test_samples_without_gravity_rest_by_their_springs(paper):
    law = paper.with_(torque=[1e-6, 4e-12])
    samples = gather([law, law.with_(stiffness=3.0)], None, 1)
    for p in (np.array([0.0, 0.0]), np.array([3e4, 6e4])):
        expected = [equilibrium(samples.model(i), p[i]) for i in range(2)]
        np.testing.assert_allclose(samples.rest(p).T, expected, atol=1e-10)
    np.testing.assert_allclose(
        samples.torque_at(np.array([3e4, 6e4])), [1e-6 * 3e4 + 4e-12 * 9e8, 1e-6 * 6e4 + 4e-12 * 36e8]
    )
    soft = gather([paper.with_(stiffening=-2.0)] * 3, None, 1)
    with pytest.raises(SimulationError, match="in 2 of 3 samples the softening springs"):
        soft.rest(np.array([0.0, 5e6, 5e6]))


@pytest.mark.parametrize(
    "name",
    [
        "stiffness",
        "stiffness_2",
        "damping_1",
        "torque_1",
        "torque_3",
        "mass",
        "gain",
        "valve_rise_time",
        "valve_fall_time",
        "valve_dead_time",
        "tip_mass",
        "base_angle",
    ],
)
def test_a_parameter_of_a_batch_is_that_of_a_fit(paper, name):
    values = {"mass": [0.04, 0.09], "gain": [0.5, 2.0], "torque_3": [1e-18, 2e-18], "torque_1": [1e-6, 2e-6],
              "tip_mass": [0.001, 0.002], "base_angle": [0.1, -0.2]}.get(name, [0.02, 0.03])  # fmt: skip
    samples = repeated(paper, {name: np.array(values)}, 1)
    assert samples.size == 2
    for i in range(2):
        expected = apply(paper, {name: values[i]})
        found = samples.model(i)
        if name in ("mass", "gain"):
            np.testing.assert_allclose(found.link_mass, expected.link_mass)
            np.testing.assert_allclose(found.joint_gain, expected.joint_gain)
        else:
            assert found == expected


def test_samples_that_do_not_fit_together(paper):
    n = paper.n
    for given, said in (
        ({f"stiffness_{n + 1}": np.ones(2)}, f"unknown batch parameter 'stiffness_{n + 1}'"),
        ({"stiffness_0": np.ones(2)}, "stiffness_0"),
        ({"torque_0": np.ones(2)}, "torque_0"),
        ({"stiffness": np.ones((2, n + 1))}, rf"for a property of each link, got shape \(2, {n + 1}\)"),
        ({"damping": np.array([1.0, np.inf, np.nan])}, "damping must be finite: in 2 of 3 samples"),
        ({"damping": np.array([0.1, -0.1])}, "must not be negative"),
        ({"stiffness": np.array([1.0, 0.0])}, "positive"),
    ):
        with pytest.raises(InputError, match=said):
            repeated(paper, given, 1)
    with pytest.raises(InputError, match="same number of samples"):
        repeated(paper, {"stiffness": np.ones(3)}, 2)
    assert repeated(paper, {}, 4).size == 4
    assert repeated(paper, {}, 1).size == 1
    assert repeated(paper, {"stiffness": 2.0}, 1).size == 1
    each = np.arange(1.0, 2 * n + 1).reshape(2, n)
    np.testing.assert_allclose(repeated(paper, {"stiffness": each}, 1).model(1).stiffness, each[1])
    both = repeated(paper, {"stiffness_2": np.array([9.0, 8.0]), "stiffness": np.array([1.0, 2.0])}, 1)
    assert both.model(0).stiffness.tolist() == [1.0, 9.0, *[1.0] * (n - 2)]  # what holds for one joint comes last
    with pytest.raises(InputError, match="not both"):
        gather([paper], {"stiffness": np.ones(2)}, 1)
    with pytest.raises(InputError, match="at least one model"):
        gather([], None, 1)
    other = {"rod": "tip", "tip": "rod"}[paper.mass_at]
    for change in ({"mass_at": other}, {"memory": Memory((0.1,), (1.0,))}):
        with pytest.raises(InputError, match=f"must share {next(iter(change))}"):
            gather([paper, paper.with_(**change)], None, 1)
    with pytest.raises(InputError, match="fixed length"):
        gather([paper.with_(extensions=(Extension(50.0),))], None, 1)
    longer = gather([paper, paper.with_(torque=[1e-6, 2e-12, 3e-18])], None, 1)
    np.testing.assert_allclose(longer.values["torque"], np.array([[*paper.torque, 0, 0][:3], [1e-6, 2e-12, 3e-18]]).T)


@pytest.mark.parametrize(("part", "good"), [(0.99, True), (1.01, False)])
def test_a_step_draws_the_first_mode_of_every_sample(paper, part, good):
    stiff = paper.with_(stiffness=paper.stiffness * 4)
    samples = gather([paper, stiff, stiff], None, 1)
    first = modes(stiff)[0][0]
    np.testing.assert_allclose(samples.first_frequency(), [modes(paper)[0][0], first, first], rtol=1e-9)
    assert samples.highest_first_frequency() > first
    step = part / (STEPS_PER_PERIOD * first)
    if good:
        check_steps(samples, step)
        return
    longest = 1e3 / (STEPS_PER_PERIOD * first)
    with pytest.raises(
        InputError, match=rf"too long for 2 of 3 samples: .* rings at {first:.3g} Hz; .* {longest:.3g} ms"
    ):
        check_steps(samples, step)
    for wrong in (0.0, -1e-3, np.nan, np.inf):
        with pytest.raises(InputError, match="positive time in seconds"):
            check_steps(samples, wrong)


def test_samples_start_at_rest_or_where_they_are_told(paper):
    n = paper.n
    two = Pulse(3e4, -1.0, 9.0), Pulse(6e4, -1.0, 9.0)
    samples = gather([paper] * 2, None, 1)
    start = initial_state(samples, Schedule(samples, two, TIMES, 1e-3), None, None)
    for i, pulse in enumerate((3e4, 6e4)):
        np.testing.assert_allclose(
            start[0, :, i], mechanics_of(paper).coordinates(equilibrium(paper, pulse)), atol=1e-9
        )
    assert not start[1].any()
    one = initial_state(samples, Schedule(samples, two[:1], TIMES, 1e-3), None, np.ones(n))
    np.testing.assert_allclose(one[0, :, 0], one[0, :, 1])
    np.testing.assert_allclose(one[1], np.tile(np.arange(1.0, n + 1)[:, None], (1, 2)))  # rates of joints add up
    q = np.arange(2.0 * n).reshape(2, n) / 10
    told = initial_state(samples, Schedule(samples, two, TIMES, 1e-3), q, None)
    np.testing.assert_allclose(told[0], np.cumsum(q, axis=1).T)
    shape = rf"must have the shape \({n},\) or \(2, {n}\), got shape \("
    finite = f"must be finite, but {n} of {n} are not"
    for wrong, words in ((np.zeros(n + 1), shape), (np.zeros((3, n)), shape), (np.full(n, np.nan), finite)):
        with pytest.raises(InputError, match=f"initial angles and rates {words}"):
            initial_state(samples, Schedule(samples, two, TIMES, 1e-3), wrong, None)


def test_a_schedule_shares_steps_of_inputs_that_jump_at_the_same_times(paper):
    samples = gather([paper] * 3, None, 1)
    pulses = (Pulse(1e4, 0.02, 0.03), Pulse(2e4, 0.02, 0.03), Pulse(1e4, 0.021, 0.03))
    plan = Schedule(samples, pulses, TIMES, 2e-3)
    assert plan.grid(0) is plan.grid(1)
    assert plan.grid(0) is not plan.grid(2)
    grid = plan.grid(0)
    np.testing.assert_allclose(grid.steps.sum(axis=0), TIMES[-1])
    np.testing.assert_allclose(grid.intervals.sum(axis=0), TIMES[-1])
    assert grid.steps.max() <= 2e-3 * (1 + 1e-9)
    ends = np.cumsum(grid.steps[:, 0])
    for row, time in zip(range(1, 9), TIMES[1:], strict=True):
        assert ends[np.flatnonzero(grid.keep == row)[0]] == pytest.approx(time)
    h, torque, keep = plan.group([0, 1, 1, 0, 0, 0, 0, 0][:WIDTH])
    assert h is grid.steps
    middle = np.cumsum(h[:, 0]) - 0.5 * h[:, 0]
    on = (middle > 0.02) & (middle < 0.05)
    for lane, level in ((0, 1e4), (1, 2e4)):
        np.testing.assert_allclose(torque[on, lane], float(paper.torque_at(level)))
        assert not torque[~on, lane].any()
    h, torque, keep = plan.group([0, 2, 2, 0, 0, 0, 0, 0][:WIDTH])  # of other steps: the shorter ones rest
    np.testing.assert_allclose(h.sum(axis=0), TIMES[-1])
    assert (h[:, 0] == 0).any() or (h[:, 1] == 0).any()
    assert np.flatnonzero(keep >= 0).size == 8
    for lane in (0, 1):
        np.testing.assert_allclose(np.cumsum(h[:, lane])[keep >= 0], TIMES[1:], atol=1e-12)
        impulse = float(paper.torque_at(1e4)) * 0.03
        assert (h[:, lane] * torque[:, lane]).sum() == pytest.approx(impulse)
    assert plan.initial(0) == 0.0
    assert Schedule(samples, (Pulse(5e4, -1.0, 9.0),), TIMES, 1e-3).initial(2) == 5e4


def test_who_is_marched_alone(paper):
    memory, longer = paper.with_(memory=Memory((0.1,), (1.0,))), paper.with_(extensions=(Extension(50.0),))
    two = paper.with_(chambers=(Chamber([1e-6], name="a"), Chamber([1e-6], name="b")))
    assert [one_by_one(m) for m in (paper, memory, longer, two)] == [False, False, True, True]
    assert one_by_one([paper, longer])
    assert not one_by_one([paper, paper])
    assert list(dimensions(paper)) == ["joint_angle", "joint_rate", "tip_position"]
    assert dimensions(longer)["axial_strain"] == ("sample", "time", "segment")
    assert sets_of(paper, PULSE) == [(PULSE,)]
    assert sets_of(paper, [PULSE, PULSE]) == [(PULSE,), (PULSE,)]
    assert sets_of(two, [PULSE, PULSE]) == [(PULSE, PULSE)]
    assert sets_of([two, two], [[PULSE, PULSE], [PULSE, PULSE]]) == [(PULSE, PULSE)] * 2
    assert sets_of([], [PULSE]) == [(PULSE,)]
    made, sets = samples_alone(two, [(PULSE, PULSE)], {"stiffness": [1.0, 2.0], "b.torque_1": [1e-6, 2e-6]})
    assert [m.stiffness[0] for m in made] == [1.0, 2.0]
    assert [m.chambers[1].torque[0] for m in made] == [1e-6, 2e-6]
    assert len(sets) == 2
    assert len(samples_alone(two, [(PULSE, PULSE)] * 3, None)[0]) == 3
    for models, given, parameters, said in (
        (two, [(PULSE, PULSE)], {"stiffness": [[1.0]]}, "one number for each sample"),
        (two, [(PULSE, PULSE)], {"stiffness": [1.0, 2.0], "damping": [0.1]}, "same number of samples"),
        ([two], [(PULSE, PULSE)], {"stiffness": [1.0]}, "not both"),
        (
            two,
            [(PULSE, PULSE)] * 3,
            {"stiffness": [1.0, 2.0]},
            "2 samples need one set of pressures, or one for each sample, got 3",
        ),
        (two, [(PULSE,)], {"stiffness": [1.0]}, "needs 2 pressure input"),
        (two, [(PULSE, PULSE)], {"c.torque_1": [1.0]}, "has no effect on this model, whose chambers are a, b"),
        (two, [(PULSE, PULSE)], {"swing": [1.0]}, "swing"),
    ):
        with pytest.raises(InputError, match=said):
            samples_alone(models, given, parameters)
    check_names(two, {"stiffness": 1.0, "a.torque_1": 1e-6, "tip_mass": 0.0})


def test_choices_and_labels(paper):
    check_choices(("joint_angle",), "cpu", "mark")
    for given, said in (
        (
            (("joint_angle", "heat"), "cpu", "raise"),
            "unknown variable 'heat': .* can keep joint_angle, joint_rate, tip_position",
        ),
        (((), "cpu", "hide"), "'raise' or 'mark', got 'hide'"),
        (((), "tpu", "raise"), "device must be one of cpu, gpu, jax, got 'tpu'"),
    ):
        with pytest.raises(InputError, match=said):
            check_choices(*given)
    made = {"joint_angle": np.ones((3, 9, paper.n)), "failed_at": np.array([np.nan, 0.0312345678, 0.05])}
    with pytest.raises(SimulationError, match=r"2 of 3 samples fail, sample 1 at 0\.0312346 s"):
        labelled(paper, TIMES, {**made}, "raise", {})
    ds = labelled(paper, TIMES, {**made}, "mark", {"step_s": 1e-3})
    assert np.isnan(ds["joint_angle"].values).all(axis=(1, 2)).tolist() == [False, True, True]
    assert ds.attrs["failed_samples"] == 2
    assert ds.attrs["step_s"] == 1e-3
    assert ds["sample"].values.tolist() == [0, 1, 2]
    assert ds["link"].values.tolist() == list(range(1, paper.n + 1))
    assert ds["failed_at"].attrs["units"] == "s"
    samples = [paper] * 3
    with pytest.raises(InputError, match="3 samples need one pressure, or one for each sample, got 2"):
        simulate_batch(samples, [PULSE, PULSE], times=TIMES)


def test_what_is_kept_is_what_is_asked_for(paper):
    every = simulate_batch([paper] * 2, PULSE, times=TIMES, variables=("joint_angle", "joint_rate", "tip_position"))
    for name in ("joint_angle", "joint_rate", "tip_position"):
        one = simulate_batch([paper] * 2, PULSE, times=TIMES, variables=(name,))
        assert [k for k in one.data_vars] == [name, "failed_at"]  # noqa: C416
        np.testing.assert_array_equal(one[name], every[name])
    late = simulate_batch([paper] * 2, [Pulse(1e4), Pulse(1e9, 0.06)], times=5.0 + TIMES, failures="mark", variables=())
    assert np.isnan(late["failed_at"][0])
    at = simulate_batch(
        [paper] * 2, [Pulse(1e4, 5.0), Pulse(1e9, 5.05)], times=5.0 + TIMES, failures="mark", variables=()
    )
    assert np.isnan(at["failed_at"][0])
    assert 5.05 < float(at["failed_at"][1]) < 5.08


def test_errors_of_a_thread_reach_the_caller(paper, monkeypatch):
    def fail(self, group, *_):
        raise ZeroDivisionError(group)

    monkeypatch.setattr(Groups, "run", fail)
    samples = gather([paper] * (WIDTH + 1), None, 1)
    plan = Schedule(samples, (PULSE,), TIMES, 1e-3)
    start = initial_state(samples, plan, None, None)
    for threads in (1, 2, 7):
        with pytest.raises(ZeroDivisionError):
            simd.run_lanes(samples, plan, start, ("joint_angle",), threads)


def test_a_pool_of_bodies_is_what_each_of_them_is(paper):
    soft = paper.with_(torque=[1e-6, 2e-12], valve=Valve(rise_time=0.05), gravity=[1.0, -9.0], swell_share=0.2)
    pool = pool_of([paper, soft])
    for k, model in enumerate((paper, soft)):
        chain = mechanics_of(model)
        np.testing.assert_allclose(
            pool["state"][k], [chain.coordinates(equilibrium(model, 0.0)), np.zeros(model.n)], atol=1e-9
        )
        np.testing.assert_allclose(pool["B"][k], chain.body.B)
        np.testing.assert_allclose(pool["gravity"][k], model.gravity)
        np.testing.assert_allclose(pool["joints"][k, :3], [model.rest_angle, model.stiffness, model.damping])
        np.testing.assert_allclose(pool["place"][k], [*model.link_length, *model.first_joint, model.base_angle])
        np.testing.assert_allclose(pool["law"][k, 0, : model.torque.size], model.torque)
        assert not pool["law"][k, 0, model.torque.size :].any()
        np.testing.assert_allclose(pool["slow"][k], model.actuation.rest_state(0.0))
    assert not pool["pressure"].any()


@pytest.mark.parametrize("size", [1, WIDTH, WIDTH + 1])
def test_a_stepper_of_any_size_holds_its_chains(paper, size):
    made = batch_stepper([paper], size, 1e-3)
    pressure = np.linspace(1e4, 5e4, size)[:, None]
    assert not made.hold(pressure, 10).any()
    assert made.position.shape == made.velocity.shape == (size, paper.n)
    if size > 1:
        assert np.all(np.diff(made.position[:, -1]) > 0)  # the more pressure, the farther


def test_bodies_of_a_stepper_all_remember_or_none(paper):
    memory = Memory(slip_share=(0.3,), slip_angle=(0.02,))
    other = Memory(slip_share=(0.2,), slip_angle=(0.02,))
    both = batch_stepper([paper.with_(memory=memory), paper.with_(memory=other)], 2, 1e-3)
    assert both.position.shape == (2, paper.n)
    with pytest.raises(InputError, match="must share memory"):
        batch_stepper([paper.with_(memory=memory), paper], 2, 1e-3)


def test_bodies_alone_fail_at_their_time_and_start_where_told(paper):
    body = chain_model(length=0.2, mass=0.05, links=paper.n, stiffness=1.0, damping=0.01,
                       chambers=(Chamber([1e-6], name="a"), Chamber([1e-6], name="b")))  # fmt: skip
    strong = [(Pulse(1e4, 5.02), Pulse(0.0)), (Pulse(1e9, 5.05), Pulse(0.0))]
    found = simulate_batch([body] * 2, strong, times=5.0 + TIMES, time_step=1e-3, failures="mark")
    assert np.isnan(found["failed_at"][0])
    assert 5.05 < float(found["failed_at"][1]) < 5.08
    n = body.n
    message = rf"initial angles and rates must have the shape \({n},\) or \(2, {n}\), got shape \(1,\)"
    with pytest.raises(InputError, match=message):
        simulate_batch([body] * 2, strong, times=TIMES, initial_angle=np.zeros(1))
    q = np.stack([np.full(n, 0.01), np.full(n, 0.02)])
    told = simulate_batch([body] * 2, [(Pulse(0.0), Pulse(0.0))] * 2, times=TIMES, initial_angle=q, initial_rate=q)
    np.testing.assert_allclose(told["joint_angle"].values[:, 0], q)
