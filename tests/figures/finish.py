"""Quiet motions on an arm with an elastic hinge behind its tool, rms torques, and stops, each against an evaluation of its own.

Cases 0 to 59: quiet motions; MuJoCo gives the inverse dynamics of the prescribed arm and of 1 kg on a hinge of 7 Hz and 1 %
damping, 250 mm behind the tool, and a Runge–Kutta step of 1 ms integrates it. 60 to 74: rms torques. 75 to 174: stopping
limits.
"""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np
import scipy

import optik
from optik.arm.mjcf_writer import to_mjcf
from optik.arm.robot import Robot
from optik.types import Array
from planners import JointLine, Line, MotionLimits, Plan, make_law, plan, replan
from tests.figures.figure import Row, Value, main

QUIET, RMS, STOPS = 60, 15, 100
FREQUENCY, MASS, LENGTH, DAMPING = 7.0, 1.0, 0.25, 0.01
INSTANTS = 50


def draw(case: int) -> tuple[Robot, Any, Array, MotionLimits]:
    rng = np.random.default_rng([case, 11])
    robot = optik.load(("ur5e", "panda")[case % 2])
    lower, upper = np.maximum(robot.limits.lower, -np.pi), np.minimum(robot.limits.upper, np.pi)
    limits = MotionLimits.of(robot, acceleration=10.0, jerk=100.0)
    while True:
        ends = lower + (upper - lower) * rng.uniform(0.1, 0.9, (2, robot.n))
        path: Any = JointLine(robot, *ends)
        if case % 4 > 1:
            goal, step = robot.fk(ends[0]).copy(), rng.normal(size=3)
            goal[:3, 3] += rng.uniform(0.3, 0.6) * step / np.linalg.norm(step)
            path = Line(robot.fk(ends[0]), goal)
        if plan(robot, path, ends[0], limits=limits):
            return robot, path, ends[0], limits


class Hinge:
    """1 kg on an elastic hinge behind the tool of an arm whose joints are prescribed."""

    def __init__(self, robot: Robot) -> None:
        spec = mujoco.MjSpec.from_string(to_mjcf(robot))
        site = next(site for site in spec.sites if site.name == "tool")
        body = site.parent.add_body(name="swing", pos=site.pos, quat=site.quat)
        body.add_joint(name="hinge", type=mujoco.mjtJoint.mjJNT_HINGE, axis=[1, 0, 0])
        body.mass, body.ipos, body.inertia, body.explicitinertial = MASS, [0, 0, LENGTH], [1e-4] * 3, True
        self.model = spec.compile()
        self.data = mujoco.MjData(self.model)
        self.model.dof_damping[:] = 0.0
        self.model.dof_frictionloss[:] = 0.0
        self.at = int(self.model.joint("hinge").dofadr[0])
        self.arm = [i for i in range(self.model.nv) if i != self.at]
        self.inertia = MASS * LENGTH**2 + 1e-4
        self.stiffness = self.inertia * (2.0 * np.pi * FREQUENCY) ** 2

    def accelerate(self, state: tuple[Array, Array, Array], angle: float, rate: float) -> float:
        for store, arm, own in zip(
            (self.data.qpos, self.data.qvel, self.data.qacc), state, (angle, rate, 0.0), strict=True
        ):
            store[self.arm], store[self.at] = arm, own
        mujoco.mj_inverse(self.model, self.data)
        damping = 2.0 * DAMPING * np.sqrt(self.stiffness * self.inertia)
        return float((-self.stiffness * angle - damping * rate - self.data.qfrc_inverse[self.at]) / self.inertia)

    def rest(self, q: Array) -> float:
        angle = 0.0
        for _ in range(60):
            angle += 0.9 * self.accelerate((q, 0.0 * q, 0.0 * q), angle, 0.0) * self.inertia / self.stiffness
        return angle

    def swing(self, found: Plan, after: float = 1.0, h: float = 1e-3) -> tuple[float, float]:
        """Return the residual amplitude after a motion, and the largest swing during it [rad]."""
        own, end = scipy.interpolate.PPoly(found.trajectory.coefficients, found.trajectory.knots), found.duration

        def state(t: float) -> tuple[Array, Array, Array]:
            if t >= end:
                q = own(end)
                return q, 0.0 * q, 0.0 * q
            return own(t), own(t, 1), own(t, 2)

        y, out = np.array([self.rest(own(0.0)), 0.0]), []
        for t in np.arange(0.0, end + after, h):
            begin, middle, last = state(t), state(t + h / 2), state(t + h)

            def rate(at: tuple[Array, Array, Array], x: Array) -> Array:
                return np.array([x[1], self.accelerate(at, x[0], x[1])])

            k1 = rate(begin, y)
            k2 = rate(middle, y + h / 2 * k1)
            k3 = rate(middle, y + h / 2 * k2)
            k4 = rate(last, y + h * k3)
            y = y + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
            out.append((t + h, y[0]))
        t, angle = np.array(out).T
        late = t > end
        return float(np.abs(angle[late] - self.rest(own(end))).max()), float(np.abs(angle[~late]).max())


def measure(case: int) -> Row:
    if case < QUIET:
        robot, path, q, limits = draw(case)
        usual, hinge = plan(robot, path, q, limits=limits), Hinge(robot)
        before, largest = hinge.swing(usual)
        row: Row = {"kind": "quiet", "usual": before / largest}
        for name, f in (("at", 7.0), ("beside", 7.0 / 1.05)):
            found = plan(robot, path, q, limits=limits, timing=make_law("optimal", quiet=f))
            row[f"{name}_ok"] = bool(found)
            row[name] = hinge.swing(found)[0] / largest if found else None
            row[f"{name}_over"] = found.duration / usual.duration if found else None
        return row
    if case < QUIET + RMS:
        robot, path, q, limits = draw(case)
        free = plan(robot, path, q, limits=limits)
        usual, still = rms(free), rms(free.stretched(50.0))
        most = np.where(usual > still, still + 0.75 * (usual - still), 1e3)
        found = free.slowed_to(rms_torque=most)
        return {"kind": "rms", "ratio": float((rms(found) / most).max()), "over": found.duration / free.duration}
    robot, path, q, limits = draw(case)
    free, rng = plan(robot, path, q, limits=limits), np.random.default_rng([case, 12])
    longest, row = free.stopping, {"kind": "stops"}
    for name, most in (("time", 0.7 * longest.time.max()), ("distance", 0.7 * longest.distance.max())):
        found = free.slowed_to(**{f"stopping_{name}": float(most)})
        stops = [
            replan(found, float(t), stop=True, time_limit=0.0)
            for t in rng.uniform(1e-3, 0.995 * found.duration, INSTANTS)
        ]
        each = [x.duration if name == "time" else x.span[1] - x.span[0] for x in stops]
        row |= {
            f"{name}_over": found.duration / free.duration,
            f"{name}_worst": max(each) / most,
            f"{name}_ok": all(map(bool, stops)),
        }
    return row


def rms(found: Plan) -> Array:
    """Root mean square of the torques over a motion, by Simpson's rule."""
    t = np.linspace(0.0, found.duration, 40_001)
    own = scipy.interpolate.PPoly(found.trajectory.coefficients, found.trajectory.knots)
    tau = found.robot.torques(own(t), own(t, 1), own(t, 2))
    return np.sqrt(scipy.integrate.simpson(tau**2, x=t, axis=0) / found.duration)


def judge(rows: list[Row]) -> list[Value]:
    values = []
    if quiet := [row for row in rows if row["kind"] == "quiet"]:
        ok = [row for row in quiet if row["at_ok"]]
        over, left = [row["at_over"] for row in ok], np.percentile([row["at"] for row in ok], 95)
        beside = np.percentile([row["beside"] for row in ok if row["beside_ok"]], 95)
        usual = np.percentile([row["usual"] for row in quiet], 95)
        words = f"{left:.3f}; {beside:.3f} for a hinge 5 % off, {usual:.3f} unshaped"
        values += [
            Value("quiet motions certified", "all", f"{len(ok)} of {len(quiet)}", len(ok) == len(quiet)),
            Value("residual over the largest unshaped swing, 95 % point", "≤ 0.05", words, left <= 0.05),
            Value(
                "duration, median and 95 % point",
                "≤ 1.07, ≤ 1.25",
                f"{np.median(over):.3f}, {np.percentile(over, 95):.3f}",
                np.median(over) <= 1.07 and np.percentile(over, 95) <= 1.25,
            ),
        ]
    if found := [row for row in rows if row["kind"] == "rms"]:
        low, high = min(row["ratio"] for row in found), max(row["ratio"] for row in found)
        values.append(
            Value(
                "rms torque of the joint that binds",
                "0.999 to 1.000",
                f"{low:.6f} to {high:.6f}",
                low >= 0.999 and high <= 1.0 + 1e-6,
            )
        )
    if stops := [row for row in rows if row["kind"] == "stops"]:
        for name, asked in (("time", 1.35), ("distance", 1.15)):
            worst, over = (
                max(row[f"{name}_worst"] for row in stops),
                float(np.median([row[f"{name}_over"] for row in stops])),
            )
            values.append(
                Value(
                    f"stopping {name}: largest over the limit, {INSTANTS} instants each",
                    "≤ 1",
                    f"{worst:.4f} of {len(stops)}",
                    worst <= 1.0 and all(row[f"{name}_ok"] for row in stops),
                )
            )
            values.append(Value(f"stopping {name}: duration, median", f"≤ {asked}", f"{over:.3f}", over <= asked))
    return values


if __name__ == "__main__":
    main("finish", measure, QUIET + RMS + STOPS, judge)
