"""Kinds of suite blocks: a file or folder in here is a kind, its name is the key of a suite that asks for it."""
