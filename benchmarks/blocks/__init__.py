"""Blocks of a suite: they solve, execute or time something and write rows. They do not depend on the report."""
