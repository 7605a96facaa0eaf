"""Batches in the JAX module of the models, on JAX's processor: the motion of a batch of pliant; what is refused."""

from __future__ import annotations

import json

import numpy as np
import pytest
from command_line import invoke

from pliant.actuators import chen2018
from pliant.batch import batch as devices
from pliant.batch import simulate_batch
from pliant.errors import InputError
from pliant.exporters import jax_batch, jax_rollouts
from pliant.model import Memory, Valve, save_model
from pliant.simulation import Pulse, simulate
from pliant.sweep import run_sweep

jax = pytest.importorskip("jax", reason="jax is not installed: pip install -e '.[jax]'")

TIMES = np.arange(11) / 50
EVERY = ("joint_angle", "joint_rate", "tip_position")


@pytest.mark.slow  # JAX compiles the step
@pytest.mark.parametrize("memory", [Memory(), Memory((0.1,), (0.3,), (0.1,), (0.01,))], ids=["none", "hysteresis"])
def test_the_motion_is_that_of_a_batch_on_the_processor(memory, monkeypatch):
    """Jumps at other times, a dead time, a failure and two blocks of samples; a name that only fits have."""
    monkeypatch.setattr(jax_rollouts, "NUMBERS", 2000)
    model = chen2018.model(memory=memory, gravity=[0.0, -9.81], valve=Valve(rise_time=0.01, dead_time=0.0123))
    pulses = [Pulse(5e4, 0.0133), Pulse(1e9, 0.1), Pulse(3e4, -1.0, 1.05), Pulse(2e4)]
    values = {"stiffness": np.array([1.2, 1.5, 1.7, 1.6])}
    if memory:
        values["creep_share_1"] = np.array([0.1, 0.2, 0.3, 0.1])
    cpu, other = (
        simulate_batch(model, pulses, parameters=values, times=TIMES, time_step=1e-3, variables=EVERY, device=device,
                       failures="mark") for device in ("cpu", "jax")
    )  # fmt: skip
    for name in EVERY:
        np.testing.assert_allclose(other[name], cpu[name], rtol=1e-10, atol=1e-12, err_msg=name)
    np.testing.assert_allclose(other.failed_at, cpu.failed_at)
    assert np.isfinite(cpu.failed_at).values.tolist() == [False, True, False, False]
    start = {"initial_angle": np.full(5, 0.1), "initial_rate": np.full(5, -1.0)}
    one = simulate_batch(model, pulses[0], times=TIMES, time_step=1e-3, device="jax", **start)
    alone = simulate(model, pulses[0], times=TIMES, time_step=1e-3, **start)
    np.testing.assert_allclose(one.tip_position[0], alone.tip_position, atol=1e-12)


@pytest.mark.slow  # JAX compiles the step
def test_a_sweep_in_jax_has_the_samples_of_one_on_the_processor(tmp_path):
    table = {"kind": "design", "duration": 0.1, "rate": 50.0, "time_step": 1e-3,
             "parameters": {"stiffness": {"values": [1.4, 1.6]}, "level": 5e4}}  # fmt: skip
    cpu, other = (run_sweep(table, chen2018.model(), tmp_path / name, device=name) for name in ("cpu", "jax"))
    np.testing.assert_allclose(other.samples.tip, cpu.samples.tip, atol=1e-12)


def test_no_gpu_is_one_sentence(monkeypatch):
    monkeypatch.setattr(jax_rollouts, "accelerator", lambda: None)
    with pytest.raises(InputError, match="needs a GPU that JAX finds, and it finds none") as error:
        simulate_batch(chen2018.model(), Pulse(1e4), times=TIMES, device="gpu")
    assert str(error.value).count(". ") == 0


def test_a_gpu_is_the_first_device_that_is_no_processor(monkeypatch):
    class Device:
        def __init__(self, platform):
            self.platform = platform

    monkeypatch.setattr(jax, "devices", lambda: [Device("cpu"), Device("gpu")])
    assert jax_batch.accelerator().platform == "gpu"
    assert jax_rollouts.device_of("gpu").platform == "gpu"
    monkeypatch.setattr(jax, "devices", lambda: [Device("cpu")])
    assert jax_batch.accelerator() is None


def test_what_a_device_refuses(tmp_path, monkeypatch):
    monkeypatch.setattr(jax_rollouts, "accelerator", lambda: None)
    design = {"kind": "design", "duration": 0.1, "rate": 50.0, "parameters": {"stiffness": {"values": [1.4]}}}
    for more, message in (
        ({"device": "tpu"}, "device must be one of cpu, gpu, jax, got 'tpu'"),
        ({"device": "gpu"}, "needs a GPU that JAX finds"),
        ({"device": "jax", "scheduler": "processes"}, "is for one process: use the scheduler local"),
    ):
        with pytest.raises(InputError, match=message):
            run_sweep(design, chen2018.model(), tmp_path / "sweep", **more)
    with pytest.raises(InputError, match=r"does not support .*moving base"):
        jax_batch.module_of([chen2018.model().with_(moving_base=True)])


def sweep_on(device, folder):
    """The command `pliant sweep` of two samples on a device."""
    table = {"kind": "design", "duration": 0.1, "rate": 50.0, "time_step": 1e-3,
             "parameters": {"stiffness": {"values": [1.4, 1.6]}, "level": 5e4}}  # fmt: skip
    (folder / "sweep.json").write_text(json.dumps({"sweep": table}), encoding="utf-8")
    model = save_model(chen2018.model(), folder / "model.json")
    return invoke("sweep", folder / "sweep.json", "--model", model, "-o", folder / "out", "--device", device, "--json")


def test_the_command_names_the_devices(tmp_path, monkeypatch):
    monkeypatch.setattr(jax_rollouts, "accelerator", lambda: None)
    for device, message in (("tpu", "or device gpu or jax, got 'tpu'"), ("gpu", "and it finds none")):
        done = sweep_on(device, tmp_path)
        assert done.exit_code != 0
        assert message in done.output + str(done.exception)
        assert not (tmp_path / "out" / "samples.nc").exists()


@pytest.mark.slow  # JAX compiles the step
def test_the_command_runs_in_jax(tmp_path):
    done = sweep_on("jax", tmp_path)
    assert done.exit_code == 0, done.output
    assert json.loads(done.stdout)["failed_samples"] == 0


def test_equal_models_are_one():
    a, b = chen2018.model(), chen2018.model(stiffness=2.0)
    bodies, index = jax_rollouts.distinct([a, b, a, a])
    assert [id(m) for m in bodies] == [id(a), id(b)]
    assert index.tolist() == [0, 1, 0, 0]
    assert devices.backend() is jax_rollouts
