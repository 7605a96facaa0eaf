"""Numerical methods without physics: matrix factorisation, splines, curves, rotations, and analysis of free decays."""
