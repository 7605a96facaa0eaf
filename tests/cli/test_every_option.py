"""Every command and every option is used by some test of the command line, as a stranger would use it."""

from __future__ import annotations

import ast
from collections import defaultdict
from pathlib import Path

import pytest
import typer

from pliant.cli import COMMANDS, app_of

TESTS = Path(__file__).parents[1]
CALLERS = ("command_line", "CliRunner")  # words of a test file that uses the command line
MODULES = {COMMANDS[name].__module__: name for name in COMMANDS}  # module of a command -> its name
PROGRAM = typer.main.get_command(app_of(*COMMANDS)).commands  # type: ignore[attr-defined]


def strings_of(node: ast.AST) -> set[str]:
    """The strings in a piece of a test, those of the form --option=value without the value."""
    found = {n.value for n in ast.walk(node) if isinstance(n, ast.Constant) and isinstance(n.value, str)}
    return {word.partition("=")[0] for word in found}


def names_of(node: ast.AST) -> set[str]:
    """The names that a piece of a test uses."""
    return {n.id for n in ast.walk(node) if isinstance(n, ast.Name)}


def imported_commands(tree: ast.Module) -> dict[str, str]:
    """The functions of commands that a test file imports: its name for them -> name of the command."""
    return {(alias.asname or alias.name): MODULES[node.module] for node in ast.walk(tree)
            if isinstance(node, ast.ImportFrom) and node.module in MODULES for alias in node.names
            if alias.name == COMMANDS[MODULES[node.module]].__name__}  # fmt: skip


def uses(text: str) -> dict[str, set[str]]:
    """The options that the pieces (functions, assignments) of a test file pass to each command. A piece without a
    command, such as a helper or a list of options, belongs to all commands of the file.
    """
    tree = ast.parse(text)
    own, found = imported_commands(tree), defaultdict(set)
    strings = [strings_of(node) for node in tree.body]
    spoken = [words & set(COMMANDS) | {own[name] for name in names_of(node) & set(own)}
              for node, words in zip(tree.body, strings, strict=True)]  # fmt: skip
    for words, commands in zip(strings, spoken, strict=True):
        options = {word for word in words if word.startswith("-")}
        for command in commands or set().union(*spoken):
            found[command] |= options
    for command in set().union(*spoken, own.values()):
        found[command] |= set()
    return found


@pytest.fixture(scope="module")
def exercised() -> dict[str, set[str]]:
    """The options that tests pass to each command, by its name."""
    found: dict[str, set[str]] = defaultdict(set)
    for path in TESTS.rglob("test_*.py"):
        text = path.read_text(encoding="utf-8")
        if path != Path(__file__) and any(word in text for word in CALLERS):
            for command, options in uses(text).items():
                found[command] |= options
    return found


@pytest.mark.parametrize("command", PROGRAM)
def test_every_option_of_a_command_is_used_by_a_test(exercised, command):
    assert command in exercised, f"no test calls `pliant {command}`"
    left = [
        option.opts[0] for option in PROGRAM[command].params
        if option.opts[0].startswith("-")
        and not {*option.opts, *option.secondary_opts} & (exercised[command] | EVERYWHERE)
    ]
    assert not left, f"no test passes {', '.join(left)} to `pliant {command}`"


EVERYWHERE = {"--quiet"}  # one wrapper adds it to every command


def test_the_scan_finds_what_a_test_passes():
    text = """
from command_line import invoke
OPTIONS = ["--level", "3"]

def test_one():
    invoke("simulate", "model.json", "--width=2", *OPTIONS)

def test_other():
    invoke("inspect", "a.csv", "--json")
"""
    assert uses(text) == {"simulate": {"--width", "--level"}, "inspect": {"--json", "--level"}}
    other = "from pliant.cli.order import order\nAPP.command()(order)\nrun('--bound-mm')"
    assert uses(other) == {"order": {"--bound-mm"}}
