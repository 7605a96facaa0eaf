"""Metrics of a model on training and held-out recordings, and figures for papers."""
