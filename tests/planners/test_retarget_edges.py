"""Retargeting at its edges: just after a start, with limits that differ by side, and at the pace that is asked."""

from __future__ import annotations

from inspect import signature

import numpy as np
import pytest

import optik
import planners
from planners import MotionLimits, retarget, stream
from planners.streams import Chunk
from tests.planners.test_retarget import PANDA, REST


@pytest.mark.parametrize("at", [1e-3, 1e-5, 1e-7])
@pytest.mark.parametrize("size", [0.5, -0.5])
def test_a_chunk_just_after_a_start_ends_when_the_chunk_does(at: float, size: float) -> None:
    """At velocities of nothing, and large jerks."""
    plan = planners.plan(optik.load("panda"), REST + 0.4, REST, limits=PANDA)
    t = np.arange(20)[:, None] / 20.0
    found = retarget(plan, at, Chunk(REST + size * np.sin(t) * np.linspace(0.2, 1.0, 7), 20.0, at))
    assert found, found.reason
    assert 0.95 <= found.trajectory.end <= 2.5


def test_a_chunk_is_joined_at_the_pace_of_the_lower_side() -> None:
    """It goes at 0.8 rad/s in the direction of the lower limit, and then back at once."""
    robot = optik.load("ur5e")
    limits = MotionLimits(velocity=(-0.4, 3.0), acceleration=(-20.0, 25.0), jerk=2000.0)
    start = np.array([0.0, -1.57, 1.57, -1.57, -1.57, 0.0])
    rest = planners.plan(robot, start + 0.01, start, limits=limits)
    t = np.arange(31)[:, None] / 20.0
    now = rest.trajectory.end + 0.1
    found = retarget(rest, now, Chunk(start + 0.01 - 0.8 * t * np.linspace(0.5, 1.0, 6), 20.0, now))
    assert found and found.joined_after is not None and found.joined_after < 1.0, found.reason
    assert 0.4 < found.pace < 0.52


def test_a_stream_goes_at_the_pace_of_its_chunks_as_retarget_does() -> None:
    mine, own = (signature(each).parameters for each in (stream, retarget))
    for name in ("tolerance", "pace", "align", "longest", "scene"):
        assert mine[name].default == own[name].default
    speed = np.linspace(0.1, 0.3, 7)
    sent = [Chunk(REST + np.arange(61)[:, None] / 20.0 * speed, 20.0, 0.0)]
    points = list(
        stream(
            optik.load("panda"),
            lambda now: sent.pop() if sent else None,
            REST,
            limits=PANDA,
            realtime=False,
            silence=0.1,
        )
    )
    (rate,) = [p.dq for p in points if abs(p.t - 2.0) < 1e-9]
    np.testing.assert_allclose(rate, speed, rtol=1e-3)
