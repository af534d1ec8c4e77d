"""Polylines drawn by seed, by every law that keeps all limits: what a dense continuation follows is planned, and proved."""

import numpy as np
import pytest

from planners import Plan, plan
from planners.limits import DERIVATIVES
from planners.planning import PlanStatus
from tests import oracles
from tests.planners.polylines import draw

LAWS = ("optimal", "ruckig", "smooth")
FASTEST = 1.02
"""The optimum's duration over that of the best other law, at most."""


def planned(seed: int) -> tuple[dict[str, Plan], bool]:
    """Plans by every law, and whether a dense continuation of the start follows the path at all."""
    drawn = draw(seed)
    made = {law: plan(drawn.robot, drawn.path, drawn.q_start, limits=drawn.limits, timing=law) for law in LAWS}
    return made, oracles.follow_densely(drawn.robot, drawn.path, drawn.q_start).follows


def wrong(seed: int) -> list[str]:
    """All that is not as it should be; empty where everything is."""
    made, follows = planned(seed)
    found = {law: result.trajectory.end for law, result in made.items() if result}
    words = [
        f"{law}: {result.status}, {result.failure}" for law, result in made.items() if not result and (found or follows)
    ]
    if found and "optimal" in found and found["optimal"] > FASTEST * min(found.values()):
        words.append(f"the optimum is not the fastest: {found}")
    for law, result in made.items():
        if not result:
            continue
        bound = result.limits.arrays(result.robot.n)
        for order, field in enumerate(DERIVATIVES, start=1):
            if (result.trajectory.extrema(order).worst / bound[field]).max() > 1.0:
                words.append(f"{law}: {field} is broken")
        if np.abs(result.trajectory(result.trajectory.end) - result.joint_path.q[-1]).max() > 1e-9:
            words.append(f"{law}: it does not end where the path ends")
    return words


@pytest.mark.parametrize("seed", [0, 5, 7, 12, 29, 31, 92, 258, 868, 1110])
def test_a_drawn_polyline_is_planned_by_every_law_and_fastest_by_the_optimum(seed: int) -> None:
    assert not wrong(seed)


@pytest.mark.parametrize("seed", [14, 20, 33])
def test_a_path_that_no_continuous_motion_follows_is_refused(seed: int) -> None:
    made, follows = planned(seed)
    assert not follows
    for result in made.values():
        assert result.status not in (PlanStatus.SOLVED, PlanStatus.NOT_PROVED, PlanStatus.TIMING_INFEASIBLE)
        assert result.failure.reason


@pytest.mark.soak
@pytest.mark.parametrize("first", range(20))
def test_many_drawn_polylines_are_planned_by_every_law(first: int) -> None:
    failed = {}
    for seed in range(first, 2000, 100):
        try:
            found = wrong(seed)
        except Exception as error:
            found = [f"{type(error).__name__}: {error}"[:200]]
        if found:
            failed[seed] = found
    assert not failed, "\n".join(f"{seed}: {what}" for seed, what in failed.items())
