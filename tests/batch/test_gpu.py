"""The GPU's path in Numba's simulator, which runs its kernels thread by thread: the numbers of the processor's path."""

from __future__ import annotations

import os
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest

from pliant.actuators import chen2018
from pliant.batch import simulate_batch
from pliant.errors import InputError
from pliant.model import Memory, Valve, chain_model
from pliant.simulation import Pulse

TIMES = np.arange(7) / 100
EVERYTHING = ("joint_angle", "joint_rate", "tip_position")
needs_cuda = pytest.mark.skipif(not find_spec("numba.cuda"), reason="the extra 'gpu' is not installed")


def cases():
    """Samples that share their steps, that do not, that fail; a chain that a straight line is written for."""
    paper = chen2018.model().with_(gravity=[0.0, -9.81], valve=Valve(rise_time=0.02))
    stiffness = {"stiffness": np.linspace(1.3, 1.9, 3)}
    yield (paper, Pulse(9e4, 0.01)), {"parameters": stiffness}
    yield (paper, [Pulse(9e4, 0.01), Pulse(4e4, 0.0137, 0.02), Pulse(1e9, 0.01), Pulse(2e4, 0.01)]), {}


def few():
    """A lone link behind a valve: three samples share their steps, two of these their pressure, and one fails."""
    link = chain_model(length=0.1, mass=0.05, links=1, stiffness=1.2, damping=6e-3, torque=[1.2e-6, 2e-12],
                       gravity=[0.5, -9.81], base_angle=0.1, base_length=0.01, valve=Valve(rise_time=0.02))  # fmt: skip
    first = Pulse(9e4, 0.004)
    yield (link, [first, Pulse(4e4, 0.0037, 0.01), first, Pulse(1e9, 0.004)]), {"times": TIMES[:3]}


def everything(device, cases=cases):
    """All variables of all cases, one after the other."""
    how = {"times": TIMES, "time_step": 5e-3, "variables": EVERYTHING, "failures": "mark", "device": device}
    runs = [simulate_batch(*given, **how | more) for given, more in cases()]
    return [run[name].values for run in runs for name in (*EVERYTHING, "failed_at")]


def simulated(path, cases):
    """The same in Numba's simulator, a process of its own; launches take two samples at most."""
    script = (f"import test_gpu, numpy; from pliant.batch import gpu; gpu.BYTES = 8 * 2 * 20; "
              f"numpy.savez(r'{path}', *test_gpu.everything('gpu', test_gpu.{cases}))")  # fmt: skip
    environment = {**os.environ, "NUMBA_ENABLE_CUDASIM": "1", "PYTHONPATH": os.pathsep.join(
        [str(Path(__file__).parent), os.environ.get("PYTHONPATH", "")])}  # fmt: skip
    done = subprocess.run([sys.executable, "-c", script], env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr[-2000:]
    return list(np.load(path).values())


@needs_cuda
def test_a_lone_link_moves_as_on_the_processor(tmp_path):
    made = simulated(tmp_path / "gpu.npz", "few")
    for a, b in zip(everything("cpu", few), made, strict=True):
        assert a == pytest.approx(b, rel=0, abs=1e-12 * max(1.0, np.nanmax(np.abs(a), initial=0.0)), nan_ok=True)
    assert np.isfinite(made[-1]).tolist() == [False, False, False, True]


@pytest.mark.slow
@needs_cuda
def test_the_simulator_gives_the_processors_numbers(tmp_path):
    made = simulated(tmp_path / "gpu.npz", "cases")
    for a, b in zip(everything("cpu"), made, strict=True):
        assert a == pytest.approx(b, rel=0, abs=1e-12 * max(1.0, np.nanmax(np.abs(a), initial=0.0)), nan_ok=True)
    assert np.isfinite(made[-1]).tolist() == [False, False, True, False]


@needs_cuda
def test_without_a_gpu_it_says_so(paper):
    from pliant.batch.gpu_loops import present

    if present():
        pytest.skip("a GPU is there")
    with pytest.raises(InputError, match="no GPU on this machine: use device='cpu'"):
        simulate_batch(paper, Pulse(1e4), times=TIMES, device="gpu")


def test_what_runs_on_the_processor_alone(paper, monkeypatch):
    pytest.importorskip("numba.cuda", reason="the extra 'gpu' is not installed")
    from pliant.batch import gpu_loops

    monkeypatch.setattr(gpu_loops, "present", lambda: True)
    for change in ({"memory": Memory(creep_share=(0.2,), creep_time=(0.3,))}, {"swell_share": 0.2}):
        with pytest.raises(InputError, match=r"hysteresis states, .* not supported on the GPU"):
            simulate_batch(paper.with_(**change), Pulse(1e4), times=TIMES, device="gpu")
