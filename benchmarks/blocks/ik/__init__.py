"""Blocks of inverse kinematics, one folder for each way of recording."""
