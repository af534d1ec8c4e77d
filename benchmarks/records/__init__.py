"""Run folders: what a run writes, and how it is read back."""

from benchmarks.records.folder import ARMS, FORMAT, LOCK, RunFolder, slug

__all__ = ["ARMS", "FORMAT", "LOCK", "RunFolder", "slug"]
