"""Time laws of other packages, one per file; their motions get the same certificates as those of optik."""

TIMING_PEERS = "benchmarks.peers.laws"
"""Package of the peers' modules, which are found by name."""
