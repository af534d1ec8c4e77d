"""A stand-in for a rosbridge server and the joint_trajectory_controller behind it, run as a process of its own.

The path of the address says how it behaves: ``ws://127.0.0.1:PORT/MODE?id=ID&names=a,b&q=0.1,0.2``. Connections with the same
id reach the same controller. ``&least=0.1&late=0.5&seed=1`` delays each feedback by 0.1 to 0.5 s, ``&fragment=100`` sends
messages in parts of so many characters, and ``&trace=FILE`` writes what is commanded, for `commanded`. Messages are those of
rosbridge_suite (send_action_goal.py, actions.py), behaviour that of ros2_controllers (joint_trajectory_controller.cpp,
trajectory.cpp).
"""

import asyncio
import json
import random
import time
from itertools import pairwise
from pathlib import Path
from typing import Any
from urllib.parse import parse_qs, urlsplit

import numpy as np
from websockets.asyncio.server import ServerConnection, serve
from websockets.exceptions import ConnectionClosed

STATES_RATE, FEEDBACK_RATE = 50.0, 20.0
SUCCEEDED, CANCELED, ABORTED = 4, 5, 6
CLOCK = 1_000_000.0  # the robot's clock is that far behind the host's [s]
ODD = [
    "}{", "[1, 2]", '"word"', "null", '{"op": "publish"}', '{"op": 7}', '{"op": "action_result"}', "\x00", '{"a": NaN}',
]  # fmt: skip


def ros_now() -> float:
    return time.time() - CLOCK


def stamp(t: float) -> dict[str, int]:
    ns = round(t * 1e9)
    return {"sec": ns // 10**9, "nanosec": ns % 10**9}


def seconds(time_message: dict[str, int]) -> float:
    return time_message["sec"] + 1e-9 * time_message["nanosec"]


State = tuple[np.ndarray, np.ndarray, np.ndarray]


def between(t: float, t0: float, a: State, t1: float, b: State) -> State:
    """Quintic Hermite, as interpolate_between_points does it."""
    T, u = t1 - t0, t - t0
    (p0, v0, a0), (p1, v1, a1) = a, b
    c = [p0, v0, a0 / 2.0]
    c.append((-20 * p0 + 20 * p1 - 3 * a0 * T**2 + a1 * T**2 - 12 * v0 * T - 8 * v1 * T) / (2 * T**3))
    c.append((30 * p0 - 30 * p1 + 3 * a0 * T**2 - 2 * a1 * T**2 + 16 * v0 * T + 14 * v1 * T) / (2 * T**4))
    c.append((-12 * p0 + 12 * p1 - a0 * T**2 + a1 * T**2 - 6 * v0 * T - 6 * v1 * T) / (2 * T**5))
    p = sum(k * u**i for i, k in enumerate(c))
    v = sum(i * k * u ** (i - 1) for i, k in enumerate(c) if i)
    acc = sum(i * (i - 1) * k * u ** (i - 2) for i, k in enumerate(c) if i > 1)
    return p, v, acc


Points = list[tuple[float, State]]


def desired(t: float, before: tuple[float, State], points: Points) -> State:
    """The state of a trajectory at a time: a state before it, and its points."""
    if not points:
        return before[1]
    if t >= points[-1][0]:
        q = points[-1][1][0]
        return q, 0 * q, 0 * q
    if t < points[0][0]:
        return between(t, *before, *points[0])
    i = max(k for k, (at, _) in enumerate(points) if at <= t)
    return between(t, *points[i], *points[i + 1])


def commanded(trace: Path, period: float) -> np.ndarray:
    """The positions (k, n) that a controller commanded at each period, by the trace that it wrote."""
    rows: list[Points] = [
        [(t, tuple(np.array(x) for x in state)) for t, state in json.loads(line)]
        for line in trace.read_text().splitlines()
    ]  # fmt: skip
    begin, end = rows[0][0][0], max(point[0] for row in rows for point in row[:1] + row[-1:]) + 2.0 * period
    found, k = [], 0
    for t in np.arange(begin, end, period):
        while k + 1 < len(rows) and rows[k + 1][0][0] <= t:
            k += 1
        found.append(desired(t, rows[k][0], rows[k][1:])[0])
    return np.array(found)


class Controller:
    """One arm and its joint_trajectory_controller."""

    def __init__(self, mode: str, query: dict[str, list[str]]) -> None:
        self.mode, self.blends = mode, "legacy" not in query
        self.names = query["names"][0].split(",")
        q = np.array([float(x) for x in query["q"][0].split(",")])
        self.slow = float(query.get("slow", ["1"])[0])
        self.least = float(query.get("least", ["0"])[0])
        self.late, self.random = float(query.get("late", ["0"])[0]), random.Random(query.get("seed", ["0"])[0])
        self.fragment = int(query.get("fragment", ["0"])[0])
        self.trace = query.get("trace", [""])[0]
        self.points: list[tuple[float, State]] = []
        self.before: tuple[float, State] = (ros_now(), (q, 0 * q, 0 * q))
        self.goals = 0
        self.running: Goal | None = None
        self.began = ros_now()

    def desired(self, t: float) -> State:
        """The state that is commanded at a time of the robot's clock."""
        return desired(t, self.before, self.points)

    def installed(self) -> None:
        """Write down what is commanded from now on."""
        if self.trace:
            plain = [(t, [x.tolist() for x in state]) for t, state in (self.before, *self.points)]
            with Path(self.trace).open("a") as file:
                file.write(json.dumps(plain) + "\n")

    def take(self, trajectory: dict[str, Any]) -> None:
        """Install a new trajectory: what is over is discarded, what lies ahead is blended with what runs."""
        now = ros_now()
        order = [trajectory["joint_names"].index(name) for name in self.names]
        start = seconds(trajectory["header"]["stamp"]) or now
        fresh = [
            (
                start + self.slow * seconds(p["time_from_start"]),
                tuple(
                    np.array(p[f])[order] / self.slow**k
                    for k, f in enumerate(("positions", "velocities", "accelerations"))
                ),
            )
            for p in trajectory["points"]
        ]
        old = self.desired(now)
        if self.blends and start > now:  # the running trajectory goes on until the new one starts
            anchor = self.desired(start)
            kept = [point for point in self.points if now < point[0] < start]
            self.points = [*kept, (start - 1e-9, anchor), *fresh]
        else:  # older controllers go straight to the first point, and know no acceleration of the arm
            self.points = fresh
            old = (old[0], old[1], 0 * old[2])
        self.before = (now, old)
        self.installed()

    def hold(self, t: float) -> None:
        """As set_hold_position does it."""
        q = self.desired(t)[0]
        self.points, self.before = [], (t, (q, 0 * q, 0 * q))
        self.installed()


class Goal:
    """One goal, followed by a task of its own."""

    def __init__(self, socket: ServerConnection, message: dict[str, Any], controller: Controller) -> None:
        self.socket, self.message, self.controller = socket, message, controller
        self.over, self.due = asyncio.Event(), 0.0
        self.began = 0.0
        self.waiting: set[asyncio.Task[None]] = set()

    async def send(self, op: str, **fields: Any) -> None:
        message = {"op": op, "action": self.message["action"], "id": self.message.get("id"), **fields}
        text, size = json.dumps(message), self.controller.fragment
        parts = [text[i : i + size] for i in range(0, len(text), size)] if 0 < size < len(text) else []
        whole = (len(text) - 1) / (size or 1) + 1  # as rosbridge_suite computes it, which is no whole number
        said = [
            {"op": "fragment", "id": message["id"], "data": part, "num": i, "total": whole}
            for i, part in enumerate(parts)
        ]
        try:
            for one in [json.dumps(each) for each in said] or [text]:
                await self.socket.send(one)
        except ConnectionClosed:
            self.over.set()

    def send_late(self, op: str, **fields: Any) -> None:
        """Send it after a random while, in order."""
        now = time.monotonic()
        self.due = max(self.due, now + self.controller.random.uniform(self.controller.least, self.controller.late))

        async def later(wait: float) -> None:
            await asyncio.sleep(wait)
            await self.send(op, **fields)

        task = asyncio.create_task(later(self.due - now))
        self.waiting.add(task)
        task.add_done_callback(self.waiting.discard)

    async def end(self, state: int, code: int, words: str) -> None:
        if not self.over.is_set():
            self.over.set()
            values = {"error_code": code, "error_string": words}
            await self.send("action_result", values=values, status=state, result=True)


def acceptable(controller: Controller, args: Any) -> bool:
    """As validate_trajectory_msg does it."""
    try:
        trajectory = args["trajectory"]
        times = [seconds(p["time_from_start"]) for p in trajectory["points"]]
        last = trajectory["points"][-1]
        good = sorted(trajectory["joint_names"]) == sorted(controller.names) and bool(times)
        return good and all(b > a for a, b in pairwise(times)) and np.abs(last["velocities"]).max() <= 1.2e-7
    except (KeyError, TypeError, IndexError):
        return False


async def run_goal(controller: Controller, goal: Goal) -> None:
    """Accept a goal and follow it to its end, as its mode says."""
    mode = controller.mode
    controller.goals += 1
    if mode == "quiet" or (mode == "quietstop" and controller.goals > 1):
        return
    if (
        not acceptable(controller, goal.message.get("args"))
        or mode == "reject"
        or (mode == "rejectstop" and controller.goals > 1)
    ):
        await goal.send("action_result", values="Action goal was rejected", status=0, result=False)
        return
    if controller.running is not None:
        await controller.running.end(ABORTED, -1, "Current goal preempted by new incoming action.")
    controller.running = goal
    goal.began = ros_now()
    controller.take(goal.message["args"]["trajectory"])
    begun, end = ros_now(), controller.points[-1][0]
    while not goal.over.is_set() and ros_now() < end + 0.02:
        t = ros_now()
        q, dq, ddq = controller.desired(t)
        rows = {"positions": q.tolist(), "velocities": dq.tolist(), "accelerations": ddq.tolist()}
        if mode == "oddfeedback" or (mode == "oddonce" and t < begun + 0.04):
            rows = {"positions": "here"}
        elif mode == "elsewhere":
            rows["positions"] = (q + 0.5).tolist()
        values = {"header": {"stamp": stamp(t), "frame_id": ""}, "joint_names": controller.names, "desired": rows}
        if controller.late:
            goal.send_late("action_feedback", values=values)
        else:
            await goal.send("action_feedback", values=values)
        if t > begun + 0.15:
            if mode == "abort":
                controller.hold(t)
                await goal.end(ABORTED, -4, "Aborted due to path tolerance violation")
            elif mode == "broken":
                await goal.end(ABORTED, -9, "hardware fault")
            elif mode == "oddresult":
                goal.over.set()
                await goal.send("action_result", values=[1], status="done", result=True)
            elif mode == "falseresult":
                goal.over.set()
                await goal.send("action_result", values="the executor was shut down", status=0, result=False)
            elif mode == "close":
                await goal.socket.close()
        await asyncio.sleep(1.0 / FEEDBACK_RATE)
    if mode != "noresult":
        await goal.end(SUCCEEDED, 0, "Goal successfully reached!")


async def states(controller: Controller, socket: ServerConnection, topic: str) -> None:
    """Publish joint states."""
    mode, began = controller.mode, ros_now()
    while True:
        t = ros_now()
        q, dq, _ = controller.desired(t)
        message: dict[str, Any] = {
            "header": {"stamp": stamp(began if mode == "stale" else t), "frame_id": ""},
            "name": controller.names, "position": q.tolist(), "velocity": dq.tolist(), "effort": [],
        }  # fmt: skip
        running = controller.running is not None and not controller.running.over.is_set()
        if controller.running is None or t < controller.running.began + 0.15:
            frozen = message["position"][2]
        if mode == "wrong":
            message["position"] = "0.1, 0.2"
        elif mode == "nan":
            message["position"][1] = float("nan")
        elif mode == "null":
            message["position"][1] = None
        elif mode == "novelocity":
            message["velocity"] = []
        elif mode == "frozen" and controller.running is not None and t > controller.running.began + 0.15:
            message["position"][2] = frozen
        elif mode == "missing":
            message = message | {"name": ["gripper"], "position": [0.0], "velocity": [0.0]}
        elif mode == "nonsense":
            await socket.send(ODD[int(t * STATES_RATE) % len(ODD)])
            await asyncio.sleep(1.0 / STATES_RATE)
            continue
        if not (mode == "freeze" and running and t > controller.before[0] + 0.15):
            await socket.send(json.dumps({"op": "publish", "topic": topic, "msg": message}))
        await asyncio.sleep(1.0 / STATES_RATE)


async def connected(socket: ServerConnection, controllers: dict[str, Controller]) -> None:
    parts = urlsplit(socket.request.path if socket.request else "/")
    mode, query = parts.path.strip("/"), parse_qs(parts.query)
    controller = controllers.setdefault(query["id"][0], Controller(mode, query))
    tasks = set()
    try:
        async for text in socket:
            message = json.loads(text)
            if mode == "silent":
                continue
            if message["op"] == "subscribe":
                tasks.add(asyncio.create_task(states(controller, socket, message["topic"])))
            elif message["op"] == "send_action_goal":
                goal = Goal(socket, message, controller)
                task = asyncio.create_task(run_goal(controller, goal))
                tasks.add(task)
                if mode == "blocking":  # nothing more is read from this connection while the goal runs
                    await task
            elif message["op"] == "cancel_action_goal":
                running = controller.running
                if running is not None and running.message.get("id") == message.get("id") and mode != "noresult":
                    controller.hold(ros_now())
                    await running.end(CANCELED, 0, "")
    except ConnectionClosed:
        pass
    finally:
        for task in tasks:
            task.cancel()


async def main() -> None:
    controllers: dict[str, Controller] = {}
    async with serve(lambda socket: connected(socket, controllers), "127.0.0.1", 0) as server:
        print(server.sockets[0].getsockname()[1], flush=True)
        await asyncio.get_running_loop().create_future()


if __name__ == "__main__":
    asyncio.run(main())
