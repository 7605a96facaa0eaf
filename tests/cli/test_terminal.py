"""What a file holds never reaches a terminal as a command to it, nor as a line that pliant did not write."""

from __future__ import annotations

import ast
import json
import logging
import pickle
from itertools import product
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from command_line import invoke, program
from small_study import STUDY, changed, write_study

import pliant.cli
from pliant.cli import COMMANDS
from pliant.cli.terminal import say
from pliant.display import Card, as_text
from pliant.errors import FitError, InputError, PliantError, SimulationError
from pliant.loop.run import ControlLoop
from pliant.recording import make_recording, read
from pliant.sweep.store import DiskError

NASTY = ("\x1b[2J\x1b]0;owned\x07", "tip\npliant: all is well", "\x9b31m", "a\u202eb", "\x08\x08\x08", "x\ry")
ROWS = "0,1,2,3,4\n0.1,1,2,3,4\n"
COLUMNS = "t,x_0,y_0,x_1,y_1\n"


def clean(*texts):
    """Whether nothing but printable lines is there."""
    return all(line.isprintable() for text in texts for line in text.split("\n"))


@pytest.mark.parametrize("text", NASTY)
@pytest.mark.parametrize("kind", [PliantError, InputError, SimulationError, FitError, DiskError])
def test_an_error_is_one_printable_line(kind, text):
    error = kind(f"no station {text!s}: correct it")
    assert str(error).isprintable()
    assert str(pickle.loads(pickle.dumps(error))) == str(error)  # from a process that fits side by side
    assert str(error).endswith(": correct it")


@pytest.mark.parametrize("text", NASTY)
def test_what_is_said_and_shown_is_printable(capsys, text):
    say(f"first {text}\nsecond {text}")
    say(text, error=True)
    shown = as_text(Card(text, [text], [text, text], [[text, text]]))
    assert clean(*capsys.readouterr(), shown)
    assert len(shown.split("\n")) == 4


@pytest.mark.parametrize("text", NASTY)
def test_names_and_facts_that_break_out_of_a_line_are_refused(tmp_path, text):
    planar = {"frame": "planar", "position": np.zeros((2, 2, 2)), "time": [0, 1]}
    for arguments in ({"station": ["base", text]}, {"source": text}, {"pressure": np.zeros((2, 1)), "chamber": [text]}):
        with pytest.raises(InputError, match="must be one printable line"):
            make_recording(**planar, **arguments)
    path = tmp_path / "a.csv"
    path.write_text(f"# {json.dumps({'station': ['base', text]})}\n{COLUMNS}{ROWS}", encoding="utf-8")
    with pytest.raises(InputError, match="the name of a station must be one printable line") as caught:
        read(path)
    assert str(caught.value).isprintable()


def files(folder: Path, text: str):
    """Tables whose free text tries, some readable, some not."""
    contents = {
        "history.csv": f"# {json.dumps({'history': text, text: [0, 1], 'arc-length' + text: 1})}\n{COLUMNS}{ROWS}",
        "column.csv": f"t,x_0,y_0,a{text}b\n0,1,2,3\n1,1,2,3\n".replace("\n", " ", text.count("\n")).replace("\r", " "),
        "cell.csv": COLUMNS + ROWS.replace("0.1", text.replace("\n", "").replace("\r", "")),
        "unit.csv": f"# {json.dumps({'length_unit': text})}\n{COLUMNS}{ROWS}",
        "frame.csv": f"# {json.dumps({'frame': text})}\n{COLUMNS}{ROWS}",
        "clock.csv": COLUMNS.replace("t,", text.replace("\n", "").replace("\r", "") + ",") + ROWS,
    }
    for name, content in contents.items():
        (folder / name).write_text(content, encoding="utf-8", newline="")
        yield folder / name


@pytest.mark.parametrize("text", NASTY)
def test_inspect_prints_nothing_raw(tmp_path, text):
    for file, more in product(files(tmp_path, text), ((), ("--json",))):
        done = invoke("inspect", file, *more)
        assert clean(done.output, str(done.exception or "")), file


def test_the_history_of_a_file_is_shown_escaped(tmp_path):
    (tmp_path / "a.csv").write_text(f"# {json.dumps({'history': NASTY[0]})}\n{COLUMNS}{ROWS}", encoding="utf-8")
    assert r"\u001b[2J\u001b]0;owned\u0007" in invoke("inspect", tmp_path / "a.csv").output


def test_the_program_prints_its_error_escaped(tmp_path):
    (tmp_path / f"b{NASTY[2]}.toml").write_text("x = 3")
    done = program("run", tmp_path / f"b{NASTY[2]}.toml")
    assert (done.returncode, done.stdout) == (2, "")
    assert r"b\u009b31m.toml" in done.stderr
    assert clean(done.stderr)


@pytest.mark.parametrize("text", ["two\nlines", "\x85\x9b", "a\u202eb\u2028c"])
def test_run_prints_nothing_raw(tmp_path, text):
    """A study's texts reach messages and progress; what its reader refuses already ends there."""
    for content in (
        changed("recordings", "low", value={**STUDY["recordings"]["low"], "file": f"{text}.csv"}),
        changed("recordings", value={text: STUDY["recordings"]["low"]}), changed("actuator", "preset", value=text),
        changed("alignment", "options", value={"base": text}),
    ):
        done = invoke("run", write_study(tmp_path, content), "-o", tmp_path / "out")
        assert done.exception is not None
        assert clean(done.output, str(done.exception))


def test_a_fault_of_the_log_is_logged_as_one_line(caplog):
    loop = SimpleNamespace(log=SimpleNamespace(fault="no space\n\x1b[2J"), _log_told=False, _log_needed=False)
    with caplog.at_level(logging.ERROR):
        ControlLoop._check_log(loop, 0)
    assert caplog.messages == [r"no space\u000a\u001b[2J"]


def test_no_command_prints_past_the_one_way():
    """`say` and the progress lines escape; `print`, `typer.echo`, `sys.stdout` and a console's own print do not."""
    folder, found = Path(pliant.cli.__file__).parent, []
    for path in folder.glob("*.py"):
        calls = [ast.unparse(n.func) for n in ast.walk(ast.parse(path.read_text())) if isinstance(n, ast.Call)]
        found += [f"{path.name}: {c}" for c in calls if c in {"print", "typer.echo", "typer.secho", "click.echo"}
                  or c.endswith((".print", "stdout.write", "stderr.write"))]  # fmt: skip
    assert sorted(found) == ["terminal.py: console.print", "terminal.py: typer.echo"]
    assert len(COMMANDS) > 15
