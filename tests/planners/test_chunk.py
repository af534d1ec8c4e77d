"""Chunks as policies emit them: in degrees, wrapped at π, of other clocks, noisy, near the ends, and too much for one call."""

from __future__ import annotations

import importlib
from typing import Any

import numpy as np
import pytest

import optik
import planners
from optik import Robot
from optik.errors import InvalidInput
from planners import MotionLimits, Retargeted, retarget
from planners.streams import Chunk
from planners.streams.chunk import read_targets
from planners.streams.reference import find_scatter, track_targets
from tests.seeds import shift_seed

engine = importlib.import_module("planners.streams.engine")  # its folder is hidden by the function

REST = np.array([0.0, -1.5, 1.4, -1.5, -1.57, 0.0])
LIMITS = MotionLimits(velocity=2.5, acceleration=10.0, jerk=200.0)
TURNING = Robot.from_urdf("""<robot name="turning"><link name="a"/><link name="b"/><link name="c"/>
<joint name="turn" type="continuous"><parent link="a"/><child link="b"/><axis xyz="0 0 1"/></joint>
<joint name="bend" type="revolute"><parent link="b"/><child link="c"/><origin xyz="0.4 0 0"/><axis xyz="0 1 0"/>
<limit lower="-3.1" upper="3.1" velocity="2" effort="9"/></joint></robot>""")


def resting(robot: Robot, q: Any, limits: MotionLimits = LIMITS) -> Retargeted:
    """A motion that begins at rest at a configuration."""
    q = np.asarray(q, dtype=np.float64)
    away = q + 1e-3 * np.where(q + 1e-3 > robot.limits.upper, -1.0, 1.0)
    made = planners.plan(robot, away, q, limits=limits)
    assert made, made.failure
    return retarget(made, 0.0, q)


def wave(q: Any, size: Any, count: int = 31) -> np.ndarray:
    """Targets from a configuration to another one and back."""
    return np.asarray(q + np.outer(0.5 * (1.0 - np.cos(np.linspace(0.0, 2.0 * np.pi, count))), size))


def test_a_chunk_in_degrees_is_kept_and_says_so() -> None:
    robot = optik.load("ur5e")
    far = np.degrees(wave(REST, [0.4, 0.2, 0.0, 0.1, 0.0, 0.3]))
    kept = retarget(resting(robot, REST), 0.0, Chunk(far, 20.0))
    k, i = np.unravel_index(int((np.abs(far) - 2.0 * np.pi).argmax()), far.shape)
    beyond = abs(far[k, i]) - robot.limits.upper[i]
    words = f"target {k} of {robot.joint_names[i]} is {far[k, i]:.6g} rad, {beyond:.3g} rad outside"
    assert kept.status == "kept" and kept.reason.startswith(words) and kept.reason.endswith("are these degrees?")
    assert "degrees" not in retarget(resting(robot, REST), 0.0, Chunk(wave(REST, [900.0, 0, 0, 0, 0, 0]), 20.0)).reason


@pytest.mark.parametrize(("name", "joint", "most"), [("ur5e", 2, 0.1), ("irb910sc", 2, 0.005)])
def test_small_excesses_are_clipped_and_counted_and_larger_ones_kept(name: str, joint: int, most: float) -> None:
    robot = optik.load(name)
    middle = np.clip(np.zeros(robot.n), robot.limits.lower + 0.01, robot.limits.upper - 0.01)
    for upwards in (False, True):
        end = (robot.limits.upper if upwards else robot.limits.lower)[joint]
        for part in (0.0, 0.9, 1.1):
            size = np.zeros(robot.n)
            size[joint] = end - middle[joint] + (part * most if upwards else -part * most)
            P = wave(middle, size)
            found = retarget(resting(robot, middle), 0.0, Chunk(P, 20.0))
            outside = (robot.limits.upper < P) | (robot.limits.lower > P)
            assert bool(found) == (part < 1.0), found.reason
            assert found.clipped == int(bool(found) * outside.any(axis=1).sum())
            assert found or ("rad" if robot.name == "ur5e" else " m ") in found.reason.split(" outside")[0] + " "
            assert not found or found.certificate.position_margin.min() >= 1e-7  # rounding does not refuse chunks


def certified_inside(robot: Robot, found: Retargeted, limits: MotionLimits) -> bool:
    """Whether the motion stays in its ranges, by samples."""
    q = found.trajectory(np.linspace(0.0, found.trajectory.end, 2000))
    return bool((q <= robot.limits.upper + 1e-9).all() and (q >= robot.limits.lower - 1e-9).all())


def test_a_reference_beyond_an_end_is_followed_to_just_before_it() -> None:
    """Rounding of the programme does not lead out of the range."""
    robot, P = optik.load("ur5e"), np.tile(REST, (12, 1))
    P[3:, 2] = np.where(np.arange(9) // 3 % 2, robot.limits.lower[2], robot.limits.upper[2])
    found = retarget(resting(robot, REST), 0.0, Chunk(P, 1.0))
    assert found and 2.5e-7 <= found.certificate.position_margin.min() <= 1e-6, found.reason


def test_a_joint_without_limits_takes_the_shortest_way() -> None:
    rng, x = np.random.default_rng(shift_seed(2)), np.linspace(0.0, 0.6, 24)
    for _ in range(5):
        first = rng.uniform(-9.0, 9.0)
        motion = resting(TURNING, [first, 0.3])
        plain = np.stack([first + x, 0.3 + 0.5 * x], axis=1)
        wound = plain + np.stack([2.0 * np.pi * rng.integers(-3, 4, x.size), 0.0 * x], axis=1)
        found, wanted = (retarget(motion, 0.0, Chunk(P, 20.0)) for P in (wound, plain))
        assert found and found.jumps == 0, found.reason
        t = np.linspace(0.0, wanted.trajectory.end, 100)
        np.testing.assert_allclose(found.trajectory(t), wanted.trajectory(t), atol=1e-6)
        goal = retarget(motion, 0.0, [first + 0.3 + 2.0 * np.pi * rng.integers(-3, 4), 0.2])
        assert np.ptp(goal.trajectory(np.linspace(0.0, goal.trajectory.end, 99))[:, 0]) == pytest.approx(0.3, abs=1e-6)
        turns = 2.0 * np.pi * rng.integers(1, 4)
        other = planners.plan(TURNING, [first + turns + 0.5, 0.0], [first + turns + 0.1, 0.2], limits=LIMITS)
        entered = retarget(motion, 0.0, other)
        assert entered and entered.trajectory(entered.trajectory.end)[0] == pytest.approx(first + 0.5, abs=1e-9)


@pytest.mark.parametrize("winding", [-5, 0, 2])
@pytest.mark.parametrize(("turn", "lasts", "age"), [(4.0, 2.0, 1.7), (1.2 * np.pi, 6.0, 5.5), (1.2 * np.pi, 6.0, 6.0)])
def test_a_late_chunk_of_a_joint_without_limits_is_entered_where_the_arm_is(turn, lasts, age, winding) -> None:
    P = np.stack([np.linspace(0.0, turn, 41) + 2.0 * np.pi * winding, np.zeros(41)], axis=1)
    motion = resting(TURNING, [0.0, 0.0])
    found = retarget(motion, 0.0, Chunk(P, 40.0 / lasts, -age))
    q = found.trajectory(np.linspace(0.0, found.trajectory.end, 999))[:, 0]
    assert found.skipped == 0 and q[-1] == pytest.approx(turn, abs=5e-3) and q.min() > -5e-3
    by_clock = retarget(motion, 0.0, Chunk(P, 40.0 / lasts, -age), align="clock")
    assert by_clock and by_clock.trajectory(by_clock.trajectory.end)[0] == pytest.approx(turn - 2.0 * np.pi, abs=0.05)


def test_a_target_of_a_joint_without_limits_that_cannot_be_computed_with_is_named() -> None:
    kept = retarget(resting(TURNING, [0.0, 0.0]), 0.0, Chunk(wave([0.0, 0.0], [1e12, 0.0]), 20.0))
    assert (
        kept.reason
        == "target 15 of turn is 1e+12 rad, 1e+12 rad outside ±100000 rad, the largest position that is computed with"
    )


@pytest.mark.parametrize(("name", "jerk"), [("panda", 1000.0), ("kr6", 50.0)])
def test_slow_and_long_chunks_are_joined_within_the_budget(name: str, jerk: float) -> None:
    robot = optik.load(name)
    low, high = np.maximum(robot.limits.lower, -2.0), np.minimum(robot.limits.upper, 2.0)
    limits = MotionLimits.of(robot, velocity=1.5, acceleration=8.0, jerk=jerk)
    motion, cycles = resting(robot, 0.5 * (low + high), limits), np.linspace(4.0, 5.5, robot.n)
    for count, rate in ((100, 50.0), (400, 10.0), (400, 100.0), (1000, 25.0)):
        P = 0.5 * (low + high) + 0.4 * (high - low) * np.sin(
            2.0 * np.pi * cycles * np.linspace(0.0, 1.0, count)[:, None]
        )
        found = retarget(motion, 0.0, Chunk(P, rate))
        assert found, found.reason


def test_jumps_of_a_joint_with_limits_are_followed_and_counted() -> None:
    P = wave([0.0, 3.0], [0.0, 0.0])
    P[10:14, 1] = -3.0
    found = retarget(resting(TURNING, [0.0, 3.0]), 0.0, Chunk(P, 20.0))
    assert found and found.jumps == 2
    assert np.ptp(found.trajectory(np.linspace(0.0, found.trajectory.end, 999))[:, 1]) > 1.0


@pytest.mark.parametrize("align", ["clock", "nearest"])
def test_chunks_of_other_clocks_raise_nothing_and_compute_little(align: str, monkeypatch: pytest.MonkeyPatch) -> None:
    robot, sizes = optik.load("ur5e"), []
    motion = resting(robot, REST)

    def counted(*given: Any) -> Any:
        sizes.append(given[2].size)
        return track_targets(*given)

    monkeypatch.setattr(engine, "track_targets", counted)
    for off in np.append(10.0 ** np.arange(-3.0, 10.0), 1e308):
        for stamp in (5.0 - off, 5.0 + off):
            kept = retarget(motion, 5.0, Chunk(wave(REST, 0.3 * np.ones(6)), 20.0, stamp), align=align)
            old = stamp < 5.0 - 30 / 20.0 * (1.0 if align == "clock" else 2.0) - (0.0 if align == "clock" else 10.0)
            meant = not (old or (align == "clock" and stamp > 15.0))
            assert bool(kept) == meant, (off, kept.reason)
            assert kept or (
                f"(`observed`) is {abs(5.0 - stamp):.6g} s {'before' if old else 'after'} `at`" in kept.reason
            )
    assert max(sizes) < 1000


def test_no_chunk_raises() -> None:
    robot, rng = optik.load("ur5e"), np.random.default_rng(shift_seed(4))
    motion = resting(robot, REST)
    given = [Chunk(np.full((2, 6), x), 20.0) for x in (1e300, -1.7e308, 1e5)]
    given += [Chunk(wave(REST, 0.2 * np.ones(6)), rate) for rate in (1e-6, 1e-3, 1e5, 1e9)]
    given += [Chunk(rng.uniform(-6.0, 6.0, (m, 6)), 20.0) for m in (2, 3, 4, 5, 30)]
    for align in ("clock", "nearest"):
        for chunk in given:
            found = retarget(motion, 0.0, chunk, align=align)
            assert found or found.reason
            assert certified_inside(robot, found, LIMITS)
    turn = retarget(resting(TURNING, [0.0, 0.0]), 0.0, Chunk(np.array([[1.7e308, 0.0], [-1.7e308, 0.0]]), 20.0))
    assert turn.reason.startswith("target 0 of turn is 1.7e+308")


def test_a_target_that_is_no_number_is_named_with_its_row() -> None:
    P = wave(REST, np.zeros(6))
    P[7, 2] = np.nan
    with pytest.raises(InvalidInput, match="in row 7"):
        Chunk(P, 20.0)
    with pytest.raises(InvalidInput, match="rate"):
        Chunk(np.zeros((4, 6)), 1e300)


def test_a_call_ends_above_its_budget_of_work(monkeypatch: pytest.MonkeyPatch) -> None:
    robot, motion = optik.load("ur5e"), resting(optik.load("ur5e"), REST)
    chunk = Chunk(np.where(np.arange(20)[:, None] % 2, -3.0, 3.0) * np.ones(6), 20.0)
    assert retarget(motion, 0.0, chunk)
    monkeypatch.setattr(engine, "WORK", 6000)
    found = [retarget(resting(robot, REST), 0.0, chunk).reason for _ in range(2)]
    assert found[0].startswith("not found within the budget of work of one call: ")
    assert found[0].endswith("fewer targets or a shorter chunk, or set a larger longest") and found[0] == found[1]
    state, limits = np.zeros((3, 2)), np.array([[[-3.0, 3.0], [-1.0, 1.0], [-5.0, 5.0], [-50.0, 50.0]]] * 2)
    when = np.arange(0.0, 3.0, 0.02)
    targets = 2.5 * np.sin(4.0 * when)[:, None] * np.ones(2)
    j, used, *_ = track_targets(state, limits, when, targets, 0.04, 10**6)
    assert j == -1
    for budget in (-1000, 0, 100, used // 2, used - 100):
        over, work, *_ = track_targets(state, limits, when, targets, 0.04, budget)
        assert over == -2 and work <= budget + 2000


def test_noise_above_the_tolerance_is_smoothed_and_measured() -> None:
    robot, rng = optik.load("ur5e"), np.random.default_rng(shift_seed(5))
    clean = wave(REST, 0.3 * np.ones(6), 50)
    assert find_scatter(clean) < 1e-5
    kinked = clean + 0.2 * np.maximum(np.linspace(-1.0, 1.0, 50), 0.0)[:, None]
    assert find_scatter(kinked) < 2e-5
    for noise in (1e-3, 4e-3):
        found = retarget(resting(robot, REST), 0.0, Chunk(clean + noise * rng.normal(size=clean.shape), 30.0))
        assert found.scatter == pytest.approx(1.3 * noise, rel=0.4)  # the largest of six joints
        assert found.reference is not None and found.reference.error <= max(5e-3, 4.0 * found.scatter)
        assert (found.reference.error > 6e-3) == (noise > 2e-3)  # smooth, also where noise is above the tolerance
        v = found.trajectory(np.linspace(0.2, 1.4, 300), 1)
        assert (np.diff(np.sign(v), axis=0) != 0).sum(axis=0).max() <= 3


def test_targets_where_no_velocity_is_allowed_are_clipped_and_goals_near_there_are_fast() -> None:
    robot = optik.load("fr3")
    home = np.array([0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785])
    limits = MotionLimits.of(robot)
    for joint in (0, 3, 5):
        size = np.zeros(7)
        size[joint] = robot.limits.upper[joint] - 0.004 - home[joint]
        found = retarget(resting(robot, home, limits), 0.0, Chunk(wave(home, size), 10.0))
        assert found and found.clipped >= 1, found.reason
        goal = home + size - 0.03 * np.eye(7)[joint]
        near = retarget(resting(robot, home, limits), 0.0, goal)
        usual = planners.plan(robot, goal, home, limits=limits)
        assert near and near.trajectory.end <= 1.4 * usual.duration, near.reason


def test_a_chunk_for_another_arm_is_kept() -> None:
    kept = retarget(resting(optik.load("ur5e"), REST), 0.0, Chunk(np.zeros((4, 7)), 20.0))
    assert kept.status == "kept" and "7 joints" in kept.reason and "6" in kept.reason


def test_a_chunk_of_few_targets_is_divided_between_them() -> None:
    P = np.random.default_rng(3).uniform(-1.0, 1.0, (3, 2))
    points, rate, *_ = read_targets(Chunk(P, 10.0), TURNING, np.zeros(2, np.bool_), np.tile([-3.0, 3.0], (2, 1)))
    assert rate == 20.0
    np.testing.assert_allclose(points, [P[0], (P[0] + P[1]) / 2, P[1], (P[1] + P[2]) / 2, P[2]])
