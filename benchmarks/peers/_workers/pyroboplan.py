"""The method that `serve.py` serves for pyroboplan: its search with shortcuts, and its trapezoids from vertex to vertex."""

from time import process_time_ns
from typing import Any

OPTIONS = {
    "bidirectional_rrt": True, "rrt_star": True, "max_connection_dist": 5.0, "max_rewire_dist": 5.0,
    "goal_biasing_probability": 0.15, "rng_seed": 1,
}  # fmt: skip
"""Settings of its example optimize_rrt_path.py; the others are its defaults. On ten problems its searches took 0.03 s (median);
with `rrt_connect` and 0.5 rad, as in rrt_panda.py, 0.06 to 2.5 s, and without goal bias 5 of ten found none in 10 s."""
SHORTCUT_STEP, SHORTCUTS = 0.05, 100
"""Largest joint motion between examined configurations of a shortcut [rad, m], and number of shortcuts: its defaults."""
PADDING = 0.002
"""Distance from everything [m], if both ends have it: without it 2 of ten motions were in contact between samples, and with
4 mm 7 of ten paths were found."""


class _Method:
    """The arm's capsules and the objects as Pinocchio's collision model, which is built before the timed call."""

    def __init__(self, model: dict[str, Any]) -> None:
        import coal
        import numpy as np
        import pinocchio
        from pyroboplan.planning import path_shortcutting, rrt, utils
        from pyroboplan.trajectory.trapezoidal_velocity import TrapezoidalVelocityTrajectory

        self.np, self.pin, self.coal, self.given, self.frames = np, pinocchio, coal, model, [0]
        self.rrt, self.shorten, self.utils = rrt, path_shortcutting.shortcut_path, utils
        self.trapezoids, self.limits = TrapezoidalVelocityTrajectory, [np.array(each) for each in model["limits"]]
        self.arm, free = pinocchio.Model(), np.array([np.inf])
        for fixed, slides, name, *limits in model["joints"]:
            kind = pinocchio.JointModelPZ() if slides else pinocchio.JointModelRZ()
            at, (lower, upper) = pinocchio.SE3(np.array(fixed)), np.array(limits)[:, None]
            joint = self.arm.addJoint(self.arm.njoints - 1, kind, at, name, free, free, lower, upper)
            self.frames.append(self.arm.addJointFrame(joint, self.frames[-1]))

    def prepared(self, scene: dict[str, Any], ends: list[Any]) -> tuple[Any, ...]:
        """Return the arguments of `call`: the collision model of the arm in a scene, and both ends."""
        pin, shapes = self.pin, self.pin.GeometryModel()
        for i, (link, kind, sizes, T) in enumerate([*self.given["shapes"], *scene["objects"]]):
            at, solid = pin.SE3(self.np.array(T)), getattr(self.coal, kind)(*sizes)
            shapes.addGeometryObject(pin.GeometryObject(f"shape{i}", link, self.frames[link], at, solid))
        for pair in [*self.given["pairs"], *scene["pairs"]]:
            shapes.addCollisionPair(pin.CollisionPair(*pair))
        return shapes, *self.np.array(ends)

    def call(self, shapes: Any, start: Any, goal: Any) -> Any:
        """Search, shorten and time a path; the timed call."""
        begin, check = process_time_ns(), self.utils.check_collisions_along_path
        room = 0.0 if check(self.arm, shapes, [start, goal], distance_padding=PADDING) else PADDING
        options = self.rrt.RRTPlannerOptions(collision_distance_padding=room, **OPTIONS)
        path = self.rrt.RRTPlanner(self.arm, shapes, options).plan(start, goal) or []
        for _ in range(
            SHORTCUTS
        ):  # one by one, each examined: `shortcut_path` of 1.3.1 drops the first point of a shortcut
            tried = self.shorten(self.arm, shapes, list(path), 1, SHORTCUT_STEP)
            between = self.utils.discretize_joint_space_path(tried, SHORTCUT_STEP)
            if not self.np.array_equal(tried, path) and not check(self.arm, shapes, between, distance_padding=room):
                path = tried
        ns = process_time_ns() - begin
        return path, ns, self.trapezoids(self.np.array(path).T, *self.limits).single_dof_trajectories if path else []

    def answer(self, raw: Any) -> dict[str, Any]:
        """Return the vertices of the path, the time of its search [ns], and the polynomials of the motion."""
        path, ns, each = raw
        found = {
            name: [getattr(one, name) for one in each] for name in ("times", "positions", "velocities", "accelerations")
        }
        return {"path": [list(q) for q in path], "search_ns": ns} | found


METHOD = _Method
