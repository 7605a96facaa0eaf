"""What commands write and print."""

from __future__ import annotations

import json as jsonlib
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from pliant.errors import InputError
from pliant.files import whole

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.figure import Figure


@contextmanager
def busy(what: str) -> Iterator[None]:
    """A line on the terminal that says what is done and for how long, once that has taken a second; none in a pipe."""
    if not sys.stderr.isatty():
        yield
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    columns = (TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn())
    bar = Progress(*columns, console=Console(stderr=True), transient=True, redirect_stdout=False, redirect_stderr=False)
    bar.add_task(what, total=None)
    begin = threading.Timer(1.0, bar.start)
    begin.start()
    try:
        yield
    finally:
        begin.cancel()
        begin.join()
        bar.stop()


@contextmanager
def telling(*, quiet: bool = False) -> Iterator[Callable[[str], None]]:
    """Takes one line for each thing done: above a running clock on a terminal, plain in a pipe, none if quiet."""
    if quiet or not sys.stderr.isatty():
        yield (lambda _line: None) if quiet else (lambda line: typer.echo(line, err=True))
        return
    from rich.console import Console
    from rich.progress import Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

    console = Console(stderr=True)
    columns = (SpinnerColumn(), TextColumn("{task.description}", markup=False), TimeElapsedColumn())
    with Progress(*columns, console=console, transient=True, redirect_stdout=False, redirect_stderr=False) as bar:
        task = bar.add_task("reading", total=None)

        def tell(line: str) -> None:
            console.print(line, markup=False, highlight=False)
            bar.update(task, description=f"after: {line[:60]}")

        yield tell


def save_trajectory(trajectory: xr.Dataset, path: Path) -> None:
    """Write a trajectory as netCDF, whole or not at all."""
    if path.suffix != ".nc":
        raise InputError(f"a trajectory is netCDF: its file ends in .nc, not {path.name!r}")
    with whole(path) as draft:
        trajectory.to_netcdf(draft, engine="h5netcdf")


def write_figure(figure: Figure, path: Path) -> None:
    """Write a figure as the ending of `path` says, whole or not at all."""
    if path.suffix not in (".png", ".svg", ".pdf"):
        raise InputError(f"a figure ends in .png, .svg or .pdf, not {path.name!r}")
    with whole(path) as draft:
        figure.savefig(draft, dpi=200, format=path.suffix[1:])


def summary(trajectory: xr.Dataset) -> dict[str, Any]:
    """The tip of a trajectory in a few numbers."""
    import numpy as np

    tip = trajectory["tip_position"].values[:, -1]
    moved = np.linalg.norm(tip - tip[0], axis=1)
    return {
        "duration_s": float(trajectory.time[-1] - trajectory.time[0]),
        "frames": int(trajectory.sizes["time"]),
        "largest_tip_displacement_mm": 1e3 * float(moved.max()),
        "final_tip_mm": [1e3 * float(v) for v in tip[-1]],
        "highest_pressure_kpa": 1e-3 * float(trajectory["pressure"].max()),
        "method": trajectory.attrs["method"],
    }


def print_summary(trajectory: xr.Dataset, *, as_json: bool) -> None:
    """Print the summary as JSON or as lines."""
    numbers = summary(trajectory)
    if as_json:
        typer.echo(jsonlib.dumps(numbers))
        return
    for name, value in numbers.items():
        shown = ", ".join(f"{v:.4g}" for v in value) if isinstance(value, list) else value
        typer.echo(f"{name:<30} {shown:.5g}" if isinstance(shown, float) else f"{name:<30} {shown}")
