"""Functions that resumable benchmarks share: one thread per process, chunks of one sample, options and results.

Import this module before NumPy, because libraries read the allowed number of threads when they are loaded.
"""

# ruff: noqa: E402
from __future__ import annotations

import os

for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"):
    os.environ[_name] = "1"

import argparse
import sys
import time
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

import xarray as xr

from pliant.sweep.scheduler import executor_of, run_chunks
from pliant.sweep.store import Store


@dataclass(frozen=True)
class OneByOne:
    """Chunks of one sample each for the sweep engine; a benchmark implements `work(chunk)`."""

    count: int

    @property
    def bounds(self) -> list[tuple[int, int]]:
        """Bounds of chunks with one sample each."""
        return [(k, k + 1) for k in range(self.count)]


def options(document: str, name: str, seeds: int) -> argparse.ArgumentParser:
    """Return the common command line options; results go to benchmarks/results/`name` by default."""
    parser = argparse.ArgumentParser(description=document.splitlines()[0])
    parser.add_argument("-o", "--output", type=Path, default=Path("benchmarks/results") / name)
    parser.add_argument("--seeds", type=int, default=seeds)
    parser.add_argument("--scheduler", default="local", help="local, processes, or tcp://host:port of Dask")
    parser.add_argument("--so-far", action="store_true", help="run nothing, show what is done")
    return parser


def samples(work: Any, key: dict[str, Any], args: argparse.Namespace) -> xr.Dataset:
    """Return all samples; missing samples are computed unless `args.so_far` is set."""
    store = Store(args.output, key)
    if not args.so_far:
        began = time.perf_counter()
        if args.scheduler == "processes":  # which import the class by name, and do not run the script again
            work = getattr(import_module(Path(sys.argv[0]).stem), type(work).__name__)(**vars(work))
        account = run_chunks(work, store, executor_of(args.scheduler), lambda line: print(line, flush=True))
        print(f"{account.sentence()}; {time.perf_counter() - began:.0f} s")
    parts = [part for k, bounds in enumerate(work.bounds) if (part := store.load(k, *bounds)) is not None]
    if not parts:
        raise SystemExit(f"nothing is done yet in {args.output}")
    return xr.concat(parts, dim="sample", data_vars="all", combine_attrs="override")
