"""`pliant figures` and `pliant view`: draw the figures of a study, and run its model on a page in the browser."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from pliant.cli.terminal import answer, busy, in_unit, mention


def figures(
    result: Annotated[Path, typer.Argument(help="Results folder of `pliant run` or `pliant demo`.")],
    output: Annotated[
        Path | None, typer.Option("-o", "--output", help="Folder for the figures; default: RESULT/figures.")
    ] = None,
    kinds: Annotated[str, typer.Option("--format", help="One or more of svg, pdf and png, such as pdf,svg.")] = "pdf",
    width_mm: Annotated[
        float | None, typer.Option("--width-mm", parser=in_unit("mm"),
                                   help="Width, mm; 88 is one column. Default: two columns, 182 mm.")
    ] = None,
    records: Annotated[str, typer.Option("--records", help="Recordings to draw: a,b. Default: all.")] = "",
    all_fits: Annotated[bool, typer.Option("--all-fits", help="Draw all fits, not the chosen model alone.")] = False,
    letters: Annotated[bool, typer.Option("--letters", help="Mark the panels (a), (b), ...")] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print the files as JSON.")] = False,
) -> None:
    """Draw figures for a paper from the results of a study: motion, residual, path, torque law, number of links.

    Figures have no title, so that you can write the caption. At 88 mm width none is higher than 120 mm.

    Example: pliant figures results/demo --format pdf,svg --width-mm 88 --records pulse_119
    """
    from pliant.validation.draw import draw_figures
    from pliant.validation.store import load_outcome

    with busy("drawing"):
        written = [str(f) for f in draw_figures(
            load_outcome(result), output or result / "figures", kinds=split(kinds), width_mm=width_mm,
            records=split(records), all_fits=all_fits, letters=letters, warn=mention,
        )]
    answer(written, "\n".join(written), as_json=as_json)


def split(text: str) -> list[str]:
    """Return the words of a comma-separated text, without blanks and empty words."""
    return [word.strip() for word in text.split(",") if word.strip()]


def view(
    source: Annotated[Path, typer.Argument(help="Model file, or results folder of `pliant run`.")],
    loop: Annotated[
        Path | None, typer.Option("--loop", help="log.csv that `pliant control` is writing, to watch that loop.")
    ] = None,
    touch_mn_m: Annotated[
        float, typer.Option("--touch-mn-m", parser=in_unit("mN m", least=0.0),
                            help="With --loop and --estimator filter: unexplained joint"
                            " torque, mN m, above which the force that explains it is drawn; 0: never.")
    ] = 0.0,
    port: Annotated[int, typer.Option("--port", help="Port on this machine; 0: any free one.")] = 0,
    browser: Annotated[bool, typer.Option("--browser/--no-browser", help="Open the page.")] = True,
    json: Annotated[bool, typer.Option("--json", help="Print the address as JSON.")] = False,
) -> None:
    """Open a page where the model runs: sliders set pressures, parameters and gravity; the mouse pulls the body.

    Needs the optional packages of the extra view. The page is accessible from this machine only, until this program
    ends (Ctrl-C).

    Example: pliant view results/demo
    """
    import webbrowser

    from pliant.view.live import page_content
    from pliant.view.server import Server

    server = Server(page_content(source, loop, 1e-3 * touch_mn_m), port)
    answer({"address": server.address}, server.address, as_json=json)
    if browser:
        webbrowser.open(server.address)
    server.run()
