"""Output of the command line: text with control characters escaped, progress on standard error, and `--quiet`."""

from __future__ import annotations

import json
import math
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from functools import wraps
from inspect import Parameter, signature
from time import monotonic
from typing import Annotated, Any, get_type_hints

import typer
from typer.core import TyperCommand

from pliant.errors import InputError
from pliant.text import escaped
from pliant.units import number_in

QUIET: ContextVar[bool] = ContextVar("quiet", default=False)


def say(text: object = "", *, error: bool = False) -> None:
    """Print a text, with control characters escaped, to standard output or, with `error=True`, to standard error."""
    typer.echo("\n".join(escaped(line, "line") for line in str(text).split("\n")), err=error)


def answer(content: Any, text: str, *, as_json: bool, **options: Any) -> None:
    """Print the result of a command: `content` as JSON, or `text`. `options` are those of `json.dumps`."""
    say(json.dumps(content, **options) if as_json else text)


def can_be_quiet(command: Callable[..., None]) -> Callable[..., None]:
    """Return the command with an added option ``--quiet``, with which it prints only its result."""

    @wraps(command)
    def run(*args: Any, quiet: bool = False, **options: Any) -> None:
        before = QUIET.set(quiet)
        try:
            command(*args, **options)
        finally:
            QUIET.reset(before)

    stated = signature(command, eval_str=True)
    taken = list(stated.parameters.values())
    index = next(k for k, p in enumerate(taken) if p.name in ("json", "as_json"))
    wish = Annotated[bool, typer.Option("--quiet", help="Print only the result.")]
    taken.insert(index, Parameter("quiet", taken[index].kind, default=False, annotation=wish))
    run.__signature__ = stated.replace(parameters=taken)  # type: ignore[attr-defined]
    run.__annotations__ = {p.name: p.annotation for p in taken}
    return run


def also_takes(options: type, **defaults: Any) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Return a decorator of a command whose ``**`` keywords are the `options`, a `TypedDict`: typer then makes an
    option of each, with the given default.
    """

    def decorated(command: Callable[..., None]) -> Callable[..., None]:
        stated = signature(command, eval_str=True)
        named = [p for p in stated.parameters.values() if p.kind is not Parameter.VAR_KEYWORD]
        kinds = get_type_hints(options, include_extras=True)
        added = [Parameter(n, Parameter.KEYWORD_ONLY, default=defaults[n], annotation=kind)
                 for n, kind in kinds.items()]  # fmt: skip
        command.__signature__ = stated.replace(parameters=[*named, *added])  # type: ignore[attr-defined]
        command.__annotations__ = {p.name: p.annotation for p in (*named, *added)}
        return command

    return decorated


def in_unit(unit: str, least: float = -math.inf) -> Callable[[Any], float]:
    """Return the parser of an option that holds a quantity: a number in `unit`, at least `least`, or a number with a
    unit of the same kind, such as 50g for an option in kg.
    """

    def parse(given: Any) -> float:
        try:
            value = number_in(given, unit) if isinstance(given, str) else float(given)
        except InputError as error:
            raise typer.BadParameter(str(error)) from None
        if value < least:
            raise typer.BadParameter(f"{value:g} is less than {least:g}")
        return value

    parse.__name__ = "float"  # as the help shows it
    return parse


class ExampleCommand(TyperCommand):
    """A command whose help ends in its example, on a single line that can be copied."""

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        text, _, example = (self.help or "").partition("Example: ")
        self.help, self.example = text.rstrip(), " ".join(example.split())

    def format_epilog(self, ctx: Any, formatter: Any) -> None:  # noqa: ARG002  as typer calls it
        """Write the example at the end of the help."""
        formatter.write_paragraph()
        formatter.write(f"Example: {self.example}\n")


@contextmanager
def busy(what: str) -> Iterator[None]:
    """Context manager: show the text `what` and the elapsed time on a terminal, if the code inside takes more than one
    second.
    """
    if QUIET.get() or not sys.stderr.isatty():
        yield
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    columns = (TextColumn("{task.description}", markup=False), BarColumn(), TimeElapsedColumn())
    bar = Progress(*columns, console=Console(stderr=True), transient=True, redirect_stdout=False, redirect_stderr=False)
    bar.add_task(escaped(what, "line"), total=None)
    begin = threading.Timer(1.0, bar.start)
    begin.start()
    try:
        yield
    finally:
        begin.cancel()
        begin.join()
        bar.stop()


@contextmanager
def progress_lines() -> Iterator[Callable[[str], None]]:
    """Yield a function that prints one line of progress to standard error. On a terminal the elapsed time is shown too.

    With `--quiet` the function prints nothing.
    """
    quiet = QUIET.get()
    if quiet or not sys.stderr.isatty():
        yield (lambda _line: None) if quiet else (lambda line: say(line, error=True))
        return
    from rich.console import Console
    from rich.progress import Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

    console = Console(stderr=True)
    columns = (SpinnerColumn(), TextColumn("{task.description}", markup=False), TimeElapsedColumn())
    with Progress(*columns, console=console, transient=True, redirect_stdout=False, redirect_stderr=False) as bar:
        task = bar.add_task("reading", total=None)

        def notify(line: str) -> None:
            line = escaped(line, "line")
            console.print(line, markup=False, highlight=False)
            bar.update(task, description=f"after: {line[:60]}")

        yield notify


def mention(line: str) -> None:
    """Print one line to standard error, unless `--quiet` is given."""
    if not QUIET.get():
        say(line, error=True)


@contextmanager
def counting(what: str) -> Iterator[Callable[[float], None]]:
    """Yield a function that shows the progress of a long computation when it is called with the completed fraction (0
    to 1).

    A terminal shows a bar after one second, a pipe gets a line for each quarter, and `--quiet` shows nothing.
    """
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeElapsedColumn

    began = monotonic()
    columns = (TextColumn("{task.description}", markup=False), BarColumn(), TaskProgressColumn(), TimeElapsedColumn())
    interactive = sys.stderr.isatty() and not QUIET.get()
    bar = Progress(*columns, console=Console(stderr=True), transient=True, redirect_stdout=False, redirect_stderr=False)
    task, printed = bar.add_task(escaped(what, "line"), total=1.0), [0]

    def update(done: float) -> None:
        late = monotonic() - began > 1.0
        if late and interactive and not bar.live.is_started:
            bar.start()
        if late and not interactive and int(4 * done) > printed[0]:
            printed[0] = int(4 * done)
            mention(f"{what}: {25 * printed[0]} %")
        bar.update(task, completed=done)

    try:
        yield update
    finally:
        if bar.live.is_started:
            bar.stop()
