"""Parameter sweeps on one process, several cores or a cluster, which continue after workers are lost."""

from pliant.sweep.sweep import run_sweep

__all__ = ["run_sweep"]
