"""Run the quick tests of a copy of the project in forks of this process, so that libraries are imported only once."""

from __future__ import annotations

import ast
import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import cache
from hashlib import sha256
from importlib import import_module
from pathlib import Path

from executed_lines import OUT, Executed, by_line

ROOT = Path(__file__).parents[2]
LIBRARIES = ("numpy", "scipy.optimize", "scipy.signal", "scipy.stats", "numba", "pandas", "xarray", "pydantic", "typer",
             "matplotlib.pyplot", "h5netcdf", "jinja2", "pytest")  # fmt: skip
QUICK = ["-q", "-p", "no:randomly", "-p", "no:cacheprovider", "-m", "not slow", "--tb=no", "-n0"]


class Copy:
    """Source, tests and compiled kernels in a separate folder; the working tree does not change."""

    def __init__(self, folder: Path) -> None:
        self.root, self.said, self.time = folder / "pliant", folder / "said", int(time.time())
        for name in ("src", "tests"):
            shutil.copytree(ROOT / name, self.root / name, ignore=shutil.ignore_patterns("__pycache__"))
        for name in (p.name for p in ROOT.iterdir() if p.name not in ("src", "tests") and not p.name.startswith(".")):
            (self.root / name).symlink_to(ROOT / name)
        if (ROOT.parent / "shared").exists():
            (folder / "shared").symlink_to((ROOT.parent / "shared").resolve())
        kernels = Path(os.environ.get("NUMBA_CACHE_DIR", Path.home() / ".cache" / "pliant"))
        if kernels.exists():
            shutil.copytree(kernels, folder / "kernels")
        self.environment = {
            **os.environ, "PYTHONPATH": str(self.root / "src"), "NUMBA_CACHE_DIR": str(folder / "kernels"),
            "OPENBLAS_NUM_THREADS": "1",
        }

    def record(self, tests: list[str]) -> Executed:
        """Run quick tests under coverage, and return which lines each of them executed."""
        from coverage import CoverageData
        from coverage.exceptions import DataError

        with tempfile.TemporaryDirectory() as folder:
            common = f"[run]\nsource = {self.root / 'src'}\nparallel = true\ndata_file = {folder}/data\n"
            (Path(folder) / "tests.ini").write_text(common)
            (Path(folder) / "processes.ini").write_text(common + "context = ${PYTEST_CURRENT_TEST-}\n")
            environment = {
                **self.environment, OUT: folder,
                "PYTHONPATH": os.pathsep.join([self.environment["PYTHONPATH"], str(Path(__file__).parent)]),
            }
            command = [sys.executable, "-m", "pytest", "-p", "executed_lines", *QUICK, *tests]
            subprocess.run(command, cwd=self.root, env=environment, check=False)
            told = json.loads((Path(folder) / "tests.json").read_text())
            data = CoverageData(f"{folder}/all")
            for part in Path(folder).glob("data.*"):
                piece = CoverageData(str(part))
                with suppress(DataError):  # of a process that was killed while it wrote
                    piece.read()
                    data.update(piece)
            return Executed(told["seconds"], by_line(data, self.root, told["seconds"], told["fixtures"]))

    def prepare(self) -> None:
        """Import libraries, but not the package, for all later forks."""
        os.environ |= self.environment
        for name in LIBRARIES:
            import_module(name)

    def run(self, tests: list[str], limit: float, *, first: bool = True) -> tuple[int, list[str]]:
        """Return the exit code of pytest (-1: time ran out) and the names of failed tests, by default only the first.
        """
        child = os.fork()
        if not child:
            self.become(["-x"] * first + tests)
        until, status = time.monotonic() + limit, None
        while status is None and time.monotonic() < until:
            done, code = os.waitpid(child, os.WNOHANG)
            status = os.waitstatus_to_exitcode(code) if done else None
            time.sleep(0.0 if done else 0.05)
        if status is None:
            os.killpg(child, signal.SIGKILL)
            os.waitpid(child, 0)
            return -1, []
        said = self.said.read_text(errors="replace").splitlines()
        if any("not found: " in line for line in said):
            raise RuntimeError("the record names tests that are not there: delete it")
        failed = [line.split(" ", 1)[1] for line in said if line.startswith(("FAILED ", "ERROR "))]
        return abs(status), [name.split(" - ")[0] for name in failed]

    def become(self, arguments: list[str]) -> None:
        """Turn this process into pytest in the copy."""
        try:
            os.setsid()
            output = os.open(self.said, os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
            os.dup2(output, 1)
            os.dup2(output, 2)
            os.chdir(self.root)
            sys.path[:0] = [str(self.root / "src")]
            import pytest

            os._exit(int(pytest.main([*QUICK, *arguments])))
        finally:
            os._exit(99)

    @contextmanager
    def changed(self, module: str, text: str) -> Iterator[None]:
        """Replace the text of a module within this context."""
        path = self.root / module
        source = path.read_text()
        try:
            self.write(path, text)
            yield
        finally:
            self.write(path, source)

    def write(self, path: Path, text: str) -> None:
        """Write a file with a modification time that differs from that of its bytecode."""
        path.write_text(text)
        self.time += 10
        os.utime(path, (self.time, self.time))


def kept_record(file: Path, copied: Copy, tests: list[str]) -> Executed:
    """Return the record from a file, or make it again if source or tests have changed."""
    texts = sorted(p for name in ("src", "tests") for p in (copied.root / name).rglob("*.py"))
    state = sha256(b"".join([repr(tests).encode(), *(p.read_bytes() for p in texts)])).hexdigest()
    if file.exists() and (kept := json.loads(file.read_text()))["state"] == state:
        return Executed(kept["seconds"], kept["lines"])
    made = copied.record(tests)
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(json.dumps({"state": state, **made._asdict()}))
    return made


@cache
def imported(source: str) -> set[str]:
    """Return modules and names that a source imports, such as pliant.model.limits."""
    names = set()
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.ImportFrom) and node.module:
            names |= {node.module, *(f"{node.module}.{a.name}" for a in node.names)}
        elif isinstance(node, ast.Import):
            names |= {a.name for a in node.names}
    return names
