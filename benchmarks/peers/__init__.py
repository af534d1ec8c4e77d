"""Peers: methods of other packages for comparison, one per file; each is imported only when it runs, none is required."""
