"""Measure how the time of one step grows with the number of links, for dense and articulated-body steps.

Each step exists as loops and as straight-line code. `chosen` is the step that every simulation uses; see
`pliant.compiler.choose`.
"""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
from numba import njit
from speed.timing import best, machine

from pliant.actuators import chen2018
from pliant.compiler.choose import fast_step, straight, twin
from pliant.compiler.twin import options, rebuild
from pliant.equations.articulated import step_articulated
from pliant.equations.motion import step
from pliant.mechanics import mechanics_of
from pliant.simulation import march_loops

LINKS = (1, 2, 3, 4, 5, 6, 7, 8, 10, 12, 14, 16, 20, 30, 40, 50)
MOST_DENSE = 16  # links of a dense straight line: more take long to compile
CALLS, STEP, TORQUE = 500, 1e-4, 0.05


def step_ns(compiled, n: int) -> tuple[float, np.ndarray]:
    """Return the time of one step in a time integration, ns, and the angles after `CALLS` steps."""
    model = chen2018.model(links=n)
    march = rebuild(march_loops.march, njit(**{**options(march_loops.march), "cache": False}), {"step": compiled})
    keep = np.append(np.full(CALLS - 1, -1), 0)
    torque, gain, load = np.full((CALLS, 1), TORQUE), np.ones((1, n)), np.zeros((0, n, 2))
    steps = march_loops.Steps(np.full(CALLS, STEP), torque, gain, keep, load, np.zeros((0, 5)))
    rows = march_loops.rows_for(1, n, (n, 0), 2)

    def run():
        march(np.zeros(n), np.zeros(n), steps, *mechanics_of(model).parts(), rows)

    seconds = best(run, seconds=0.2)
    return 1e9 * seconds / CALLS, rows.phi[0].copy()


def kinds(n: int) -> dict[str, object]:
    """Return the compiled steps that exist for n links."""
    made = {"dense": twin(step)}
    if n <= MOST_DENSE:
        made["dense_straight"] = straight(step, n)
    if n >= 4:
        made |= {"articulated": twin(step_articulated), "articulated_straight": straight(step_articulated, n)}
    return made


def main() -> None:
    """Print one line per number of links, and write the table."""
    rows = []
    names = ("dense", "dense_straight", "articulated", "articulated_straight", "chosen")
    print(f"{'links':>5} " + " ".join(f"{name:>20}" for name in names) + f" {'difference rad':>15}   (ns)")
    for n in LINKS:
        made = kinds(n)
        found = {name: step_ns(compiled, n) for name, compiled in made.items()}
        chosen = next(name for name, compiled in made.items() if compiled is fast_step(n))
        difference = max(float(np.abs(found["dense"][1] - angle).max()) for _, angle in found.values())
        row = {f"{name}_ns": found[name][0] for name in found} | {"chosen": chosen, "chosen_ns": found[chosen][0]}
        rows.append({"links": n, **row, "difference_rad": difference})
        shown = " ".join(f"{row[f'{name}_ns']:>20.0f}" if f"{name}_ns" in row else f"{'-':>20}" for name in names)
        print(f"{n:>5} {shown} {difference:>15.1e}", flush=True)
    path = Path(__file__).parent / "results" / "growth.json"
    path.parent.mkdir(exist_ok=True)
    path.write_text(json.dumps({"machine": machine(), "rows": rows}, indent=1) + "\n", encoding="utf-8")
    print(f"wrote {path}")


if __name__ == "__main__":
    main()
