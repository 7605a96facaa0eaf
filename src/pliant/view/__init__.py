"""The report and the live page."""

from pliant.view.report import write_report

__all__ = ["write_report"]
