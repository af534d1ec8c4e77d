"""The lines to time: the same for the same seed, inside the limits all along, and as near to a singularity as they say."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.kinds.laws.lines import LINE_KINDS, LINE_LENGTHS, LINE_TURNS, draw_line
from optik import se3
from optik.errors import InvalidInput, UnknownName
from optik.ik import make_solver
from planners.following.follow import follow


@pytest.mark.parametrize(
    ("robot", "kind"), [("paper6r", "regular"), ("paper6r", "near_singular"), ("ur5e", "regular"), ("panda", "regular")]
)
def test_every_line_is_followed_whole_by_another_way_and_is_of_its_kind(robot: str, kind: str) -> None:
    low, high = LINE_KINDS[kind]
    for line in (draw_line(robot, kind, index, seed=5) for index in range(4)):
        assert LINE_LENGTHS[0] <= line.path.end <= LINE_LENGTHS[1]
        angle = float(np.linalg.norm(se3.error(line.path.start, line.path.goal)[3:]))
        assert (
            angle == pytest.approx(0.0, abs=1e-9)
            if line.index % 2 == 0
            else LINE_TURNS[0] <= angle <= LINE_TURNS[1] + 1e-9
        )
        np.testing.assert_allclose(line.robot.fk(line.q_start), line.path.start, atol=1e-12)
        followed = follow(make_solver(line.robot, "lm"), line.path, line.q_start)
        assert followed, followed.stop
        if line.robot.n == 6:  # with more joints another way along the same line has other singular values
            assert followed.joint_path is not None
            assert low - 1e-3 <= followed.joint_path.singular_values.min() <= high + 1e-3


def test_a_line_depends_on_its_seed_robot_kind_and_index_alone() -> None:
    some = [draw_line("ur5e", "regular", index, seed=2) for index in range(3)]
    again = draw_line("ur5e", "regular", 2, seed=2)
    np.testing.assert_array_equal(again.q_start, some[2].q_start)
    np.testing.assert_array_equal(again.path.goal, some[2].path.goal)
    assert (again.index, again.draws) == (2, some[2].draws)
    others = [*some[:2], draw_line("ur5e", "regular", 2, seed=3), draw_line("ur5e", "near_singular", 2, seed=2)]
    assert not any(np.array_equal(other.q_start, again.q_start) for other in others)


def test_what_cannot_be_drawn_is_said() -> None:
    with pytest.raises(InvalidInput, match="regular, near_singular"):
        draw_line("ur5e", "singular", 0)
    with pytest.raises(UnknownName, match="ur5e"):
        draw_line("ur5", "regular", 0)
    with pytest.raises(InvalidInput, match="index"):
        draw_line("ur5e", "regular", -1)
