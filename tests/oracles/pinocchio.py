"""Another library's kinematics of the same tables, which it reads as URDF, and its dynamics of the same bodies."""

from typing import Any

import numpy as np

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


class PinocchioDynamics:
    """Another library's dynamics of a robot, built body by body from the robot's data; friction is a formula."""

    def __init__(self, robot: Any) -> None:
        import pinocchio as pin

        self._pin, self.robot = pin, robot
        self.model = model = pin.Model()
        last = 0
        for i in range(robot.n):
            kind = pin.JointModelPZ() if robot.prismatic[i] else pin.JointModelRZ()
            place = pin.SE3(robot.fixed[i])
            last = model.addJoint(last, kind, place, f"j{i}")
            arm = robot.inertia
            model.appendBodyToJoint(last, pin.Inertia(arm.mass[i], arm.com[i], arm.tensor[i]), pin.SE3.Identity())
        model.armature = robot.inertia.motor.copy()
        model.gravity.linear = robot.gravity_magnitude * robot.gravity
        if robot.payload is not None:
            load = robot.payload
            model.appendBodyToJoint(last, pin.Inertia(load.mass, load.com, load.inertia), pin.SE3(robot.tool))
        self._data = model.createData()

    def torques(self, q: Array, dq: Array, ddq: Array) -> Array:
        rigid = self._pin.rnea(self.model, self._data, q, dq, ddq)
        return rigid + self.robot.inertia.viscous * dq + self.robot.inertia.coulomb * np.sign(dq)

    def rates(self, q: Array, dq: Array, ddq: Array, dddq: Array) -> Array:
        """Change of the torques in time, without Coulomb friction."""
        by_q, by_dq, _ = self._pin.computeRNEADerivatives(self.model, self._data, q, dq, ddq)
        rigid = by_q @ dq + by_dq @ ddq
        return rigid + self.mass_matrix(q) @ dddq + self.robot.inertia.viscous * ddq

    def gravity(self, q: Array) -> Array:
        return self._pin.computeGeneralizedGravity(self.model, self._data, q).copy()

    def mass_matrix(self, q: Array) -> Array:
        M = np.triu(self._pin.crba(self.model, self._data, q))
        return M + np.triu(M, 1).T
