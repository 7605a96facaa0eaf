"""Output of the command line to a terminal, with control characters from files escaped."""

from __future__ import annotations

import typer

from pliant.text import escaped


def say(text: object = "", *, error: bool = False) -> None:
    """Print a text to standard output, or to standard error, with each line passed through `escaped`."""
    typer.echo("\n".join(escaped(line, "line") for line in str(text).split("\n")), err=error)
