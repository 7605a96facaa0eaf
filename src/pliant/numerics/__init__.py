"""Numerical methods without physics: factorisations, splines, bases, curves, ring-down analysis."""
