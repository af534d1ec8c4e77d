"""Events of programs: times against roots found in another way, after slowing, replanning and files, and on drives."""

import json
from pathlib import Path

import numpy as np
import pytest
import scipy

import optik
import planners
from optik.errors import InvalidInput, NoSolution
from planners import MotionLimits, Part, Program
from planners.cell.drives.ideal import METHOD as Ideal
from planners.motion import Event
from planners.program import Dwell, Move, PathEvent, PeriodicEvent, TimedEvent

ROBOT = optik.load("ur5e")
HOME = np.deg2rad([0.0, -90.0, 90.0, -90.0, -90.0, 0.0])
LIMITS = MotionLimits.of(ROBOT, acceleration=10.0, jerk=100.0)
PROGRAM = Program([
    Part(np.deg2rad([20.0, -80.0, 95.0, -100.0, -90.0, 10.0]), blend=0.02, name="above"),
    Part(Move([0.0, 0.0, 0.1]), name="down"),
    Dwell(0.3),
    Part(Move([0.15, 0.0, 0.0], "base"), blend=0.01, name="seam", tool_speed=0.15),
    Part(Move([0.0, 0.1, 0.0], "base"), name="side"),
])  # fmt: skip


@pytest.fixture(scope="module")
def plan() -> planners.ProgramPlan:
    found = planners.plan(ROBOT, PROGRAM, HOME, limits=LIMITS)
    assert found
    return found


def root(plan, part: int, distance: float) -> float:
    """The time at which the tool has gone a distance along a line, by bisection on its position in space."""
    line = plan.parts[part].path
    start, along = line.pose(0.0)[:3, 3], line.twist(0.0)[:3]
    last = plan.moving_sections.index(plan.parts[part].section)
    begin, rest, _ = plan.times[last]

    def off(t: float) -> float:
        return float((ROBOT.fk(plan.trajectory(t))[:3, 3] - start) @ along - distance)

    grid = np.linspace(begin, rest, 2001)
    k = int(np.argmax([off(t) > 0.0 for t in grid]))
    return scipy.optimize.brentq(off, grid[k - 1], grid[k], xtol=1e-14)


def straight(plan, part: int, distance: float) -> bool:
    """Whether a place is outside of all rounded corners."""
    s = plan.parts[part].s_at(distance)
    return all(not corner.begin < s < corner.end for corner in plan.corners)


def test_places_on_lines_are_reached_at_their_time_also_slowed_and_replanned(plan) -> None:
    rng = np.random.default_rng(3)
    slower = planners.plan(ROBOT, PROGRAM, HOME, limits=LIMITS, duration=1.4 * plan.duration)
    halted = planners.replan(plan, 0.8 * plan.duration)
    count = 0
    for motion in (plan, slower, halted):
        for part in (1, 2, 3):
            length = motion.parts[part].path.end
            places = [float(x) for x in rng.uniform(0.02, 0.98, 20) * length if straight(motion, part, float(x))]
            found = motion.schedule([PathEvent(part, x, "s", i) for i, x in enumerate(places)]).events
            assert motion is halted or len(found) == len(places)
            for event in found:
                assert abs(event.t - root(motion, part, places[event.value])) <= 1e-6
                count += 1
    assert count > 60
    assert len(halted.schedule([PathEvent("side", -0.01, "s")]).events) == 1


def test_the_end_of_a_part_is_the_point_of_the_rounded_corner_nearest_to_its_end(plan) -> None:
    corner = next(c for c in plan.corners if c.part == 2)
    sharp = plan.parts[2].path.pose(plan.parts[2].path.end)[:3, 3]
    s = np.linspace(corner.begin, corner.end, 20001)
    nearest = s[np.linalg.norm(plan.path.pose(s)[:, :3, 3] - sharp, axis=1).argmin()]
    (end,), (start,) = (plan.schedule([PathEvent(*place, "s")]).events for place in ((2, -0.0), (3, 0.0)))
    end = plan.schedule([PathEvent(2, plan.parts[2].path.end, "s")]).events[0]
    assert abs(end.s - nearest) <= 2.0 * (s[1] - s[0])
    assert abs(start.t - end.t) <= 1e-12
    places = [plan.parts[2].path.end - x for x in (0.03, 0.02, 0.01, 0.005, 0.0)]
    times = [e.t for e in plan.schedule([PathEvent(2, x, "s") for x in places]).events]
    assert (np.diff(times) > 0.0).all()


def test_an_event_at_a_stop_is_before_the_wait_for_one_part_and_after_it_for_the_next(plan) -> None:
    down = plan.schedule([PathEvent("down", plan.parts[1].path.end, "s")]).events[0]
    seam = plan.schedule([PathEvent("seam", 0.0, "s")]).events[0]
    assert down.t == pytest.approx(plan.times[0].rest, abs=1e-9)
    assert seam.t == pytest.approx(plan.times[0].end, abs=1e-9)
    assert seam.t - down.t == pytest.approx(0.3, abs=1e-9)


def test_periods_delays_and_given_times(plan) -> None:
    shots = plan.schedule([PeriodicEvent("side", 0.01, "shot")]).events
    assert len(shots) == 11
    late, early = (plan.schedule([PathEvent("side", 0.05, "v", before=b)]).events[0] for b in (0.0, 0.04))
    assert late.t - early.t == pytest.approx(0.04, abs=1e-12)
    period = 0.008
    for event in plan.schedule([PeriodicEvent("side", 0.01, "shot")], period=period).events:
        assert event.t / period == pytest.approx(round(event.t / period), abs=1e-9)
        assert abs(event.shift) <= 0.5 * period + 1e-12
    again = planners.replan(plan.schedule([TimedEvent(1.0, "a"), TimedEvent(2.0, "b")]), 1.5)
    assert [(e.signal, pytest.approx(e.t)) for e in again.events] == [("b", 0.5)]


def test_an_event_after_a_place_also_where_the_place_is_passed_when_replanned(plan) -> None:
    late = [PathEvent("seam", 0.0, "gun", after=0.2), PathEvent("above", None, "half", fraction=0.0, after=0.2)]
    marked = plan.schedule(
        [*late, PathEvent("seam", 0.0, "begin"), PathEvent("side", 0.08, "b", before=0.01, after=0.03)]
    )
    at = {event.signal: event.t for event in marked.events}
    assert at["gun"] == pytest.approx(at["begin"] + 0.2) and at["half"] == pytest.approx(0.2)
    assert at["b"] == pytest.approx(root(plan, 3, 0.08) + 0.02, abs=1e-6)
    for t in (at["begin"] - 0.05, at["begin"] + 0.05, at["gun"] + 0.01):
        onward = planners.replan(marked, t)
        shift = at["begin"] - t if t < at["begin"] else 0.0
        gun = [event.t for event in onward.events if event.signal == "gun"]
        assert onward and len(gun) == (t < at["gun"]) and not [e for e in onward.events if e.signal == "half"]
        if shift:  # the place is ahead, and may be reached at another time
            begin = next(event.t for event in onward.events if event.signal == "begin")
            assert gun == [pytest.approx(begin + 0.2)]
        elif gun:
            assert gun == [pytest.approx(at["gun"] - t)]
    slower = plan.slowed_to(stopping_time=10.0).schedule(late)
    assert [e.t for e in slower.events] == pytest.approx([0.2, at["gun"]])
    with pytest.raises(InvalidInput, match="times in"):
        plan.schedule([PathEvent("side", 0.1, "x", after=0.1)])
    with pytest.raises(InvalidInput, match="after"):
        PathEvent(0, 0.0, "x", after=-1.0)


@pytest.mark.parametrize("period", [0.004, 0.5, 100.0])
def test_a_rounded_time_is_not_after_the_end(plan, period: float) -> None:
    marked = plan.schedule([TimedEvent(plan.duration, "end"), TimedEvent(0.99 * plan.duration, "near")], period=period)
    for event in marked.events:
        assert 0.0 <= event.t <= plan.duration and event.t / period == pytest.approx(round(event.t / period), abs=1e-9)
        assert event.t - event.shift in (plan.duration, pytest.approx(0.99 * plan.duration))


def test_files_keep_events_and_messages_have_them_beside(plan, tmp_path: Path) -> None:
    marked = plan.schedule(
        [PathEvent("seam", 0.05, "gun", "on"), TimedEvent(0.5, "x", 2.5), PathEvent(3, -0.01, "gun", False)]
    )
    for suffix in ("json", "csv", "npz"):
        planners.save(marked, tmp_path / f"m.{suffix}")
        assert planners.load_motion(tmp_path / f"m.{suffix}").events == marked.events
    sent = planners.to_ros(marked, tmp_path / "m.yaml", rate=125.0)
    written = [Event(**row) for row in json.loads((tmp_path / "m.events.json").read_text())]
    for event, old in zip(written, marked.events, strict=True):
        if old.s is None:
            assert event.t == old.t
            continue
        off = ROBOT.fk(sent.trajectory(event.t)) - ROBOT.fk(marked.trajectory(old.t))
        assert np.abs(off).max() <= 1e-6  # the controller interpolates between points


def test_a_drive_raises_each_event_once_also_around_a_stop(plan) -> None:
    marked = plan.schedule([PeriodicEvent("seam", 0.01, "shot"), PathEvent("down", 0.0, "start"), TimedEvent(0.1, "t")])
    seen: list[tuple[float, Event]] = []
    done = Ideal(ROBOT, HOME).execute(marked, watch=lambda now: seen.extend((now.t, event) for event in now.events))
    assert done
    assert tuple(event for _, event in seen) == done.events == done.plan.events
    assert all(0.0 <= t - event.t <= 0.004 + 1e-9 for t, event in seen)
    middle = 0.5 * (plan.times[1].begin + plan.times[1].rest)
    drive = Ideal(ROBOT, HOME)
    first = drive.execute(marked, stop=middle)
    second = drive.resume(first)
    assert first.events and second
    assert [e.s for e in (*first.events, *second.events)] == pytest.approx([e.s for e in marked.events])


@pytest.mark.parametrize(
    ("event", "text"),
    [
        (PathEvent("seem", 0.0, "s"), "part: expected 0 to 3, or 'above', 'down', 'seam', 'side'; got 'seem'"),
        (PathEvent(4, 0.0, "s"), "part: expected 0 to 3"),
        (PathEvent("seam", 0.2, "s"), "distance: expected at most the length of the part 'seam', 0.15 m; got 0.2 m"),
        (PathEvent("seam", -0.16, "s"), "distance: "),
        (
            PathEvent("above", 0.1, "s"),
            "distance: expected fraction=, from 0 to 1; got a distance along the part 'above'",
        ),
        (PeriodicEvent("above", 0.1, "s"), "spacing: expected fraction="),
        (PathEvent("down", 0.0, "s", before=5.0), "events: expected times in"),
        (TimedEvent(99.0, "s"), "events: expected times in"),
    ],
)
def test_what_cannot_be_scheduled_is_refused_in_one_line(plan, event, text: str) -> None:
    with pytest.raises(InvalidInput, match="^" + text.replace("(", r"\(")) as caught:
        plan.schedule([event])
    assert "\n" not in str(caught.value)


def test_one_event_alone_and_events_of_a_failed_plan_are_refused(plan) -> None:
    event = PathEvent(0, None, "s", fraction=0.5)
    with pytest.raises(InvalidInput, match=r"^events: expected a list of PathEvent, .*; got PathEvent\(part=0"):
        plan.schedule(event)
    failed = planners.plan(ROBOT, Program([Part(Move([0.0, 0.0, 1.5]), name="far")]), HOME, limits=LIMITS)
    with pytest.raises(NoSolution, match=r"^part 1 'far' \(line\): the path leaves"):
        failed.schedule([event])
    assert str(failed).startswith("unreachable: ur5e, program of 1 part, lm\n")
