"""Formatting of a generated study file: values, keys, file names, comments and open questions as TOML."""

from __future__ import annotations

import json
import os
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pliant.recording.published import PREFIX
from pliant.study.shorthand import OPEN


def relative(path: Path, folder: Path) -> str:
    """Return the name of a file relative to `folder`; absolute if they have only the root in common."""
    if str(path).startswith(PREFIX):
        return path.as_posix()
    whole, home = path.resolve(), folder.resolve()
    if whole.parts[:2] != home.parts[:2]:  # nothing in common but the root
        return whole.as_posix()
    return Path(os.path.relpath(whole, home)).as_posix()


def toml(value: Any) -> str:
    """Return `value` formatted as TOML on one line."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, Mapping):
        return "{ " + ", ".join(f"{key(k)} = {toml(v)}" for k, v in value.items()) + " }"
    if isinstance(value, (list, tuple)):
        return "[" + ", ".join(toml(v) for v in value) + "]"
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    return repr(value)


def key(name: str) -> str:
    """Return `name` as a TOML key, quoted if necessary."""
    return name if re.fullmatch(r"[A-Za-z0-9_-]+", name) else toml(name)


LONGEST = 150  # characters of a comment


class Lines:
    """The lines of a generated study file, and the questions in it that the user has to answer."""

    def __init__(self) -> None:
        self.text: list[str] = []
        self.questions: list[str] = []

    def say(self, *comments: str) -> None:
        """Add comment lines, each cut to 150 characters."""
        lines = [" ".join(c.split()) for c in comments]
        self.text += [f"# {c if len(c) <= LONGEST else c[: LONGEST - 4] + ' ...'}" for c in lines]

    def table(self, name: str) -> None:
        """Add an empty line and the head of a table."""
        self.text += ["", f"[{name}]"]

    def item(self, table: str, name: str) -> None:
        """Add an empty line, the head of a table in a list of tables, and the name of this table."""
        self.text += ["", f"[[{table}]]"]
        self.put("name", name)

    def put(self, name: str, value: Any, comment: str = "") -> None:
        """Add a line ``name = value``, with an optional comment."""
        self.text.append(f"{key(name)} = {toml(value)}" + (f"  # {comment}" if comment else ""))

    def propose(self, name: str, value: Any, comment: str) -> None:
        """Add a line ``name = value`` as a comment, which becomes an entry if its # is removed."""
        self.put(name, value, comment)
        self.text[-1] = f"# {self.text[-1]}"

    def ask(self, name: str, question: str, value: Any = None, known: str = "") -> None:
        """Add a line ``name = value`` or, if the value is None, a line ``name = "?"`` with the question as comment."""
        if value is not None:
            self.put(name, float(f"{value:.4g}") if isinstance(value, float) else value, known)
            return
        self.put(name, OPEN, question)
        self.questions.append(f"{name}: {question}")
