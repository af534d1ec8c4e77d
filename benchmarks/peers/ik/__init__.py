"""Outside IK methods: one file each, called as its users call it, judged by our forward kinematics."""

PEERS = "benchmarks.peers.ik"
"""The package in which an outside IK method is found by its name."""
