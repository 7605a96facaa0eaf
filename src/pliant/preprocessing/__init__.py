"""From a recording to clean planar shapes: quality, clusters, alignment, clocks, resampling, curvature, tip."""
