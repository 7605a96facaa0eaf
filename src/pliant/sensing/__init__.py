"""Compute curvature and shape from the strain of a multicore fibre."""

from pliant.numerics.curve import planar_curve, spatial_curve
from pliant.sensing.cores import read_shape, shape_from_strain, tip_sigma
from pliant.sensing.strain import CoreLayout, FibreState, curvature_from_strain

__all__ = [
    "CoreLayout", "FibreState", "curvature_from_strain", "planar_curve", "read_shape",
    "shape_from_strain", "spatial_curve", "tip_sigma",
]  # fmt: skip
