"""benchmarks: which method, on what, how well; suites, runs, the report, and the command line."""
