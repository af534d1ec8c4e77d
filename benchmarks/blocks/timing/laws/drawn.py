"""Motions of a block of time laws, drawn one by one, and their hash: a continued run must draw the same."""

from __future__ import annotations

import hashlib
import json

import numpy as np

from benchmarks.blocks._problems import about_file, check_same
from benchmarks.blocks.timing.laws.lines import DrawnLine
from benchmarks.blocks.timing.laws.motions import draw_motion
from benchmarks.blocks.timing.laws.sets import LineSet
from benchmarks.blocks.timing.laws.settings import LawBlock
from benchmarks.records import RunFolder


def all_lines(block: LawBlock) -> list[tuple[LineSet, int]]:
    """The set and the index of every motion."""
    return [(part, index) for part in block.lines for index in range(part.count)]


def motion_hash(line: DrawnLine) -> str:
    """SHA-256 over the start configuration and the path of a motion."""
    content = hashlib.sha256(np.ascontiguousarray(line.q_start, dtype="<f8").tobytes())
    content.update(json.dumps(line.path.to_dict(), sort_keys=True).encode())
    return content.hexdigest()


class Motions:
    """The motions of a block; the hash of each that is drawn is recorded in ``problems/BLOCK.json``.

    A process that continues a block draws its first motion again, and refuses to go on if that is another one.
    """

    def __init__(self, folder: RunFolder, block: LawBlock, seed: int) -> None:
        self._folder, self._block, self._seed = folder, block, seed
        self._lines = all_lines(block)
        self._hashes: dict[str, str] = (folder.read_json(about_file(block)) or {}).get("motions", {})
        if self._hashes:
            self.draw(int(min(self._hashes, key=int)))

    def draw(self, number: int) -> DrawnLine:
        """Draw a motion, and record its hash."""
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
            about["sha256_of"] = f"the {len(known):,} drawn by now"
        self._folder.write_json(about_file(self._block), about)
