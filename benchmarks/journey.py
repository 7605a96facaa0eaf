"""Time whole commands as separate processes, with and without compiled kernels, and the compiling of each kernel.

Cold means an empty cache of kernels; warm means the same command again. Times are medians of ``--runs`` (5) runs. The
processor time (user and system, all child processes) is printed beside the wall-clock time, because it is more
meaningful on a busy computer.

    python benchmarks/journey.py [--runs 5] [--only simulate demo] [--studies examples/a.toml ...] [-o journey.json]
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from statistics import median
from time import perf_counter

from pliant.actuators import chen2018
from pliant.model import save_model
from pliant.testbed.bundle import FOLDER

TARGETS = {  # s of the wall's clock on two quiet cores: warm, cold
    "help": (0.2, None), "inspect": (0.6, None), "simulate": (0.8, 3.0), "demo": (8.0, 20.0), "control": (3.0, 20.0),
}
STUDY = (15.0, None)

# Run in the command's process: seconds that Numba compiles a kernel, without those of the kernels that it calls.
PROBE = """
import atexit, json, re, sys
from time import perf_counter
from numba.core import event

out, seconds, running = sys.argv.pop(1), {}, []


class Listener(event.Listener):
    def on_start(self, started):
        running.append([perf_counter(), 0.0])

    def on_end(self, ended):
        start, inside = running.pop()
        whole = perf_counter() - start
        name = re.sub("_[0-9a-f]{12}$", "", ended.data["dispatcher"].py_func.__qualname__)
        seconds[name] = seconds.get(name, 0.0) + whole - inside
        if running:
            running[-1][1] += whole


def tell():
    with open(out, "w", encoding="utf-8") as file:
        json.dump(seconds, file)


event.register("numba:compile", Listener())
atexit.register(tell)
sys.argv[0] = "pliant"
from pliant.__main__ import main

main()
"""


def commands(folder: Path) -> dict[str, list[str]]:
    """Return the commands to time, each with the files that it needs."""
    model, task, pulse = folder / "model.json", folder / "task.toml", str(FOLDER / "pulse_119.nc")
    save_model(chen2018.model(), model)
    example = subprocess.run(
        [sys.executable, "-m", "pliant", "control", "--example"], capture_output=True, text=True, check=True
    )
    task.write_text(example.stdout, encoding="utf-8")
    pliant = [sys.executable, "-m", "pliant"]
    return {
        "import": [sys.executable, "-c", "import pliant.study"],
        "help": [*pliant, "--help"],
        "inspect": [*pliant, "inspect", pulse],
        "simulate": [*pliant, "simulate", str(model)],
        "demo": [*pliant, "demo", "-o", str(folder / "demo")],
        "control": [*pliant, "control", "--model", str(model), "--task", str(task), "-o", str(folder / "control")],
    }


def run(command: list[str], cache: Path) -> tuple[float, float]:
    """Return wall-clock time and processor time of a command, s."""
    before, start = resource.getrusage(resource.RUSAGE_CHILDREN), perf_counter()
    kept = {"NUMBA_CACHE_DIR": str(cache), "PYTHONDONTWRITEBYTECODE": ""}  # a person's second command finds bytecode
    done = subprocess.run(command, env={**os.environ, **kept}, capture_output=True, text=True, check=False)
    wall, after = perf_counter() - start, resource.getrusage(resource.RUSAGE_CHILDREN)
    if done.returncode:
        raise RuntimeError(f"{' '.join(command)[:100]} failed: {done.stderr[-500:]}")
    return wall, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def medians(once: Callable[[], tuple[float, float]], runs: int) -> dict[str, float]:
    """Return medians of the two times of `run`."""
    walls, processor = zip(*(once() for _ in range(runs)), strict=True)
    return {"wall_s": median(walls), "processor_s": median(processor)}


def measure(command: list[str], folder: Path, runs: int) -> dict[str, object]:
    """Return cold and warm times of one command, and the compile time of each kernel, s."""

    def cold() -> tuple[float, float]:
        with tempfile.TemporaryDirectory(dir=folder) as empty:
            return run(command, Path(empty))

    kernels: dict[str, float] = {}
    if "pliant" in command and "run" not in command:  # a study is asked for warm alone
        told = folder / "kernels.json"
        with tempfile.TemporaryDirectory(dir=folder) as empty:
            run([sys.executable, "-c", PROBE, str(told), *command[3:]], Path(empty))
        kernels = json.loads(told.read_text(encoding="utf-8"))
    found = {"cold": medians(cold, runs) if kernels else None}
    run(command, folder / "cache")
    return {**found, "warm": medians(lambda: run(command, folder / "cache"), runs), "kernels": kernels}


def table(results: dict[str, dict[str, object]]) -> str:
    """Return all commands, then all kernels, as text."""
    titles = (
        "command", "warm: wall, processor (s)", "target", "cold: wall, processor (s)", "target", "kernels",
        "compiling (s)",
    )
    lines = [f"| {' | '.join(titles)} |", "|---|---|---|---|---|---|---|"]
    for name, found in results.items():
        both = (found["warm"], found["cold"])
        pairs = [f"{t['wall_s']:.2f}, {t['processor_s']:.2f}" if t else "as warm" for t in both]
        kernels, aims = found["kernels"], TARGETS.get(name, STUDY if name.endswith(".toml") else (None, None))
        beside = [item for pair in zip(pairs, (aim or "" for aim in aims), strict=True) for item in pair]
        lines.append(f"| {name} | {' | '.join(map(str, beside))} | {len(kernels)} | {sum(kernels.values()):.1f} |")
    for name, found in results.items():
        ordered = sorted(found["kernels"].items(), key=lambda pair: -pair[1])
        lines += [f"{name}: " + ", ".join(f"{kernel} {seconds:.2f}" for kernel, seconds in ordered)] if ordered else []
    return "\n".join(lines)


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--runs", type=int, default=5)
    parser.add_argument("--only", nargs="+", default=None)
    parser.add_argument("--studies", nargs="+", type=Path, default=[])
    parser.add_argument("-o", "--output", type=Path, default=None)
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        chosen = {name: c for name, c in commands(folder).items() if asked.only is None or name in asked.only}
        for file in asked.studies:
            chosen[file.name] = [sys.executable, "-m", "pliant", "run", str(file), "-o", str(folder / file.stem)]
        results = {name: measure(command, folder, asked.runs) for name, command in chosen.items()}
    print(table(results))
    if asked.output is not None:
        asked.output.write_text(json.dumps(results, indent=2), encoding="utf-8")


if __name__ == "__main__":
    main()
