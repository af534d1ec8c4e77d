"""Run folders: what a run writes, and how it is read back."""

from benchmarks.records.folder import ARMS, FORMAT, LOCK, RunFolder, slug
from benchmarks.records.journal import JOURNAL, UNKEPT, Journal

__all__ = ["ARMS", "FORMAT", "JOURNAL", "LOCK", "UNKEPT", "Journal", "RunFolder", "slug"]
