"""The package benchmarks: suites that compare methods, their runs, the report, and the command line."""
