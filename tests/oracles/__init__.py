"""Slow, obvious second opinions that the tests share: naive, closed-form and symbolic."""
