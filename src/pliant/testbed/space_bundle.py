"""Generate the bundled recordings of a body in space: ``python -m pliant.testbed.space_bundle``.

It needs PyElastica and takes about a minute. The noise has the seed 1.
"""

from __future__ import annotations

import numpy as np

from pliant.recording import append_history
from pliant.recording.netcdf import write_netcdf
from pliant.testbed.bundle import FOLDER, QUANTUM
from pliant.testbed.space import COMMANDS, fibre_table, marker_recording, simulate_in_space

SEED = 1
FIBRE = "mixed"  # the motion that the fibre records too


def main() -> None:
    """Write all bundled recordings of a body in space."""
    for number, name in enumerate(COMMANDS):
        motion = simulate_in_space(name)
        seen = marker_recording(motion, SEED + number, name=name)
        rounded = seen["position"].copy(data=np.round(seen["position"].to_numpy() / QUANTUM) * QUANTUM)
        kept = append_history(seen.assign(position=rounded), f"positions rounded to {QUANTUM * 1e6:.1f} um")
        write_netcdf(kept, FOLDER / f"space_{name}.nc", float32=True, compress=True)
        if name == FIBRE:
            half = motion._replace(**{field: getattr(motion, field)[::2] for field in motion._fields})
            (FOLDER / "space_fibre.csv").write_text(fibre_table(half, SEED), encoding="utf-8")


if __name__ == "__main__":
    main()
