"""copp with torque limits: torque along the path as additional second-order rows at its stations."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np

from benchmarks.peers.laws.copp import COPP_PASSES, Copp
from optik.types import Array
from planners.following.follow import JointPath
from planners.limits import PathPoints, kind_of

TORQUE_STATIONS = 151
"""Number of equally spaced stations in s. With 601 a call takes eight times as long for motions that are 2 % shorter."""


class CoppTorque(Copp):
    """`Copp` with exact torque rows for the lightest and the heaviest payload, Coulomb friction included.

    Its rows are linear in ṡ² and s̈. Viscous friction is linear in ṡ: its row is taken as proportional to ṡ², with the
    factor that makes it exact at the speed of the previous pass.
    """

    settings = (
        f"{TORQUE_STATIONS} equal stations with exact q', q'', q''' and exact rows of torque (add_constraint_2nd), Coulomb "
        f"friction included, viscous friction exact at the speed of the pass before; topp2_ra, then {COPP_PASSES} passes of "
        "topp3_socp as of copp; no limits on the torque's rate"
    )
    enforced: ClassVar[tuple[str, ...]] = ("velocity", "acceleration", "jerk", "torque")
    stations: ClassVar[int] = TORQUE_STATIONS

    def _constrained(self, joint_path: JointPath, s: Array) -> Any:
        robot = super()._constrained(joint_path, s)
        rows = self._rows(joint_path, s)
        if rows is not None:
            _add(robot, rows, robot.constraints.amax_values())
        return robot

    def _again(self, robot: Any, joint_path: JointPath, s: Array, a: Array) -> Any:
        rows = self._rows(joint_path, s)
        if rows is None or not rows[..., 2].any():  # without viscous friction the rows stay as they are
            return robot
        robot = super()._constrained(joint_path, s)
        _add(robot, rows, a)
        return robot

    def _rows(self, joint_path: JointPath, s: Array) -> Array | None:
        """Return relative torques (k, m, 4) as coefficients of s̈, ṡ², ṡ and 1; None without torque limits."""
        bound = self._limits.get("torque")
        if bound is None or not np.isfinite(bound).any():
            return None
        return kind_of("torque").rows(PathPoints(joint_path, s), bound)


def _add(robot: Any, rows: Array, a: Array) -> None:
    """Add |relative torque| ≤ 1 as two rows each; viscous friction is exact at ṡ² (k,)."""
    speed = np.sqrt(np.maximum(a, 0.0))[:, None]
    with np.errstate(divide="ignore", invalid="ignore"):
        viscous = np.where(speed > 0.0, rows[..., 2] / speed, 0.0)
    for side in (1.0, -1.0):
        parts = (side * (rows[..., 1] + viscous), side * rows[..., 0], 1.0 - side * rows[..., 3])
        robot.constraints.add_constraint_2nd(*(np.ascontiguousarray(part) for part in parts), 0)


METHOD = CoppTorque
