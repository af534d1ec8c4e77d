"""Rows of limits, which time laws respect: at any place and path speed they are what the limit judges of the state there."""

from __future__ import annotations

from math import factorial
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.interpolate import PPoly

import optik
from optik.arm.limits import VelocityByPosition
from optik.types import Array
from planners import MotionLimits
from planners.certificate.analysis import MotionAnalysis
from planners.limits import ALL_LIMITS, AccelerationByVelocity, Grip, Limit, OpenContainer, PathPoints, Suction, kind_of
from planners.limits._combination import Combination
from planners.trajectory import Trajectory
from planners.trajectory.curve import apply_chain_rule, monomials
from tests.optik.test_motors import MATRICES

ROBOT = optik.load("puma560").with_payload(2.0).with_limits(velocity=(2.5,) * 6, acceleration=(15.0,) * 6)
MOTORS = ROBOT.with_motors(MATRICES["random"])
COUPLED = Combination(MATRICES["random"].T, np.linspace(1.0, 3.0, 6))
GIVEN: dict[str, Any] = {
    "velocity": (np.linspace(-3.0, -1.0, 6), np.linspace(1.0, 2.0, 6)), "acceleration": (-np.full(6, 3.0), np.full(6, 5.0)),
    "jerk": 40.0, "torque": np.linspace(9.0, 90.0, 6), "torque_rate": 300.0,
    "velocity_by_position": VelocityByPosition(np.full(6, 0.1), np.full(6, 2.0)),
    "acceleration_by_velocity": AccelerationByVelocity(8.0, 11.0, 3.0),
    "open_container": OpenContainer(1.4, "z", (0.0, 0.02, 0.05)), "grip": Grip(0.4, 11.0, 1.0),
    "suction": Suction(0.4, 20.0, 1.0),
    "motor_velocity": COUPLED, "motor_acceleration": COUPLED, "motor_jerk": COUPLED, "motor_torque": COUPLED,
    "motor_torque_rate": COUPLED,
}  # fmt: skip
CONES = ("open_container", "grip", "suction")
PIECE = 1e-7
"""Duration of the motion around a state [s]: as good as the instant."""


def states(rng: np.random.Generator, k: int) -> tuple[list[Array], list[Array]]:
    """Derivatives in s at k places far apart, all joints moving one way each, and rates of s of all sizes."""
    q = ROBOT.limits.middle + ROBOT.limits.half * rng.uniform(-0.9, 0.9, (k, 6))
    others = [rng.choice([-1.0, 1.0], 6) * rng.uniform(0.2, 1.0, (k, 6)), *(rng.normal(size=(k, 6)) for _ in range(3))]
    size = 10.0 ** rng.uniform(-0.7, 0.5, (3, k))
    return [q, *others], [size[0], size[1] ** 2 * rng.normal(size=k), size[2] ** 3 * rng.normal(size=k)]


def judged(kind: Limit, robot: optik.Robot, bound: Any, q: Array, rates: list[Array]) -> Array:
    """Ratios (k, r) of the motions that begin with these states."""
    found = []
    for i in range(len(q)):
        c = np.zeros((6, 1, 6))
        for order, value in enumerate((q, *rates)):
            c[5 - order, 0] = value[i] / factorial(order)
        found.append(np.atleast_1d(kind.judge(MotionAnalysis(robot, Trajectory(PPoly(c, [0.0, PIECE]))), bound).ratio))
    return np.array(found)


@pytest.mark.parametrize("name", GIVEN)
def test_rows_are_the_ratios_of_the_states_that_they_describe(name: str) -> None:
    """Where their largest value is no ratio itself, it is above 1 where a ratio is; 16 faces cut little of a cone."""
    exact, kind = name not in (*CONES, "acceleration", "acceleration_by_velocity"), kind_of(name)
    rng, count = np.random.default_rng(len(name)), 25 if exact else 200
    robot = MOTORS if name.startswith("motor") else ROBOT
    bound = MotionLimits(**({name: GIVEN[name]} if name in ALL_LIMITS else {"extra": {name: GIVEN[name]}})).bounds(6)[
        name
    ]
    q, s = states(rng, count)
    if robot is MOTORS:
        q[1] = q[1] @ MATRICES["random"].T  # of motors that move one way each
    # inside a path: at its ends either sign of friction counts
    points = PathPoints(SimpleNamespace(robot=robot, end=2.0 * count), np.arange(1.0, count + 1.0), tuple(q))
    rows = kind.rows(points, bound)
    ratio = judged(kind, robot, bound, q[0], apply_chain_rule(q[1:4], [x[:, None] for x in s])).max(axis=1)
    mono = np.stack(monomials(s[: kind.order], full=rows.shape[2] > kind.order), axis=-1)
    said = np.abs(np.einsum("krc,kc->kr", rows, mono)).max(axis=1)
    if exact:
        np.testing.assert_allclose(said, ratio, rtol=1e-5)
        return
    near = np.abs(ratio - 1.0) < 1e-5
    assert count / 5 < (ratio > 1.0).sum() < 4 * count / 5
    if name in CONES:
        assert (ratio > 1.0)[said > 1.0].all() and (said > 1.0)[ratio > 1.06].all()
    else:
        np.testing.assert_array_equal((said > 1.0)[~near], (ratio > 1.0)[~near])
