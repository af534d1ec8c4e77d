"""Outside ways to time a joint path: one file each, judged by the same certificate as our laws."""

TIMING_PEERS = "benchmarks.peers.laws"
"""The package in which an outside time law is found by its name."""
