"""Benchmarks of pliant compared with other programs on this machine, with the error of each computation."""
