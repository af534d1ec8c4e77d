"""Arms with masses, motions and dense torques for the tests of limits on torque."""

from functools import cache
from typing import Any

import numpy as np

import optik
from optik import Robot
from optik.arm.inertia import Inertia
from optik.dynamics import torques_batch
from optik.types import Array
from planners import Trajectory
from planners.certificate.analysis import MotionAnalysis
from planners.limits.inputs import TorqueRatios
from planners.trajectory.curve import quintic_through
from tests import oracles
from tests.robots import built


def inertia(rng: np.random.Generator, n: int, *, coulomb: float = 0.0, viscous: float = 0.3) -> Inertia:
    """Bodies of links of a table arm: a few kilograms each, lighter towards the tool, of shapes that exist."""
    mass = rng.uniform(0.5, 2.0, n) * np.linspace(3.0, 0.5, n)
    points = 0.1 * rng.normal(size=(n, 4, 3))
    points -= points.mean(axis=1, keepdims=True)
    outer = np.einsum("lpi,lpj->lij", points, points) * (mass / 4.0)[:, None, None]
    tensor = np.trace(outer, axis1=1, axis2=2)[:, None, None] * np.eye(3) - outer
    com = 0.12 * rng.normal(size=(n, 3))
    return Inertia(mass, com, tensor, motor=rng.uniform(0.0, 0.3, n), viscous=viscous, coulomb=coulomb)


@cache
def loaded(name: str = "paper6r", coulomb: float = 0.0, viscous: float = 0.3) -> Robot:
    robot = optik.load(name)
    return robot.with_inertia(inertia(np.random.default_rng(3), robot.n, coulomb=coulomb, viscous=viscous))


def random_loaded(rng: np.random.Generator, n: int, *, prismatic: bool, coulomb: float = 0.0) -> Robot:
    """An arm of any joints; some of them slide."""
    arm = oracles.random_arm(rng, n, prismatic=prismatic)
    return built(arm).with_inertia(inertia(rng, n, coulomb=coulomb))


def swing(rng: np.random.Generator, n: int, pieces: int, duration: float) -> Trajectory:
    """Random quintic pieces from rest to rest that meet in q, q̇ and q̈."""
    t = np.concatenate([[0.0], np.cumsum(rng.uniform(0.5, 1.5, pieces))])
    t *= duration / t[-1]
    h = duration / pieces
    q = np.cumsum(rng.normal(size=(pieces + 1, n)) * h, axis=0)
    dq, ddq = rng.normal(size=(pieces + 1, n)), 0.5 * rng.normal(size=(pieces + 1, n)) / h
    dq[[0, -1]] = ddq[[0, -1]] = 0.0
    return Trajectory(quintic_through(t, q, dq, ddq))


def values(robot: Robot, trajectory: Trajectory, t: Array, load: Any) -> Array:
    """Torques and their rates (k, 2, n) at times, without Coulomb friction."""
    states = np.ascontiguousarray(np.stack([trajectory(t, order) for order in range(4)], axis=1))
    out = np.empty((t.size, 2, robot.n))
    torques_batch(robot.chain, load.bodies, load.viscous, states, out)
    return out


def proved(robot: Robot, trajectory: Trajectory, *, rate: bool, **options: Any) -> TorqueRatios:
    """The proof with limits of 1: its ratios are torques."""
    bound = np.stack([-np.ones(robot.n), np.ones(robot.n)])
    return MotionAnalysis(robot, trajectory).torques.bound_ratios(bound, rate=rate, **options)
