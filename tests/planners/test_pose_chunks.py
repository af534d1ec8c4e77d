"""Chunks of poses, resolved on the branch of the running motion, against the joint motions that they come from."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest

import optik
import planners
from optik.errors import InvalidInput
from optik.types import Array
from planners import MotionLimits, retarget, stream
from planners.streams import Chunk, RetargetStatus
from planners.streams.chunk import resolve_poses
from planners.trajectory import make_rest
from tests.planners.test_retarget import PANDA, REST, check_motion
from tests.seeds import shift_seed

RATE = 20.0
ARMS = ("ur5e", "kr6", "irb120", "panda", "iiwa14", "fr3")


def curve(robot: optik.Robot, rng: np.random.Generator, m: int, least: float = 0.03) -> Array:
    """Joint targets of a smooth motion inside the ranges, whose smallest singular value is above a least one."""
    low, high = np.maximum(robot.limits.lower, -2.8), np.minimum(robot.limits.upper, 2.8)
    t = np.arange(m)[:, None] / RATE
    while True:
        wave = sum(rng.uniform(-0.3, 0.3, robot.n) * np.sin(t * rng.uniform(0.5, 3.0, robot.n)) for _ in range(2))
        q = rng.uniform(low + 0.4, high - 0.4) + wave
        if np.linalg.svd(robot.jacobian(q), compute_uv=False).min() > least and ((low < q) & (q < high)).all():
            return np.asarray(q)


def state_at(q: Array, k: int) -> Array:
    """The state of a motion at target k, by differences."""
    return np.stack([q[k], (q[k + 1] - q[k - 1]) * RATE / 2.0, 0.0 * q[k]])


@pytest.mark.parametrize("name", ARMS)
def test_poses_of_a_known_motion_give_its_joints(name):
    robot, rng = optik.load(name), np.random.default_rng(shift_seed(3))
    for _ in range(20):
        q = curve(robot, rng, 30)
        k = int(rng.integers(1, 10))
        found, cut = resolve_poses(
            robot, Chunk(robot.fk(q), RATE, 0.0), state_at(q, k), k / RATE + rng.uniform(0.0, 0.2)
        )
        assert not cut and found is not None and len(found.points) == 30 and found.observed == 0.0
        np.testing.assert_allclose(robot.fk(found.points), robot.fk(q), atol=1e-9)
        if robot.n == 6:
            np.testing.assert_allclose(found.points, q, atol=1e-8)
        assert robot.limits.contains(np.asarray(found.points).max(axis=0))
        longest = [np.linalg.norm(np.diff(x, axis=0), axis=1).max() for x in (found.points, q)]
        assert longest[0] <= 2.0 * longest[1]


def test_a_chunk_of_poses_is_followed_like_one_of_joints():
    robot = optik.load("ur5e")
    limits = MotionLimits(velocity=np.pi, acceleration=10.0, jerk=100.0)
    rng = np.random.default_rng(shift_seed(4))
    for _ in range(5):
        q = curve(robot, rng, 30)
        running = planners.plan(robot, q[0] + 0.3, q[0] - 0.05, limits=limits)
        found, same = (retarget(running, 0.2, Chunk(x, RATE, 0.1)) for x in (robot.fk(q), q))
        assert found and same and (found.skipped, found.repaired, found.cut) == (same.skipped, same.repaired, "")
        check_motion(robot, limits, found.trajectory, [running.trajectory(0.2, k) for k in range(3)])
        t = np.linspace(0.0, same.trajectory.end, 50)
        np.testing.assert_allclose(found.trajectory(t), same.trajectory(t), atol=1e-6)


def test_redundant_joints_stay_in_their_ranges():
    robot = optik.load("panda")
    q = REST + 0.3 * np.sin(np.arange(40)[:, None] / RATE * np.linspace(1.0, 2.0, 7))
    free, _ = resolve_poses(robot, Chunk(robot.fk(q), RATE), state_at(q, 1), 0.05)
    assert free is not None
    upper = robot.limits.upper.copy()
    upper[0] = np.asarray(free.points)[:, 0].max() - 0.05  # the motion of least norm goes beyond it
    limits = optik.JointLimits(robot.limits.lower, upper)
    tight = dataclasses.replace(robot, limits=limits)
    found, cut = resolve_poses(tight, Chunk(robot.fk(q), RATE), state_at(q, 1), 0.05)
    assert not cut and found is not None and np.asarray(found.points)[:, 0].max() == upper[0]
    np.testing.assert_allclose(robot.fk(found.points), robot.fk(q), atol=1e-9)


def cut_of(robot: optik.Robot, poses: Array, q: Array) -> tuple[int, str]:
    """How many poses are joined from rest, and what the result says."""
    rest = planners.Motion(robot, planners.JointLine(robot, q, q + 0.1), LIMITS, make_rest(q, 1.0))
    found = retarget(rest, 1.0, Chunk(poses, RATE, 1.0))
    assert bool(found) == (not found.reason) and found.reason in ("", found.cut)
    return (0 if found.reference is None else round(found.reference.s[-1] * RATE) + 1), found.cut


LIMITS = MotionLimits(velocity=2.0, acceleration=10.0, jerk=500.0)
BENT = np.array([0.0, -1.2, 1.4, -0.2, 0.5, 0.0])


def test_a_chunk_ends_before_a_pose_that_is_out_of_reach_singular_or_out_of_range():
    robot = optik.load("ur5e")
    poses = np.array([robot.fk(BENT)] * 12)
    poses[:, 2, 3] += 0.01 * np.arange(12)
    assert cut_of(robot, poses, BENT) == (12, "")
    away = poses.copy()
    away[7:, 0, 3] += 5.0
    assert cut_of(robot, away, BENT) == (
        7,
        "the chunk of 12 poses ends before pose 7 (counted from 0), which is not reached on the arm's branch",
    )
    away[1:, 0, 3] += 5.0
    assert cut_of(robot, away, BENT)[0] == 0
    straight = BENT + np.linspace(0.0, 1.0, 11)[:, None] * (0.0, 0.0, -1.4, 0.0, 0.0, 0.0)
    count, words = cut_of(robot, robot.fk(straight), BENT)
    assert count == 10 and "before pose 10 (counted from 0), which is singular, or" in words
    turned = BENT + np.linspace(0.0, 0.5, 11)[:, None] * np.eye(6)[5]
    turned[:, 5] += robot.limits.upper[5] - 0.22
    count, words = cut_of(robot, robot.fk(turned), turned[0])
    assert count == 5 and "before pose 5 (counted from 0), which takes joint6 out of its range" in words


@pytest.mark.parametrize("name", ["ur5e", "kr6"])
def test_a_motion_through_singular_configurations_ends_the_chunk_or_is_the_known_one(name):
    robot, rng, ended = optik.load(name), np.random.default_rng(shift_seed(6)), 0
    for _ in range(100):
        q = curve(robot, rng, 60, least=0.0)[::2]
        found, cut = resolve_poses(robot, Chunk(robot.fk(q), RATE, 0.0), state_at(q, 1), 1.0 / RATE)
        if found is not None:
            first = round(found.observed * RATE)
            np.testing.assert_allclose(found.points, q[first : first + len(found.points)], atol=1e-6)
        ended += bool(cut)
    assert ended > 5


@pytest.mark.parametrize(
    ("change", "words"),
    [((slice(None), slice(3), slice(3), 1.001), r"points\[0\]: expected a rotation"),
     ((3, 3, 3, 2.0), r"points\[3\]: .*last row"),
     ((2, 0, 3, np.nan), r"points\[2\]: .*NaN"), ((1, 0, 0, -1.0), r"points\[1\]")],
)  # fmt: skip
def test_a_chunk_of_poses_names_the_one_that_is_none(change, words):
    poses = np.array([optik.se3.pose(p=[0.4, 0.1 * k, 0.3]) for k in range(5)])
    poses[change[:3]] *= change[3]
    with pytest.raises(InvalidInput, match=words):
        Chunk(poses, RATE)


def test_a_stream_takes_poses_and_counts_chunks_that_end_early():
    robot = optik.load("panda")
    q = REST + 0.2 * np.sin(np.arange(20)[:, None] / RATE * np.linspace(1.0, 2.0, 7))
    poses = robot.fk(q)

    def source(now: Any) -> Any:
        chunk = poses.copy()
        chunk[10:, 0, 3] += 2.0 * (now.t >= 0.1)
        return Chunk(chunk, RATE, 0.0) if round(now.t * 500.0) in (0, 50, 100) else None

    flow = stream(robot, source, REST, limits=PANDA, rate=500.0, realtime=False, silence=0.1)
    last = list(flow)[-1]
    report = flow.report()
    assert report.joined == 3 and list(report.cut.values()) == [2] and "before pose 10" in str(report)
    np.testing.assert_allclose(robot.fk(last.q), poses[9], atol=5e-3)
    kept = retarget(
        planners.plan(robot, REST + 0.1, REST, limits=PANDA),
        0.0,
        Chunk(poses + 9.0 * np.eye(4)[0, :, None] * np.eye(4)[3], RATE),
    )
    assert kept.status is RetargetStatus.KEPT and "is not reached" in kept.reason
