"""`pliant shape`: convert a raw recording to a clean shape in the base frame."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from pliant.cli.terminal import answer, in_unit


def shape(
    file: Annotated[Path, typer.Argument(help="Raw recording of a body's shape.")],
    output: Annotated[Path, typer.Option("-o", "--output", help="Clean recording to write (.nc or .csv).")],
    mapping: Annotated[Path | None, typer.Option(help="TOML file with columns, units and format.")] = None,
    base: Annotated[str | None, typer.Option(help="Station at the base; default: 'base' or the first.")] = None,
    tangent: Annotated[
        str, typer.Option(help="Base tangent: chord, clamp, an axis of a station such as station+x, or 'x,y,z'.")
    ] = "chord",
    plane: Annotated[str, typer.Option(help="Plane of bending: motion, body, input, or its normal, an axis such as +x "
                                             "or 'x,y,z'; in space the normal is x.")] = "motion",
    rest: Annotated[str, typer.Option(help="START,STOP: when the body is at rest, s.", show_default="found")] = "",
    origin: Annotated[str, typer.Option(help="X,Y,Z of the base in the tracker's frame, m, if no station shows it.",
                                        show_default="the base station")] = "",
    cap_curvature: Annotated[float | None, typer.Option(parser=in_unit("1/m"),
                                                        help="Signed curvature of the tip's cap, 1/m.")] = None,
    cap_length: Annotated[float | None, typer.Option(parser=in_unit("m"), help="Length of that cap, m.")] = None,
    body_length: Annotated[float | None, typer.Option(parser=in_unit("m"),
                                                      help="Length of the body along the fibre, m, from the "
                                                           "base to the tip.")] = None,
    start: Annotated[float | None, typer.Option(parser=in_unit("m"),
                                                help="Length of fibre before the body, m, if no cap marks the "
                                                     "tip.")] = None,
    space: Annotated[bool, typer.Option("--space", help="Keep three dimensions: base tangent along +z.")] = False,
    clamp_length: Annotated[float, typer.Option(parser=in_unit("m"),
                                                help="Length of straight, clamped fibre at its start, m.")] = 0.012,
    gauge_length: Annotated[float | None, typer.Option(parser=in_unit("m"),
                                                       help="Length over which the sensor averages, m.")] = None,
    json: Annotated[bool, typer.Option("--json", help="Print the processing steps as JSON.")] = False,
) -> None:
    """Convert a raw shape to a clean one with its base at the origin: find the tip, cut out the body, align.

    Example: pliant shape fibre.nc -o clean.nc --cap-curvature 50 --cap-length 0.03 --body-length 0.17
    """
    from pliant.cli.reading import read_with_mapping, vector
    from pliant.cli.terminal import busy
    from pliant.errors import InputError, inside
    from pliant.preprocessing.align import align
    from pliant.preprocessing.quality import quality
    from pliant.recording import write
    from pliant.recording.schema import history_of
    from pliant.study.dense import body_of_fibre
    from pliant.study.schema import Fibre

    raw = read_with_mapping(file, mapping)
    summary, status = quality(raw).summary().splitlines(), ""
    cap = cap_curvature is not None and cap_length is not None
    if any(value is not None for value in (cap_curvature, cap_length, body_length, start)):
        if body_length is None or cap == (start is not None) or (cap_curvature is None) != (cap_length is None):
            raise InputError("to locate the body along the fibre, give either --cap-curvature, --cap-length and "
                             "--body-length together, or --start and --body-length")  # fmt: skip
        fibre = Fibre(
            body_length=body_length, cap_curvature=cap_curvature, cap_length=cap_length, gauge_length=gauge_length,
            clamp_length=clamp_length, start=start,
        )
        with busy("finding the tip"), inside(file.name):
            clean, status = body_of_fibre(raw, fibre, space=space)
    else:
        window = vector(rest, 2, f"--rest must be START,STOP in s, got {rest!r:.60}", "s") if rest else None
        place = vector(origin, 3, f"--origin must be X,Y,Z in m, got {origin!r:.60}", "m") if origin else None
        with busy("aligning"), inside(file.name):
            clean = align(raw, base=base, tangent=direction(tangent), plane=direction(plane), space=space, rest=window,
                          origin=place)
    write(clean, output)
    history = history_of(clean)
    answer({"quality": summary, "tip": status or None, "history": history, "recording": str(output)},
           "\n".join([*summary, *filter(None, [status]), *history, f"wrote {output}"]), as_json=json)


def direction(text: str) -> str | list[float]:
    """Return 'x,y,z' as a list of three numbers. Any other text, the name of an axis or a method, is returned
    unchanged.
    """
    parts = text.split(",")
    try:
        return [float(p) for p in parts] if len(parts) == 3 else text
    except ValueError:
        return text
