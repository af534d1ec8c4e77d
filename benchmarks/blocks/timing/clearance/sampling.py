"""Contact by sampling with coal: Pinocchio places the shapes and stops at the first pair that is too near."""

from __future__ import annotations

from typing import Any

import numpy as np

from optik.arm.robot import Robot
from optik.scene import Scene
from optik.scene.contact import BOX, PLANE, SELF, find_pairs
from optik.types import Array


class CoalSampling:
    """The shapes of an arm and a scene in Pinocchio's geometry model: the same pairs as the proof examines."""

    def __init__(self, robot: Robot, scene: Scene) -> None:
        import coal
        import pinocchio as pin

        self._pin, self._coal = pin, coal
        self._model: Any = pin.Model()
        for i in range(robot.n):
            joint = pin.JointModelPZ() if robot.prismatic[i] else pin.JointModelRZ()
            self._model.addJoint(i, joint, pin.SE3(np.array(robot.fixed[i])), robot.joint_names[i])
        self._geometry: Any = pin.GeometryModel()
        assert robot.shapes is not None
        link, a, b, radius = robot.shapes.capsules
        arm = [self._capsule(int(link[k]), a[k], b[k], float(radius[k]), f"arm {k}") for k in range(len(radius))]
        around = self._scene(scene)
        bodies = find_pairs(robot, scene).bodies
        for k, number, kind in bodies.tolist():
            other = arm[number] if kind == SELF else around[kind][number]
            self._geometry.addCollisionPair(pin.CollisionPair(arm[k], other))
        self._data, self._placed = self._model.createData(), self._geometry.createData()
        self._margins = np.where(bodies[:, 2] == SELF, 0.0, scene.margin)
        for request, least in zip(self._placed.collisionRequests, self._margins, strict=True):
            request.security_margin = float(least)

    def touches(self, q: Array) -> int:
        """Index of the first configuration with a contact."""
        pin, model, data, geometry, placed = self._pin, self._model, self._data, self._geometry, self._placed
        for k, configuration in enumerate(q):
            if pin.computeCollisions(model, data, geometry, placed, configuration, True):
                return k
        return -1

    def room(self, q: Array) -> float:
        """Least distance of all pairs at a configuration, those to the scene less the margin."""
        self._pin.computeDistances(self._model, self._data, self._geometry, self._placed, q)
        found = [result.min_distance for result in self._placed.distanceResults]
        return float(np.min(found - self._margins, initial=np.inf))

    def _add(self, joint: int, T: Array, shape: Any, name: str) -> int:
        pin = self._pin
        return int(self._geometry.addGeometryObject(pin.GeometryObject(name, joint, pin.SE3(T), shape)))

    def _capsule(self, joint: int, a: Array, b: Array, radius: float, name: str) -> int:
        T, length = np.eye(4), float(np.linalg.norm(b - a))
        T[:3, :3], T[:3, 3] = _along(b - a), 0.5 * (a + b)
        shape = self._coal.Capsule(radius, length) if length > 0.0 else self._coal.Sphere(radius)
        return self._add(joint, T, shape, name)

    def _scene(self, scene: Scene) -> dict[int, list[int]]:
        """Add the objects; their numbers by the kinds of `find_pairs`."""
        box_pose, box_half, a, b, radius, point, normal = scene.arrays
        boxes = [
            self._add(0, T, self._coal.Box(*(2.0 * half)), f"box {i}")
            for i, (T, half) in enumerate(zip(box_pose, box_half, strict=True))
        ]
        rounds = [self._capsule(0, a[i], b[i], float(radius[i]), f"round {i}") for i in range(len(radius))]
        planes = [
            self._add(0, np.eye(4), self._coal.Halfspace(n, float(n @ p)), f"plane {i}")
            for i, (p, n) in enumerate(zip(point, normal, strict=True))
        ]
        return {BOX: boxes, BOX + 1: rounds, PLANE: planes}


def _along(d: Array) -> Array:
    """A rotation whose z points along d; the identity where d is 0."""
    length = float(np.linalg.norm(d))
    if length == 0.0:
        return np.eye(3)
    z = d / length
    x = np.cross(z, (1.0, 0.0, 0.0) if abs(z[0]) < 0.9 else (0.0, 1.0, 0.0))
    x /= np.linalg.norm(x)
    return np.array([x, np.cross(z, x), z]).T
