"""Time laws of other packages, one per file; their motions are certified in the same way as ours."""

TIMING_PEERS = "benchmarks.peers.laws"
"""The package in which an outside time law is found by its name."""
