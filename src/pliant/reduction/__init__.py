"""Reduce the continuous shape of a body to a chain of rigid links: how many links are needed, where their joints are,
and the joint angles over time.
"""

from pliant.reduction.error import spline_shape
from pliant.reduction.links import LinkPlacement, links_of
from pliant.reduction.order import OrderResult, select_order

__all__ = [
    "LinkPlacement", "OrderResult", "links_of", "select_order", "spline_shape",
]  # fmt: skip
