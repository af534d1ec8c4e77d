"""Blocks of timed motions: time laws, whole plans and proofs of clearance."""
