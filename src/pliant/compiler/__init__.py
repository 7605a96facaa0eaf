"""Compilation of numerical kernels: by Numba, as straight-line code, for SIMD vectors, for dual numbers, and
translation to C.
"""
