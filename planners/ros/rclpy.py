"""A controller of ROS 2 through rclpy, which needs a sourced ROS 2 installation; pip does not install it."""

from __future__ import annotations

import contextlib
import threading
from typing import Any

from optik.check import check_number
from optik.errors import MissingDependency
from planners.ros.transport import ACTION, STATES, Goal, Transport, check_ros_name

NODE = "optik_drive"
"""Name of the node."""
SERVER = 2.0
"""Default of the longest wait for the controller's action [s]: discovery takes up to a second."""


class RclpyTransport(Transport):
    """A transport through an own node of ROS 2, whose thread ends with the process.

    Parameters
    ----------
    action : str
        Name of the controller's action.
    states : str
        Topic of the joint states.
    timeout : float
        Longest wait for the controller's action [s].

    Raises
    ------
    InvalidInput
        An argument is out of range.
    MissingDependency
        No ROS 2 installation is sourced.
    """

    def __init__(self, *, action: str = ACTION, states: str = STATES, timeout: float = SERVER) -> None:
        super().__init__()
        self.address = check_ros_name(action, "action")
        states = check_ros_name(states, "states")
        timeout = check_number(timeout, "timeout", "seconds above 0", above=0.0)
        self._ros = _packages()
        self._context = self._ros["rclpy"].Context()
        self._ros["rclpy"].init(context=self._context)
        self._node = self._ros["rclpy"].create_node(NODE, context=self._context)
        quality = self._ros["qos"].qos_profile_sensor_data
        self._node.create_subscription(self._ros["JointState"], states, self._states_came, quality)
        self._client = self._ros["action"].ActionClient(self._node, self._ros["FollowJointTrajectory"], action)
        self._executor = self._ros["executors"].SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self._node)
        self._handles: dict[str, Any] = {}
        self._cancelled: set[str] = set()
        threading.Thread(target=self._spin, name=NODE, daemon=True).start()
        if not self._client.wait_for_server(timeout_sec=timeout):
            self.lost = f"no controller offers {action} within {timeout:g} s"

    def _spin(self) -> None:
        try:
            self._executor.spin()
        except Exception as error:  # the context was shut down, by us or by a signal
            self.lost = self.lost or f"rclpy stopped: {type(error).__name__}: {' '.join(str(error).split())[:120]}"

    def _states_came(self, message: Any) -> None:
        data = {"header": _header(message), "name": list(message.name), "position": list(message.position)}
        self.tell_states(data | {"velocity": list(message.velocity)})

    def send(self, trajectory: dict[str, Any]) -> Goal:
        """Send a goal; see `Transport.send`."""
        goal = Goal()
        if self.lost:
            goal.tell_refused(self.lost)
            return goal
        message = self._ros["FollowJointTrajectory"].Goal()
        message.trajectory = self._trajectory(trajectory)
        sending = self._client.send_goal_async(message, feedback_callback=lambda told: _feedback(goal, told.feedback))
        sending.add_done_callback(lambda future: self._answered(goal, future))
        return goal

    def _answered(self, goal: Goal, future: Any) -> None:
        """Record whether the controller accepted the goal."""
        try:
            handle = future.result()
        except Exception as error:  # whatever the middleware raises
            goal.tell_refused(f"{type(error).__name__}: {error}")
            return
        if not handle.accepted:
            goal.tell_refused("the controller rejected the goal")
            return
        self._handles[goal.id] = handle
        goal.tell_accepted()
        handle.get_result_async().add_done_callback(lambda done: _ended(goal, done))
        if goal.id in self._cancelled:  # cancelled before it was accepted
            handle.cancel_goal_async()

    def cancel(self, goal: Goal) -> None:
        """Cancel a goal; see `Transport.cancel`."""
        self._cancelled.add(goal.id)
        handle = self._handles.get(goal.id)
        if handle is not None:
            handle.cancel_goal_async()

    def close(self) -> None:
        """End the node; accepted goals continue on the controller."""
        self.lost = self.lost or "the connection was closed on this side"
        for end in (self._executor.shutdown, self._node.destroy_node, self._context.shutdown):
            with contextlib.suppress(Exception):  # ended already, by a signal
                end()

    def _trajectory(self, data: dict[str, Any]) -> Any:
        """Return a ``trajectory_msgs/JointTrajectory`` from plain data."""
        message = self._ros["JointTrajectory"]()
        message.joint_names = data["joint_names"]
        message.header.frame_id = data["header"]["frame_id"]
        _set_time(message.header.stamp, data["header"]["stamp"])
        for row in data["points"]:
            point = self._ros["JointTrajectoryPoint"]()
            for field in ("positions", "velocities", "accelerations"):
                setattr(point, field, row[field])
            _set_time(point.time_from_start, row["time_from_start"])
            message.points.append(point)
        return message


def _set_time(message: Any, time: dict[str, int]) -> None:
    message.sec, message.nanosec = time["sec"], time["nanosec"]


def _header(message: Any) -> dict[str, Any]:
    stamp = message.header.stamp
    return {"stamp": {"sec": int(stamp.sec), "nanosec": int(stamp.nanosec)}}


def _feedback(goal: Goal, told: Any) -> None:
    desired = {
        field: [float(value) for value in getattr(told.desired, field)]
        for field in ("positions", "velocities", "accelerations")
    }
    goal.tell_feedback({"header": _header(told), "joint_names": list(told.joint_names), "desired": desired})


def _ended(goal: Goal, future: Any) -> None:
    try:
        answer = future.result()
    except Exception as error:  # whatever the middleware raises
        goal.tell_result(None, {"error_string": f"{type(error).__name__}: {error}"})
        return
    result = answer.result
    goal.tell_result(int(answer.status), {"error_code": int(result.error_code), "error_string": result.error_string})


def _packages() -> dict[str, Any]:
    """Return the packages of a sourced ROS 2."""
    try:
        import rclpy
        import rclpy.action
        import rclpy.executors
        import rclpy.qos
        from control_msgs.action import FollowJointTrajectory
        from sensor_msgs.msg import JointState
        from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint
    except ImportError as error:  # not sourced; or sourced for another Python, whose compiled part cannot be loaded
        how = "source a ROS 2 installation with control_msgs (source /opt/ros/jazzy/setup.bash), or use rosbridge"
        raise MissingDependency((error.name or "rclpy").partition(".")[0], "a drive through rclpy", None, how) from None
    return {
        "rclpy": rclpy, "action": rclpy.action, "executors": rclpy.executors, "qos": rclpy.qos,
        "FollowJointTrajectory": FollowJointTrajectory, "JointState": JointState,
        "JointTrajectory": JointTrajectory, "JointTrajectoryPoint": JointTrajectoryPoint,
    }  # fmt: skip
