"""Error against time of every method on the paper's pulse: docs/figures/work_precision.png and .svg, and a table.

`--seconds S` ends each method after about S seconds, coarse settings first; the figure is then not replaced.
"""

from __future__ import annotations

from pathlib import Path

import matplotlib as mpl

mpl.use("Agg")
import matplotlib.pyplot as plt
from harness import parser_of
from speed import race
from speed.race import TARGET_MM
from speed.timing import machine

ROOT = Path(__file__).resolve().parents[1]
MARKERS = "os^vD<>Pp*Xh8d"


def draw(curves: dict[str, list[dict[str, float]]], processor: str):
    """Draw the diagram with one line per method, distinguished by markers and brightness."""
    fig, ax = plt.subplots(figsize=(7.5, 6.2), layout="constrained")
    for k, (name, rows) in enumerate(curves.items()):
        ours = name.startswith("pliant")
        shade = "0.0" if ours else f"{0.25 + 0.06 * (k % 8):.2f}"
        ax.loglog(
            [r["error_mm"] for r in rows], [r["ms"] for r in rows], marker=MARKERS[k % len(MARKERS)], color=shade,
            linewidth=2.0 if ours else 1.0, markersize=5 if ours else 4, label=name,
            linestyle="-" if ours else ("--", "-.", ":")[k % 3], markerfacecolor=shade if ours else "white",
        )
    ax.axvline(TARGET_MM, color="0.6", linewidth=0.8, zorder=0)
    ax.annotate(f"{TARGET_MM} mm", (TARGET_MM, 0.0), xycoords=("data", "axes fraction"), fontsize=8, color="0.4",
                xytext=(-2, 4), textcoords="offset points", ha="right", va="bottom")
    ax.set(xlabel="largest error of any tip [mm]", ylabel="processor time of the 4 s experiment [ms]", xlim=(1e-8, 30))
    ax.invert_xaxis()
    ax.grid(visible=True, which="major", color="0.9")
    fig.legend(fontsize=7.5, ncols=3, loc="outside lower center", handlelength=3.5)
    ax.set_title(f"The paper's pulse of 119 kPa, five links, one core of {processor}", fontsize=9)
    return fig


def main() -> None:
    """Race the methods, draw the figure and write it."""
    limit = parser_of(__doc__, seconds=float("inf")).parse_args().seconds
    problem = race.solved(race.Problem())
    methods = [race.pliant_midpoint(problem), race.pliant_extrapolated(problem), *race.scipy_methods(problem),
               *race.mujoco_methods(problem)]  # fmt: skip
    curves = {}
    never = "never within the target" if limit == float("inf") else "not within the target in the time given"
    for method in methods:
        said = "no setting gives an answer"
        if rows := race.curve(problem, method, limit):
            curves[method.name] = rows
            at = [r for r in rows if r["error_mm"] <= TARGET_MM]
            fastest = min(at, key=lambda r: r["ms"]) if at else None
            said = f"{fastest['ms']:.3g} ms at {fastest['error_mm']:.2g} mm" if fastest else never
        print(f"{method.name:<28} {said}", flush=True)
    if limit < float("inf"):
        return
    figure = draw(curves, str(machine()["processor"]))
    for ending in ("png", "svg"):
        figure.savefig(ROOT / "docs" / "figures" / f"work_precision.{ending}", dpi=160)
    print("wrote docs/figures/work_precision.png and .svg")


if __name__ == "__main__":
    main()
