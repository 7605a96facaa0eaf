"""The one way of the command line to a terminal: lines that a file's content cannot turn into commands to it."""

from __future__ import annotations

import typer

from pliant.text import escaped


def say(text: object = "", *, error: bool = False) -> None:
    """Print a text line by line, on standard output or standard error, each line through `escaped`."""
    typer.echo("\n".join(escaped(line, "line") for line in str(text).split("\n")), err=error)
