"""Entry point of the command line: `python -m pliant` and the console script `pliant`."""

from __future__ import annotations

import atexit
import gc
import os

GARBAGE = 1_000_000  # new objects between two garbage collections: imports create many objects and no garbage


def main() -> None:
    """Run pliant's command line, with one BLAS thread and rare garbage collections to make it start faster."""
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # on small matrices, threads cost more than they gain
    gc.set_threshold(GARBAGE)
    atexit.register(gc.freeze)  # skips the garbage collections when Python exits
    from pliant.cli import run
    from pliant.heavy import hide_heavy

    hide_heavy()
    run()


if __name__ == "__main__":
    main()
