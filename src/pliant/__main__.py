"""`python -m pliant`, the same as the console script `pliant`."""

from __future__ import annotations

import atexit
import gc
import os

GARBAGE = 1_000_000  # new objects between two searches for garbage: of those that an import makes none is any


def main() -> None:
    """Run the command line."""
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # small matrices: threads that wait cost more than they bring
    gc.set_threshold(GARBAGE)
    atexit.register(gc.freeze)  # Python's end searches everything for garbage, twice, before it gives all memory back
    from pliant.cli import run
    from pliant.heavy import hide_heavy

    hide_heavy()
    run()


if __name__ == "__main__":
    main()
