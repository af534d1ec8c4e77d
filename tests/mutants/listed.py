"""Which files are changed, which tests must notice, changes that once went unnoticed, and changes that nothing can notice.

Files may be renamed: bring `TESTS` and `LISTED` up to date, and a stale entry says so.
"""

from __future__ import annotations

SEED, COUNT = 20251121, 80
"""Of the changes that are drawn: 80 in all, of every file in `DRAWN` the same number."""

PATHS = ("tests/planners/test_path_line.py", "tests/planners/test_path_arc.py", "tests/planners/test_path_polyline.py")
CERTIFICATE = (
    "tests/planners/test_bounds.py",
    "tests/planners/test_promises.py",
    "tests/planners/test_certificate.py",
    "tests/planners/test_coverage.py",
    "tests/planners/test_progress.py",
    "tests/contract/test_plans.py",
)
FOLLOW = (
    "tests/planners/test_branches.py",
    "tests/planners/test_follow.py",
    "tests/planners/test_edges.py",
    "tests/planners/test_singular.py",
    "tests/planners/test_follow_polyline.py",
    "tests/planners/test_redundancy.py",
    "tests/contract/test_plans.py",
)
KINEMATICS = (
    "tests/optik/test_kinematics.py",
    "tests/optik/test_robot.py",
    "tests/optik/test_linear.py",
    "tests/optik/test_nearest.py",
    "tests/planners/test_branches.py",
    "tests/planners/test_follow.py",
)
JUDGE = (
    "tests/optik/test_task.py",
    "tests/optik/test_ik_base.py",
    "tests/optik/test_ik_dls.py",
    "tests/contract/test_ik_methods.py",
)
TORQUE = (
    "tests/planners/test_torque.py",
    "tests/planners/test_torque_limits.py",
    "tests/planners/test_optimal_torque.py",
)
CONTACT = ("tests/planners/test_clearance.py", "tests/optik/test_distance.py")
LIMITS = "tests/planners/test_motion_limits.py"
SIDES = "tests/planners/test_limit_sides.py"
SEGMENTS = "tests/planners/test_segment_speeds.py"
FILES = (
    "tests/contract/test_file_formats.py",
    "tests/planners/test_export.py",
    "tests/planners/test_export_ros.py",
)
LAWS = ("tests/planners/test_optimal.py", "tests/planners/test_laws.py", "tests/contract/test_time_laws.py")

TESTS: dict[str, tuple[str, ...]] = {
    "planners/certificate/certificate.py": CERTIFICATE,
    "planners/certificate/_clearance.py": CONTACT,
    "planners/certificate/clearance.py": CONTACT,
    "optik/arm/shapes/contact.py": CONTACT,
    "optik/distance.py": CONTACT[::-1],
    "planners/certificate/continuity.py": CERTIFICATE[1:],
    "planners/certificate/coverage.py": (CERTIFICATE[3], *CERTIFICATE[1:3]),
    "planners/certificate/path_error.py": CERTIFICATE,
    "planners/certificate/path_bounds.py": CERTIFICATE,
    "planners/certificate/dividing.py": CERTIFICATE,
    "planners/certificate/nearest.py": (CERTIFICATE[4], *CERTIFICATE[1:4], CERTIFICATE[5]),
    "planners/certificate/active.py": CERTIFICATE[1:],
    "planners/certificate/singularity.py": CERTIFICATE[1:],
    "planners/limits/base.py": (LIMITS, *CERTIFICATE),
    "planners/limits/_derivative.py": (LIMITS, *CERTIFICATE),
    "planners/limits/_tool.py": (LIMITS, *CERTIFICATE),
    "planners/limits/_sides.py": (SIDES,),
    "planners/limits/_segments.py": (SEGMENTS,),
    "planners/certificate/segment_speed.py": (SEGMENTS,),
    "planners/limits/_motion_limits.py": (LIMITS, "tests/planners/test_plan.py"),
    "planners/curve.py": (LIMITS, *LAWS[::-1]),
    "planners/fit.py": (LIMITS, *LAWS[::-1]),
    "planners/certificate/bounds.py": CERTIFICATE,
    "planners/certificate/progress.py": (CERTIFICATE[4], *CERTIFICATE[1:4], CERTIFICATE[5]),
    "planners/certificate/tool_speed.py": CERTIFICATE,
    "planners/extrema.py": ("tests/planners/test_trajectory.py", *CERTIFICATE),
    "planners/trajectory.py": ("tests/planners/test_trajectory.py", *CERTIFICATE),
    "planners/following/follow.py": FOLLOW,
    "planners/following/track.py": FOLLOW,
    "planners/following/march.py": FOLLOW,
    "planners/following/course.py": FOLLOW,
    "planners/following/singular.py": FOLLOW,
    "planners/following/joint_path.py": FOLLOW,
    "optik/task.py": JUDGE,
    "optik/ik/base.py": JUDGE,
    "optik/kinematics.py": KINEMATICS,
    "optik/newton.py": KINEMATICS,
    "optik/se3.py": ("tests/optik/test_se3.py", *KINEMATICS[:2], *PATHS),
    "planners/files/base.py": FILES,
    "planners/files/json.py": FILES,
    "planners/files/csv.py": FILES,
    "planners/files/npz.py": FILES,
    "planners/files/_ros/export.py": FILES[::-1],
    "planners/files/_ros/pace.py": FILES[::-1],
    "planners/files/_ros/message.py": FILES[::-1],
    "optik/dynamics.py": ("tests/optik/test_dynamics.py", *TORQUE[1:]),
    "planners/limits/_torque_rows.py": TORQUE[1:],
    "planners/certificate/torque.py": TORQUE,
    "planners/certificate/torque_bounds.py": TORQUE,
    "planners/certificate/torque_slowing.py": TORQUE,
    "planners/timing/_optimal/limited.py": TORQUE[::-1],
    "planners/timing/_optimal/newton.py": LAWS,
    "planners/timing/_optimal/iteration.py": LAWS,
    "planners/timing/base.py": LAWS[::-1],
    "benchmarks/records/folder.py": ("tests/benchmarks/test_run.py", "tests/benchmarks/test_suite.py"),
}
"""The tests that are run for a change of each file, those that find most first."""

DRAWN = (
    "planners/certificate/certificate.py",
    "planners/certificate/continuity.py",
    "planners/certificate/coverage.py",
    "planners/certificate/path_error.py",
    "planners/certificate/path_bounds.py",
    "planners/certificate/dividing.py",
    "planners/certificate/nearest.py",
    "planners/certificate/bounds.py",
    "planners/certificate/progress.py",
    "planners/certificate/tool_speed.py",
    "planners/certificate/_clearance.py",
    "optik/distance.py",
    "planners/limits/base.py",
    "planners/limits/_derivative.py",
    "planners/limits/_tool.py",
    "planners/extrema.py",
    "planners/following/follow.py",
    "planners/following/track.py",
    "planners/following/march.py",
    "planners/following/course.py",
    "planners/following/singular.py",
    "optik/task.py",
    "optik/ik/base.py",
    "optik/kinematics.py",
    "optik/newton.py",
    "optik/se3.py",
    "planners/files/base.py",
    "planners/files/json.py",
    "planners/files/csv.py",
    "planners/files/npz.py",
    "planners/files/_ros/export.py",
    "planners/files/_ros/pace.py",
    "planners/files/_ros/message.py",
)
"""Certificate, its bounds, extrema, following, the judge, kinematics, poses, motion files and ROS."""

LISTED: tuple[tuple[str, str, str], ...] = (
    ("planners/certificate/bounds.py", "fourth * h**4 / 384.0)", "fourth * h**4 / 3840.0)"),
    ("planners/certificate/path_bounds.py", "6.0 * a[2] * b[2]", "3.0 * a[2] * b[2]"),
    ("planners/certificate/path_bounds.py", "float(np.sqrt(3.0) * fourth)", "float(fourth)"),
    ("planners/certificate/path_bounds.py", "max(abs(v0), abs(v1)) + j * h * h / 8.0", "max(abs(v0), abs(v1))"),
    ("planners/certificate/path_bounds.py", "3.0 * b2 * v * a", "b2 * v * a"),
    ("planners/certificate/certificate.py", "RATIO_ROUNDING = 1e-12", "RATIO_ROUNDING = 1e-4"),
    (
        "planners/limits/_derivative.py",
        "for order in range(self.order):",
        "for order in range(self.order - 1, self.order):",
    ),
    ("planners/limits/_tool.py", "np.maximum(*speeds)", "np.minimum(*speeds)"),
    ("optik/dynamics.py", "dp + 2.0 * c, dc, dg", "dp + c, dc, dg"),
    ("planners/timing/_optimal/limited.py", "load.coulomb * np.where(forth, 1.0, -1.0)", "load.coulomb * forth"),
    ("planners/timing/_optimal/limited.py", "back[:-1] | back[1:]", "back[:-1] & back[1:]"),
    ("planners/timing/_optimal/newton.py", "+ 2.0 * y) * v", "+ y) * v"),
    ("planners/limits/_sides.py", "out[..., 3] -= 0.5", "out[..., 3] += 0.5"),
    ("planners/limits/_segments.py", "return np.minimum(pieces", "return np.maximum(pieces"),
    ("planners/certificate/segment_speed.py", "on_pieces[crossed + 1]", "on_pieces[crossed]"),
    ("planners/certificate/segment_speed.py", "last[k] + 1].min()", "last[k] + 1].max()"),
    ("planners/certificate/singularity.py", "GRID_WIDTH = 1e-4", "GRID_WIDTH = 1e-1"),
    ("planners/following/follow.py", "np.abs(x[0] - tracked).max() <= 1e-6", "np.abs(x[0] - tracked).max() <= 0.1"),
    (
        "planners/following/follow.py",
        "FollowStatus.OUTSIDE_LIMITS if result.status is IKStatus.OUTSIDE_LIMITS else FollowStatus.UNREACHABLE",
        "FollowStatus.UNREACHABLE",
    ),
    ("planners/timing/_optimal/newton.py", "TERMINAL = 1e4", "TERMINAL = 1e-1"),
    ("planners/timing/_optimal/iteration.py", "if product < 1e-150 or product > 1e150:", "if product > 1e150:"),
    ("planners/curve.py", "(1.0, 3.0, 1.0))", "(1.0, 2.0, 1.0))"),
    ("optik/task.py", "c = 1.0 / 12.0 if", "c = 1.0 / 6.0 if"),
)
"""Changes that every test once let pass: file, text, and what stands there instead; a text is in its file exactly once."""

EQUIVALENT: dict[tuple[str, str, str], str] = {
    (
        "planners/certificate/dividing.py",
        "loose[k] = loose[k] and number <= room",
        "loose[k] = loose[k] and number < room",
    ): "one interval more or fewer of 200,000: the bound is proved with either",
    (
        "planners/certificate/singularity.py",
        "GRID_INSTANTS, FINER_INSTANTS = 121, 9",
        "GRID_INSTANTS, FINER_INSTANTS = 121, 8",
    ): "eight places or nine around the least: the least of them is the same to 1e-8",
    (
        "planners/certificate/bounds.py",
        "for i in range(1, 6):",
        "for i in range(0, 6):",
    ): "a bound on the position itself is asked for by nobody",
    (
        "planners/extrema.py",
        "if not (low < after < high):",
        "if not (low <= after < high):",
    ): "a Newton step to the very end of the bracket ends there, or is halved from there",
    (
        "planners/following/track.py",
        "if np.abs(right.q - left.q).max() > march.LARGEST_STEP:",
        "if np.abs(right.q - left.q).max() >= march.LARGEST_STEP:",
    ): "a step of exactly the largest length is divided",
    (
        "planners/following/course.py",
        "may = s[i + 1] - s[last] <= least",
        "may = s[i + 1] - s[last] < least",
    ): "of places exactly as far apart as may be, one more is kept",
    (
        "planners/following/course.py",
        "if parts.max() > 1:",
        "if parts.max() >= 1:",
    ): "to divide into one part each changes nothing",
    (
        "optik/task.py",
        "e[i] -= side if e[i] > 0.0 else -side",
        "e[i] -= side if e[i] >= 0.0 else -side",
    ): "an error of exactly 0 is inside its box and not changed here",
    (
        "planners/files/_ros/pace.py",
        "if motion.speed is not None and needed > 1.0 + SAME_SPEED:",
        "if motion.speed is not None and needed >= 1.0 + SAME_SPEED:",
    ): "a slow-down of exactly the share that counts as none",
}
"""Changes that no test can notice, each with why."""
