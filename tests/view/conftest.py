from made_study import outcome, shape, written

__all__ = ["outcome", "shape", "written"]
