"""A pytest plugin that records by coverage which test executes which line of the package.

Processes that a test starts are recorded too. A fixture that several tests share runs in the first of them; its lines
count for all tests that use it. Kernels compiled by Numba leave no record, and failed tests are left out.
"""

from __future__ import annotations

import ast
import json
import os
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import Any, NamedTuple

OUT = "PLIANT_EXECUTED_LINES"  # folder for what the plugin writes


class Executed(NamedTuple):
    """Lines that tests executed, and how long each test took."""

    seconds: dict[str, float]  # of each test, its own fixtures counted
    lines: dict[str, dict[str, list[int]]]  # source file, line -> numbers of the tests in `seconds`

    def of(self, module: str, lines: Iterable[int]) -> set[str]:
        """Return the tests that executed at least one of some lines."""
        names, done = list(self.seconds), self.lines.get(module, {})
        return {names[k] for line in lines for k in done.get(str(line), [])}

    def inside(self, module: str, source: str) -> set[str]:
        """Return the tests that executed any line inside a function of a module."""
        functions = [f for f in ast.walk(ast.parse(source)) if isinstance(f, ast.FunctionDef)]
        return self.of(module, {line for f in functions for line in range(f.body[0].lineno, f.end_lineno + 1)})


def by_line(data: Any, root: Path, seconds: dict[str, float], fixtures: dict[str, list[str]]) -> dict[str, Any]:
    """Return the numbers of the tests that executed each line of each file."""
    number = {test: k for k, test in enumerate(seconds)}

    def tests_of(context: str) -> list[int]:
        if context in fixtures:
            return [number[t] for t in fixtures[context] if t in number]
        test = context.removesuffix(" (call)").removesuffix(" (setup)").removesuffix(" (teardown)")
        return [number[test]] if test in number else []

    lines: dict[str, Any] = {}
    for file in data.measured_files():
        found = {str(line): sorted({k for c in contexts for k in tests_of(c)})
                 for line, contexts in data.contexts_by_lineno(file).items()}  # fmt: skip
        lines[str(Path(file).relative_to(root))] = {line: tests for line, tests in found.items() if tests}
    return lines


class Recorder:
    """Records which test, or which shared fixture, is running."""

    def __init__(self, folder: str) -> None:
        import coverage

        self.folder, self.now = Path(folder), ""
        self.seconds: dict[str, float] = {}
        self.fixtures: dict[str, list[str]] = {}
        self.failed = set[str]()
        self.coverage = coverage.Coverage(config_file=f"{folder}/tests.ini")
        self.coverage.start()
        os.environ["COVERAGE_PROCESS_START"] = f"{folder}/processes.ini"  # of processes that tests start

    def switch(self, context: str) -> str:
        """Record the following lines under `context`, and return the previous context."""
        before, self.now = self.now, context
        self.coverage.switch_context(context)
        return before

    def pytest_collection_finish(self, session: Any) -> None:
        for item in session.items:
            for name, definitions in item._fixtureinfo.name2fixturedefs.items():
                for definition in definitions:
                    self.fixtures.setdefault(f"{definition.baseid}::{name} fixture", []).append(item.nodeid)

    def pytest_runtest_logreport(self, report: Any) -> None:
        self.seconds[report.nodeid] = round(self.seconds.get(report.nodeid, 0.0) + report.duration, 3)
        if report.failed:
            self.failed.add(report.nodeid)

    def pytest_runtest_logstart(self, nodeid: str) -> None:
        self.switch(nodeid)

    def pytest_runtest_logfinish(self) -> None:
        self.switch("")

    def pytest_sessionfinish(self) -> None:
        self.coverage.stop()
        self.coverage.save()
        sound = {test: seconds for test, seconds in self.seconds.items() if test not in self.failed}
        told = {"seconds": sound, "fixtures": self.fixtures}
        (self.folder / "tests.json").write_text(json.dumps(told))


def pytest_configure(config: Any) -> None:
    """Start recording; pytest calls this hook by its name."""
    config.pluginmanager.register(Recorder(os.environ[OUT]), "pliant-recorder")


def pytest_fixture_setup(fixturedef: Any, request: Any) -> Any:
    """Record the lines that a shared fixture executes under the fixture's own name."""
    recorder = request.config.pluginmanager.getplugin("pliant-recorder")
    shared = fixturedef.scope != "function"
    before = recorder.switch(f"{fixturedef.baseid}::{fixturedef.argname} fixture") if shared else ""
    try:
        return (yield)
    finally:
        if shared:
            recorder.switch(before)


if "pytest" in sys.modules:
    import pytest

    pytest_fixture_setup = pytest.hookimpl(wrapper=True)(pytest_fixture_setup)
