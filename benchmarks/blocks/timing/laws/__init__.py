"""Time laws on many straight lines: every law and peer times the same joint paths, and every motion is certified."""

from __future__ import annotations

import hashlib
import json
import time
from typing import Any

import numpy as np
import polars as pl

from benchmarks.blocks._contest import clock_cost, facts_on, read_facts
from benchmarks.blocks._problems import about_file, check_same
from benchmarks.blocks.base import BlockRows, Compared, Kind, Tell
from benchmarks.blocks.timing.laws.example import write_example
from benchmarks.blocks.timing.laws.motions import DrawnLine, draw_motion, motion_in_file, stands_of
from benchmarks.blocks.timing.laws.rows import MEASURES, SCHEMA, LawRows, example_file, facts_file, in_group, read_rows
from benchmarks.blocks.timing.laws.settings import LawBlock, LineSet, told
from benchmarks.blocks.timing.laws.timers import line_rows
from benchmarks.peers.ik.base import Absent, version_of
from benchmarks.peers.laws import TIMING_PEERS
from benchmarks.peers.laws.base import TimingPeer, build_timing_peer, peer_limits
from benchmarks.records import JOURNAL, Journal, RunFolder, slug
from benchmarks.settings import naming
from benchmarks.targets import Target, measure_named
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


# ---------------------------------------------------------------- parts


def part_files(block: LawBlock) -> list[str]:
    """Return the names of all parts of a block."""
    count = len(all_lines(block))
    return [f"timing/{slug(block.id)}--{part:04d}.parquet" for part in range(-(-count // LINES_A_PART))]


def run_laws(block: LawBlock, seed: int, folder: RunFolder, tell: Tell, journal: Journal) -> None:
    """Run the unfinished work of a block."""
    if not folder.has(facts_file(block)):
        folder.write_json(facts_file(block), {"clock_ns": clock_cost(), "entries": _facts(block, journal)})
    lacking = [(part, file) for part, file in enumerate(part_files(block)) if not folder.has(file)]
    motions, count = Motions(folder, block, seed) if lacking else None, len(all_lines(block))
    for part, file in lacking:
        assert motions is not None
        rows: list[pl.DataFrame] = []
        for number in range(part * LINES_A_PART, min((part + 1) * LINES_A_PART, count)):
            tell(f"{block.id}: line {number + 1:,} of {count:,}")
            kept = journal.kept(f"{number:06d}")
            if kept is None:
                begin = time.perf_counter()
                line = motions.draw(number)
                found = [row | {"line": number} for row in line_rows(block, line, journal)]
                kept = pl.DataFrame(found, schema_overrides=SCHEMA, infer_schema_length=None)
                journal.keep(f"{number:06d}", kept, time.perf_counter() - begin)
            rows.append(kept)
        folder.write(file, pl.concat(rows))
    if not folder.has(example_file(block, "curve")):
        tell(f"{block.id}: the example")
        chosen = block.example
        line = draw_motion(
            chosen.robot, chosen.kind, chosen.index, seed=seed, path=chosen.path, payload=chosen.payload,
            limits=block.limits,
        )  # fmt: skip
        write_example(block, line, folder, lambda name: example_file(block, name), journal)


def _facts(block: LawBlock, journal: Journal) -> dict[str, dict[str, Any]]:
    """Return the facts on every law and peer by label, for the report."""
    found: dict[str, dict[str, Any]] = {}
    for entry in (*block.laws, *([block.reference] if block.reference else [])):
        enforced = [name for name in make_law(entry.name, **entry.options).enforced if name not in entry.without]
        found[entry.label] = facts_on(entry, enforced=enforced)
    for entry in block.peers:
        peer = load_method(TIMING_PEERS, entry.name, "peer of timing")
        built: TimingPeer | Absent | None = None
        if entry.label not in journal.crashed:
            with journal.at_work(entry.label):
                arm = block.lines[0].load()
                built = build_timing_peer(entry.name, peer_limits(block.limits[0].of(arm), arm.n))
        absent = {"absent": built.why} if isinstance(built, Absent) else {}
        about = {
            "version": version_of(entry.name, TIMING_PEERS),
            "settings": peer.settings,
            "enforced": list(peer.enforced),
        }
        found[entry.label] = facts_on(entry) | about | absent
    return found


class _Laws(Kind):
    """Blocks of timed lines: ``[[timing]]`` of a suite."""

    name = "laws"
    title = "Time laws on many lines"
    block = LawBlock
    measures = MEASURES
    order = 60
    compared = (
        Compared("motions found", "%", "more", "solved"),
        Compared("within every limit", "%", "more", "keeps_all", only="solved"),
        Compared("duration", "s", "less", "duration", only="solved"),
        Compared("time of the law", "ms", "less", "ms_law", only="solved"),
    )

    def compared_rows(self, block: LawBlock, rows: pl.DataFrame) -> pl.DataFrame:
        """Return the rows on which two runs are compared: one problem is one line within one set of limits."""
        problem = pl.concat_str("robot", "kind", "index", "limits", separator=" ").alias("problem")
        return rows.filter(pl.col("entry") != "reference").with_columns(problem, label="law")

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

    def run(self, block: LawBlock, seed: int, folder: RunFolder, tell: Tell) -> None:
        with Journal(folder, self.file(block, JOURNAL)) as journal:
            run_laws(block, seed, folder, tell, journal)

    def rows(self, folder: RunFolder, block: LawBlock) -> pl.DataFrame | None:
        return read_rows(folder, block)

    def read(self, folder: RunFolder, block: LawBlock) -> BlockRows | None:
        rows = self.rows(folder, block)
        return None if rows is None else LawRows(block, rows, folder, read_facts(folder, facts_file(block), block.id))

    def judge(self, rows: pl.DataFrame | None, target: Target) -> tuple[float, str]:
        if rows is None or rows.filter(pl.col("law") == target.method).is_empty():
            return float("nan"), f"{target.method} was not run"
        own = in_group(rows.filter(pl.col("law") == target.method), target.group)
        good = own.filter("solved")
        note = f"{len(own):,} motions" if len(good) == len(own) else f"{len(good):,} of {len(own):,} motions"
        measure = measure_named(MEASURES, target.measure, "measure")
        if measure.relative:
            chosen = in_group(
                rows.filter(pl.col("law").is_in([target.method, target.to]) & pl.col("solved")), target.group
            )
            return float(measure.compute(chosen, target.method, target.to)), note
        if measure.name == "solved":
            return (measure.values(own)[0], note) if len(own) else (float("nan"), "no such lines")
        if measure.name == "plan_ms":
            good = good.filter(pl.col("ms_plan").is_not_null())
        if good.is_empty():
            return float("nan"), "no motions" if measure.name != "plan_ms" else "its whole plans were not timed"
        return measure.values(good)[0], note


METHOD = _Laws
