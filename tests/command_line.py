"""The command line for tests: in this process, and as a process of its own."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

from click.testing import Result
from typer.testing import CliRunner

from pliant.cli import app


def invoke(*arguments: str | Path) -> Result:
    """Run a command in this process; known errors are printed as the program itself prints them."""
    return CliRunner().invoke(app, [str(a) for a in arguments])


def program(*arguments: str | Path, cwd: Path | None = None) -> subprocess.CompletedProcess[str]:
    """Run the program as a process of its own."""
    return subprocess.run(
        [sys.executable, "-m", "pliant", *(str(a) for a in arguments)], capture_output=True, text=True, cwd=cwd,
        check=False, timeout=60,
    )
