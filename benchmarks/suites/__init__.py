"""Suites: one TOML file each, sets × robots × methods × budgets."""
