"""Another library's kinematics of the same tables, which it reads as URDF."""

from __future__ import annotations

from typing import Any

from tests.oracles.arms import Arm

Array = Any


def urdf(arm: Arm) -> str:
    """The table as URDF text. Each row is its moving joint and one fixed joint, so no angles need be combined."""
    lines = ['<robot name="table">', '  <link name="link0"/>']
    before = "link0"
    for i, r in enumerate(arm.rows):
        kind = "prismatic" if r.prismatic else "revolute"
        limit = '<axis xyz="0 0 1"/><limit lower="-7" upper="7" effort="1" velocity="1"/>'
        moving = (f"joint{i + 1}", kind, f"0 0 {r.d!r}", f"0 0 {r.theta!r}", limit)
        fixed = (f"link{i + 1}_offset", "fixed", f"{r.a!r} 0 0", f"{r.alpha!r} 0 0", "")
        for name, type_, xyz, rpy, rest in (fixed, moving) if arm.convention == "mdh" else (moving, fixed):
            after = f"after_{name}"
            lines.append(f'  <link name="{after}"/>')
            lines.append(
                f'  <joint name="{name}" type="{type_}"><parent link="{before}"/><child link="{after}"/>'
                f'<origin xyz="{xyz}" rpy="{rpy}"/>{rest}</joint>'
            )
            before = after
    lines += [
        '  <link name="tool"/>',
        f'  <joint name="flange" type="fixed"><parent link="{before}"/><child link="tool"/></joint>',
        "</robot>",
    ]
    return "\n".join(lines)


class Pinocchio:
    """Another library's kinematics of the same table."""

    def __init__(self, arm: Arm) -> None:
        import pinocchio

        self._pin = pinocchio
        self._model = pinocchio.buildModelFromXML(urdf(arm))
        self._data = self._model.createData()
        self._tool = self._model.getFrameId("tool")

    def fk(self, q: Array) -> Array:
        self._pin.framesForwardKinematics(self._model, self._data, q)
        return self._data.oMf[self._tool].homogeneous.copy()

    def jacobian(self, q: Array) -> Array:
        """Rows (v, ω) at the tool point along the base's axes."""
        axes = self._pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
        return self._pin.computeFrameJacobian(self._model, self._data, q, self._tool, axes).copy().reshape(6, -1)
