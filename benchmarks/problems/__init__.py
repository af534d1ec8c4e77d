"""Problem sets, one per file: targets, start configurations, and known properties of each problem."""
