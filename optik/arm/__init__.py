"""An arm: its joints and limits, from tables, files and data, and what can be said of it as a whole."""
