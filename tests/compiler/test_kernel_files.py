"""The kernel cache: bounded by size and by the time of use, and no calculation ends because of its disk."""

from __future__ import annotations

import os
import threading
import warnings
from pathlib import Path
from time import time

import pytest

from pliant.compiler import cache, kernel_cache
from pliant.compiler.kernel_files import DAY, FORGOTTEN, alone, evict, kernel_of, mark_used

NOW = float(int(time()))


def stored(folder: Path, name: str, age: float, size: int = 1000) -> list[Path]:
    """An index file and two data files of a kernel, of `size` bytes each, last used `age` seconds ago."""
    files = [folder / f"{name}-12.py311.{ending}" for ending in ("nbi", "1.nbc", "2.nbc")]
    for file in files:
        file.write_bytes(b"x" * size)
        os.utime(file, (NOW - age, NOW - age))
    return files


def names(folder: Path) -> set[str]:
    return {file.name.partition("-")[0] for file in folder.iterdir() if file.suffix != ".lock"}


def test_kernels_not_used_for_longest_are_removed_first(tmp_path: Path) -> None:
    for age, name in ((300.0, "old"), (100.0, "new"), (200.0, "middle")):
        stored(tmp_path, name, age)
    evict(tmp_path, most=9000)
    assert names(tmp_path) == {"old", "middle", "new"}
    evict(tmp_path, most=8999)
    assert names(tmp_path) == {"middle", "new"}
    evict(tmp_path, most=3000)
    assert names(tmp_path) == {"new"}
    evict(tmp_path, most=0)
    assert names(tmp_path) == set()


def test_kernels_not_used_for_a_month_are_removed(tmp_path: Path) -> None:
    stored(tmp_path, "old", FORGOTTEN + DAY)
    stored(tmp_path, "new", FORGOTTEN - DAY)
    code = [tmp_path / f"{name}-12.code" for name in ("old_step", "new_step")]
    for file, age in zip(code, (FORGOTTEN + DAY, 0.0), strict=True):
        file.write_bytes(b"x")
        os.utime(file, (NOW - age, NOW - age))
    evict(tmp_path)
    assert names(tmp_path) == {"new", "new_step"}


def test_a_kernel_is_removed_whole_and_no_other_of_a_similar_name(tmp_path: Path) -> None:
    stored(tmp_path, "step", 300.0)
    files = stored(tmp_path, "step_two", 100.0)
    evict(tmp_path, most=4000)
    assert names(tmp_path) == {"step_two"}
    assert all(file.exists() for file in files)
    assert {kernel_of(file).name for file in files} == {"step_two-12.py311"}


def test_folders_of_other_versions_count(tmp_path: Path) -> None:
    here, other = (tmp_path / f"kernels-checked-numba{v}" for v in ("0.68", "0.61"))
    for folder, age in ((here, 100.0), (other, 300.0)):
        folder.mkdir()
        stored(folder, "step", age)
    evict(here, most=3000)
    assert (names(here), names(other)) == ({"step"}, set())


def test_a_kernel_that_another_process_stores_is_kept(tmp_path: Path) -> None:
    stored(tmp_path, "busy", 300.0)
    stored(tmp_path, "idle", 100.0)
    with alone(tmp_path / "busy-12.py311.lock"):
        evict(tmp_path, most=3000)
    assert names(tmp_path) == {"busy"}


def test_what_a_killed_process_left_is_removed_after_a_day(tmp_path: Path) -> None:
    left, writing = tmp_path / "a.nbi.tmp.0123", tmp_path / "b.nbi.tmp.0123"
    for file in (left, writing):
        file.write_bytes(b"x")
    os.utime(left, (NOW - DAY, NOW - DAY))
    evict(tmp_path)
    assert not left.exists()
    assert writing.exists()


def test_use_counts_as_the_time_of_a_kernel(tmp_path: Path) -> None:
    index, *_ = stored(tmp_path, "step", 3 * DAY)
    mark_used(index)
    assert index.stat().st_mtime > NOW
    recent = index.stat().st_mtime
    mark_used(index)
    assert index.stat().st_mtime == recent
    mark_used(tmp_path / "none.nbi")


def test_many_that_remove_at_once_disturb_nobody(tmp_path: Path) -> None:
    for k in range(40):
        stored(tmp_path, f"kernel{k}", float(k))
    errors: list[BaseException] = []

    def work() -> None:
        try:
            evict(tmp_path, most=6000)
        except BaseException as error:
            errors.append(error)

    threads = [threading.Thread(target=work) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert errors == []
    assert {"kernel0", "kernel1"} >= names(tmp_path)


def halved(x: float) -> float:
    return 0.5 * x


def first_call(folder: Path, monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Compile a kernel as a new process does, and return the warnings."""
    monkeypatch.setattr(kernel_cache, "folder", lambda: folder)
    kernel_cache.tell_unsaved.cache_clear()
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        for _ in range(2):
            assert cache.kept(halved)(3.0) == 1.5
    return [str(w.message) for w in caught]


def full(*_: object, **__: object) -> None:
    raise OSError(28, "No space left on device")


@pytest.mark.parametrize("method", ["_save_index", "_save_data"])
def test_a_full_disk_costs_one_warning(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, method: str) -> None:
    monkeypatch.setattr(kernel_cache.CheckedFiles, method, full)
    (line,) = first_call(tmp_path, monkeypatch)
    assert line.startswith(f"compiled kernels cannot be stored in {tmp_path} (No space left on device)")


def test_a_folder_without_locks_costs_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """No lock file can be opened, or the file system has no locks."""
    with alone(tmp_path / "none" / "kernel.lock") as free:
        assert free
    monkeypatch.setattr("pliant.compiler.kernel_files.fcntl.flock", full)
    with alone(tmp_path / "kernel.lock") as free:
        assert free
    assert first_call(tmp_path, monkeypatch) == []


def test_a_folder_that_is_removed_costs_one_warning(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = tmp_path / "kernels"
    folder.mkdir()
    monkeypatch.setattr(kernel_cache, "folder", lambda: folder)
    kernel = cache.kept(halved)
    (folder / "kernels.lock").unlink(missing_ok=True)
    folder.rmdir()
    folder.write_text("a file in its place")
    kernel_cache.tell_unsaved.cache_clear()
    with pytest.warns(RuntimeWarning, match="compiled kernels cannot be stored"):
        assert kernel(3.0) == 1.5
