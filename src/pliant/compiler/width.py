"""Sizes of the numbers in memory with which compiled kernels calculate, apart from plain floats."""

WIDTH = 8  # doubles in one AVX-512 register; LLVM splits the vector where registers are shorter
SLOTS = 2 * WIDTH  # floats of a dual number: the value, padding for alignment, the derivatives
