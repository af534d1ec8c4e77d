"""IK methods of other packages, one per file: called as their users call them, judged by optik's forward kinematics."""

PEERS = "benchmarks.peers.ik"
"""Package of the peers' modules, which are found by name."""
