"""A stand-in for rclpy and ROS's messages, with a controller that is where it was sent at once."""

import sys
import time
from types import ModuleType, SimpleNamespace
from typing import Any

import pytest

import planners


class Future:
    """A future of rclpy that is done."""

    def __init__(self, value: Any) -> None:
        self.value = value

    def result(self) -> Any:
        return self.value

    def add_done_callback(self, told: Any) -> None:
        told(self)


def message(**fields: Any) -> Any:
    """A class of messages whose objects have these fields; each is made anew."""
    return lambda: SimpleNamespace(**{name: make() for name, make in fields.items()})


class Rclpy:
    """The part of rclpy and of ROS's messages that the transport uses, with a controller that is where it was sent at once."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, plan: planners.Plan) -> None:
        self.names, self.q = list(plan.robot.joint_names), plan.trajectory(0.0).tolist()
        self.goals: list[Any] = []
        self.accepts, self.state, self.cancelled, self.closed = True, 4, 0, False
        self.told: Any = None
        time_message = message(sec=int, nanosec=int)
        header = message(stamp=time_message, frame_id=str)
        trajectory = message(header=header, joint_names=list, points=list)
        point = message(positions=list, velocities=list, accelerations=list, time_from_start=time_message)
        modules = {
            "rclpy": {"Context": lambda: SimpleNamespace(shutdown=self.close), "init": lambda context: None,
                      "create_node": lambda name, context: self},
            "rclpy.action": {"ActionClient": lambda node, kind, name: self},
            "rclpy.executors": {"SingleThreadedExecutor": lambda context: SimpleNamespace(
                add_node=lambda node: None, spin=self.spin, shutdown=self.close)},
            "rclpy.qos": {"qos_profile_sensor_data": 10},
            "control_msgs": {}, "sensor_msgs": {}, "trajectory_msgs": {},
            "control_msgs.action": {"FollowJointTrajectory": SimpleNamespace(Goal=message(trajectory=trajectory))},
            "sensor_msgs.msg": {"JointState": None},
            "trajectory_msgs.msg": {"JointTrajectory": trajectory, "JointTrajectoryPoint": point},
        }  # fmt: skip
        for name, content in modules.items():
            module = ModuleType(name)
            vars(module).update(content)
            monkeypatch.setitem(sys.modules, name, module)
            package, _, rest = name.rpartition(".")
            if package:
                setattr(sys.modules[package], rest, module)

    def create_subscription(self, kind: Any, topic: str, told: Any, quality: Any) -> None:
        self.told = told

    def wait_for_server(self, timeout_sec: float) -> bool:
        return True

    def destroy_node(self) -> None:
        self.closed = True

    def close(self) -> None:
        self.closed = True

    def spin(self) -> None:
        """Tell of joint states until the end."""
        while not self.closed:
            stamp = SimpleNamespace(sec=int(time.time()), nanosec=time.time_ns() % 10**9)
            head = SimpleNamespace(stamp=stamp)
            self.told(SimpleNamespace(header=head, name=self.names, position=self.q, velocity=[0.0] * len(self.q)))
            time.sleep(0.005)

    def send_goal_async(self, goal: Any, feedback_callback: Any) -> Future:
        self.goals.append(goal)
        if goal.trajectory.points and self.accepts and self.state == 4:
            self.q = list(goal.trajectory.points[-1].positions)
        code = 0 if self.state == 4 else -5
        answer = SimpleNamespace(status=self.state, result=SimpleNamespace(error_code=code, error_string=""))
        return Future(
            SimpleNamespace(
                accepted=self.accepts, get_result_async=lambda: Future(answer), cancel_goal_async=self.cancel_goal_async
            )
        )

    def cancel_goal_async(self) -> None:
        self.cancelled += 1
