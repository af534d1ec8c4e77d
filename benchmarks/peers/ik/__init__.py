"""IK methods of other packages, one per file: called as their users call them, judged by our forward kinematics."""

PEERS = "benchmarks.peers.ik"
"""The package in which an outside IK method is found by its name."""
