"""Problem sets, one per file: targets, start configurations, and what is known about each problem."""
