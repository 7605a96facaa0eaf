"""Preprocess a recording to clean shapes: quality, marker clusters, alignment, time synchronisation, resampling, ..."""
