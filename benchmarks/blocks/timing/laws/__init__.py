"""Time laws on many straight lines: every law and peer times the same joint paths, and every motion is certified."""

from __future__ import annotations

import hashlib
import json
import time
from collections.abc import Callable, Iterator
from functools import cache, partial
from typing import Any

import numpy as np
import polars as pl

from benchmarks.blocks.base import Compared, Kind, Target, Tell, chunks
from benchmarks.blocks.contest import clock_cost
from benchmarks.blocks.entries import about_file, check_same
from benchmarks.blocks.timing.laws.motions import DrawnLine, draw_motion, motion_in_file, stands_of
from benchmarks.blocks.timing.laws.rows import MEASURES as MEASURES
from benchmarks.blocks.timing.laws.rows import SCHEMA, in_group, with_optimum
from benchmarks.blocks.timing.laws.settings import LawBlock, LineSet, told
from benchmarks.blocks.timing.laws.timers import enter_laws, line_rows, write_example
from benchmarks.peers.laws import TIMING_PEERS
from benchmarks.records import Journal, RunFolder
from benchmarks.settings import naming
from optik.registry import load_method
from planners.plan import make_law


def all_lines(block: LawBlock) -> list[tuple[LineSet, int]]:
    """Return the set and the index of every motion."""
    return [(part, index) for part in block.lines for index in range(part.count)]


def motion_hash(line: DrawnLine) -> str:
    """Return the SHA-256 over the start configuration and the path of a motion."""
    content = hashlib.sha256(np.ascontiguousarray(line.q_start, dtype="<f8").tobytes())
    content.update(json.dumps(line.path.to_dict(), sort_keys=True).encode())
    return content.hexdigest()


class Motions:
    """The motions of a block; the hash of each sampled motion is recorded in ``problems/BLOCK.json``.

    A process that continues a block draws its first motion again, and refuses to go on if that is another one.
    """

    def __init__(self, folder: RunFolder, block: LawBlock, seed: int) -> None:
        self._folder, self._block, self._seed = folder, block, seed
        self._lines = all_lines(block)
        self._hashes: dict[str, str] = (folder.read_json(about_file(block)) or {}).get("motions", {})
        if self._hashes:
            self.draw(int(min(self._hashes, key=int)))

    def draw(self, number: int) -> DrawnLine:
        """Sample a motion, and record its hash."""
        part, index = self._lines[number]
        line = draw_motion(
            part.robot,
            part.kind,
            index,
            seed=self._seed,
            path=part.path,
            payload=part.payload,
            limits=self._block.limits,
        )
        now, before = motion_hash(line), self._hashes.get(str(number))
        if before is None:
            self._hashes[str(number)] = now
            self._store()
        check_same(self._block, before, now)
        return line

    def _store(self) -> None:
        """Write the hash over all hashes so far, in order."""
        known = sorted(self._hashes, key=int)
        about = {
            "sha256": hashlib.sha256("".join(self._hashes[number] for number in known).encode()).hexdigest(),
            "problems": len(self._lines),
            "motions": {number: self._hashes[number] for number in known},
        }
        if len(known) < len(self._lines):
            about["sha256_of"] = f"the {len(known):,} sampled so far"
        self._folder.write_json(about_file(self._block), about)


LINES_A_PART = 5
"""Number of lines in one part: an interrupted run repeats at most this number."""


def _facts(block: LawBlock, journal: Journal) -> dict[str, dict[str, Any]]:
    """Return the facts on every law and peer by label, for the report."""
    arm = block.lines[0].load()
    found = enter_laws(block, arm.n, block.limits[0].of(arm), journal)
    return {c.label: c.about for c in sorted(found, key=lambda c: c.entry.role == "peer")}


class _Laws(Kind):
    """Blocks of timed lines: ``[[timing]]`` of a suite."""

    name = "laws"
    title = "Time laws on many lines"
    block = LawBlock
    has_facts = True
    order = 60
    compared = (
        Compared("motions found", "%", "more", "solved"),
        Compared("within every limit", "%", "more", "keeps_all", only="solved"),
        Compared("duration", "s", "less", "duration", only="solved"),
        Compared("time of the law", "ms", "less", "ms_law", only="solved", clock=True),
    )

    def compared_rows(self, block: LawBlock, rows: pl.DataFrame) -> pl.DataFrame:
        """Return the rows on which two runs are compared: all but those of the reference."""
        return rows.filter(pl.col("entry") != "reference")

    def prepare(self, block: LawBlock, seed: int) -> None:
        """Raise InvalidInput for wrong options, and for missing limits that a law needs, before anything is written."""
        entries = [*block.laws, *([block.reference] if block.reference else [])]
        for arm in {part.arm: part.load() for part in block.lines}.values():
            for limits in block.limits:
                stands_of(arm, [limits])
                for entry in entries:
                    make_law(entry.name, **entry.options).need(told(limits.of(arm), entry), arm)
        for peer in block.peers:
            load_method(TIMING_PEERS, peer.name, "peer of timing")
        for part in block.lines:
            if part.path:
                with naming(f"block {block.id!r}"):
                    motion_in_file(part.robot, part.path, part.payload)

    def timed(
        self, block: LawBlock, seed: int, folder: RunFolder, tell: Tell, journal: Journal
    ) -> Iterator[tuple[str, Callable[[], pl.DataFrame]]]:
        """Yield the motions, part by part, then write the detailed view."""
        facts = self.file(block, "json")
        if not folder.has(facts):
            folder.write_json(facts, {"clock_ns": clock_cost(), "entries": _facts(block, journal)})
        motions = cache(lambda: Motions(folder, block, seed))
        for part, numbers in enumerate(chunks(range(len(all_lines(block))), LINES_A_PART)):
            yield f"{part:04d}", partial(_rows_of, block, numbers, motions, tell, journal)
        if not folder.has(self.file(block, "curve.parquet")):
            tell(f"{block.id}: the example")
            chosen = block.example
            line = draw_motion(
                chosen.robot, chosen.kind, chosen.index, seed=seed, path=chosen.path, payload=chosen.payload,
                limits=block.limits,
            )  # fmt: skip
            write_example(block, line, folder, lambda name: self.file(block, f"{name}.parquet"), journal)

    def complete(self, rows: pl.DataFrame, block: LawBlock) -> pl.DataFrame:
        return with_optimum(rows)

    def judged_rows(self, rows: pl.DataFrame, target: Target) -> tuple[pl.DataFrame, str]:
        rows = in_group(rows, target.group)
        own = rows.filter(pl.col("method") == target.method)
        good = own.filter("solved")
        note = f"{len(own):,} motions" if len(good) == len(own) else f"{len(good):,} of {len(own):,} motions"
        if target.to:
            return rows.filter("solved"), note
        if target.measure == "solved":
            return own, note if len(own) else "no such lines"
        if target.measure == "plan_ms":
            good = good.filter(pl.col("ms_plan").is_not_null())
            return good, note if len(good) else "its whole plans were not timed"
        return good, note if len(good) else "no motions"


def _rows_of(
    block: LawBlock, numbers: range, motions: Callable[[], Motions], tell: Tell, journal: Journal
) -> pl.DataFrame:
    """Return the rows of some motions; those of a motion that the journal has are not computed again."""
    rows: list[pl.DataFrame] = []
    for number in numbers:
        tell(f"{block.id}: line {number + 1:,} of {len(all_lines(block)):,}")
        kept = journal.kept(f"{number:06d}")
        if kept is None:
            begin = time.perf_counter()
            found = [row | {"line": number} for row in line_rows(block, motions().draw(number), journal)]
            kept = pl.DataFrame(found, schema_overrides=SCHEMA, infer_schema_length=None)
            journal.keep(f"{number:06d}", kept, time.perf_counter() - begin)
        rows.append(kept)
    return pl.concat(rows)


METHOD = _Laws
