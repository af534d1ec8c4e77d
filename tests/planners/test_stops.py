"""Stops: asymmetric limits against closed forms, limits whose rows read the tool's twist, dense paths, drives that refuse."""

import itertools
from collections.abc import Iterator
from functools import cache
from typing import Any, ClassVar

import numpy as np
import pytest

import optik
from optik.types import Array
from planners import JointLine, MotionLimits, Plan, Polyline, plan, replan
from planners.cell import ExecutionStatus
from planners.limits import Limit, PathPoints, ToolExtreme, kinds, register
from planners.limits.inputs import LimitedMotion
from planners.timing.base import StopKind
from tests import oracles
from tests.planners.cases import START, default_line, paper6r
from tests.planners.faulty import FaultyIdeal, FaultyMujoco, LostEncoder

MOVE = np.array([0.9, 0.3, -0.2, 0.2, 0.5, -1.1])
PERIOD = 0.004


@cache
def joint_line(lower: float, upper: float, sense: float = 1.0) -> Plan:
    """A joint line on which joint 6 (backwards) or joint 1 (forwards) limits velocity, acceleration and jerk."""
    move = sense * np.array([1.0, 0.1, -0.1, 0.1, 0.1, -0.1])
    found = plan(
        paper6r(), JointLine(paper6r(), START, START + move), START, limits=MotionLimits(1.0, (-lower, upper), 40.0)
    )
    assert found
    return found


@pytest.mark.parametrize("sense", [1.0, -1.0])
@pytest.mark.parametrize(("braking", "other"), [(4.0, 9.0), (9.0, 4.0), (5.0, 5.0)])
def test_a_stop_from_constant_speed_takes_the_time_of_its_closed_form(
    braking: float, other: float, sense: float
) -> None:
    """From V under the deceleration A and the jerk J: V / A + A / J, or 2 (V / J)^½ if A is not reached."""
    sides = (braking, other) if sense > 0.0 else (other, braking)
    running = joint_line(*sides, sense)
    t = 0.5 * running.trajectory.end
    assert abs(running.trajectory(t, 2)).max() < 0.05  # at its largest speed, as near as the iteration comes
    speed = float(abs(running.trajectory(t, 1)[0]))
    shortest = speed / braking + braking / 40.0 if braking**2 <= 40.0 * speed else 2.0 * np.sqrt(speed / 40.0)
    sweep, best = (replan(running, t, stop=True, time_limit=limit) for limit in (0.0, 60.0))
    assert sweep and best
    assert shortest * 0.99 <= best.trajectory.end <= shortest * 1.015
    assert best.trajectory.end <= sweep.trajectory.end <= shortest * 1.12


def test_an_optimum_is_found_where_the_braking_side_is_the_wider_one() -> None:
    """From a moment at which the joints still gain speed: 2 % shorter than the sweep."""
    running = joint_line(9.0, 4.0)
    t = 0.25 * running.trajectory.end
    sweep, best = (replan(running, t, stop=True, time_limit=limit) for limit in (0.0, 60.0))
    assert best.stop_kind is StopKind.OPTIMUM and best.trajectory.end < 0.985 * sweep.trajectory.end


@pytest.mark.parametrize("time_limit", [0.0, 60.0])
def test_a_wider_side_that_no_joint_uses_does_not_change_a_stop(time_limit: float) -> None:
    running = joint_line(4.0, 9.0)
    t = 0.5 * running.trajectory.end
    signs = np.sign(running.trajectory(t, 1))  # each joint brakes on the other side
    own = replan(running, t, stop=True, time_limit=time_limit).trajectory
    for factor in (1.5, 10.0):
        lower, upper = np.where(signs > 0.0, 4.0, 4.0 * factor), np.where(signs > 0.0, 9.0 * factor, 9.0)
        wide = replan(running, t, stop=True, time_limit=time_limit, limits=MotionLimits(1.0, (-lower, upper), 40.0))
        assert wide and wide.trajectory.end == pytest.approx(own.end, rel=5e-3 if time_limit else 1e-9)


class PathAcceleration(Limit):
    """Limit on the tangential acceleration of the tool's point on a line; its rows read the twist."""

    name: ClassVar[str] = "path_acceleration"
    units: ClassVar[tuple[str, str]] = ("m/s²", "m/s²")
    order: ClassVar[int] = 2
    subject: ClassVar[str | None] = "tool"
    seen: ClassVar[list[PathPoints]] = []

    def rows(self, at: PathPoints, limit: Array) -> Array:
        self.seen.append(at)
        out = np.zeros((at.s.size, 1, 2))
        out[:, 0, 0] = np.linalg.norm(at.twist[:, :3], axis=1) / limit[0]
        out[:, 0, 1] = oracles_along(at) / limit[0]
        return out

    def piece_ratios(self, motion: LimitedMotion, limit: Array) -> Array:
        return np.array([[values_of(motion, a, b).max() / limit[0]] for a, b in pairs(motion.trajectory.knots)])

    def judge(self, motion: LimitedMotion, limit: Array) -> ToolExtreme:
        ratios = self.piece_ratios(motion, limit)[:, 0]
        k = int(ratios.argmax())
        return ToolExtreme(float(ratios[k] * limit[0]), float(ratios[k]), float(motion.trajectory.knots[k]))


def oracles_along(at: PathPoints) -> Array:
    """Derivative of the tool's speed per unit of s over s, by differences."""
    h, robot = 1e-6, at.joint_path.robot
    ends = [
        np.linalg.norm(
            np.einsum("kij,kj->ki", robot.jacobian(at.q() + d * at.q(1)), at.q(1) + d * at.q(2))[:, :3], axis=1
        )
        for d in (-h, h)
    ]
    return np.asarray((ends[1] - ends[0]) / (2.0 * h))


def pairs(knots: Array) -> Iterator[tuple[float, float]]:
    return itertools.pairwise(knots)


def values_of(motion: LimitedMotion, begin: float, end: float) -> Array:
    """Absolute rate of the tool's speed at nine instants of a piece, by differences."""
    t, h = np.linspace(begin, end, 11)[1:-1], 1e-6 * (end - begin)

    def speed(at: Array) -> Array:
        J = motion.robot.jacobian(motion.trajectory(at))
        return np.linalg.norm(np.einsum("kij,kj->ki", J, motion.trajectory(at, 1))[:, :3], axis=1)

    return np.abs(speed(t + h) - speed(t - h)) / (2.0 * h)


def test_a_limit_whose_rows_read_the_twist_stops_a_motion(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(kinds, "_ADDED", {})
    monkeypatch.setattr(PathAcceleration, "seen", [])
    register(PathAcceleration())
    limits = MotionLimits(2.0, 10.0, 100.0, extra={"path_acceleration": 1.0})
    running = plan(paper6r(), default_line(), START, limits=limits)
    assert running
    PathAcceleration.seen.clear()
    t = 0.35 * running.trajectory.end
    stop = replan(running, t, stop=True, time_limit=0.0)
    assert stop and stop.stop_kind is StopKind.SWEEP
    assert 0.9 < stop.certificate.worst("path_acceleration")[0] <= 1.0
    at, h = PathAcceleration.seen[0], 1e-6  # s of a running motion is its time
    moved = [oracles.fk(paper6r(), running.trajectory(at.s + d))[:, :3, 3] for d in (-h, h)]
    np.testing.assert_allclose(at.twist[:, :3], (moved[1] - moved[0]) / (2.0 * h), atol=1e-6)


@cache
def dense() -> Plan:
    """A plan on a smooth curve of 300 points."""
    robot = paper6r()
    u = np.linspace(0.0, 1.0, 300)
    poses = np.tile(robot.fk(START), (u.size, 1, 1))
    poses[:, :3, 3] += 0.12 * np.stack([-u, 0.3 * np.sin(4.0 * u), u - 0.4 * u**2], axis=1)
    found = plan(robot, Polyline(poses, blend=1e-4, blend_rotation=0.01), START, limits=MotionLimits(2.0, 10.0, 100.0))
    assert found
    return found


@pytest.mark.parametrize("part", [0.2, 0.35, 0.5, 0.65, 0.8])
def test_a_stop_on_a_dense_path_is_early_and_not_shorter_with_lower_limits(part: float) -> None:
    """The bounds are those of the slowest joint alone: V / A + A / J, and 3 times that on a path of corners."""
    running = dense()
    t = part * running.trajectory.end
    stop = replan(running, t, stop=True, time_limit=0.0)
    V, A, J = float(abs(running.trajectory(t, 1)).max()), 10.0, 100.0
    usual = V / A + A / J if V >= A * A / J else 2.0 * np.sqrt(V / J)
    assert stop and stop.trajectory.end <= 3.0 * usual
    # A lower limit of the jerk is exceeded at once: the stop is then the same, and said to be within it later.
    for names, within in ((("acceleration",), True), (("jerk",), False)):
        lower = replan(running, t, stop=True, time_limit=0.0, limits=running.limits.scale(0.9, names))
        assert lower and (lower.within_limits_from == 0.0) == within
        assert lower.trajectory.end >= (0.97 if within else 1.0) * stop.trajectory.end


# ---------------------------------------------------------------- drives


@cache
def moving() -> Plan:
    found = plan(optik.load("ur5e"), JointLine(optik.load("ur5e"), START, START + MOVE), START,
                 limits=MotionLimits(2.0, 10.0, 100.0))  # fmt: skip
    assert found
    return found


def test_a_refused_execution_records_where_the_arm_is() -> None:
    drive = FaultyIdeal(moving().robot, START, faults=(LostEncoder("joint2", 0.0),))
    refused = drive.execute(moving())
    assert refused.status is ExecutionStatus.REFUSED and "encoder of joint2 is lost" in refused.reason
    np.testing.assert_array_equal(refused.q, START[None])
    assert np.isnan(refused.measured[0, 1]) and np.isfinite(np.delete(refused.measured[0], 1)).all()


def test_an_arm_with_a_frozen_encoder_ends_at_rest() -> None:
    pytest.importorskip("mujoco")
    for at, joint in ((0.06, 0), (0.3, 1), (0.55, 3), (0.8, 0)):
        lost: Any = LostEncoder(joint, at, frozen=True)
        execution = FaultyMujoco(moving().robot, START, faults=(lost,)).execute(moving())
        assert execution.status is ExecutionStatus.FAULT
        assert np.abs(execution.dq[-1]).max() <= 1e-4, execution.notes
