"""Functions that save a contact map to a file: the whole dataset, a table of cells, or a figure."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from pliant.errors import InputError
from pliant.files import whole
from pliant.plotting import COLUMN_WIDTH, REST_COLOUR, new_figure, style

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def save_map(chart: xr.Dataset, path: str | Path) -> Path:
    """Write a contact map as .nc (whole dataset), .csv (x, y, probability of every cell) or .png (figure).

    Raises
    ------
    InputError
        For another suffix, or when the file cannot be written.
    """
    path = Path(path)
    if path.suffix not in (".nc", ".csv", ".png"):
        raise InputError(f"a map can be written as .nc, .csv or .png, not as {path.name!r}")
    with whole(path) as draft:
        if path.suffix == ".nc":
            chart.to_netcdf(draft, engine="h5netcdf")
        elif path.suffix == ".csv":
            X, Y = np.meshgrid(chart["x"].values, chart["y"].values)
            table = np.column_stack([X.ravel(), Y.ravel(), chart["probability"].values.ravel()])
            np.savetxt(draft, table, delimiter=",", header="x_m,y_m,probability", comments="", fmt="%.6g")
        else:
            contact_map(chart).savefig(draft, format="png")
    return path


def contact_map(chart: Any) -> Figure:
    """Plot a contact map: occupied cells dark, and the touched points with their normals."""
    with style():
        figure, ax = new_figure(width=COLUMN_WIDTH, height=3.2)
        x, y = (1e3 * chart[name].values for name in ("x", "y"))
        half = 0.5e3 * float(chart.attrs["cell_m"])
        box = (x[0] - half, x[-1] + half, y[0] - half, y[-1] + half)
        image = ax.imshow(chart["probability"].values, origin="lower", extent=box, cmap="Greys", vmin=0, vmax=1)
        points, normals = 1e3 * chart["surface"].values, chart["surface_normal"].values
        if len(points):
            ax.plot(*points.T, linestyle="", marker="o", markersize=2, color=REST_COLOUR, label="touched")
            ax.quiver(*points.T, *normals.T, color=REST_COLOUR, width=0.003, scale=25)
            ax.legend(loc="upper right")
        ax.set(xlabel="x (mm)", ylabel="y (mm)", aspect="equal")
        ax.grid(visible=False)
        figure.colorbar(image, ax=ax, label="probability of being solid")
    return figure
