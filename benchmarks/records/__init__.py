"""Run folders: the files of a run, and their readers."""

from benchmarks.records.folder import (
    FORMAT,
    LOCK,
    MANIFEST,
    RunFolder,
    failures,
    record_failures,
    rows_file,
    slug,
    update_manifest,
)
from benchmarks.records.journal import JOURNAL, UNKEPT, Journal
from benchmarks.records.store import LEDGER

__all__ = [
    "FORMAT", "JOURNAL", "LEDGER", "LOCK", "MANIFEST", "UNKEPT", "Journal", "RunFolder", "failures", "record_failures",
    "rows_file", "slug", "update_manifest",
]  # fmt: skip
