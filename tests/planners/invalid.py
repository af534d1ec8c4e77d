"""Random motions that violate one thing, confirmed by dense sampling: what must not be written or executed by itself."""

from dataclasses import replace
from functools import cache
from typing import Any, NamedTuple

import numpy as np

import planners
from optik import Scene
from optik.arm.robot import Robot
from optik.types import Array
from planners import JointLine, Line, MotionLimits, Plan
from planners.trajectory import simulate_controller
from tests.planners.contacts import REST, panda

KINDS = ("contact", "path", "limits", "coverage")
LIMITS = MotionLimits(2.0, 8.0, 80.0)
SAMPLES = 4001


class Invalid(NamedTuple):
    """A plan with a motion, the word of its only violation, and by how much a sampled instant shows it (above 1)."""

    plan: Plan
    word: str
    found: float


def invalid(kind: str, case: int) -> Invalid:
    rng = np.random.default_rng([21, KINDS.index(kind), case])
    return {"contact": touching, "path": off_path, "limits": too_fast, "coverage": partial}[kind](rng)


def ends(rng: np.random.Generator) -> tuple[Array, Array]:
    start = REST + rng.uniform(-0.3, 0.3, 7)
    return start, start + 10.0 ** rng.uniform(-1.0, 0.0) * rng.uniform(-0.6, 0.6, 7)


def planned(rng: np.random.Generator, **options: Any) -> Plan:
    start, goal = ends(rng)
    timing = str(rng.choice(["optimal", "ruckig", "smooth"]))
    plan = planners.plan(panda(), goal, start, **({"limits": LIMITS, "timing": timing} | options))
    assert plan.has_motion, plan.failure
    return plan


def instants(plan: Plan) -> Array:
    return np.linspace(0.0, plan.trajectory.end, SAMPLES)


# ---------------------------------------------------------------- contact
@cache
def capsules() -> tuple[Array, Array, Array, Array]:
    shapes = panda().shapes
    return shapes.capsules


def to_point(robot: Robot, q: Array, point: Array) -> Array:
    """Distances (k,) of the moving capsules to a point, by plain geometry."""
    link, a, b, radius = capsules()
    poses = np.concatenate([np.broadcast_to(np.eye(4), (len(q), 1, 4, 4)), robot.frames(q)[:, :-1]], axis=1)[:, link]
    first, last = (np.einsum("kmij,mj->kmi", poses[..., :3, :3], x) + poses[..., :3, 3] for x in (a, b))
    along = last - first
    share = np.einsum("kmi,kmi->km", point - first, along) / np.maximum(np.einsum("kmi,kmi->km", along, along), 1e-30)
    nearest = first + np.clip(share, 0.0, 1.0)[..., None] * along
    away = np.linalg.norm(nearest - point, axis=2) - radius
    return np.asarray(away[:, link > 0].min(axis=1))


def touching(rng: np.random.Generator) -> Invalid:
    """A sphere near the hand on the way: the arm enters it, or only its margin."""
    plan = planned(rng)
    t = rng.uniform(0.0, plan.trajectory.end)
    point = panda().fk(plan.trajectory(t))[:3, 3] + rng.uniform(-0.1, 0.1, 3)
    least = float(to_point(panda(), plan.trajectory(instants(plan)), point).min())
    if least < 0.02:  # the arm enters a sphere that is larger than the distance
        margin, radius = 0.0, max(least, 0.0) + rng.uniform(0.001, 0.03)
    else:
        radius = rng.uniform(0.1, 0.9) * least
        margin = (least - radius) * rng.uniform(1.02, 2.0)
    plan = replace(plan, scene=Scene(spheres=[(point, radius)], margin=margin))
    return Invalid(plan, "contact", 1.0 + (margin - (least - radius)))


def interpolated_contact(rng: np.random.Generator, rate: float = 20.0) -> Plan | None:
    """A valid plan beside a sphere which the arm touches once a controller draws lines at this rate; None if none fits."""
    start, _ = ends(rng)
    goal = panda().fk(start)
    goal[:3, 3] += rng.uniform(-0.3, 0.3, 3)
    plan = planners.plan(panda(), goal, start, limits=LIMITS, tolerance=(0.05, 0.5))
    if not plan:
        return None
    lines = simulate_controller(plan.trajectory, rate, "linear")
    t = instants(plan)[::10]
    frames = panda().frames(plan.trajectory(t))[:, 6, :3, 3]
    true, drawn = plan.trajectory(t), lines(t)
    for _ in range(60):
        way = rng.normal(size=3)
        point = frames[rng.integers(t.size)] + rng.uniform(0.05, 0.3) * way / np.linalg.norm(way)
        free, hit = (float(to_point(panda(), q, point).min()) for q in (true, drawn))
        if hit > 0.005 and free - hit > 1e-4:
            scene = Scene(spheres=[(point, 0.5 * (free + hit))])
            proof = replace(plan, scene=scene).motion.certify()
            return replace(plan, scene=scene, _certificate=proof) if proof.is_valid else None
    return None


# ---------------------------------------------------------------- path, limits, coverage
def off_path(rng: np.random.Generator) -> Invalid:
    """A motion straight in joint space, beside the straight line of the tool that it should follow."""
    plan = planned(rng)
    assert isinstance(plan.path, JointLine)
    line = Line(plan.path.pose(0.0), plan.path.pose(plan.path.end))
    poses = panda().fk(plan.trajectory(instants(plan)))
    along = (line.goal - line.start)[:3, 3]
    along = along / np.linalg.norm(along)
    off = poses[:, :3, 3] - line.start[:3, 3]
    away = float(np.linalg.norm(off - np.outer(off @ along, along), axis=1).max())
    return Invalid(replace(plan, path=line), "path", away / plan.certificate.tolerance.position)


def too_fast(rng: np.random.Generator) -> Invalid:
    """A motion beyond a limit: changed after planning, or given and not enforced by the law."""
    if rng.random() < 0.3:
        plan = planned(rng, timing="toppra")
        steps = np.abs(np.diff(plan.trajectory(instants(plan), 2), axis=0)).max()
        return Invalid(plan, "jerk", float(steps * SAMPLES / plan.trajectory.end / 80.0))
    plan = planned(rng)
    order = int(rng.integers(1, 4))
    largest = np.abs(plan.trajectory(instants(plan), order)).max(axis=0)
    bound = np.full(7, 1e3 * largest.max())
    joint = int(largest.argmax())
    bound[joint] = largest[joint] / rng.uniform(1.001, 3.0)
    name = ("velocity", "acceleration", "jerk")[order - 1]
    word = "jerk" if name == "jerk" else "limits"
    return Invalid(replace(plan, limits=replace(LIMITS, **{name: bound})), word, float(largest[joint] / bound[joint]))


def partial(rng: np.random.Generator) -> Invalid:
    """A motion to a place before the end of its path, or from a place after its begin."""
    start, goal = ends(rng)
    a, b = (0.0, rng.uniform(0.1, 0.99)) if rng.random() < 0.5 else (rng.uniform(0.01, 0.9), 1.0)
    whole, part = (
        planners.plan(panda(), start + y * (goal - start), start + x * (goal - start), limits=LIMITS)
        for x, y in ((0.0, 1.0), (a, b))
    )
    made = replace(whole, _trajectory=part.trajectory)
    missing = np.abs(part.trajectory(np.array([0.0, part.trajectory.end])) - np.array([start, goal])).max()
    return Invalid(made, "coverage", 1.0 + float(missing))
