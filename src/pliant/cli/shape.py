"""`pliant shape`: from a raw recording to a clean planar shape."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from pliant.cli.terminal import say


def shape(
    file: Annotated[Path, typer.Argument(help="Raw recording of a body's shape.")],
    output: Annotated[Path, typer.Option("-o", "--output", help="Clean planar recording to write (.nc or .csv).")],
    mapping: Annotated[Path | None, typer.Option(help="TOML file with columns, units and format.")] = None,
    base: Annotated[str | None, typer.Option(help="Station at the base; default: 'base', or the first.")] = None,
    tangent: Annotated[
        str, typer.Option(help="Base tangent: chord, clamp, station+x ..., or three numbers 'x,y,z'.")
    ] = "chord",
    plane: Annotated[str, typer.Option(help="Plane of bending: motion, body, or its normal 'x,y,z'.")] = "motion",
    cap_curvature: Annotated[float | None, typer.Option(help="Of a cap that marks a fibre's tip, 1/m, signed.")] = None,
    cap_length: Annotated[float | None, typer.Option(help="Of that cap, m.")] = None,
    body_length: Annotated[float | None, typer.Option(help="Of the body along the fibre, m: the base lies so far "
                                                           "before the tip.")] = None,
    clamp_length: Annotated[float, typer.Option(help="Straight clamped fibre at its start, m.")] = 0.012,
    gauge_length: Annotated[float | None, typer.Option(help="Length over which the sensor averages, m.")] = None,
    json: Annotated[bool, typer.Option("--json", help="Print what was done as JSON.")] = False,
) -> None:
    """Find the tip, cut lead and tail, align: a raw shape becomes a planar one with its base at the origin.

    Example: pliant shape fibre.nc -o clean.nc --cap-curvature 50 --cap-length 0.03 --body-length 0.17
    """
    from pliant.cli.progress import busy
    from pliant.cli.reading import read_with_mapping
    from pliant.errors import InputError
    from pliant.preprocessing.align import align
    from pliant.preprocessing.quality import quality
    from pliant.recording import write
    from pliant.study.dense import body_of_fibre
    from pliant.study.schema import Fibre

    raw = read_with_mapping(file, mapping)
    found, status = quality(raw).summary(), ""
    cap = (cap_curvature, cap_length, body_length)
    if any(value is not None for value in cap):
        if cap_curvature is None or cap_length is None or body_length is None:
            raise InputError("a tip is found by its cap: give --cap-curvature, --cap-length and --body-length together")
        fibre = Fibre(
            body_length=body_length, cap_curvature=cap_curvature, cap_length=cap_length, gauge_length=gauge_length,
            clamp_length=clamp_length,
        )
        with busy("finding the tip"):
            clean, status = body_of_fibre(raw, fibre)
    else:
        with busy("aligning"):
            clean = align(raw, base=base, tangent=direction(tangent), plane=direction(plane))
    write(clean, output)
    tell(found.splitlines(), status, str(clean.attrs["history"]).splitlines(), output, as_json=json)


def tell(found: list[str], status: str, history: list[str], output: Path, *, as_json: bool) -> None:
    """What was found in the raw recording, how the tip was found, what was done, and where it went."""
    if as_json:
        import json

        say(json.dumps({"quality": found, "tip": status or None, "history": history, "recording": str(output)}))
        return
    say("\n".join([*found, *([status] if status else []), *history, f"wrote {output}"]))


def direction(text: str) -> str | list[float]:
    """Three numbers as a vector; anything else as the name of a method."""
    parts = text.split(",")
    try:
        return [float(p) for p in parts] if len(parts) == 3 else text
    except ValueError:
        return text
