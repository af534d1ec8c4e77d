"""Contract of the simulated drives: each takes its arm to the end of a plan, stops on the path, goes on, and stays at rest."""

from functools import cache
from typing import Any

import numpy as np
import pytest

from optik.errors import InvalidInput
from optik.registry import load_method
from planners import Plan, plan
from planners.cell import Drive, ExecutionStatus, Moment, drives, make_drive
from tests.outside import everything
from tests.planners.cases import START, default_line, paper6r

NEEDS_MORE = ("ros",)
"""Drives that need a transport: they have tests of their own."""
NAMES = tuple(name for name in everything("planners.cell.drives") if name not in NEEDS_MORE)
each_drive = pytest.mark.parametrize("name", NAMES, ids=[name.rpartition("/")[2] for name in NAMES])
NEAR = 1e-3
"""How near to its set-point a drive must come to rest [rad]."""


@cache
def line() -> Plan:
    found = plan(paper6r(), default_line(), START)
    assert found
    return found


def goal() -> Any:
    return line().trajectory(line().trajectory.end)


def test_the_drives_are_found_by_their_names() -> None:
    assert "ideal" in drives()
    assert issubclass(load_method("planners.cell.drives", "ideal", "drive"), Drive)


@each_drive
def test_a_plan_is_executed_to_its_end(name: str) -> None:
    drive, seen = make_drive(name, paper6r()), list[Moment]()
    execution = drive.execute(line(), watch=seen.append)
    assert execution and execution.status is ExecutionStatus.DONE
    ticks = len(execution.setpoints.t)
    assert len(seen) == len(execution.measured) == ticks
    assert execution.q.shape == execution.dq.shape == (len(execution.t), 6)
    assert (np.diff(execution.t) > 0.0).all() and execution.t[0] == 0.0
    np.testing.assert_allclose(execution.t[-1], execution.setpoints.t[-1], rtol=1e-12)
    np.testing.assert_allclose(execution.setpoints.q[-1], goal(), rtol=0.0, atol=1e-9)
    np.testing.assert_allclose(execution.q[-1], goal(), rtol=0.0, atol=NEAR)
    np.testing.assert_allclose(drive.measure(), execution.q[-1], rtol=0.0, atol=NEAR)
    np.testing.assert_allclose([x.t for x in seen], execution.setpoints.t, atol=1e-12)


@each_drive
def test_a_stop_ends_at_rest_and_the_rest_of_the_way_is_gone(name: str) -> None:
    drive = make_drive(name, paper6r())
    execution = drive.execute(line(), stop=lambda t: t > 0.1)
    assert execution.status is ExecutionStatus.STOPPED and not execution
    assert execution.stop_plan is not None and execution.stop_plan.certificate.is_valid
    assert np.abs(execution.dq[-1]).max() < 1e-2
    assert np.abs(execution.q[-1] - goal()).max() > 0.01
    again = drive.resume(execution)
    assert again
    np.testing.assert_allclose(again.q[-1], goal(), rtol=0.0, atol=NEAR)


@each_drive
def test_what_cannot_be_executed_is_refused_and_nothing_moves(name: str) -> None:
    elsewhere = START + 0.1
    drive = make_drive(name, paper6r(), q=elsewhere)
    refused = drive.execute(line())
    assert refused.status is ExecutionStatus.REFUSED and "is at" in refused.reason and refused.advice
    assert refused.motion is None and refused.setpoints is None
    np.testing.assert_allclose(drive.measure(), elsewhere, rtol=0.0, atol=NEAR)
    with pytest.raises(InvalidInput, match=r"^period: "):
        make_drive(name, paper6r(), period=10.0).execute(line())
    with pytest.raises(InvalidInput):
        drive.resume(refused)
