"""A full disk, as a limit of 0 bytes on every file that the program writes: a sentence, and nothing left behind."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

import pliant
from pliant.actuators import chen2018
from pliant.errors import InputError
from pliant.files import reason_of, whole, write_new
from pliant.loop import LoopLog, new_key
from pliant.testbed.bundle import FOLDER

pytest.importorskip("resource", reason="limits of a process exist on POSIX systems only")
PULSE = FOLDER / "pulse_119.nc"


def without_space(*arguments: str | Path, **environment: str) -> subprocess.CompletedProcess[str]:
    """Run the program where no file can take a byte. Python ignores the signal, so that writing raises OSError."""
    limited = ("sh", "-c", 'ulimit -f 0; exec "$@"', "sh")
    return subprocess.run(
        [*limited, sys.executable, "-m", "pliant", *map(str, arguments)], capture_output=True, text=True, check=False,
        timeout=300, env={**os.environ, **environment},
    )  # fmt: skip


def test_a_study_that_cannot_be_written_can_be_written_later(tmp_path: Path) -> None:
    path = tmp_path / "arm.toml"
    done = without_space("new", path, "--from", PULSE)
    assert done.returncode == 2
    assert done.stderr.strip().splitlines()[-1].startswith(f"pliant: cannot write {path}: File too large")
    assert list(tmp_path.iterdir()) == []


def test_a_figure_that_cannot_be_written_leaves_nothing(tmp_path: Path) -> None:
    done = without_space("order", PULSE, "--figure", tmp_path / "order")
    assert done.returncode == 2
    assert "cannot write" in done.stderr
    assert "Traceback" not in done.stderr
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow
def test_kernels_that_cannot_be_stored_end_no_calculation(tmp_path: Path) -> None:
    """With the cache of kernels empty: they are compiled, and one warning says that they are not stored."""
    model, cache = tmp_path / "model.json", tmp_path / "cache"
    pliant.save_model(chen2018.model(links=1), model)
    done = without_space("simulate", model, "--level", 30, "--duration", 0.05, NUMBA_CACHE_DIR=str(cache))
    assert done.returncode == 0, done.stderr
    assert "final tip" in done.stdout + done.stderr
    assert done.stderr.count("compiled kernels cannot be stored") == 1
    assert "Traceback" not in done.stderr


def no_space(*_: object, **__: object) -> int:
    raise OSError(28, "No space left on device")


def test_failed_logs_and_keys_leave_their_names_free(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with monkeypatch.context() as full:
        full.setattr(LoopLog, "_append", no_space)
        with pytest.raises(InputError, match=r"cannot write the log .*No space left on device"):
            LoopLog(tmp_path / "log.csv", ["time_s"])
        full.setattr(Path, "write_text", no_space)
        with pytest.raises(InputError, match=r"cannot write .*No space left on device"):
            new_key(tmp_path / "valve.key")
    assert list(tmp_path.iterdir()) == []
    new_key(tmp_path / "valve.key")
    LoopLog(tmp_path / "log.csv", ["time_s"]).close()


def test_a_new_file_replaces_none(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "new.txt"
    assert write_new(path, "first") == path
    for _ in range(2):
        with pytest.raises(InputError, match="exists already and is not overwritten"):
            write_new(path, "second")
        monkeypatch.setattr(os, "link", no_links)  # a file system without them
    assert path.read_text() == "first"
    path.unlink()
    assert write_new(path, "third").read_text() == "third"
    assert list(tmp_path.iterdir()) == [path]


def no_links(*_: object) -> None:
    raise OSError(95, "Operation not supported")


def test_the_reason_of_hdf5_is_that_of_the_system(tmp_path: Path) -> None:
    error = OSError("Can't close file (file write failed: time = now, errno = 28, error message = 'No space left on "
                    "device', buf = 0x55)")  # fmt: skip
    assert reason_of(error) == "No space left on device"
    assert reason_of(OSError("no drive")) == "no drive"
    with pytest.raises(InputError, match=r"run\.nc: No space left on device$"), whole(tmp_path / "run.nc"):
        raise error
