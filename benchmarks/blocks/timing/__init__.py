"""Time laws on many straight lines: every law and peer times the same joint paths, and every motion is certified."""

from __future__ import annotations

import hashlib
import json
import time
from collections.abc import Iterator
from typing import Any

import numpy as np
import polars as pl

from benchmarks.blocks.base import Kind, Session, Shard, Trials
from benchmarks.blocks.block import Target
from benchmarks.blocks.contest import clock_cost
from benchmarks.blocks.entries import about_file, check_same, scene_named
from benchmarks.blocks.timing.motions import DrawnLine, motion_of, stands_of
from benchmarks.blocks.timing.rows import FIELDS, OF_EVERY_MOTION, in_group, with_optimum
from benchmarks.blocks.timing.rows import MEASURES as MEASURES
from benchmarks.blocks.timing.settings import GIVEN_LINE, LawBlock, LineSet, told
from benchmarks.blocks.timing.timers import enter_laws, line_rows, write_example
from benchmarks.peers.laws import TIMING_PEERS
from benchmarks.records import Journal, RunFolder
from benchmarks.settings import naming
from optik.registry import load_method
from optik.scene.contact import check_scene
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
        line = motion_of(part, index, self._seed, self._block.limits)
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


def _facts(block: LawBlock, journal: Journal) -> dict[str, dict[str, Any]]:
    """Return the facts on every law and peer by label, for the report."""
    arm = block.lines[0].load()
    found = enter_laws(block, arm.n, block.limits[0].of(arm), journal)
    return {c.label: c.about for c in sorted(found, key=lambda c: c.entry.role == "peer")}


class _Timing(Kind):
    """Blocks of timed motions."""

    name = "timing"
    title = "Time laws on many lines"
    block = LawBlock
    fields = FIELDS
    size = 5
    has_facts = True
    order = 60
    on_paper = True

    def compared_rows(self, block: LawBlock, rows: pl.DataFrame) -> pl.DataFrame:
        """Return the rows on which two runs are compared: all but those of the reference.

        The times of whole plans of a detailed view are compared for all laws together, because there are few of each.
        """
        rows = rows.filter(pl.col("entry") != "reference")
        if not block.detail:
            return rows
        times = rows.select(pl.lit("all laws").alias("method"), pl.col("problem") + " " + pl.col("method"), "ms_plan")
        return pl.concat([rows.with_columns(ms_plan=pl.lit(None, pl.Float64)), times], how="diagonal")

    def prepare(self, block: LawBlock, seed: int) -> None:
        """Raise InvalidInput for wrong options, and for missing limits that a law needs, before anything is written."""
        entries = [*block.laws, *([block.reference] if block.reference else [])]
        for arm in {part.arm: part.load() for part in block.lines}.values():
            for limits in block.limits:
                stands_of(arm, [limits])
                for entry in entries:
                    make_law(entry.name, **entry.options).need(told(limits.of(arm), entry), arm)
        for peer in block.peers:
            load_method(TIMING_PEERS, peer.name, "peer of time laws")
        for part in block.lines:
            with naming(f"block {block.id!r}"):
                if part.path or part.kind == GIVEN_LINE:
                    motion_of(part, 0, seed, block.limits)
                if block.scene:
                    check_scene(part.load(), scene_named(block.scene, block.margin))

    def share(self, session: Session) -> Motions:
        return Motions(session.folder, session.block, session.seed)

    def count(self, block: LawBlock, session: Session) -> int:
        return len(all_lines(block))

    def shards(self, block: LawBlock, session: Session) -> Iterator[Shard]:
        """Write the facts, yield the motions, then write the detailed view."""
        folder, facts = session.folder, self.file(block, "json")
        if not folder.has(facts):
            folder.write_json(facts, {"clock_ns": clock_cost(), "entries": _facts(block, session.journal)})
        yield from super().shards(block, session)
        if not folder.has(self.file(block, "curve.parquet")):
            session.tell(f"{block.id}: the example")
            line = motion_of(block.example_set, block.example.index, session.seed, block.limits)
            write_example(block, line, folder, lambda ending: self.file(block, ending), session.journal)

    def solve(self, trials: Trials) -> Iterator[dict[str, Any]]:
        """Time some motions by all laws; those of a motion that the journal has are not computed again."""
        assert trials.session is not None
        journal, motions = trials.session.journal, trials.session.shared
        for number in trials.numbers:
            rows = journal.kept(f"{number:06d}")
            if rows is None:
                begin = time.perf_counter()
                found = line_rows(trials.block, motions.draw(number), journal)
                rows = self.frame(row | {"line": number} for row in found)
                journal.keep(f"{number:06d}", rows, time.perf_counter() - begin)
            yield from rows.iter_rows(named=True)

    def complete(self, rows: pl.DataFrame, block: LawBlock) -> pl.DataFrame:
        return with_optimum(rows)

    def judged_rows(self, rows: pl.DataFrame, target: Target) -> tuple[pl.DataFrame, str]:
        rows = in_group(rows, target.group)
        own = rows.filter(pl.col("method") == target.method)
        good = own.filter("solved")
        note = f"{len(own):,} motions" if len(good) == len(own) else f"{len(good):,} of {len(own):,} motions"
        if target.to:
            return rows.filter("solved"), note
        if target.measure in OF_EVERY_MOTION:
            return own, note if len(own) else "no such lines"
        if target.measure == "plan_ms":
            good = good.filter(pl.col("ms_plan").is_not_null())
            return good, note if len(good) else "its whole plans were not timed"
        return good, note if len(good) else "no motions"


METHOD = _Timing
