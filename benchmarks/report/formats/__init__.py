"""Other formats of the report: Markdown with figures, CSV and LaTeX tables, written into the run folder."""
