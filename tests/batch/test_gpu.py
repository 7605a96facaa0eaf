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
from pliant.batch.batch import simulate_batch
from pliant.errors import InputError
from pliant.model import Memory, Valve
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


def everything(device):
    """All variables of all cases, one after the other."""
    runs = [
        simulate_batch(*given, **more, times=TIMES, step=5e-3, variables=EVERYTHING, failures="mark", device=device)
        for given, more in cases()
    ]
    return [run[name].values for run in runs for name in (*EVERYTHING, "failed_at")]


@pytest.mark.slow
@needs_cuda
def test_the_simulator_gives_the_processors_numbers(tmp_path):
    script = f"import test_gpu, numpy; numpy.savez(r'{tmp_path / 'gpu.npz'}', *test_gpu.everything('gpu'))"
    simulated = {**os.environ, "NUMBA_ENABLE_CUDASIM": "1", "PYTHONPATH": str(Path(__file__).parent)}
    done = subprocess.run([sys.executable, "-c", script], env=simulated, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr[-2000:]
    made = list(np.load(tmp_path / "gpu.npz").values())
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
        with pytest.raises(InputError, match="run on the processor"):
            simulate_batch(paper.with_(**change), Pulse(1e4), times=TIMES, device="gpu")
