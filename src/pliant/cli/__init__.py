"""The command line: one file for each command. Heavy packages are imported only when a command runs."""

from __future__ import annotations

import sys
import warnings
from collections.abc import Callable
from functools import cache
from typing import Any

import typer
from typer.core import TyperGroup

from pliant.cli.contact import contact
from pliant.cli.control import control
from pliant.cli.demo import data, demo, run_testbed
from pliant.cli.estimate import estimate
from pliant.cli.export import export
from pliant.cli.figures import figures, view
from pliant.cli.inspect import inspect, sync, track
from pliant.cli.new import new
from pliant.cli.order import order
from pliant.cli.run import adapt
from pliant.cli.run import run as run_command
from pliant.cli.shape import shape
from pliant.cli.simulate import design, simulate
from pliant.cli.sweep import sweep
from pliant.cli.terminal import ExampleCommand, can_be_quiet, say
from pliant.errors import PliantError
from pliant.text import escaped
from pliant.version import __version__

INTERRUPTED = 130


class Panels(TyperGroup):
    """A group of commands whose help lists them under headings, in plain text, since drawing boxes around them would be
    slow.
    """

    def format_commands(self, ctx: Any, formatter: Any) -> None:  # noqa: ARG002  as typer calls it
        """Write the list of commands in the help, grouped under headings, each with the first line of its help."""
        widest = max(map(len, self.commands))
        for panel, names in JOURNEY.items():
            with formatter.section(panel):
                formatter.write_dl([(n.ljust(widest), str(self.commands[n].help).partition("\n")[0]) for n in names])


def version(asked: bool) -> None:
    """If `--version` is given, print the versions that a bug report needs, and exit."""
    if asked:
        import platform
        from importlib.metadata import version as installed

        say(f"pliant {__version__}")
        say(f"Python {platform.python_version()}, numpy {installed('numpy')}, numba {installed('numba')}, "
            f"{platform.system()} {platform.machine()}")
        raise typer.Exit


def common(
    _version: bool = typer.Option(False, "--version", callback=version, is_eager=True, help="Show all versions."),
) -> None:
    """Declare the options of `pliant` itself, such as `--version`, which are written before the command."""


JOURNEY: dict[str, dict[str, Callable[..., None]]] = {  # headings of the help, in the order of an analysis
    "First steps": {"demo": demo, "data": data},
    "Your recording": {
        "inspect": inspect, "track": track, "sync": sync, "new": new, "shape": shape, "order": order,
    },
    "Your model": {
        "run": run_command, "adapt": adapt, "figures": figures, "view": view, "design": design, "simulate": simulate,
        "sweep": sweep,
    },
    "Use the model": {"estimate": estimate, "contact": contact, "control": control, "export": export},
    "Simulated actuator": {"testbed": run_testbed},
}
COMMANDS = {name: command for panel in JOURNEY.values() for name, command in panel.items()}


@cache
def app_of(*names: str) -> typer.Typer:
    """Return the Typer application that has the commands with these names."""
    app = typer.Typer(
        name="pliant", add_completion=True, no_args_is_help=True, pretty_exceptions_enable=False, cls=Panels,
        rich_markup_mode=None,
        help="From recordings of a soft actuator's shape to a validated, real-time reduced-order model.",
        epilog="Usual order: inspect a recording, write a study, run it, use its model. Every command takes --json and "
        "--quiet, and `pliant COMMAND --help` ends in an example. Exit codes: 0 good, 1 the job failed, 2 bad usage or "
        "bad input.",
    )
    app.callback()(common)
    for name in names:
        app.command(name, cls=ExampleCommand)(can_be_quiet(COMMANDS[name]))
    return app


def __getattr__(name: str) -> Any:
    if name == "app":  # with all commands; `run` builds only the one it needs, which is faster
        return app_of(*COMMANDS)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def show_warning(message: Warning | str, *_: Any, **__: Any) -> None:
    """Print a warning to standard error as one line, without its file and line number."""
    say(escaped(f"warning: {message}", "line"), error=True)


def run() -> None:
    """Run the command line; print a known error as one sentence and exit with its code."""
    asked = sys.argv[1:2]
    warnings.showwarning = show_warning
    try:
        app_of(*(asked if set(asked) & set(COMMANDS) else COMMANDS))()
    except PliantError as error:
        say(f"pliant: {error}", error=True)
        sys.exit(error.exit_code)
    except (KeyboardInterrupt, SystemExit) as left:
        if isinstance(left, SystemExit) and left.code != INTERRUPTED:  # typer turns Ctrl-C into this exit code
            raise
        say("pliant: interrupted; no incomplete files were written", error=True)
        sys.exit(INTERRUPTED)
