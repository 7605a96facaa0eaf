"""Sweeps over parameters, on cores or a cluster, that survive a lost worker."""

from pliant.sweep.sweep import run_sweep

__all__ = ["run_sweep"]
