"""Batch simulation of many samples on SIMD vectors and all cores."""

from pliant.batch.batch import simulate_batch

__all__ = ["simulate_batch"]
