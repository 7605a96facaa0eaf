"""A run that is stopped leaves a sentence, and no model without its metrics."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from threading import Barrier, Thread
from typing import Any

import pytest
from small_study import STUDY, write_study

from pliant.errors import InputError
from pliant.files import DRAFTS, output_folder, replaced_together, writable
from pliant.study import load_study, run_study
from pliant.study.run import WRITTEN, write_outcome
from pliant.validation.outcome import StudyOutcome
from pliant.validation.store import load_outcome


@pytest.mark.slow
@pytest.mark.skipif(os.name != "posix", reason="signals of another kind")
def test_ctrl_c_ends_a_run_with_its_sentence(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "pliant", "run", str(write_study(tmp_path, STUDY)), "-o", str(tmp_path / "out")]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as running:
        assert running.stderr is not None
        assert "prepared" in running.stderr.readline()
        running.send_signal(signal.SIGINT)
        said = running.communicate(timeout=60)[1]
    assert running.returncode == 130
    assert said.endswith("pliant: interrupted; no incomplete files were written\n")
    assert "Traceback" not in said
    assert not (tmp_path / "out" / "model.json").exists()


def test_a_run_stopped_while_it_writes_leaves_no_model_alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    study = load_study(write_study(tmp_path, STUDY))

    def stop(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("pliant.view.report.write_report", stop)
    with pytest.raises(KeyboardInterrupt):
        run_study(study, tmp_path / "out")
    assert not (tmp_path / "out").exists()  # the run had made it


def stopped_in(folder: Path, *, writes: bool) -> None:
    with output_folder(folder):
        if writes:
            (folder / "log").write_text("kept")
        raise KeyboardInterrupt


def test_a_folder_that_was_there_or_holds_something_stays(tmp_path: Path) -> None:
    (tmp_path / "mine").mkdir()
    for name, writes in (("mine", False), ("new/deep", True), ("other/deep", False)):
        with pytest.raises(KeyboardInterrupt):
            stopped_in(tmp_path / name, writes=writes)
    assert (tmp_path / "mine").is_dir()
    assert (tmp_path / "new/deep/log").exists()
    assert not (tmp_path / "other").exists()


class Killed(BaseException):
    """Nothing answers to a kill."""


@pytest.fixture
def killed_after(monkeypatch: pytest.MonkeyPatch) -> Iterator[Any]:
    """Let so many changes of files pass, then none: that is how a kill leaves the disk."""
    left = [0]

    def limited(change: Any) -> Any:
        def run(*arguments: Any, **options: Any) -> Any:
            if left[0] <= 0:
                raise Killed
            left[0] -= 1
            return change(*arguments, **options)

        return run

    for name in ("replace", "rename", "unlink", "rmdir"):
        monkeypatch.setattr(os, name, limited(getattr(os, name)))
    yield lambda changes: left.__setitem__(0, changes)
    left[0] = 1000


def state_of(folder: Path) -> dict[str, bytes]:
    """The visible files that a run writes."""
    return {name: (folder / name).read_bytes() for name in WRITTEN if (folder / name).exists()}


@pytest.mark.slow
def test_a_kill_at_any_moment_leaves_one_run_or_says_so(
    outcome: StudyOutcome, tmp_path: Path, killed_after: Any,
) -> None:
    """Of an old and a new run in one folder, in which the user has files too."""
    killed_after(1000)
    study = load_study(write_study(tmp_path, STUDY))
    whole = replace(outcome, fits=tuple(replace(f, records=f.records[:1]) for f in outcome.fits), title="old")
    folder = writable(tmp_path / "out")
    (folder / "notes.txt").write_text("mine")
    (folder / "figures").mkdir()
    (folder / "figures" / "own.pdf").write_text("mine")
    write_outcome(study, whole, folder, 0.0, lambda _line: None)
    old, ends = state_of(folder), []
    assert list(old) == list(WRITTEN)
    for changes in range(60):
        killed_after(1000)
        for name, content in old.items():
            (folder / name).write_bytes(content)
        killed_after(changes)
        with suppress(Killed):
            write_outcome(study, replace(whole, title="new"), folder, 0.0, lambda _line: None)
            ends.append("done")
        killed_after(1000)
        if "metrics.json" not in state_of(folder):
            with pytest.raises(InputError, match="was interrupted while it replaced its files"):
                load_outcome(folder)
            ends.append("said")
        else:
            found = load_outcome(folder)
            assert (state_of(folder) == old) == (found.title == "old")
            assert found.run_id in (folder / "report.html").read_text(encoding="utf-8")
            ends.append(found.title)
        if ends[-2:] == ["done", "new"]:
            break
    assert set(ends) == {"old", "said", "new", "done"}
    assert ends.count("said") >= len(WRITTEN)
    assert (folder / "notes.txt").read_text() == (folder / "figures" / "own.pdf").read_text() == "mine"


@pytest.mark.slow
@pytest.mark.skipif(os.name != "posix", reason="signals of another kind")
def test_a_real_kill_while_files_are_replaced(tmp_path: Path) -> None:
    script = """
import os, signal, sys
from pathlib import Path
from pliant.files import replaced_together
folder, changes, own = Path(sys.argv[1]), [int(sys.argv[2])], os.replace
def replace(*arguments):
    changes[0] -= 1
    if changes[0] < 0:
        os.kill(os.getpid(), signal.SIGKILL)
    own(*arguments)
os.replace = os.rename = replace
with replaced_together(folder, ["a", "b", "mark"]) as draft:
    for name in ("a", "b", "mark"):
        (draft / name).write_text("new")
"""
    for changes in range(4):
        for name in ("a", "b", "mark"):
            (tmp_path / name).write_text("old")
        code = subprocess.run([sys.executable, "-c", script, str(tmp_path), str(changes)], check=False).returncode
        assert code == (0 if changes == 3 else -signal.SIGKILL)
        assert (tmp_path / "mark").exists() == (changes == 3)
    assert [(tmp_path / name).read_text() for name in ("a", "b", "mark")] == ["new"] * 3


def test_what_a_killed_run_left_is_removed_by_a_later_one(tmp_path: Path) -> None:
    left, busy = tmp_path / f"{DRAFTS}old", tmp_path / f"{DRAFTS}busy"
    for folder in (left, busy):
        folder.mkdir()
        (folder / "results.nc").write_text("half")
    os.utime(left, (0, 0))
    with replaced_together(tmp_path, ["mark"]) as draft:
        (draft / "mark").write_text("new")
    assert {path.name for path in tmp_path.iterdir()} == {busy.name, "mark"}


def test_two_runs_do_not_refuse_one_another_and_do_not_mix(tmp_path: Path) -> None:
    names, together, refused = ["a", "b", "mark"], Barrier(4), list[Exception]()

    def write(mine: str) -> None:
        try:
            for _ in range(40):
                together.wait()
                folder = writable(tmp_path / "out")
                with replaced_together(folder, names) as draft:
                    for name in names:
                        (draft / name).write_text(mine)
        except Exception as error:
            refused.append(error)
            together.abort()

    threads = [Thread(target=write, args=(str(k),)) for k in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert not refused
    assert len({(tmp_path / "out" / name).read_text() for name in names}) == 1
    assert {path.name for path in (tmp_path / "out").iterdir()} == set(names)
