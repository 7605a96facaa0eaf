"""Functions by which commands write files and print tables."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import product
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

from pliant.cli.terminal import answer, busy, mention
from pliant.errors import InputError
from pliant.files import whole
from pliant.units import input_words, quantity, shown_in

if TYPE_CHECKING:
    import numpy as np
    import pandas as pd
    import xarray as xr
    from matplotlib.figure import Figure

    from pliant.model import Model


def save_trajectory(trajectory: xr.Dataset, path: Path) -> None:
    """Write a trajectory atomically as netCDF (.nc) or as a table with one row for each time (.csv)."""
    if path.suffix not in (".nc", ".csv"):
        raise InputError(f"a trajectory file must end in .nc (netCDF) or .csv (table), got {path.name!r}")
    with whole(path) as draft:
        if path.suffix == ".nc":
            trajectory.to_netcdf(draft, engine="h5netcdf")
        else:
            table(trajectory).to_csv(draft, index=False)
    mention(f"wrote {path}")


def table(trajectory: xr.Dataset) -> pd.DataFrame:
    """Return a trajectory as a table with one row for each time. Each column name ends in its unit, as
    ``tip_position_link_5_x (m)``.
    """
    import pandas as pd

    from pliant.simulation.result import inputs_in

    columns = {"time (s)": trajectory["time"].to_numpy()}
    for name, variable in trajectory.data_vars.items():
        inner = [d for d in variable.dims if d != "time" and (d != "input" or variable.sizes[d] > 1)]
        labels = [[f"{d}_{v}" if d in ("joint", "link") else str(v) for v in trajectory[d].to_numpy()] for d in inner]
        flat = variable.to_numpy().reshape(variable.shape[0], -1)
        units = inputs_in(trajectory)[1] if name == "actuation" else [variable.attrs["units"]] * flat.shape[1]
        for k, ends in enumerate(product(*labels)):
            columns[f"{'_'.join([str(name), *ends])} ({units[k]})"] = flat[:, k]
    return pd.DataFrame(columns)


def write_film(trajectory: xr.Dataset, model: Model, path: Path) -> None:
    """Write a video of the moving body (.gif or .mp4) atomically."""
    if path.suffix not in (".gif", ".mp4"):
        raise InputError(f"the name of a video file must end in .gif or .mp4, got {path.name!r}")
    from pliant.validation.use_figures import body_film, inputs_shown

    time, tips = trajectory["time"].to_numpy(), trajectory["tip_position"].to_numpy()
    with whole(path) as draft, TemporaryDirectory() as folder, busy("drawing the video"):
        video = Path(folder) / f"film{path.suffix}"  # the writer depends on the suffix
        body_film(video, time, base_of(model), tips, *inputs_shown(trajectory))
        draft.write_bytes(video.read_bytes())
    mention(f"wrote {path}")


def base_of(model: Model) -> np.ndarray:
    """Return the positions (2, d) [m] of the body's base and of its first joint, at rest."""
    import numpy as np

    from pliant.mechanics import mechanics_of

    chain = mechanics_of(model)
    return np.asarray(chain.nodes(chain.coordinates(np.zeros(chain.size))))[:2]


def write_figure(figure: Figure, path: Path) -> None:
    """Write a figure atomically in the format of the suffix of `path`."""
    if path.suffix not in (".png", ".svg", ".pdf"):
        raise InputError(f"the name of a figure file must end in .png, .svg or .pdf, got {path.name!r}")
    with whole(path) as draft:
        figure.savefig(draft, dpi=200, format=path.suffix[1:])
    mention(f"wrote {path}")


def largest(trajectory: xr.Dataset) -> dict[str, float]:
    """Return the input farthest from zero, with its sign, so that a vacuum counts too: one for each kind of input, by
    a name that ends in its unit, such as "largest_pressure_kpa".
    """
    from pliant.simulation.result import inputs_in

    values, units = inputs_in(trajectory)
    peaks = {}
    for unit in dict.fromkeys(units):
        columns = values[:, [u == unit for u in units]]
        factor, display_unit = shown_in(unit)
        name = f"largest_{input_words([unit])[0]}_{display_unit}".lower().replace(" ", "_")
        peaks[name] = factor * float(columns.flat[abs(columns).argmax()])
    return peaks


def summary(trajectory: xr.Dataset) -> dict[str, Any]:
    """Return a dict that summarises a simulated trajectory: duration, frames, tip displacement [mm], largest input
    of each kind and time step [ms].
    """
    import numpy as np

    tip = trajectory["tip_position"].to_numpy()[:, -1]
    moved = np.linalg.norm(tip - tip[0], axis=1)
    error = trajectory.attrs.get("tip_error")
    return {
        "duration_s": float(trajectory.time[-1] - trajectory.time[0]),
        "frames": int(trajectory.sizes["time"]),
        "largest_tip_displacement_mm": 1e3 * float(moved.max()),
        "final_tip_mm": [1e3 * float(v) for v in tip[-1]],
        **largest(trajectory),
        "method": trajectory.attrs["method"], "step_ms": 1e3 * trajectory.attrs["step_s"],
        **({} if error is None else {"largest_tip_error_estimated_mm": 1e3 * error}),
    }


def print_numbers(
    numbers: Mapping[str, Any], *, as_json: bool, title: str = "", meaning: Mapping[str, str] | None = None,
) -> None:
    """Print named numbers as JSON, or as a table with name, value, unit and, if stated, meaning."""
    answer(numbers, number_table(numbers, title, meaning), as_json=as_json, default=float)


def number_table(numbers: Mapping[str, Any], title: str, meaning: Mapping[str, str] | None) -> str:
    """Return named numbers as a table with name, value, unit and, if stated, meaning."""
    rows, sentences = [], []
    for name, value in numbers.items():
        words, unit = quantity(name)
        if isinstance(value, str):
            sentences.append(f"  {words}: {value}")
        else:
            rows.append([words, shown(value), unit, *([meaning.get(name, "")] if meaning else [])])
    return "\n".join([*([title] if title else []), *aligned(rows), *sentences])


def shown(value: Any) -> str:
    """Return a value as text for a table: numbers with four digits, yes or no for a bool, a dash for None."""
    if isinstance(value, bool) or value is None:
        return {True: "yes", False: "no", None: "-"}[value]
    if isinstance(value, float):
        return f"{value:.4g}"
    return ", ".join(map(shown, value)) if isinstance(value, list | tuple) else str(value)


def aligned(rows: Sequence[Sequence[str]]) -> list[str]:
    """Return the rows of a table as lines of text, with numeric columns aligned to the right and others to the left."""
    width = [max(map(len, column)) for column in zip(*rows, strict=True)]
    right = [k > 0 and sum(c[:1].isdigit() or c[:1] in ("-", "+") for c in column) > len(rows) // 2
             for k, column in enumerate(zip(*rows, strict=True))]
    placed = [[c.rjust(w) if r else c.ljust(w) for c, w, r in zip(row, width, right, strict=True)] for row in rows]
    return [f"  {'  '.join(row)}".rstrip() for row in placed]
