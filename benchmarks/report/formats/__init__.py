"""The report in other formats than the page: Markdown with figures, CSV and LaTeX tables, written into the run folder."""
