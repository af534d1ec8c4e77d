"""Peers: one file an outside method; each is imported only when it is run, and none is needed."""
