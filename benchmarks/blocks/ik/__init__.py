"""Blocks of inverse kinematics, one module for each way of recording."""
