"""`python -m benchmarks.cli`: the command line without an installed script."""

from benchmarks.cli.app import main

main()
