"""The HTML report of a study, and the live page of a running model."""

from pliant.view.report import write_report

__all__ = ["write_report"]
