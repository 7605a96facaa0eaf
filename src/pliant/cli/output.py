"""What commands write and print."""

from __future__ import annotations

import json as jsonlib
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from itertools import product
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

import typer

from pliant.errors import InputError
from pliant.files import whole

if TYPE_CHECKING:
    import numpy as np
    import pandas as pd
    import xarray as xr
    from matplotlib.figure import Figure

    from pliant.model import Model


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
    """Write a trajectory as netCDF or as a table of everything that has a time, whole or not at all."""
    if path.suffix not in (".nc", ".csv"):
        raise InputError(f"a trajectory is netCDF or a table: its file ends in .nc or .csv, not {path.name!r}")
    with whole(path) as draft:
        if path.suffix == ".nc":
            trajectory.to_netcdf(draft, engine="h5netcdf")
        else:
            table(trajectory).to_csv(draft, index=False)


def table(trajectory: xr.Dataset) -> pd.DataFrame:
    """One row a time, one column a number, its unit in the name: ``tip_position_link_5_x (m)``."""
    import pandas as pd

    columns = {"time (s)": trajectory["time"].to_numpy()}
    for name, variable in trajectory.data_vars.items():
        inner = [d for d in variable.dims if d != "time"]
        labels = [[f"{d}_{v}" if d in ("joint", "link") else str(v) for v in trajectory[d].to_numpy()] for d in inner]
        flat = variable.to_numpy().reshape(variable.shape[0], -1)
        for k, ends in enumerate(product(*labels)):
            columns[f"{'_'.join([str(name), *ends])} ({variable.attrs['units']})"] = flat[:, k]
    return pd.DataFrame(columns)


def write_film(trajectory: xr.Dataset, model: Model, path: Path) -> None:
    """Write a film of the moving body, whole or not at all."""
    if path.suffix not in (".gif", ".mp4"):
        raise InputError(f"a film ends in .gif or .mp4, not {path.name!r}")
    from pliant.validation.film import body_film

    base, pressure = base_of(model), 1e-3 * trajectory["pressure"].to_numpy()
    time, tips = trajectory["time"].to_numpy(), trajectory["tip_position"].to_numpy()
    with whole(path) as draft, TemporaryDirectory() as folder, busy("drawing the film"):
        made = Path(folder) / f"film{path.suffix}"  # its writers go by the ending
        body_film(made, time, base, tips, pressure)
        draft.write_bytes(made.read_bytes())


def base_of(model: Model) -> list[list[float]]:
    """Origin and first joint (2, 2), m."""
    x, y = model.first_joint
    return [[0.0, 0.0], [float(model.bend_sign * x), float(y)]]


def write_figure(figure: Figure, path: Path) -> None:
    """Write a figure as the ending of `path` says, whole or not at all."""
    if path.suffix not in (".png", ".svg", ".pdf"):
        raise InputError(f"a figure ends in .png, .svg or .pdf, not {path.name!r}")
    with whole(path) as draft:
        figure.savefig(draft, dpi=200, format=path.suffix[1:])


def largest(pressure: np.ndarray) -> float:
    """The value of the largest size, with its sign: a vacuum is no pressure of zero."""
    return float(pressure[abs(pressure).argmax()])


def summary(trajectory: xr.Dataset) -> dict[str, Any]:
    """The tip of a trajectory in a few numbers."""
    import numpy as np

    tip = trajectory["tip_position"].to_numpy()[:, -1]
    moved = np.linalg.norm(tip - tip[0], axis=1)
    return {
        "duration_s": float(trajectory.time[-1] - trajectory.time[0]),
        "frames": int(trajectory.sizes["time"]),
        "largest_tip_displacement_mm": 1e3 * float(moved.max()),
        "final_tip_mm": [1e3 * float(v) for v in tip[-1]],
        "largest_pressure_kpa": 1e-3 * largest(trajectory["pressure"].to_numpy()),
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
