"""Batch simulation of many samples on SIMD vectors, all cores or a GPU."""

from pliant.batch.batch import simulate_batch

__all__ = ["simulate_batch"]
