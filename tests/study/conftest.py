from made_study import outcome

__all__ = ["outcome"]
