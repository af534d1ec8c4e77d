"""The report: from a run folder to one self-contained HTML page."""

from benchmarks.report.page import write_report

__all__ = ["write_report"]
