"""Benchmarks of pliant beside other programs on this machine; an error accompanies every time."""
