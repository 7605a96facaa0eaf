"""Draw the explaining pictures of the documentation: ``python docs/figures/draw.py``."""

from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Arc, FancyArrowPatch, FancyBboxPatch, Rectangle

from pliant.plotting import save_figure, style

HERE = Path(__file__).parent
BLUE, RED, GREY = "#123e91", "#b02020", "0.45"


def arrow(ax, start, end, colour="black", width=1.2, head=9):
    """An arrow in data coordinates."""
    ax.add_patch(FancyArrowPatch(start, end, arrowstyle="-|>", mutation_scale=head, color=colour, linewidth=width,
                                 shrinkA=0, shrinkB=0, zorder=5))


def arc_points(kappa, s):
    """Points of a circular arc with tangent +y at the origin; positive curvature turns toward -x."""
    return np.stack([(np.cos(kappa * s) - 1) / kappa, np.sin(kappa * s) / kappa])


def tracker_panel(ax):
    """What a tracker sees: a body anywhere, marker clusters, its own axes."""
    turn = np.deg2rad(-80)
    R = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    place = np.array([[0.45], [0.75]])
    body = R @ arc_points(0.75, np.linspace(1e-3, 1.25, 60)) + place
    rest = R @ np.array([[0, 0], [0, 1.25]]) + place
    ax.plot(*rest, color="0.82", linewidth=7, linestyle="-", solid_capstyle="round")
    ax.plot(*body, color="0.45", linewidth=7, linestyle="-", solid_capstyle="round")
    for centre, name, shift in (
        (body[:, 0], "base markers", (-0.15, 0.17)), (body[:, -1], "tip markers", (-0.62, 0.05)),
    ):
        for offset in ((-0.06, 0.05), (0.07, 0.04), (0.0, -0.08)):
            ax.plot(*(centre + offset), "o", color="white", markeredgecolor=BLUE, markersize=5, markeredgewidth=1.2)
        ax.text(*(centre + shift), name, color=BLUE, fontsize=8)
    ax.text(1.35, 0.72, "at rest", color=GREY, fontsize=8)
    arrow(ax, place[:, 0], (R @ np.array([0, 0.6]) + place[:, 0]), RED, 1.6)
    ax.text(0.6, 0.55, "tangent", color=RED, fontsize=8)
    for end, name in (((0.35, 0.0), "X"), ((0.0, 0.35), "Z"), ((-0.16, -0.14), "Y")):
        arrow(ax, (0, 0.1), (end[0], end[1] + 0.1))
        ax.text(end[0] * 1.15 - 0.02, end[1] * 1.15 + 0.09, name, fontsize=8)
    ax.set_title("the tracker's frame", fontsize=9)
    ax.set(xlim=(-0.35, 2.0), ylim=(-0.3, 1.6))


def base_panel(ax):
    """The frame of every model: base at the origin, tangent +y, positive bending toward -x."""
    s = np.linspace(1e-3, 1.4, 60)
    body = arc_points(0.75, s)
    ax.plot([0, 0], [0, 1.4], color="0.82", linewidth=7, linestyle="-", solid_capstyle="round")
    ax.plot(*body, color="0.45", linewidth=7, linestyle="-", solid_capstyle="round")
    nodes = arc_points(0.75, np.array([1e-6, 1.4 / 3, 2.8 / 3, 1.4]))
    ax.plot(*nodes, "o", linestyle="-", color="black", markerfacecolor="white", linewidth=1.3, markersize=5)
    ax.fill_between([-0.18, 0.18], -0.16, -0.04, color="0.3")
    arrow(ax, (0, 0), (0.75, 0))
    arrow(ax, (0, 0), (0, 0.85), RED, 1.6)
    ax.text(0.78, -0.03, "+x", fontsize=9)
    ax.text(0.06, 0.8, "+y, the base tangent", fontsize=8, color=RED)
    ax.text(0.22, -0.16, "origin: the base station\n(+ origin_offset)", fontsize=7.5, va="top")
    ax.plot(0.42, 0.28, "o", markersize=9, markerfacecolor="white", markeredgecolor="black")
    ax.plot(0.42, 0.28, ".", color="black", markersize=4)
    ax.text(0.5, 0.25, "+z, to the reader", fontsize=8)
    ax.add_patch(Arc((0, 0), 2.4, 2.4, theta1=91, theta2=108, color=BLUE, linewidth=1.4, zorder=5))
    at = 1.2 * np.array([np.cos(np.deg2rad(108)), np.sin(np.deg2rad(108))])
    arrow(ax, at + np.array([0.05, 0.02]), at - np.array([0.06, 0.03]), BLUE, 1.4)
    ax.text(-1.15, 0.55, "positive pressure\nand positive angle:\ntip toward $-x$", fontsize=8, color=BLUE, va="top")
    ax.text(0.06, 0.2, "link 1", fontsize=7.5)
    ax.text(0.06, 1.3, "rest", fontsize=8, color=GREY)
    ax.set_title("the base frame of every model", fontsize=9)
    ax.set(xlim=(-1.2, 1.2), ylim=(-0.45, 1.5))


def frames():
    """Tracker frame and base frame side by side."""
    figure = Figure(figsize=(7.2, 3.4), layout="constrained")
    figure.get_layout_engine().set(h_pad=0.12)  # the titles stand above axes that are switched off
    left, right = figure.subplots(1, 2)
    tracker_panel(left)
    base_panel(right)
    for ax in (left, right):
        ax.set_aspect("equal")
        ax.axis("off")
    return figure


def mapping():
    """A plain table, its columns by index, and the lines of the mapping that name them."""
    figure = Figure(figsize=(7.2, 3.0), layout="constrained")
    ax = figure.subplots()
    rows = [
        ["0.00", "0.2", "0.1", "0.0", "0.3", "0.2", "99.8", "-4.1"],
        ["0.01", "0.2", "0.1", "0.0", "0.3", "0.1", "99.8", "-4.1"],
        ["0.02", "8.7", "0.1", "0.0", "0.3", "-1.9", "99.7", "-4.2"],
    ]
    groups = [
        (0, 1, "time = 0", BLUE, 3), (1, 2, 'pressure = { columns = [1], unit = "kPa" }', RED, 2),
        (2, 5, "stations.base = { position = [2, 3, 4] }", "#2c6e49", 1),
        (5, 8, "stations.tip = { position = [5, 6, 7] }", "#7a4fa3", 0),
    ]
    for first, last, line, colour, row in groups:
        ax.add_patch(Rectangle((first, 0), last - first, 4, facecolor=colour, alpha=0.12, edgecolor="none"))
        ax.plot([first + 0.06, last - 0.06], [-0.15, -0.15], color=colour, linewidth=2, linestyle="-")
        low = -0.55 - 0.5 * row
        ax.plot([first + 0.3, first + 0.3, first + 0.45], [-0.15, low, low], color=colour, linewidth=1, linestyle="-")
        ax.text(first + 0.5, low, line, va="center", fontsize=8, family="monospace", color=colour)
    for k in range(8):
        ax.text(k + 0.5, 3.5, str(k), ha="center", va="center", fontsize=9, weight="bold")
        for r, row in enumerate(rows):
            ax.text(k + 0.5, 2.5 - r, row[k], ha="center", va="center", fontsize=9, family="monospace")
    ax.text(-0.1, 3.5, "column", ha="right", va="center", fontsize=8)
    ax.text(-0.1, 1.5, "rows of\nthe file", ha="right", va="center", fontsize=8)
    ax.add_patch(FancyBboxPatch((8.25, 1.0), 2.3, 2.2, boxstyle="round,pad=0.1", facecolor="0.95", edgecolor="0.6"))
    whole = 'for the whole file\n\ndelimiter = ","\nlength_unit = "mm"'
    ax.text(8.35, 2.1, whole, fontsize=8, family="monospace", va="center")
    ax.set(xlim=(-1.0, 10.9), ylim=(-2.4, 4.1))
    ax.axis("off")
    return figure


def followed(path: Path) -> None:
    """The bundled film with what `pliant track` found in it: the sheet of `--overlay`, made smaller."""
    import cv2

    from pliant.files import read_entries
    from pliant.study import camera_study
    from pliant.testbed.bundle import FOLDER
    from pliant.video import Tracking, track_video

    with TemporaryDirectory() as folder:
        sheet = Path(folder) / "sheet.png"
        camera = read_entries(camera_study(), "study")["camera"]
        track_video(FOLDER / "film.mp4", camera, Tracking(overlays=(sheet,)))
        picture = cv2.imread(str(sheet))
    size = (1100, round(1100 * picture.shape[0] / picture.shape[1]))
    cv2.imwrite(str(path), cv2.resize(picture, size, interpolation=cv2.INTER_AREA), [cv2.IMWRITE_JPEG_QUALITY, 85])


def main() -> None:
    """Write all pictures."""
    followed(HERE / "followed.jpg")
    with style():
        for make in (frames, mapping):
            figure = make()
            save_figure(figure, HERE / f"{make.__name__}.svg")


if __name__ == "__main__":
    main()
