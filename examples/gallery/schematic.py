"""The paper's drawings: cross-section, chain in the base frame, one segment with its symbols; to scale.

No recording. Run: python examples/gallery/schematic.py [picture.png]
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Arc, FancyArrowPatch, Wedge

from pliant.actuators import chen2018
from pliant.equations.chamber import lever_arm
from pliant.plotting import save_figure, style
from pliant.simulation import equilibrium

R1, R2 = 14.0, 10.0  # mm, the paper's


def arrow(ax, start, end, text, shift=(3, 3), colour="black"):
    """An arrow with its name at the head."""
    ax.add_patch(FancyArrowPatch(start, end, arrowstyle="-|>", mutation_scale=8, color=colour, shrinkA=0, shrinkB=0))
    ax.annotate(text, end, xytext=shift, textcoords="offset points", fontsize=8, color=colour)


def section(ax):
    """The half ring of Sec. II with the chamber, its area A and the distance d of its centroid."""
    ax.add_patch(Wedge((0, 0), R1, 0, 180, width=R1 - R2, facecolor="0.75", edgecolor="black"))
    ax.add_patch(Wedge((0, 0), R2, 0, 180, facecolor="0.95", edgecolor="black", linewidth=0.8))
    d = 1e3 * lever_arm(R2 / 1e3)
    ax.plot([-R1 - 3, R1 + 3], [0, 0], color="0.4", linestyle=":", linewidth=0.8)
    ax.plot(0, d, "o", color="black", markersize=4)
    arrow(ax, (0, 0), (0, d), "d", (4, -9))
    for radius, angle, name, shift in ((R1, 35, "$r_1$", (3, 3)), (R2, 145, "$r_2$", (4, -9))):
        turn = np.deg2rad(angle)
        arrow(ax, (0, 0), (radius * np.cos(turn), radius * np.sin(turn)), name, shift)
    ax.text(2, 6.5, "A", fontsize=9)
    ax.set(xlim=(-20, 20), ylim=(-6, 20), title="cross-section")


def chain(ax):
    """Five links under 480 kPa, for the angles to be seen: joints, angles, the base frame."""
    model = chen2018.model()
    phi = np.cumsum(equilibrium(model, 480e3) + model.rest_angle)
    steps = 1e3 * model.link_length[:, None] * np.stack([-np.sin(phi), np.cos(phi)], axis=1)
    nodes = np.concatenate([[[0.0, 0.0]], np.cumsum(steps, axis=0)])
    ax.plot(*nodes.T, color="black", marker="o", markerfacecolor="white", linewidth=1.5, linestyle="-")
    arrow(ax, (0, 0), (45, 0), "x")
    arrow(ax, (0, 0), (0, 55), "y")
    ax.text(4, -12, "{O}", fontsize=9)
    for i, (x, y) in enumerate(nodes[:-1]):
        ax.annotate(rf"$\theta_{i + 1}$", (x, y), xytext=(8, 6), textcoords="offset points", fontsize=8)
    ax.annotate("tip", nodes[-1], xytext=(-16, 6), textcoords="offset points", fontsize=8)
    ax.set(xlim=(-110, 60), ylim=(-25, 160), title="the chain")


def link(ax):
    """Segment i: its length, its angle from the one before, spring, damper and torque at its joint."""
    turn = np.deg2rad(28)
    end = np.array([-34 * np.sin(turn), 34 * np.cos(turn)])
    ax.plot([0, 0], [-26, 0], color="0.55", linewidth=5, linestyle="-", solid_capstyle="round")
    ax.plot([0, end[0]], [0, end[1]], color="black", linewidth=5, linestyle="-", solid_capstyle="round")
    ax.plot([0, 0], [0, 36], color="0.4", linestyle=":", linewidth=0.9)
    ax.plot([0, end[0]], [0, end[1]], "o", color="black", markerfacecolor="white", markersize=7, linestyle="none")
    ax.add_patch(Arc((0, 0), 40, 40, theta1=90, theta2=118, color="black"))
    ax.text(3, 14, r"$\theta_i+\theta_{i0}$", fontsize=8)
    ax.text(*(end / 2 + [-14, -2]), r"$l_i,\ m_i$", fontsize=8)
    ax.text(5, -2, r"$K_b,\ D_i,\ \tau_i=pAd$", fontsize=8)
    along = np.array([-np.sin(turn), np.cos(turn)])
    arrow(ax, end, end + 13 * along, "$y_i$")
    arrow(ax, end, end + 13 * np.array([along[1], -along[0]]), "$x_i$")
    ax.text(end[0] - 14, end[1] - 4, r"$\{O_i\}$", fontsize=8)
    ax.set(xlim=(-42, 34), ylim=(-30, 52), title="segment i")


def main(path: Path) -> None:
    """Draw the three panels side by side into `path`."""
    with style():
        figure = Figure(figsize=(7.2, 3.4), layout="constrained")
        for ax, draw in zip(figure.subplots(1, 3), (section, chain, link), strict=True):
            draw(ax)
            ax.set_aspect("equal")
            ax.axis("off")
        figure.get_layout_engine().set(h_pad=0.15)
        save_figure(figure, path)


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "schematic.png"))
