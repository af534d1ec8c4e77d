"""What the planners' tests plan for: the paper's arm, its line, and motions drawn at random, made by the package itself."""

from functools import cache
from math import factorial
from typing import Any

import numpy as np
from hypothesis import strategies as st
from numpy.polynomial import polynomial
from scipy.interpolate import PPoly

import optik
from optik.ik import make_solver
from optik.types import Array
from planners import Line, Trajectory, follow
from planners.following.joint_path import JointPath
from tests.oracles import moved

START = np.deg2rad([20.0, -35.0, 40.0, 25.0, 50.0, -30.0])
MOVE = np.array([-0.12, 0.0, 0.20])
END_DEG = np.array([52.74, -34.83, 37.15, 57.57, 53.29, -29.81])


@cache
def paper6r() -> optik.Robot:
    return optik.load("paper6r")


def wide(robot: optik.Robot) -> optik.Robot:
    """The same arm with two turns of room on every joint."""
    room = np.full(robot.n, 4.0 * np.pi)
    return optik.Robot("wide", robot.fixed, robot.prismatic, robot.tool, optik.JointLimits(-room, room))


def pose_of(position: Any, turn: Any = (0.0, 0.0, 0.0)) -> Array:
    return moved(np.eye(4), np.asarray(position, float), np.asarray(turn, float))


number = st.floats(-1.0, 1.0, allow_subnormal=False)
vectors = st.tuples(number, number, number).map(np.array)
parts = st.floats(0.0, 1.0)


@cache
def default_line() -> Line:
    start = paper6r().fk(START)
    return Line(start, moved(start, MOVE))


@cache
def default_joint_path(ik: str = "dls", samples: int = 151) -> JointPath:
    followed = follow(make_solver(paper6r(), ik), default_line(), START, samples=samples)
    assert followed.joint_path is not None and followed.failure is None
    return followed.joint_path


def followed_line(start: Array, goal: Array) -> JointPath:
    """The joint path of a line from the default start."""
    followed = follow(make_solver(paper6r(), "dls"), Line(start, goal), START)
    assert followed.joint_path is not None and followed.failure is None
    return followed.joint_path


@cache
def random_joint_paths(count: int, seed: int = 5) -> tuple[JointPath, ...]:
    """Regular lines of the paper's arm: drawn at random, kept where the arm stays well away from singularities."""
    robot, rng, kept = paper6r(), np.random.default_rng(seed), []
    solver = make_solver(robot, "dls")
    middle, half = 0.5 * (robot.limits.lower + robot.limits.upper), 0.5 * (robot.limits.upper - robot.limits.lower)
    while len(kept) < count:
        q = middle + 0.7 * half * rng.uniform(-1.0, 1.0, 6)
        start = robot.fk(q)
        move = rng.normal(size=3)
        turn = None if len(kept) % 2 else 0.5 * rng.normal(size=3)
        goal = moved(start, move / np.linalg.norm(move) * rng.uniform(0.03, 0.35), turn)
        joint_path = follow(solver, Line(start, goal), q)
        if joint_path and joint_path.joint_path.singular_values.min() > 0.03:
            kept.append(joint_path.joint_path)
    return tuple(kept)


def step_of(joint: int, size: float, T: float) -> Trajectory:
    """One joint from rest to rest by 10u³ − 15u⁴ + 6u⁵, whose extrema are known: 15/8, 10/√3 and 60 over powers of T."""
    c = np.zeros((6, 1, 6))
    c[5, 0] = START
    c[:3, 0, joint] = size * np.array([6.0 / T**5, -15.0 / T**4, 10.0 / T**3])
    return Trajectory(PPoly(c, [0.0, T]))


def random_trajectory(rng: np.random.Generator, pieces: int = 3, n: int = 2, smooth: int = 0) -> Trajectory:
    """Random pieces that meet in so many orders: 0 for none, 2 for position and velocity, 6 for one polynomial."""
    x = np.concatenate([[0.0], np.cumsum(rng.uniform(0.05, 1.0, pieces))])
    c = rng.normal(size=(6, pieces, n)) * np.array([3.0, 2.0, 1.0, 1.0, 1.0, 1.0])[:, None, None]
    for k in range(1, pieces):
        h = x[k] - x[k - 1]
        for j in range(n):
            left = c[::-1, k - 1, j]
            for order in range(smooth):
                c[5 - order, k, j] = polynomial.polyval(h, polynomial.polyder(left, order)) / factorial(order)
    return Trajectory(PPoly(c, x))
