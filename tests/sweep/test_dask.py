"""A real scheduler and workers on loopback, one of them killed; a scheduler that goes away and comes back."""

from __future__ import annotations

import json
import signal
import socket
import subprocess
import sys
import time
from importlib.util import find_spec

import pytest
import xarray as xr
from command_line import program

from pliant.model import save_model
from pliant.sweep import run_sweep, scheduler
from pliant.sweep.spec import sweep_from

pytestmark = [
    pytest.mark.slow, pytest.mark.filterwarnings("ignore"),  # what Dask says of its own is not ours
    pytest.mark.skipif(find_spec("distributed") is None, reason="the extra 'scale' is not installed"),
]


def free_port():
    with socket.socket() as s:
        s.bind(("127.0.0.1", 0))
        return s.getsockname()[1]


def dask(*arguments):
    return subprocess.Popen(
        [sys.executable, "-m", *arguments], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    )


class Cluster:
    """A scheduler and two workers as processes of their own."""

    def __init__(self):
        self.port = free_port()
        self.address = f"tcp://127.0.0.1:{self.port}"
        self.processes, self.workers = [], []
        self.start_scheduler()

    def complete(self):
        """Two workers that the scheduler knows, whichever was killed before; unknown ones have nothing under way."""
        self.workers = [w for w in self.workers if w.poll() is None]
        while len(self.workers) < 2:
            self.workers.append(self.start_worker())
        from distributed import Client

        with Client(self.address, timeout=60) as client:
            client.wait_for_workers(2, timeout=60)

    def start_scheduler(self):
        process = dask(
            "distributed.cli.dask_scheduler", "--host", "127.0.0.1", "--port", str(self.port), "--no-dashboard"
        )
        self.processes.append(process)

    def start_worker(self):
        process = dask(
            "distributed.cli.dask_worker", self.address, "--no-nanny", "--nthreads", "1", "--no-dashboard",
            "--memory-limit", "0",
        )
        self.processes.append(process)
        return process

    def stop(self):
        for process in self.processes:
            if process.poll() is None:
                process.send_signal(signal.SIGKILL)
            process.wait()


@pytest.fixture(scope="module")
def started():
    made = Cluster()
    yield made
    made.stop()


@pytest.fixture
def cluster(started):
    """A scheduler and two workers, as the test before left them or made complete: each process imports for seconds."""
    started.complete()
    return started


@pytest.fixture(scope="module")
def long_sweep():
    """Twelve chunks of which each takes a tenth of a second, so that one is under way when its worker goes."""
    return sweep_from({
        "kind": "monte_carlo", "samples": 24, "chunk": 2, "seed": 5, "duration": 8.0, "rate": 5.0, "time_step": 5e-5,
        "parameters": {"stiffness": {"mean": 1.6, "std": 0.1}, "level": 5e4},
    })


@pytest.fixture(scope="module")
def whole(long_sweep, paper, tmp_path_factory):
    """The same on this machine's cores."""
    return run_sweep(long_sweep, paper, tmp_path_factory.mktemp("local")).samples


def test_a_killed_worker_changes_nothing(cluster, long_sweep, whole, paper, tmp_path):

    def kill_early(line):
        if "10 to go" in line:
            cluster.workers[0].send_signal(signal.SIGKILL)

    result = run_sweep(long_sweep, paper, tmp_path / "dask", scheduler=cluster.address, progress=kill_early)
    assert cluster.workers[0].poll() is not None
    assert result.samples.equals(whole)
    assert result.account.made == 12


def test_the_command_runs_on_the_workers(cluster, paper, tmp_path):
    """The program hides Dask while it starts; a sweep on a cluster must see it again."""
    save_model(paper, tmp_path / "model.json")
    small = {"kind": "design", "duration": 0.2, "rate": 50.0, "time_step": 2e-3,
             "parameters": {"damping": {"low": 2e-3, "high": 8e-3, "count": 3}, "level": 4e4}}
    (tmp_path / "sweep.json").write_text(json.dumps({"sweep": small}), encoding="utf-8")
    command = ("sweep", tmp_path / "sweep.json", "--model", tmp_path / "model.json")
    done = program(*command, "-o", tmp_path / "dask", "--scheduler", cluster.address)
    assert done.returncode == 0, done.stderr
    assert "3 samples, 0 of them failed" in done.stdout
    assert program(*command, "-o", tmp_path / "here").returncode == 0
    samples = [xr.load_dataset(tmp_path / folder / "samples.nc") for folder in ("dask", "here")]
    assert samples[0].equals(samples[1])


def test_a_restarted_scheduler_changes_nothing(cluster, long_sweep, whole, paper, tmp_path, monkeypatch):
    monkeypatch.setattr(scheduler, "CONNECT_S", 60.0)

    def restart(line):
        if "10 to go" in line:
            cluster.stop()
            time.sleep(0.5)
            cluster.start_scheduler()
            cluster.workers = [cluster.start_worker()]

    told = []
    result = run_sweep(
        long_sweep, paper, tmp_path / "dask", scheduler=cluster.address,
        progress=lambda line: (told.append(line), restart(line)),
    )
    assert result.samples.equals(whole)
    assert result.account.restarts >= 1
    assert result.account.made == 12
    assert "submitted again" in result.account.sentence()
