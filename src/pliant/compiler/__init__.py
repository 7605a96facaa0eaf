"""Compilation of numerical kernels, which are plain Python functions on arrays. Numba compiles them for floats, SIMD
vectors and dual numbers, partly as straight-line code without loops. They can also be translated to C.
"""
