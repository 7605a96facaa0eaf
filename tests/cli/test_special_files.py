"""Pipes, devices and endless files where a text file is wanted: one sentence, at once, from every command."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from command_line import invoke, program

import pliant
from pliant.actuators import chen2018
from pliant.errors import InputError
from pliant.files import LARGEST_FILE, content_of
from pliant.loop import read_key, read_log

pytestmark = pytest.mark.skipif(os.name != "posix", reason="no such files")

COMMANDS: dict[str, tuple[str, ...]] = {
    "study": ("run", "{}.toml"),
    "study of an earlier run": ("run", "{}.json"),
    "study to design": ("design", "{}.toml"),
    "sweep": ("sweep", "{}.toml", "-o", "out"),
    "recording to draft": ("new", "new.toml", "--from", "{}.csv"),
    "mapping to draft": ("new", "new.toml", "--from", "arm.csv", "--mapping", "{}.toml"),
    "recording": ("inspect", "{}.csv"),
    "mapping": ("inspect", "arm.csv", "--mapping", "{}.toml"),
    "recording to clean": ("shape", "{}.csv", "-o", "out.nc"),
    "recording to order": ("order", "{}.csv"),
    "recording to synchronise": ("sync", "{}.csv"),
    "log to synchronise": ("sync", "arm.csv", "{}.csv"),
    "camera": ("track", "film.mp4", "-o", "out.nc", "--camera", "{}.toml"),
    "model": ("simulate", "{}.json"),
    "trace": ("simulate", "model.json", "--trace", "{}.csv"),
    "model to export": ("export", "{}.json", "--to", "c99", "-o", "out.c"),
    "fit to export": ("export", "model.json", "--to", "c99", "-o", "out.c", "--fit", "{}.json"),
    "task": ("control", "--model", "model.json", "--task", "{}.toml", "-o", "out"),
    "model to control": ("control", "--model", "{}.json", "-o", "out"),
    "recording to estimate": ("estimate", "{}.csv", "--model", "model.json"),
    "model to estimate with": ("estimate", "arm.csv", "--model", "{}.json"),
    "contact": ("contact", "{}.csv", "--model", "model.json", "--free", "arm.csv"),
    "free motion": ("contact", "arm.csv", "--model", "model.json", "--free", "{}.csv"),
    "model to view": ("view", "{}.json"),
    "log to view": ("view", "model.json", "--loop", "{}.csv"),
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A model, a recording, and for each ending a pipe that nobody writes to and an endless device."""
    path = tmp_path_factory.mktemp("special")
    pliant.save_model(chen2018.model(), path / "model.json")
    (path / "arm.csv").write_text("time,tip_x,tip_y\n0,0,0.1\n0.1,0.01,0.1\n")
    for ending in ("toml", "json", "csv"):
        os.mkfifo(path / f"pipe.{ending}")
        (path / f"device.{ending}").symlink_to("/dev/zero")
    return path


@pytest.mark.parametrize("kind", ["pipe", "device"])
@pytest.mark.parametrize("case", COMMANDS)
def test_no_command_reads_it(folder: Path, case: str, kind: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(folder)
    result = invoke(*(argument.format(kind) for argument in COMMANDS[case]))
    assert isinstance(result.exception, InputError)
    assert f"it is a {kind}; save its content to a file" in str(result.exception)
    assert not any((folder / name).exists() for name in ("new.toml", "out.nc", "out.c"))


def test_a_recording_in_a_study_is_no_pipe(folder: Path, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"cannot read the recording .*it is a pipe"):
        pliant.read(folder / "pipe.csv")
    with pytest.raises(InputError, match="this is a folder"):
        pliant.read(tmp_path)
    with pytest.raises(InputError, match="there is no such file"):
        pliant.read(tmp_path / "none.csv")


def test_logs_and_keys_too(folder: Path) -> None:
    with pytest.raises(InputError, match=r"cannot read the log .*it is a pipe"):
        read_log(folder / "pipe.csv")
    (folder / "pipe.csv").chmod(0o600)
    with pytest.raises(InputError, match=r"cannot read the key file .*it is a pipe"):
        read_key(folder / "pipe.csv")


def test_the_program_does_not_wait_for_a_writer(folder: Path) -> None:
    done = program("run", "pipe.toml", cwd=folder)  # the time of `program` is limited
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr == (
        "pliant: cannot read the study pipe.toml: it is a pipe; save its content to a file and name this file\n"
    )


@pytest.mark.parametrize(("name", "arguments"), [
    ("study", ("run", "large.toml")), ("model file", ("simulate", "large.json")),
])  # fmt: skip
def test_a_large_file_is_not_read(tmp_path: Path, name: str, arguments: tuple[str, ...],
                                  monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    with Path(arguments[1]).open("wb") as file:
        file.truncate(10**12)  # takes no space
    result = invoke(*arguments)
    assert f"{name} {arguments[1]} has {10**12} bytes: at most {LARGEST_FILE} are read" in str(result.exception)


def test_content_is_read_whole_up_to_its_limit(tmp_path: Path) -> None:
    path = tmp_path / "text"
    path.write_bytes(b"x" * 100)
    assert content_of(path, "text", 100) == b"x" * 100
    with pytest.raises(InputError, match="has 100 bytes: at most 99 are read"):
        content_of(path, "text", 99)
