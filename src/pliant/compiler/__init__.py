"""Compilation of numerical kernels, which are plain Python functions on arrays. Numba compiles them for floats, SIMD
vectors and dual numbers, partly as straight-line code without loops. They can also be translated to C.
"""

WIDTH = 8  # doubles in one AVX-512 register; LLVM splits the vector where registers are shorter
SLOTS = 2 * WIDTH  # floats of a dual number: the value, padding for alignment, the derivatives
