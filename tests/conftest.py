"""Shared by all tests: where recordings lie, seeded random numbers, the order of files, what may be skipped."""

from __future__ import annotations

import gc
import os
import sys
from collections import Counter
from math import log2
from pathlib import Path
from time import time

ROOT = Path(__file__).resolve().parents[1]
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before NumPy: small matrices, and tests share the cores
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)  # the suite starts a hundred processes: without bytecode each of them
sys.dont_write_bytecode = False  # compiles the package again, and each worker all tests
gc.set_threshold(100_000)  # as seldom as pays: of all that imports and pytest make, hardly anything is garbage

import numpy as np  # noqa: E402
import pytest  # noqa: E402
from hypothesis import settings  # noqa: E402

# The same examples in every run; `--hypothesis-profile=default` draws new ones.
settings.register_profile("repeatable", derandomize=True, database=None)
settings.load_profile("repeatable")

MAY_BE_SKIPPED = {  # what a reason holds -> why a run without that test is complete on this machine
    "measured recordings are absent": "they are no part of the project",
    "no Chromium on this machine": "a browser does not come with pip",
    "not a git checkout": "a copy without history",
    "this user may write everywhere": "file permissions do not stop root",
    "no C compiler": "compilers do not come with pip",
    "no arm-none-eabi-gcc": "nor do cross-compilers",
    "the sanitizers' libraries are not installed": "nor what comes beside a compiler",
    "Pinocchio is not installed": "an extra of the benchmarks; Lagrange's equations hold the same kernels here",
    "PyElastica is not installed": "an extra of the benchmarks; it made the bundled recordings in space",
    "MJX is not installed": "MuJoCo's version in JAX is no dependency; MuJoCo itself holds the exported files here",
    "MuJoCo Warp is not installed": "MuJoCo on a GPU is no dependency either",
    "cosseratbench is not installed": "a suite of others; rods as chains are compared in tests/measured/test_rods.py",
    "PyTables is not installed": "it stores what it reads as pickles: no dependency",
    "no limit of a file's size": "a system other than POSIX",
    "signals of another kind": "a system other than POSIX",
    (OUT_OF_TIME := "no slow test starts after --slow-until"): "CI has a limit of time; it says how many are left",
}
DURATIONS = "pliant/seconds_by_file"
LONG, LONG_TESTS = 1.5, "pliant/long_tests"  # s of the processor; from one on a test is `slow`, but machines differ
PROCESSOR, LEFT = "processor_s", "slow_left"


def pytest_addoption(parser):
    parser.addoption("--tell-skips", action="store_true", help="fail when a test is skipped for a reason not expected")
    parser.addoption("--slow-until", type=float, metavar="TIME", help="s since 1970, after which no slow test starts")


class Controller:
    """What is counted over the whole run, on all workers."""

    def __init__(self, config):
        self.config, self.seconds, self.untold, self.long, self.left = config, Counter(), [], {}, 0

    def pytest_runtest_logreport(self, report):
        self.seconds[report.nodeid.partition("::")[0]] += report.duration
        used = dict(report.user_properties).get(PROCESSOR, 0.0)
        if report.when == "call" and used > LONG and "slow" not in report.keywords:
            self.long[report.nodeid] = used
        self.note(report)

    @pytest.hookimpl(optionalhook=True)
    def pytest_testnodedown(self, node):
        self.left = getattr(node, "workeroutput", {}).get(LEFT, self.left)

    def pytest_collectreport(self, report):
        self.note(report)

    def note(self, report):
        if report.skipped and isinstance(report.longrepr, tuple):
            reason = str(report.longrepr[2])
            self.left += OUT_OF_TIME in reason
            if not any(part in reason for part in MAY_BE_SKIPPED):
                self.untold.append(f"{report.nodeid}: {reason}")

    def pytest_sessionfinish(self, session):
        if cache := getattr(self.config, "cache", None):  # pytest may run without its cache
            cache.set(DURATIONS, {**cache.get(DURATIONS, {}), **self.seconds})
            before = cache.get(LONG_TESTS, {})  # whoever is first compiles for the others: once says nothing
            cache.set(LONG_TESTS, self.long)
            self.long = {test: min(used, before[test]) for test, used in self.long.items() if test in before}
        if self.untold and self.config.getoption("--tell-skips") and not session.exitstatus:
            session.exitstatus = pytest.ExitCode.TESTS_FAILED

    def pytest_terminal_summary(self, terminalreporter):
        if self.untold and self.config.getoption("--tell-skips"):
            terminalreporter.section("skipped for a reason not in MAY_BE_SKIPPED of tests/conftest.py", red=True)
            terminalreporter.write_line("\n".join(self.untold))
        for test, used in sorted(self.long.items()):
            terminalreporter.write_line(f"{test} took {used:.1f} s of the processor, twice: cheaper, or marked slow?")
        if self.left:
            terminalreporter.write_line(f"{self.left} slow proofs left out; make test SLOW=1 runs them too")


def pytest_configure(config):
    if not hasattr(config, "workerinput"):
        config.pluginmanager.register(Controller(config), "pliant-controller")


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_setup(item):
    until = item.config.getoption("--slow-until")
    if until and time() > until and item.get_closest_marker("slow"):
        pytest.skip(OUT_OF_TIME)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_call(item):
    """Note what a test takes of the processor, in this process and in those that it waits for."""
    began = sum(os.times()[:4])
    try:
        return (yield)
    finally:
        item.user_properties.append((PROCESSOR, sum(os.times()[:4]) - began))


def pytest_deselected(items):
    """Let the controller tell what its workers leave by `-m "not slow"`; without workers pytest counts it."""
    if hasattr(items[0].config, "workeroutput") and all(item.get_closest_marker("slow") for item in items):
        items[0].config.workeroutput[LEFT] = len(items)


@pytest.hookimpl(trylast=True)
def pytest_collection_modifyitems(config, items):
    """Files that took long in the last run come first, so that no worker is left with one at the end.

    Those that took about as long as each other stay in their random order, as do the tests of a file.
    """
    cache = getattr(config, "cache", None)
    seconds = cache.get(DURATIONS, {}) if cache else {}
    slow = Counter(item.nodeid.partition("::")[0] for item in items if item.get_closest_marker("slow"))

    def rank(item):
        file = item.nodeid.partition("::")[0]
        return -round(log2(seconds.get(file, 4.0 * slow[file]) + 1.0))

    items.sort(key=rank)


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """Folder of the measured recordings, beside the project or named by PLIANT_SHARED_DATA."""
    folder = Path(os.environ.get("PLIANT_SHARED_DATA", ROOT.parent / "shared" / "data"))
    if not folder.is_dir():
        pytest.skip(f"measured recordings are absent: no folder {folder}; set PLIANT_SHARED_DATA to it")
    return folder


@pytest.fixture
def rng() -> np.random.Generator:
    """Random numbers that are the same in every run."""
    return np.random.default_rng(20181113)


@pytest.fixture
def untried(monkeypatch):
    """`pliant new` leaves its drafts untried, which takes as long as the first steps of a fit."""
    monkeypatch.setattr("pliant.study.draft.checked", lambda draft, _study: draft)
