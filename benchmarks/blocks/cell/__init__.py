"""The executed cell: spots on graph paper, on a simulated drive."""

from __future__ import annotations

from benchmarks.blocks.cell.spots import Spots

METHOD = Spots
