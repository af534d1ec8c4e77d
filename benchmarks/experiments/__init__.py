"""Experiments: the claims and misprints of the paper, evaluated on the data of a run."""
