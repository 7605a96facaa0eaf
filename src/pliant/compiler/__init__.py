"""Compilation of kernels: with Numba from the same source, as straight-line code, on SIMD vectors, and to C."""
