"""Records that hold arrays are equal and hashed by value, and so are the keys of solvers that are kept."""

import numpy as np
import pytest

import optik
from optik import IKResult, IKStatus
from optik.ik import IKBatch, get_solver
from optik.ik.closed_form import Branches
from optik.types import content
from planners import MotionLimits

PANDA = optik.load("panda")
HOME = np.array([0.0, -0.5, 0.0, -2.0, 0.0, 1.5, 0.7])


def result(last=0.7, status=IKStatus.SOLVED, trace=None):
    return IKResult(np.append(HOME[:-1], last), status, 3, 0, 1e-9, 1e-9, trace, "")


def branches(free=True):
    return Branches(HOME[None].copy(), np.zeros(1), np.zeros(1), np.array([free]), "ssik", True, "")


def batch(status=0):
    return IKBatch(
        HOME[None].copy(), np.array([status], np.uint8), *np.zeros((2, 1), np.int32), np.zeros(1), np.zeros(1)
    )


PAIRS = {
    "IKResult": (result(), result(), result(0.8)),
    "IKResult by status": (result(), result(), result(status=IKStatus.STALLED)),
    "IKResult with a trace": (result(trace=np.ones((2, 6))), result(trace=np.ones((2, 6))), result()),
    "IKBatch": (batch(), batch(), batch(1)),
    "Branches": (branches(), branches(), branches(False)),
    "MotionLimits": (MotionLimits([1.0, 2.0], 3.0), MotionLimits(np.array([1, 2]), 3), MotionLimits([1.0, 2.5], 3.0)),
    "MotionLimits, free": (MotionLimits(), MotionLimits(), MotionLimits(tool_speed=1.0)),
    "MotionLimits, scalar": (MotionLimits(2), MotionLimits(2.0), MotionLimits([2.0, 2.0])),
}


@pytest.mark.parametrize(("one", "same", "other"), PAIRS.values(), ids=PAIRS.keys())
def test_records_are_equal_by_value(one, same, other):
    assert one == same
    assert not one != same  # noqa: SIM202  (both ways are written out)
    assert hash(one) == hash(same)
    assert one != other
    assert not one == other  # noqa: SIM201
    assert {one: "found"}[same] == "found"
    assert one != tuple(range(8)) and one != "a word"


def test_motion_limits_are_their_own_and_read_only():
    given = np.array([1.0, 2.0])
    limits = MotionLimits(given)
    before = hash(limits)
    given[0] = 9.0
    assert hash(limits) == before
    assert list(limits.velocity) == [1.0, 2.0]
    with pytest.raises(ValueError, match="read-only"):
        limits.velocity[0] = 9.0


def test_content_tells_types_apart_and_not_the_order_of_a_mapping():
    assert content({"a": 1, "b": [2.0]}) == content({"b": [2.0], "a": 1})
    kinds = [1, 1.0, True, "1", (1,), [1], (1.0,), [True], np.array([1]), np.array([1.0]), np.array(1.0), {1: 1}, {1}]
    assert len({content(k) for k in kinds}) == len(kinds)


@pytest.mark.parametrize(
    ("one", "same", "other"),
    [
        ({"posture": HOME}, {"posture": HOME.copy()}, {"posture": HOME + 0.1}),
        ({"posture": list(HOME)}, {"posture": list(HOME)}, {"posture": tuple(HOME)}),
        ({}, {}, {"max_restarts": 3}),
    ],
)
def test_a_solver_is_kept_for_options_of_equal_content(one, same, other):
    kept = get_solver(PANDA, "lm", {"prefer": {"posture": 1.0, "limits": 0.1}} | one)
    assert get_solver(PANDA, "lm", {"prefer": {"limits": 0.1, "posture": 1.0}} | same) is kept
    assert get_solver(PANDA, "lm", {"prefer": {"posture": 1.0, "limits": 0.1}} | other) is not kept
    assert get_solver(PANDA, "lm", {"prefer": {"posture": 1.0, "limits": 0.2}} | one) is not kept


def test_an_array_that_changes_after_a_call_does_not_change_the_kept_solver():
    posture = HOME.copy()
    kept = get_solver(PANDA, "lm", {"prefer": "posture", "posture": posture})
    posture[0] = 1.0
    other = get_solver(PANDA, "lm", {"prefer": "posture", "posture": posture})
    assert other is not kept
    assert other.preference.posture[0] == 1.0
    assert get_solver(PANDA, "lm", {"prefer": "posture", "posture": HOME}) is kept
    assert kept.preference.posture[0] == 0.0
