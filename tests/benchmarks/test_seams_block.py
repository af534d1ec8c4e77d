"""Blocks of seams among boxes: how they are swept, both ways along them, and the rows."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest
from scipy.spatial.transform import Rotation

from benchmarks.blocks.base import load_kind
from benchmarks.blocks.seams import ROOM, SeamsBlock, draw
from optik.arm.library import load
from optik.errors import InvalidInput
from optik.scene.contact import find_clearances
from tests.benchmarks.conftest import solved

SETTINGS: dict[str, Any] = {
    "id": "s", "robot": "paper6r", "boxes": 4, "turn": 2.0, "tilt": 0.4, "poses": 50, "count": 2,
    "limits": {"velocity": 2.0, "acceleration": 10.0, "jerk": 100.0},
}  # fmt: skip
LABELS = ["whole path", "local", "whole path, free", "local, free"]


def test_a_seam_is_swept_by_a_motion_that_is_free_of_contact_and_turns_the_tool() -> None:
    block, arm = SeamsBlock.read(SETTINGS), load("paper6r")
    scene, path, q, f = draw(block, arm, 3, 1)
    assert len(scene.boxes) == 4 and f.shape == (50, 3) and np.abs(f).max(axis=0).max() <= 2.0
    assert find_clearances(arm, scene, q)[0].min() > ROOM
    poses = arm.fk(q)
    poses[:, :3, :3] = poses[:, :3, :3] @ Rotation.from_euler("ZXY", f).inv().as_matrix()
    np.testing.assert_allclose(path.waypoints, poses[[k for k in range(50) if k not in path.dropped]], atol=1e-12)
    again, other = (draw(block, arm, 3, number).q for number in (1, 0))
    assert np.array_equal(again, q) and not np.array_equal(other, q)


def test_freedoms_make_seams_possible_that_are_refused_without(tmp_path: Path) -> None:
    rows = solved("seams", SETTINGS, tmp_path)
    assert rows["method"].to_list() == LABELS * 2 and rows["problem"].to_list() == [0] * 4 + [1] * 4
    assert rows.filter(method="whole path, free")["certified"].all()
    assert not rows.filter(method="local, free")["certified"].any()
    assert rows.select((pl.col("duration").is_not_null() == pl.col("certified")).all()).item()
    assert rows.filter(~pl.col("certified"))["reason"].str.len_chars().min() > 0
    plain = SETTINGS | {"robot": "panda", "turn": 0.0, "tilt": 0.0}
    assert SeamsBlock.read(plain).labels == tuple(LABELS[:2])
    with pytest.raises(InvalidInput, match=r"seams 's': .*shapes"):
        load_kind("seams").prepare(SeamsBlock.read(SETTINGS | {"robot": "kr6"}), 0)


def test_durations_are_compared_with_the_local_way_along_the_same_seam() -> None:
    rows = pl.DataFrame({"method": LABELS * 2, "problem": [0] * 4 + [1] * 4, "duration": [2.0, 4, 3, 2, 5, None, 6, 4]})
    found = load_kind("seams").complete(rows, SeamsBlock.read(SETTINGS))
    assert found["ratio"].to_list() == [0.5, 1.0, 1.5, 1.0, None, None, 1.5, 1.0]
