"""`pliant order`: determine how many links a recorded shape needs."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from pliant.cli.inspect import described
from pliant.cli.output import aligned
from pliant.cli.terminal import answer, busy, in_unit, say
from pliant.errors import InputError

if TYPE_CHECKING:
    from pliant.reduction import OrderResult


def order(
    file: Annotated[Path, typer.Argument(help="Recording of a body's shape, base first.")],
    max_order: Annotated[int, typer.Option("--max-order", help="Highest number of segments to try.")] = 8,
    bound_mm: Annotated[
        float | None, typer.Option("--bound-mm", parser=in_unit("mm"), help="Largest error allowed in any frame, mm.")
    ] = None,
    boundary: Annotated[
        str, typer.Option("--boundary", help="natural, not-a-knot or clamped+not-a-knot.")
    ] = "clamped+not-a-knot",
    placement: Annotated[
        str, typer.Option("--placement", help="Joints at equal arc length (equal) or with the smallest error (best).")
    ] = "equal",
    metric: Annotated[
        str, typer.Option("--metric", help="arc: error at equal arc length; closest: distance to the closest point.")
    ] = "arc",
    mapping: Annotated[
        Path | None, typer.Option("--mapping", help="TOML file that describes the columns of FILE.")
    ] = None,
    figure: Annotated[
        Path | None, typer.Option("--figure", help="File for a figure; without a suffix, .svg and .png are written.")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON instead of a table.")] = False,
) -> None:
    """Choose the number of links from the errors of the shape rebuilt with 2, 3, ... segments.

    Example: pliant order body.nc --bound-mm 3 --figure order.png
    """
    from pliant.reduction import select_order

    recording, proposed = described(file, None if mapping is None else [str(mapping)])
    for line in proposed:
        say(line, error=True)
    with busy("trying orders"):
        result = select_order(
            recording, max_order=max_order, bound=None if bound_mm is None else 1e-3 * bound_mm, boundary=boundary,
            placement=placement, metric=metric,
        )
    if figure is not None:
        for path in _draw(result, figure):
            say(f"figure: {path}", error=True)
    answer(result.to_dict(), _table(result), as_json=as_json, indent=2)
    if as_json and result.frames_left_out:
        say(f"{result.frames_left_out} frame(s) with missing stations were left out", error=True)


def _table(result: OrderResult) -> str:
    head = ("n", "max", "mean", "median of max", "95 % of max", "within bound", "stations between", "flops")
    rows = []
    for n, row in zip(result.orders, result.to_dict()["orders"].values(), strict=True):
        numbers = (f"{row[key]:.3f}" for key in ("max_mm", "mean_mm", "median_of_max_mm", "p95_of_max_mm"))
        within = "" if result.bound is None else f"{100 * result.fraction_within(n):.1f} %"
        between = str(result.stations_between[result.orders.index(n)])
        mark = " <" if n == result.chosen else ""
        rows.append((f"{n}{mark}", *numbers, within, between, str(result.operations(n))))
    count = result.chosen or result.orders[-1]
    worst = ", ".join(f"{t:.3f} s ({e * 1e3:.2f} mm)" for t, e in result.worst_frames(count, 3))
    return "\n".join([
        f"{result.frames} frames, {result.stations} stations, errors in mm", *aligned([head, *rows]), result.summary(),
        f"Worst frames for n = {count}: {worst}.", *(f"- {note}" for note in result.notes),
    ])  # fmt: skip


def _draw(result: OrderResult, path: Path) -> list[Path]:
    from pliant.plotting import error_by_order, new_figure, order_bars, save_figure, style

    errors = dict(zip(result.orders, result.max_error, strict=True))
    with style():
        figure, (left, right) = new_figure(1, 2, width_ratios=(2, 1))
        error_by_order(left, result.time, errors, bound=result.bound)
        order_bars(right, errors, bound=result.bound)
        try:
            return save_figure(figure, path)
        except InputError:
            raise
        except ValueError as error:
            raise InputError(f"cannot save the figure {path}: {error}") from None
