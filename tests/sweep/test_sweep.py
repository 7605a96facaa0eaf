"""Sweeps: the same samples whoever works on them, nothing lost, nothing twice, told in the end."""

from __future__ import annotations

import os
import resource
import shutil
import signal
import sys
from concurrent.futures import BrokenExecutor, Executor, Future
from dataclasses import replace
from importlib.util import find_spec
from io import BytesIO
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
import xarray as xr

from pliant.errors import InputError, PliantError
from pliant.heavy import HEAVY
from pliant.identification import Parameter, experiment
from pliant.model import Chamber, Space, Tendon, chain_model
from pliant.recording import make_recording
from pliant.simulation import Pulse, simulate
from pliant.sweep import run_sweep, scheduler, store, tasks
from pliant.sweep.spec import fixed, sweep_from, table
from pliant.sweep.sweep import unit_of
from pliant.validation.use_figures import sweep_figure


@pytest.fixture(scope="module")
def done(monte_carlo, paper, tmp_path_factory):
    """The sweep, and the folder that it left."""
    folder = tmp_path_factory.mktemp("whole")
    return run_sweep(monte_carlo, paper, folder), folder


@pytest.fixture(scope="module")
def whole(done):
    """Its samples."""
    return done[0].samples


def test_local_runs_give_the_simulations_of_their_parameters(done, whole, paper):
    (result, folder), samples = done, whole
    assert samples.sizes["sample"] == 22
    for i in (0, 3, 4, 21):
        changes = {k: float(samples[f"parameter_{k}"][i]) for k in ("stiffness", "damping")}
        alone = simulate(paper.with_(**changes), Pulse(5e4), times=samples["time"].values, time_step=2e-3)
        assert samples["tip"].values[i] == pytest.approx(alone["tip_position"].values[:, -1], abs=1e-12)
    assert xr.load_dataset(folder / "samples.nc").equals(samples)
    summary = result.summary()
    assert summary["failed_samples"] == 0
    assert summary["numbers"]["parameter_stiffness"]["median"] == pytest.approx(1.6, abs=0.1)
    assert "6 chunks: 6 computed, 0 already on disk" in summary["message"]


def test_values_depend_on_seed_and_place_alone(monte_carlo):
    whole = table(monte_carlo, 0, 22)
    for first in (0, 7, 21):
        part = table(monte_carlo, first, 22)
        assert all(np.array_equal(part[k], whole[k][first:]) for k in whole)
    other = table(monte_carlo.model_copy(update={"seed": 6}), 0, 22)
    assert not np.array_equal(other["stiffness"], whole["stiffness"])
    assert fixed(monte_carlo) == {"level": 5e4}


def test_a_design_is_every_combination(paper, tmp_path):
    sweep = sweep_from({
        "kind": "design", "chunk": 4, "duration": 0.1, "rate": 50.0,
        "parameters": {"stiffness": {"values": [1.2, 1.6]}, "level": {"low": 1e4, "high": 3e4, "count": 3}},
    })
    samples = run_sweep(sweep, paper, tmp_path).samples
    pairs = list(zip(samples["parameter_stiffness"].values, samples["parameter_level"].values, strict=True))
    assert pairs == [(k, p) for k in (1.2, 1.6) for p in (1e4, 2e4, 3e4)]


def test_it_goes_on_where_it_stopped(done, whole, monte_carlo, paper, tmp_path):
    folder = shutil.copytree(done[1], tmp_path / "parts")
    (folder / "chunks" / "chunk_000002.npz").unlink()
    damaged = folder / "chunks" / "chunk_000004.npz"
    damaged.write_bytes(damaged.read_bytes()[:1000])
    again = run_sweep(monte_carlo, paper, folder)
    assert again.samples.equals(whole)
    assert (again.account.made, again.account.found) == (2, 4)
    assert "2 computed, 4 already on disk" in again.account.sentence()


def test_how_many_samples_make_a_chunk():
    def together(**table):
        return sweep_from({"kind": "monte_carlo", "parameters": {"stiffness": {"low": 1, "high": 2}}, **table}).together

    assert [together(samples=n) for n in (3, 10_000, 10_000_000)] == [128, 312, 4096]
    assert together(samples=10_000, chunk=7) == 7
    assert sweep_from({"kind": "bootstrap", "samples": 50}).together == 1


def test_another_sweep_is_not_mixed_in(done, monte_carlo, paper, tmp_path):
    folder = shutil.copytree(done[1], tmp_path / "other")
    with pytest.raises(InputError, match="another sweep"):
        run_sweep(monte_carlo.model_copy(update={"seed": 9}), paper, folder)
    (folder / "sweep.json").unlink()
    with pytest.raises(InputError, match="another sweep: use another folder, or remove this one"):
        run_sweep(monte_carlo, paper, folder)
    assert len(list((folder / "chunks").iterdir())) == 6


def kill_once(task, chunk):
    """Work that takes its process down in chunk 3, the first time."""
    mark = Path(os.environ["PLIANT_TEST_MARK"])
    if chunk == 3 and not mark.exists():
        mark.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return task.work(chunk)


@pytest.mark.slow
def test_processes_and_a_killed_worker_give_the_same_bits(whole, monte_carlo, paper, tmp_path, monkeypatch):
    monkeypatch.setenv("PLIANT_TEST_MARK", str(tmp_path / "killed"))
    monkeypatch.setattr(scheduler, "work", kill_once)
    told = []
    broken = run_sweep(
        monte_carlo, paper, tmp_path / "b", scheduler="processes", workers=2, progress=told.append
    )
    assert (tmp_path / "killed").exists()
    assert broken.samples.equals(whole)
    assert broken.account.restarts == 1
    assert "workers failed 1 time" in broken.account.sentence()
    assert any("submitted again" in line for line in told)


class Dying(Executor):
    """Workers that die of every job."""

    def submit(self, fn, /, *args, **kwargs):
        future = Future()
        future.set_exception(BrokenExecutor("a worker died"))
        return future


def test_workers_that_always_die_end_the_sweep(monte_carlo, paper, tmp_path):
    with pytest.raises(PliantError, match="without delivering a chunk"):
        run_sweep(monte_carlo, paper, tmp_path, make_executor=Dying)


def test_a_disk_that_takes_no_more_is_told_and_loses_nothing(whole, monte_carlo, paper, tmp_path):
    """The system itself refuses the fourth file, as a full disk does."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)

    def fill(line):
        if line.startswith("chunk 2 written"):
            resource.setrlimit(resource.RLIMIT_FSIZE, (1024, before[1]))

    try:
        with pytest.raises(PliantError, match=r"cannot write .*chunk_000003\.npz: File too large.*the same sweep"):
            run_sweep(monte_carlo, paper, tmp_path / "a", progress=fill)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    names = sorted(p.name for p in (tmp_path / "a" / "chunks").iterdir())
    assert names == [f"chunk_{k:06d}.npz" for k in range(3)]
    again = run_sweep(monte_carlo, paper, tmp_path / "a")
    assert again.account.found == 3
    assert again.samples.equals(whole)


def test_failed_samples_are_counted(paper, tmp_path):
    sweep = sweep_from({
        "kind": "design", "chunk": 8, "duration": 0.1, "rate": 50.0,
        "parameters": {"level": {"values": [1e4, 1e9, 2e4]}},
    })
    result = run_sweep(sweep, paper, tmp_path)
    assert result.samples["failed"].values.tolist() == [False, True, False]
    assert np.isnan(result.samples["tip"].values[1]).all()
    assert result.summary()["failed_samples"] == 1


@pytest.fixture(scope="module")
def recorded(paper):
    """A recording of the paper's pulse with noise, and the parameters to fit."""
    times = np.arange(0, 1.2, 0.01)
    pulse = Pulse(9e4, 0.1, 0.6)
    tips = simulate(paper, pulse, times=times, time_step=1e-3)["tip_position"].values
    noisy = tips + 2e-4 * np.random.default_rng(4).standard_normal(tips.shape)
    recording = make_recording(
        times, noisy, station=[p.name for p in paper.points], frame="planar",
        pressure_time=np.array([0, 0.0999, 0.1, 0.7, 0.7001, 1.2]),
        pressure=np.array([0, 0, 9e4, 9e4, 0, 0]), source="test",
    )
    return experiment("pulse", recording), [Parameter("stiffness", 1.7), Parameter("damping", 9e-3)]


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["bootstrap", "multi_start"])
def test_fits_are_repeated(kind, recorded, paper, tmp_path):
    record, parameters = recorded
    sweep = sweep_from({"kind": kind, "samples": 6, "chunk": 2, "seed": 3})
    options = {"time_step": 2e-3, "loss": "linear", "weighting": "travel"}
    given = {"experiments": [record], "parameters": parameters, "fit_options": options}
    found = run_sweep(sweep, paper, tmp_path, **given).samples
    assert not found["failed"].any()
    spread = float(found["parameter_stiffness"].std())
    assert found["parameter_stiffness"].values == pytest.approx(1.6067, rel=0.01)
    if kind == "multi_start":
        assert spread < 1e-3
    else:
        assert 1e-6 < spread < 1e-2
    part = tasks.SweepTask(sweep, paper, (record,), tuple(parameters), options, None).work(1) \
        if kind == "multi_start" else None
    if part is not None:
        assert np.array_equal(part["parameter_damping"], found["parameter_damping"].values[2:4])


@pytest.mark.parametrize(("content", "sentence"), [
    ({"kind": "monte_carlo", "samples": 3}, "needs parameters"),
    ({"kind": "monte_carlo", "parameters": {"stiffness": {"low": 1, "high": 2}}}, "needs samples"),
    ({"kind": "design", "parameters": {"stiffness": {"low": 1, "high": 2}}}, "low, high and count"),
    ({"kind": "design", "samples": 3, "parameters": {"stiffness": {"values": [1]}}}, "leave samples out"),
    ({"kind": "bootstrap", "samples": 3, "parameters": {"stiffness": 1}}, "from the fit"),
    ({"kind": "design", "parameters": {"stiffness": {"low": 2, "high": 1, "count": 3}}}, "not below"),
    ({"kind": "guess"}, "kind"),
    ({"kind": "design", "parameters": {"stiffness": {"values": [1]}}, "typo": 1}, "typo"),
])
def test_refused_tables(content, sentence):
    with pytest.raises(InputError, match=sentence):
        sweep_from(content)


@pytest.mark.skipif(find_spec("distributed") is None, reason="the extra 'scale' is not installed")
def test_dask_is_found_although_the_program_hides_it(monkeypatch):
    for name in HEAVY:
        monkeypatch.setitem(sys.modules, name, None)
    monkeypatch.setitem(sys.modules, "distributed", ModuleType("distributed"))  # the real one takes a second to import
    scheduler.executor_of("tcp://127.0.0.1:1")
    assert not [name for name in HEAVY if sys.modules.get(name, True) is None]


def test_refused_before_anything_runs(monte_carlo, paper, tmp_path):
    with pytest.raises(InputError, match="scheduler must be"):
        run_sweep(monte_carlo, paper, tmp_path, scheduler="cloud")
    wrong = sweep_from({"kind": "design", "parameters": {"stifness": {"values": [1.0]}}})
    with pytest.raises(InputError, match="'stifness'"):
        run_sweep(wrong, paper, tmp_path)
    with pytest.raises(InputError, match="recordings of a fit"):
        run_sweep(sweep_from({"kind": "bootstrap", "samples": 2}), paper, tmp_path)


def test_a_folder_that_cannot_be_written(monte_carlo, paper, tmp_path):
    file = tmp_path / "file"
    file.touch()
    with pytest.raises(InputError, match="cannot write"):
        run_sweep(monte_carlo, paper, file)


def test_missing_chunks_are_never_papered_over(tmp_path):
    kept = store.Store(tmp_path, {"a": 1})
    kept.save(0, 0, {"x": np.arange(2.0)})
    with pytest.raises(PliantError, match="chunk 1"):
        kept.combine([(0, 2), (2, 4)])


def test_every_bit_of_a_chunk_counts(tmp_path):
    """A flipped bit anywhere is seen by the checksum: the chunk counts as absent, and a sweep makes it again."""
    kept = store.Store(tmp_path, {"a": 1})
    kept.save(0, 0, {"tip": np.arange(60.0).reshape(4, 15)})
    data = kept.path(0).read_bytes()
    assert kept.load(0, 0, 4) is not None
    end = len(data) - 79  # behind it stands the checksum
    for place in np.random.default_rng(3).integers(0, end, 60):
        broken = bytearray(data)
        broken[place] ^= 1 << int(place % 8)
        kept.path(0).write_bytes(broken)
        assert kept.load(0, 0, 4) is None, place
    kept.path(0).write_bytes(data[:end])
    assert kept.load(0, 0, 4) is None


class Creates:
    """An object whose pickle creates a file when somebody loads it."""

    def __init__(self, path):
        self.path = str(path)

    def __reduce__(self):
        return open, (self.path, "w")


@pytest.mark.parametrize("entries", [
    lambda marker: {"x": np.array([Creates(marker)] * 2, dtype=object)}, lambda _: {"sample": np.arange(3)},
    lambda _: {"sample": np.array(["a", "b"])}, lambda _: {"sweep": np.array("other")},
    lambda _: {"sweep": np.arange(9.0)}, lambda _: {"x": np.array([1j, 2j])}, lambda _: {"x": np.arange(3.0)},
    lambda _: {"x": np.float64(3)},
])  # fmt: skip
def test_a_chunk_that_somebody_made_is_made_again(tmp_path, entries):
    """Its checksum is right, as anybody can write one; nothing in it is run; numbers and texts alone are taken."""
    kept = store.Store(tmp_path / "sweep", {"a": 1})
    right = {"sweep": np.array([kept.key, "0"]), "sample": np.arange(2), "x": np.arange(2.0)}
    for made, found in ((right, True), ({**right, **entries(tmp_path / "marker")}, False)):
        content = BytesIO()
        np.savez(content, **made)
        store.write_sealed(content, kept.path(0))
        assert (kept.load(0, 0, 2) is not None) == found
    assert not (tmp_path / "marker").exists()


def arms():
    """Opposite chambers on the two halves of a body."""
    halves = [Chamber(torque=[1.2e-6], joint_gain=[1.0, 1.0, 0.0, 0.0], name="low"),
              Chamber(torque=[0.9e-6], joint_gain=[0.0, 0.0, -1.0, -1.0], name="high")]  # fmt: skip
    body = chain_model(length=0.16, mass=0.06, links=4, stiffness=1.2, damping=6e-3, torque=[0.0])
    return body.with_(chambers=halves)


@pytest.mark.slow
def test_a_sweep_of_two_chambers_is_its_simulations(tmp_path):
    """Levels and laws of single chambers, against the reference solver; a chamber that is not named rests."""
    sweep = {
        "kind": "design", "chunk": 3, "duration": 0.3, "rate": 50.0, "time_step": 5e-4,
        "parameters": {"low.level": {"values": [2e4, 4e4]}, "high.level": {"values": [0.0, 5e4]}, "high.start": 0.1,
                       "high.torque_1": {"values": [0.9e-6, 1.8e-6]}, "stiffness": 1.1},
    }
    samples = run_sweep(sweep, arms(), tmp_path / "both").samples
    assert samples.sizes["sample"] == 8
    assert not samples["failed"].any()
    assert [samples[f"parameter_{name}"].units for name in ("low.level", "high.torque_1")] == ["Pa", "N m/Pa^k"]
    for i in (1, 3, 6):
        low, high, law = (float(samples[f"parameter_{k}"][i]) for k in ("low.level", "high.level", "high.torque_1"))
        one, two = arms().chambers
        model = arms().with_(stiffness=1.1, chambers=[one, replace(two, torque=[law])])
        alone = simulate(model, [Pulse(low), Pulse(high, 0.1)], times=samples["time"].values, method="Radau")
        assert samples["tip"].values[i] == pytest.approx(alone["tip_position"].values[:, -1], abs=2e-5)
    sweep = {"kind": "monte_carlo", "samples": 2, "duration": 0.1, "parameters": {"stiffness": {"values": [1.1]}}}
    with pytest.raises(InputError, match=r"needs the level of at least one: low\.level"):
        run_sweep(sweep, arms(), tmp_path / "still")
    sweep["parameters"] |= {"middle.level": 3e4, "low.level": 2e4}
    with pytest.raises(InputError, match=r"middle\.level"):
        run_sweep(sweep, arms(), tmp_path / "unknown")
    del sweep["parameters"]["middle.level"]
    sweep["parameters"] |= {"middle.torque_1": 1e-6}
    with pytest.raises(InputError, match=r"has no effect on this model, whose chambers are low, high"):
        run_sweep(sweep, arms(), tmp_path / "nobody")


@pytest.mark.slow  # compiles the march in space
def test_a_sweep_in_space_keeps_three_coordinates_of_the_tip(tmp_path):
    pulled = Chamber([2e-6], joint_gain=0.6, cross_gain=-0.8, name="own")
    body = chain_model(length=0.3, mass=0.1, links=2, stiffness=0.5, damping=5e-3, gravity=(0.0, 0.0, -9.81),
                       chambers=(pulled,), space=True)  # fmt: skip
    sweep = {"kind": "design", "duration": 0.2, "rate": 50.0, "time_step": 2e-3,
             "parameters": {"stiffness_ratio": {"values": [0.8, 1.4]}, "level": 3e4}}
    samples = run_sweep(sweep, body, tmp_path).samples
    assert list(samples.axis.values) == ["x", "y", "z"]
    for i, ratio in enumerate((0.8, 1.4)):
        own = body.with_(space=Space(stiffness_ratio=ratio))
        alone = simulate(own, Pulse(3e4, 0.0), times=np.arange(11) / 50.0, time_step=2e-3)
        np.testing.assert_array_equal(samples.tip.values[i], alone.tip_position.values[:, -1])
    assert sweep_figure(samples).axes[-1].get_legend_handles_labels()[1][-1] == "tip z, median and 95 %"


def test_levels_of_tendons_are_in_their_own_units(tmp_path):
    """No common level for a displacement and a tension, and no default of 119 kPa for a tendon alone."""
    same = {"joint_gain": [-1.0, -1.0], "cross_gain": [0.0, 0.0], "lever": 8e-3}
    cords = [Tendon(**same, name="long", driven_by="displacement", line_stiffness=2e3), Tendon(**same, name="pull")]
    model = chain_model(length=0.2, mass=0.05, links=2, stiffness=0.3, damping=4e-3, space=Space(), chambers=cords)
    sweep = {"kind": "design", "duration": 0.1, "rate": 20.0}

    def refused(body, **parameters):
        with pytest.raises(InputError) as error:
            run_sweep(sweep_from({**sweep, "parameters": parameters}), body, tmp_path / "no")
        return str(error.value)

    stiff = {"values": [0.3, 0.4]}
    assert "a sweep of several inputs needs the level of at least one: long.level, in m" in refused(
        model, stiffness=stiff)
    assert "no common level: give some of long.level [m], pull.level [N]" in refused(model, level={"values": [0.1, 1]})
    alone = model.with_(chambers=cords[1:])
    assert "a sweep of a tendon needs its level: pull.level, in N" in refused(alone, stiffness=stiff)
    names = ("parameter_long.level", "parameter_pull.level", "parameter_level", "parameter_stiffness", "tip")
    assert [unit_of(name, model) for name in names] == ["m", "N", "m", "N m/rad", "m"]
