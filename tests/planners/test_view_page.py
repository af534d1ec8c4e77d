"""What a viewer is given, and the page without a browser: whole, small, and safe from the names in it."""

import base64
import json
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.interpolate import CubicHermiteSpline

from optik import se3
from optik.errors import InvalidInput, NoSolution, OutputError
from optik.scene import Scene
from optik.types import Array
from optik.view.page import MOST_PAGE, make_page, write_page
from optik.view.show import Show, Track
from planners.cell import Cell, Outcome, PanTiltLaser, Spot, make_drive
from planners.cell.show import show_execution, show_outcome, thin_execution
from planners.motion.show import sample_track, show_motion
from tests.planners.cases import MOVE, START, paper6r
from tests.planners.faulty import FaultyIdeal, Stall
from tests.planners.motions import planned

EVIL = "</script><script>alert('x')</script> & <b>bold</b>"


@pytest.fixture(scope="module")
def show() -> Show:
    return show_motion(planned())


def data_of(page: str) -> Any:
    found = re.search(r'<script type="application/json" id="data">(.*?)</script>', page, re.DOTALL)
    return json.loads(found[1])


def numbers(text: str) -> Array:
    return np.frombuffer(base64.b64decode(text))


def test_a_show_has_the_motion_the_path_and_the_certificate(show: Show) -> None:
    motion = planned().trajectory
    t = np.linspace(0.0, motion.duration, 1001)
    k = np.clip(np.searchsorted(show.planned.t, t, side="right") - 1, 0, len(show.planned.t) - 2)
    h = show.planned.t[k + 1] - show.planned.t[k]
    u = ((t - show.planned.t[k]) / h)[:, None]
    basis = (2 * u**3 - 3 * u**2 + 1, u**3 - 2 * u**2 + u, 3 * u**2 - 2 * u**3, u**3 - u**2)
    q, dq = show.planned.q, show.planned.dq * h[0]
    between = basis[0] * q[k] + basis[1] * dq[k] + basis[2] * q[k + 1] + basis[3] * dq[k + 1]
    assert np.abs(between - motion(t)).max() < 1e-6
    ends = planned().path.pose(np.array([0.0, planned().path.end]))[:, :3, 3]
    np.testing.assert_allclose(show.path[[0, -1]], ends, atol=1e-12)
    facts = dict(show.facts)
    assert facts["Certificate"] == "valid"
    assert facts["Duration"] == f"{motion.duration:.4f} s"
    assert show_motion(planned().motion).facts == show.facts


def test_what_was_executed_is_thinned_out_and_unread_instants_are_counted() -> None:
    t = np.arange(5001) * 5e-4
    q = np.column_stack([np.sin(t), np.cos(t)])
    q[[7, 9]] = np.nan
    track, unread = thin_execution(t, q, np.zeros_like(q))
    assert unread == 2
    assert len(track.t) == 2000
    assert track.t[-1] == t[-1]
    assert np.isfinite(track.q).all()
    assert thin_execution(t[:1], q[7:8], q[7:8]) == (None, 1)


def test_a_very_long_motion_fits(show: Show) -> None:
    slow = sample_track(planned().trajectory.stretched(1000.0))
    assert len(slow.t) == 2000
    page = make_page(replace(show, planned=slow, executed=slow))
    assert len(page) < 0.5 * MOST_PAGE
    data = data_of(page)
    np.testing.assert_array_equal(numbers(data["planned"]["q"]).reshape(-1, 6), slow.q)


def test_an_arm_of_many_joints_and_a_scene_of_many_objects_fit(show: Show) -> None:
    rng = np.random.default_rng(3)
    spheres = [(p, 0.01) for p in rng.uniform(-3.0, 3.0, (3000, 3))]
    box = (np.eye(4), [0.1, 0.1, 0.1])
    page = make_page(replace(show, scene=Scene(boxes=[box], spheres=spheres)))
    assert len(page) < MOST_PAGE
    assert "the 2000 objects nearest to the path, of 3001" in page
    drawn = numbers(data_of(page)["scene"]["rounds"]).reshape(-1, 7)[:, :3]
    distances = np.sort([np.linalg.norm(show.path - p, axis=1).min() for p, _ in spheres])
    found = max(np.linalg.norm(show.path - p, axis=1).min() for p in drawn)
    assert found == pytest.approx(distances[len(drawn) - 1])


def test_names_are_text_in_the_page(show: Show) -> None:
    page = make_page(replace(show, title=EVIL, facts=((EVIL, EVIL),), robot=replace(show.robot, name=EVIL)))
    assert EVIL not in page
    assert page.count("<script") == page.count("</script>") == 2
    named = replace(show.robot, joint_names=(EVIL, *show.robot.joint_names[1:]))
    assert data_of(make_page(replace(show, robot=named)))["arm"]["joints"][0] == EVIL


def test_the_page_names_no_other_file(show: Show) -> None:
    page = make_page(show)
    assert "default-src 'none'" in page
    assert re.findall(r"https?://|url\(|@import|\bsrc=|fetch\(|import\(", page) == []


@pytest.mark.parametrize("name", ["page.txt", "page", "page.json"])
def test_another_suffix_is_refused(show: Show, tmp_path: Path, name: str) -> None:
    with pytest.raises(InvalidInput, match=r"\.html"):
        write_page(show, tmp_path / name)
    assert list(tmp_path.iterdir()) == []


def test_what_cannot_be_written_or_does_not_fit_is_said(show: Show, tmp_path: Path) -> None:
    with pytest.raises(OutputError):
        write_page(show, tmp_path / "missing" / "page.html")
    with pytest.raises(InvalidInput, match="2 MB"):
        write_page(replace(show, facts=(("Note", "x" * MOST_PAGE),)), tmp_path / "page.html")
    assert list(tmp_path.iterdir()) == []


def test_a_single_instant_can_be_shown(show: Show) -> None:
    still = Track(show.planned.t[:1], show.planned.q[:1], show.planned.dq[:1])
    assert data_of(make_page(replace(show, planned=still)))["planned"]["t"]


# ---------------------------------------------------------------- tasks of the cell
BESIDE = se3.pose(np.eye(3), [-0.6, 0.2, 0.1])


def task(**options: Any) -> Outcome:
    robot = paper6r()
    cell = Cell(robot, PanTiltLaser(BESIDE), FaultyIdeal(robot, START, **options))
    return cell.move_to_spot(cell.read(robot.fk(START)[:3, 3] + MOVE), corrections=1, timing="ruckig")


def test_a_task_is_shown_with_all_its_executions_and_its_beam() -> None:
    outcome = task()
    shown = show_outcome(outcome)
    assert len(outcome.executions) == 2
    assert outcome.beam is not None and shown.beam is not None and shown.executed is not None
    np.testing.assert_array_equal(shown.beam.origin, BESIDE[:3, 3])
    np.testing.assert_array_equal(shown.beam.spot, outcome.beam[1])
    for track in (shown.planned, shown.executed):
        assert (np.diff(track.t) >= 0.0).all()
        np.testing.assert_allclose(track.q[-1], outcome.executions[-1].q[-1], atol=1e-4)
    assert shown.duration == pytest.approx(sum(e.t[-1] for e in outcome.executions))
    assert np.isnan(shown.path).any(axis=1).sum() == 1
    facts = dict(shown.facts)
    assert facts["Task"] == "arrived"
    assert facts["Error at the end"].endswith(("mm", "nm"))
    assert "NaN" not in make_page(shown).partition('id="data"')[2].partition("</script>")[0]


def test_a_task_that_failed_is_shown_as_far_as_it_came() -> None:
    stalled = show_outcome(task(faults=(Stall(0, 0.2),)))
    assert dict(stalled.facts)["Failed step"] == "execution"
    assert stalled.executed is not None
    robot = paper6r()
    cell = Cell(robot, PanTiltLaser(BESIDE), make_drive("ideal", robot, q=START))
    with pytest.raises(NoSolution, match="nothing was executed"):
        show_outcome(cell.move_to_spot(Spot(np.nan, 0.0, 1.0)))


def test_an_execution_is_shown_beside_what_was_sent() -> None:
    done = make_drive("ideal", paper6r(), encoder=2.0**14).execute(planned())
    shown = show_execution(done)
    assert shown.executed is not None and done.motion is not None
    assert shown.planned.t[-1] == done.motion.duration
    np.testing.assert_array_equal(shown.executed.q[-1], done.q[-1])
    refused = show_execution(make_drive("ideal", paper6r(), q=START + 0.3).execute(planned()))
    assert refused.executed is None
    assert dict(refused.facts)["Execution"] == "refused"
    assert dict(refused.facts)["Reason"]


def test_a_track_between_its_instants_is_the_motion(show: Show) -> None:
    motion, cubics = planned().trajectory, CubicHermiteSpline(*show.planned[:3])
    for t in np.linspace(0.0, motion.duration, 37).tolist():
        np.testing.assert_allclose(cubics(t), motion(t), atol=1e-7)
        np.testing.assert_allclose(cubics(t, 1), motion(t, 1), atol=1e-4)
