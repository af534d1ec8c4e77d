"""The report: from a run folder to one self-contained HTML page."""

import benchmarks.extras  # noqa: F401 -- before the modules that need them
from benchmarks.report.page import write_report

__all__ = ["write_report"]
