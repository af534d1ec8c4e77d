"""Experiments: the paper's claims and misprints, judged from the rows of a run."""
