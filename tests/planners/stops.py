"""Stops of simulated drives at random moments of drawn plans, judged apart from the package's own certificates."""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

import optik
from optik import Robot
from optik.types import Array
from planners import Arc, JointLine, Line, MotionLimits, Path, Plan, Polyline, certify, make_law, plan
from planners.cell import Execution, ExecutionStatus
from planners.cell.drives.ideal import IdealDrive
from tests import oracles

PAYLOADS = {"panda": 2.5, "ur5e": 4.5, "puma560": 2.0}
"""Nearly what the arms may carry [kg]: their torques then limit the motion."""
KINDS = ("panda torque", "ur5e torque", "iiwa14", "panda torque", "paper6r", "kr6", "ur5e torque", "ur5e speed", "irb120",
         "puma560 torque")  # fmt: skip
"""Arms of the plans in turn: with limits on torque, with a constant tool speed, or drawn limits."""
LAWS = ("optimal", "ruckig", "smooth")
"""Laws of the plans without limits on torque, drawn."""
SAMPLES = 4000


def limits_of(robot: Robot, torque: bool, rng: np.random.Generator) -> MotionLimits:
    """Drawn limits, within the arm's own velocities; or the arm's own, with its torques."""
    own = robot.limits
    scale = 10.0 ** rng.uniform(-0.5, 0.5, 3)
    fastest = np.full(robot.n, 2.0) if own.velocity is None else np.broadcast_to(own.velocity, robot.n)
    v, a, j = np.minimum(2.0 * scale[0], fastest), 10.0 * scale[1], 100.0 * scale[2]
    if not torque:
        return MotionLimits(v, a, j, tool_speed=float(rng.uniform(0.1, 0.5)) if rng.random() < 0.3 else None)
    return MotionLimits(fastest, None, 2000.0, torque=own.torque)


def path_of(robot: Robot, q: Array, rng: np.random.Generator) -> Path:
    low, high = np.maximum(robot.limits.lower, -3.0), np.minimum(robot.limits.upper, 3.0)

    def near(q: Array, size: float) -> Array:
        return np.clip(q + rng.normal(0.0, size, robot.n), low, high)

    kind, T = rng.integers(4), robot.fk(q)
    if kind == 0:
        poses = [q, near(q, 0.15), near(q, 0.15), near(q, 0.15)]
        return Polyline(np.array([robot.fk(x) for x in poses]), blend=0.005, blend_rotation=0.05)
    if kind == 1:
        return JointLine(robot, q, near(q, 0.4))
    if kind == 2:
        return Line(T, robot.fk(near(q, 0.2)))
    return Arc.about(T, T[:3, 3] + 0.05 * T[:3, 0], T[:3, 2], float(rng.uniform(0.5, 6.2)))


def drawn(seed: int, first: int = 0) -> Iterator[Plan]:
    """Plans that hold and promise velocity, acceleration and jerk: arms, paths, laws and limits in turn."""
    rng, k = np.random.default_rng([31, seed]), first
    while True:
        name, _, kind = KINDS[k % len(KINDS)].partition(" ")
        robot, law = optik.load(name), str(rng.choice(LAWS))
        if kind == "torque":
            robot, law = robot.with_payload(PAYLOADS[name]), "optimal"
        low, high = np.maximum(robot.limits.lower, -3.0), np.minimum(robot.limits.upper, 3.0)
        q = low + (high - low) * rng.uniform(0.3, 0.7, robot.n)
        limits, path = limits_of(robot, kind == "torque", rng), path_of(robot, q, rng)
        if kind == "speed":
            path = Line(robot.fk(q), oracles.moved(robot.fk(q), 0.15 * rng.normal(size=3)))
        timing = make_law("constant_speed", speed=0.04) if kind == "speed" else make_law(law)
        found = plan(robot, path, q, limits=limits, timing=timing)
        if found and found.trajectory.end > 0.2:
            k += 1
            yield found


class Stopped(NamedTuple):
    """One stop: what was planned, the execution, the rest of the way, largest ratios found, and what was wrong."""

    plan: Plan
    execution: Execution
    resumed: Execution | None
    ratios: dict[str, float]
    wrong: tuple[str, ...]


def ratios_of(plan: Plan, execution: Execution) -> dict[str, float]:
    """Largest values over limits and tolerances, densely sampled: both sides of every knot included."""
    motion = execution.motion
    joints, robot, tolerance = oracles.Joints(motion), plan.robot, plan.certificate.tolerance
    assert tolerance is not None
    rng = np.random.default_rng(1)
    t = np.sort(rng.uniform(0.0, motion.end, SAMPLES))
    bound, found = plan.limits.arrays(robot.n), {}
    for order, field in enumerate(("velocity", "acceleration", "jerk"), start=1):
        values = np.concatenate([np.abs(joints(t, order)), *(np.abs(x) for x in joints.ends(order))])
        found[field] = float((values / bound[field]).max())
    few = np.concatenate([t[:: SAMPLES // 400], motion.knots[1:-1:3]])
    if plan.limits.torque is not None:
        other = oracles.PinocchioDynamics(robot)
        tau = np.array([other.torques(*(joints(np.array([x]), order)[0] for order in range(3))) for x in few])
        found["torque"] = float((np.abs(tau) / plan.limits.bounds(robot.n)["torque"]).max())
    T = oracles.fk(robot, joints(few))
    whole = np.full(few.size, plan.path.end)
    near = plan.path.nearest(T)
    margin = 0.01 * whole
    s, _ = oracles.nearest(plan.path, T, np.maximum(near - margin, 0.0), np.minimum(near + margin, whole), 1.0)
    distance, angle = oracles.off_by(T, plan.path.pose(s))
    if plan.speed is not None:
        found["speed"] = float(oracles.speeds(robot, joints, few)[:, 0].max() / plan.speed / (1.0 + 1e-6))
    return found | {
        "distance": float(distance.max() / tolerance.position),
        "angle": float(angle.max() / tolerance.rotation),
    }


def contradictions(plan: Plan, execution: Execution, ratios: dict[str, float]) -> Iterator[str]:
    """What is not as it should be of an execution that was stopped."""
    motion, end = execution.motion, execution.plan.path.end
    assert motion is not None
    if execution.stop_plan is None:
        yield f"no stop: {execution.notes}"
        return
    proof = certify(
        plan.robot, plan.path, motion, plan.limits, enforced=plan.certificate.enforced,
        tolerance=plan.certificate.tolerance, span=(0.0, min(execution.stop_plan.span[1], end)),
    )  # fmt: skip
    yield from proof.reasons
    yield from (f"{name} comes to {ratio:.9g}" for name, ratio in ratios.items() if ratio > 1.0 + 1e-9)
    if np.abs(motion(motion.end, 1)).max() > 1e-9 or np.abs(execution.dq[-1]).max() > 1e-9:
        yield "does not end at rest"


def stopped(plan: Plan, at: float) -> Stopped:
    """Stop a plan on an ideal drive at some time, and resume it."""
    drive = IdealDrive(plan.robot)
    execution = drive.execute(plan, stop=at)
    if execution.stop_plan is None and execution.status is ExecutionStatus.DONE and at > plan.trajectory.end - 0.06:
        return Stopped(plan, execution, None, {}, ())  # what the drive held already reached the end
    ratios = ratios_of(plan, execution)
    wrong = list(contradictions(plan, execution, ratios))
    resumed = None
    if execution.status is ExecutionStatus.STOPPED:
        resumed = drive.resume(execution)
        if not resumed:
            wrong.append(f"does not resume: {resumed.reason}")
        elif np.abs(resumed.q[-1] - plan.trajectory(plan.trajectory.end)).max() > 1e-9:
            wrong.append(
                f"resumes to {np.abs(resumed.q[-1] - plan.trajectory(plan.trajectory.end)).max()} off the goal"
            )
    return Stopped(plan, execution, resumed, ratios, tuple(wrong))


def stops(seed: int, plans: int, each: int, first: int = 0) -> Iterator[Stopped]:
    """Stop plans at random moments."""
    rng = np.random.default_rng([32, seed])
    for _, running in zip(range(plans), drawn(seed, first), strict=False):
        for at in rng.uniform(0.0, running.trajectory.end, each):
            yield stopped(running, float(at))
