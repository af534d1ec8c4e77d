"""Suites: one TOML file a suite, sets × robots × methods × budgets."""
