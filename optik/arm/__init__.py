"""An arm: its joints and limits, from tables, files and data, its reach, and its comparison with another."""
