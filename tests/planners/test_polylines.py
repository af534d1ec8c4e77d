"""Polylines drawn by seed by every law that keeps all limits: no exception, no motion missing, the optimum the fastest."""

from __future__ import annotations

import numpy as np
import pytest

from optik.ik import make_solver
from planners import follow, make_law
from planners.timing.base import DERIVATIVES
from tests.planners.polylines import draw

LAWS = ("optimal", "ruckig", "smooth")


def durations(seed: int) -> dict[str, float]:
    """Duration by every law, each of which keeps velocity, acceleration and jerk; none where the path cannot be followed."""
    drawn = draw(seed)
    followed = follow(make_solver(drawn.robot, "lm"), drawn.path, drawn.q_start)
    if not followed or followed.joint_path is None:
        return {}
    bound, out = drawn.limits.arrays(drawn.robot.n), {}
    for law in LAWS:
        motion = make_law(law).run(followed.joint_path, drawn.limits)
        for order, field in enumerate(DERIVATIVES, start=1):
            assert (motion.extrema(order).worst / bound[field]).max() <= 1.0, (seed, law, field)
        np.testing.assert_allclose(motion(motion.end), followed.joint_path.q[-1], atol=1e-9)
        out[law] = motion.duration
    return out


@pytest.mark.parametrize("seed", [0, 5, 6, 7, 12, 27, 32, 85, 100, 116, 145, 152])
def test_the_optimum_is_the_fastest_on_a_drawn_polyline(seed: int) -> None:
    found = durations(seed)
    assert found
    assert found["optimal"] <= 1.02 * min(found.values())


@pytest.mark.soak
@pytest.mark.parametrize("first", range(0, 2000, 100))
def test_the_optimum_is_the_fastest_on_many_polylines(first: int) -> None:
    failed = {}
    for seed in range(first, first + 100):
        try:
            found = durations(seed)
        except Exception as error:
            failed[seed] = f"{type(error).__name__}: {error}"[:120]
            continue
        if found and not found["optimal"] <= 1.02 * min(found.values()):
            failed[seed] = str(found)
    assert not failed, "\n".join(f"{seed}: {what}" for seed, what in failed.items())
