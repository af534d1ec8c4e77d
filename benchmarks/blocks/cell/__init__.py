"""The executed cell: spots on graph paper, cycles of ISO 9283 and time laws, on a simulated drive."""

from __future__ import annotations

from typing import Any

from benchmarks.blocks.base import Kind
from benchmarks.blocks.block import Block
from benchmarks.blocks.cell.iso import Iso
from benchmarks.blocks.cell.laws import Laws
from benchmarks.blocks.cell.settings import ISO, LAWS, SPOTS, CellBlock, read_block
from benchmarks.blocks.cell.spots import Spots
from benchmarks.blocks.cell.trials import CellKind

EXECUTED = {SPOTS: Spots(), ISO: Iso(), LAWS: Laws()}
"""Kinds of work by type of motion."""


class _Cell(CellKind):
    """Blocks of the executed cell."""

    def settings(self, data: Any) -> Block:
        return self.name_block(read_block(data))

    def of(self, block: CellBlock) -> Kind:
        return EXECUTED[block.what]


METHOD = _Cell
