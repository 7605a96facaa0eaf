"""What people look at: the report that moves."""

from pliant.view.report import write_report

__all__ = ["write_report"]
