"""Inputs at the edge of what can be meant: each has a named error or a status, and nothing calls a network."""

import socket
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from optik import Scene
from optik.errors import InvalidInput, NoSolution
from optik.types import Array
from planners import Arc, JointLine, Line, MotionLimits, Path, Plan, Polyline, laws, plan
from planners.limits import ALL_LIMITS
from planners.planning import PlanStatus
from tests.planners.cases import START, paper6r

ROBOT = paper6r()
HERE = ROBOT.fk(START)


@pytest.fixture(autouse=True)
def no_network(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: Any, **__: Any) -> None:
        raise AssertionError("a planner calls a network")

    monkeypatch.setattr(socket, "socket", refuse)
    monkeypatch.setattr(socket, "create_connection", refuse)
    monkeypatch.setattr(socket, "getaddrinfo", refuse)


def kind_of(path: Any) -> str:
    return type(path).__name__ if not isinstance(path, np.ndarray) else f"goal {path.shape}"


def at(x: float, y: float, z: float, turn: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> Array:
    """A pose that far from the start."""
    T = HERE.copy()
    T[:3, 3] += (x, y, z)
    T[:3, :3] = Rotation.from_rotvec(turn).as_matrix() @ T[:3, :3]
    return T


def planned(path: Any, q_start: Any = START, **options: Any) -> Plan:
    return plan(ROBOT, path, q_start, **{"timing": "smooth", "samples": 21} | options)


def refused(argument: str, path: Any, q_start: Any = START, **options: Any) -> str:
    with pytest.raises(InvalidInput) as info:
        planned(path, q_start, **options)
    assert info.value.argument == argument
    return str(info.value)


# ---------------------------------------------------------------- paths
@pytest.mark.parametrize(
    "path", [Line(HERE, HERE), JointLine(ROBOT, START, START), HERE, START, START + 1e-15, HERE + 1e-16], ids=kind_of
)
@pytest.mark.parametrize("avoid", [False, True], ids=["", "avoid"])
def test_a_plan_of_length_0_has_a_status_and_no_error(path: Any, avoid: bool) -> None:
    found = planned(path, scene=Scene(), avoid=avoid and not isinstance(path, Path))
    assert (found.status, bool(found), found.has_motion) == ("no_length", False, False)
    with pytest.raises(NoSolution, match="start and goal are equal, so there is nothing to move; try: a goal away"):
        found.trajectory  # noqa: B018


@pytest.mark.parametrize("off", [1e-9, 1e-7, 2e-6])
def test_a_goal_beside_the_start_is_reached_also_around_obstacles(off: float) -> None:
    for goal in (START + off, at(off, off, 0.0)):
        assert all(planned(goal, scene=Scene(), avoid=avoid) for avoid in (False, True))


@pytest.mark.parametrize("axis", np.eye(3), ids=str)
def test_a_half_turn_has_no_shortest_way(axis: Array) -> None:
    opposite = at(0.01, 0.0, 0.0, tuple(np.pi * axis))
    for build in (
        lambda: Line(HERE, opposite),
        lambda: Polyline([HERE, at(0.02, 0.0, 0.0), at(0.03, 0.0, 0.0), opposite]),
        lambda: Arc.through(HERE, HERE[:3, 3] + [0.01, 0.01, 0.0], opposite),
        lambda: planned(opposite),
    ):
        with pytest.raises(InvalidInput, match=r"180|half turn"):
            build()


def test_a_turn_of_nearly_180_degrees_ends_in_a_status() -> None:
    result = planned(Line(HERE, at(0.0, 0.0, 0.01, (0.0, 0.0, np.pi - 1e-4))))
    assert result.status in PlanStatus
    assert bool(result) == (result.failure is None)


def test_a_path_that_leaves_the_workspace_says_where() -> None:
    result = planned(Line(HERE, at(3.0, 0.0, 0.0)))
    assert result.status in (PlanStatus.UNREACHABLE, PlanStatus.OUTSIDE_LIMITS)
    assert 0.0 < result.failure.s < 3.0
    assert result.failure.advice
    assert result.prefix is not None
    again = planned(Line(HERE, result.path.pose(0.98 * result.failure.s)))
    assert again.certificate.is_valid


def test_a_path_that_begins_beyond_reach_is_unreachable_at_0() -> None:
    result = planned(Line(at(5.0, 0.0, 0.0), at(5.1, 0.0, 0.0)), None)
    assert result.status is PlanStatus.UNREACHABLE
    assert result.failure.s == 0.0


# ---------------------------------------------------------------- starts
def test_a_start_off_the_path_is_refused() -> None:
    assert "mm" in refused("q_start", Line(at(0.001, 0.0, 0.0), at(0.1, 0.0, 0.0)))
    assert "rad" in refused("q_start", JointLine(ROBOT, START + 0.01, START + 0.1))


@pytest.mark.parametrize("bad", [np.nan, np.inf, 10.0])
def test_a_start_that_is_no_configuration_is_refused(bad: float) -> None:
    for path in (Line(HERE, at(0.05, 0.0, 0.0)), at(0.05, 0.0, 0.0), START + 0.1):
        refused("q_start", path, np.where(np.arange(6) == 2, bad, START))
    refused("q_start", Line(HERE, at(0.05, 0.0, 0.0)), START[:5])


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_a_goal_that_is_no_pose_and_no_joints_is_refused(bad: float) -> None:
    for goal in (np.full((4, 4), bad), np.full(6, bad), np.zeros(5), np.eye(3), "goal", None):
        with pytest.raises(InvalidInput):
            planned(goal)


# ---------------------------------------------------------------- limits and the least path
@pytest.mark.parametrize("field", ALL_LIMITS)
@pytest.mark.parametrize(
    "wrong", [0.0, -1.0, np.nan, -np.inf, [1, 1, 1, 1, 1, 0], [1, 2, np.nan, 1, 1, 1], "fast", [[1.0]]]
)
def test_limits_that_are_not_above_zero_are_refused_by_name(field: str, wrong: Any) -> None:
    with pytest.raises(InvalidInput, match=rf"^{field}: "):
        MotionLimits(**{field: wrong})


@pytest.mark.parametrize("law", [law for law in laws() if law != "quintic"])
def test_the_least_path_has_a_motion_or_a_named_reason(law: str) -> None:
    result = planned(Line(HERE, at(1e-6, 0.0, 0.0)), timing=law)
    assert result, result.failure
    assert result.certificate.is_valid
