"""Worker processes: no script is run twice, nobody is left behind, and Ctrl-C reaches the process that started them."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from multiprocessing import get_context
from pathlib import Path
from threading import Barrier, get_ident

import pytest

from pliant import parallel
from pliant.parallel import WorkerProcesses, side_by_side

pytestmark = pytest.mark.skipif(os.name != "posix", reason="signals of another kind")
SCRIPT = """
import sys, time
from functools import partial
from pathlib import Path
import {name}
from pliant.parallel import WorkerProcesses, compute
print("script")
ends = []
with WorkerProcesses(2) as pool:
    failure = compute({work}, iter(range({jobs})), pool, lambda job, end: ends.append((job, end)))
print(sorted(ends), repr(failure), "script over")
"""


@contextmanager
def started(folder: Path, work: str, jobs: int, module: str = "") -> Iterator[subprocess.Popen[str]]:
    """A script that has no guard and computes jobs in two worker processes; `module` is what they import."""
    (folder / "helpful.py").write_text(f"import os, signal, sys, time\n{module}")
    path = folder / "script.py"
    path.write_text(SCRIPT.format(name="helpful", work=work, jobs=jobs))
    command, pipe = [sys.executable, str(path)], subprocess.PIPE
    with subprocess.Popen(command, stdout=pipe, stderr=pipe, text=True, start_new_session=True) as running:
        try:
            yield running
        finally:
            with suppress(ProcessLookupError):
                os.killpg(running.pid, signal.SIGKILL)


def test_a_script_without_a_guard_is_not_run_again(tmp_path: Path) -> None:
    """And what a job prints is not in the script's output."""
    job = "def square(k):\n    print('printed by a job')\n    return k * k\n"
    with started(tmp_path, "helpful.square", 3, job) as running:
        out, error = running.communicate(timeout=60)
    assert out.splitlines() == ["script", "[(0, 0), (1, 1), (2, 4)] '' script over"]
    assert error.replace("\n", "") == "printed by a job" * 3  # two processes may write their ends of lines together
    assert error.count("\n") == 3


def test_an_error_of_a_job_is_raised_and_a_death_is_a_failure(tmp_path: Path) -> None:
    with started(tmp_path, "helpful.divide", 2, "def divide(k):\n    return 1 / k\n") as running:
        assert "ZeroDivisionError" in running.communicate(timeout=60)[1]
    job = "def die(k):\n    time.sleep(k)\n    os.kill(os.getpid(), signal.SIGKILL)\n"
    with started(tmp_path, "helpful.die", 1, job) as running:
        assert running.communicate(timeout=60)[0].splitlines()[-1] == "[] 'BrokenProcessPool' script over"


BUSY = "def busy(folder, k):\n    (folder / f'{os.getpid()}.pid').touch()\n    time.sleep(600)\n"


def alive(pid: int) -> bool:
    """Whether a process runs; one that has ended and waits to be collected does not."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


@pytest.mark.skipif(not Path("/proc").is_dir(), reason="asks /proc which processes run")
@pytest.mark.parametrize("ending", [signal.SIGINT, signal.SIGTERM, signal.SIGKILL])
def test_workers_end_with_the_process_that_started_them(tmp_path: Path, ending: signal.Signals) -> None:
    with started(tmp_path, f"partial(helpful.busy, Path({str(tmp_path)!r}))", 9, BUSY) as running:
        deadline = time.monotonic() + 60
        while len(pids := [int(p.stem) for p in tmp_path.glob("*.pid")]) < 2 and time.monotonic() < deadline:
            time.sleep(0.02)
        assert len(pids) == 2
        if ending == signal.SIGINT:
            os.killpg(running.pid, ending)  # as a terminal does
        else:
            running.send_signal(ending)
        said = running.communicate(timeout=60)[1]
        while any(map(alive, pids)) and time.monotonic() < deadline:
            time.sleep(0.02)
        assert not any(map(alive, pids))
    assert said.count("KeyboardInterrupt") == (ending == signal.SIGINT)  # of the script alone, and of no worker
    assert said.count("Traceback") == (ending == signal.SIGINT)


def test_an_interrupt_does_not_reach_a_worker_that_starts() -> None:
    """The signal is blocked from its first instruction on; in this process it is not."""
    with WorkerProcesses(1) as pool:
        assert signal.SIGINT in pool.submit(signal.pthread_sigmask, signal.SIG_BLOCK, []).result(60)
    assert signal.SIGINT not in signal.pthread_sigmask(signal.SIG_BLOCK, [])


@pytest.fixture
def two_cores(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    monkeypatch.setattr(parallel, "cores", lambda: 2)
    parallel.threads.cache_clear()
    yield
    parallel.threads.cache_clear()


@pytest.mark.usefixtures("two_cores")
def test_jobs_of_one_process_run_side_by_side_and_keep_their_order() -> None:
    """Each of two jobs waits for the other."""
    together = Barrier(2, timeout=30)

    def work(k: int) -> tuple[int, int]:
        together.wait()
        return k, get_ident()

    ends = side_by_side(work, [3, 1])
    assert [k for k, _ in ends] == [3, 1]
    assert len({thread for _, thread in ends}) == 2
    with pytest.raises(ZeroDivisionError):
        side_by_side(lambda k: 1 / k, [1, 0, 2])


def test_a_single_core_computes_one_job_after_another(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(parallel, "cores", lambda: 1)
    parallel.threads.cache_clear()
    assert side_by_side(lambda k: (k, get_ident()), [1, 2]) == [(1, get_ident()), (2, get_ident())]
    parallel.threads.cache_clear()


@pytest.mark.usefixtures("two_cores")
def test_a_forked_process_does_not_wait_for_the_threads_of_its_parent() -> None:
    assert side_by_side(abs, [-1, 2]) == [1, 2]
    with get_context("fork").Pool(1) as pool:
        assert pool.apply_async(side_by_side, (abs, [-3, 4])).get(30) == [3, 4]


@pytest.mark.usefixtures("two_cores")
def test_jobs_run_one_after_another_where_no_thread_takes_them() -> None:
    """As at the end of a program, whose pools are shut down before its last threads end."""
    pool = parallel.threads()
    assert pool is not None
    pool.shutdown()
    assert side_by_side(abs, [-1, 2]) == [1, 2]


@pytest.mark.usefixtures("two_cores")
def test_an_interrupt_ends_the_wait_for_jobs_side_by_side() -> None:
    """As Ctrl-C does: the caller goes on at once, while the kernels end by themselves."""
    began = time.monotonic()

    def work(k: int) -> None:
        if k == 0:
            os.kill(os.getpid(), signal.SIGINT)
        time.sleep(2.0 * k)

    with pytest.raises(KeyboardInterrupt):
        side_by_side(work, [0, 1])
    assert time.monotonic() - began < 1.5
