"""`python -m pliant`, the same as the console script `pliant`."""

from __future__ import annotations

import os


def main() -> None:
    """Run the command line."""
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # small matrices: threads that wait cost more than they bring
    from pliant.cli import run
    from pliant.heavy import hide_dask

    hide_dask()
    run()


if __name__ == "__main__":
    main()
