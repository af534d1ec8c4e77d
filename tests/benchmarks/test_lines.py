"""The lines to time: the same for the same seed, inside the limits all along, and as near to a singularity as they say."""

from __future__ import annotations

import hashlib
from pathlib import Path

import numpy as np
import pytest

from benchmarks.blocks.timing import Motions, motion_hash
from benchmarks.blocks.timing.motions import LINE_LENGTHS, LINE_TURNS, draw_motion
from benchmarks.blocks.timing.settings import LINE_KINDS
from benchmarks.records import RunFolder
from benchmarks.suite import suite_of
from optik import se3
from optik.errors import InvalidInput, UnknownName
from optik.ik import make_solver
from planners.following.follow import follow


@pytest.mark.parametrize(
    ("robot", "kind"), [("paper6r", "regular"), ("paper6r", "near_singular"), ("ur5e", "regular"), ("panda", "regular")]
)
def test_every_line_is_followed_whole_by_another_way_and_is_of_its_kind(robot: str, kind: str) -> None:
    low, high = LINE_KINDS[kind]
    for line in (draw_motion(robot, kind, index, seed=5) for index in range(4)):
        assert LINE_LENGTHS[0] <= line.path.end <= LINE_LENGTHS[1]
        angle = float(np.linalg.norm(se3.error(line.path.start, line.path.goal)[3:]))
        assert (
            angle == pytest.approx(0.0, abs=1e-9)
            if line.index % 2 == 0
            else LINE_TURNS[0] <= angle <= LINE_TURNS[1] + 1e-9
        )
        np.testing.assert_allclose(line.robot.fk(line.q_start), line.path.start, atol=1e-12)
        followed = follow(make_solver(line.robot, "lm"), line.path, line.q_start)
        assert followed, followed.failure
        if line.robot.n == 6:  # with more joints another way along the same line has other singular values
            assert low - 1e-3 <= followed.joint_path.singular_values.min() <= high + 1e-3


def test_a_line_depends_on_its_seed_robot_kind_and_index_alone() -> None:
    some = [draw_motion("ur5e", "regular", index, seed=2) for index in range(3)]
    again = draw_motion("ur5e", "regular", 2, seed=2)
    np.testing.assert_array_equal(again.q_start, some[2].q_start)
    np.testing.assert_array_equal(again.path.goal, some[2].path.goal)
    assert (again.index, again.draws) == (2, some[2].draws)
    others = [*some[:2], draw_motion("ur5e", "regular", 2, seed=3), draw_motion("ur5e", "near_singular", 2, seed=2)]
    assert not any(np.array_equal(other.q_start, again.q_start) for other in others)


def test_what_cannot_be_drawn_is_said() -> None:
    with pytest.raises(InvalidInput, match="regular, near_singular"):
        draw_motion("ur5e", "singular", 0)
    with pytest.raises(UnknownName, match="ur5e"):
        draw_motion("ur5ee", "regular", 0)
    with pytest.raises(InvalidInput, match="index"):
        draw_motion("ur5e", "regular", -1)


def test_motions_are_recorded_by_their_hash_and_a_run_does_not_continue_with_others(tmp_path: Path) -> None:
    limits = [{"velocity": 2.0, "acceleration": 10.0, "jerk": 100.0}]
    lines = [{"robot": "paper6r", "kind": "joints", "count": 3}]
    settings = {"id": "m", "lines": lines, "limits": limits, "laws": [{"law": "quintic"}]}
    (block,) = suite_of("moves", {"timing": [settings]}).of("timing")
    folder = RunFolder(tmp_path)
    motions = Motions(folder, block, 7)
    drawn = [motions.draw(number) for number in (0, 1)]
    first = folder.read_json("problems/m.json")
    assert (first["problems"], first["sha256_of"]) == (3, "the 2 sampled so far")
    assert first["motions"] == {str(k): motion_hash(one) for k, one in enumerate(drawn)}
    assert first["motions"]["0"] == motion_hash(draw_motion("paper6r", "joints", 0, seed=7))

    Motions(folder, block, 7).draw(2)  # the next session
    whole = folder.read_json("problems/m.json")
    joined = "".join(whole["motions"][str(k)] for k in range(3))
    assert whole["sha256"] == hashlib.sha256(joined.encode()).hexdigest()
    assert "sha256_of" not in whole
    assert len(set(whole["motions"].values())) == 3
    with pytest.raises(InvalidInput, match="as when the run began"):
        Motions(folder, block, 8)
    folder.write_json("problems/m.json", whole | {"motions": whole["motions"] | {"1": "0" * 64}})
    with pytest.raises(InvalidInput, match="0000"):
        Motions(folder, block, 7).draw(1)
