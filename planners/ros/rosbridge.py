"""A controller of ROS 2 through rosbridge: JSON over a web socket by roslibpy, without ROS on this machine."""

from __future__ import annotations

import contextlib
import json
import logging
from typing import Any
from urllib.parse import urlsplit

from optik.check import check_number
from optik.errors import InvalidInput, MissingDependency
from planners.ros.transport import ACTION, ACTION_TYPE, STATES, STATES_TYPE, Goal, Transport, check_ros_name

URL = "ws://127.0.0.1:9090"
"""Default address of a rosbridge server, on this machine."""
CONNECTING = 5.0
"""Default of the longest wait for a connection [s]: a server on the same network answers in milliseconds."""
MOST_FRAGMENTS = 10_000
"""Largest number of parts of one message, and of incomplete messages; a server that sends more is broken."""
LINES = 2
"""Number of connections to a server. An older rosbridge reads nothing from a connection while a goal from it runs, so that the
goal of a stop would wait for the end of the motion. Therefore goals use the connections in turn."""


class RosbridgeTransport(Transport):
    """A transport through a rosbridge server. Failures are in `lost`: it raises nothing, and does not connect again.

    Parameters
    ----------
    url : str
        Address of the server, ``ws://HOST:PORT`` or ``wss://HOST:PORT``.
    action : str
        Name of the controller's action.
    states : str
        Topic of the joint states.
    timeout : float
        Longest wait for the connection [s].
    throttle : float
        Least time between two joint states from the server [s].

    Raises
    ------
    InvalidInput
        An argument is out of range.
    MissingDependency
        roslibpy is not installed.
    """

    def __init__(
        self, url: str = URL, *, action: str = ACTION, states: str = STATES, timeout: float = CONNECTING,
        throttle: float = 0.0,
    ) -> None:  # fmt: skip
        super().__init__()
        self.address, self.action = check_url(url), check_ros_name(action, "action")
        self._topic = check_ros_name(states, "states")
        timeout = check_number(timeout, "timeout", "seconds above 0", above=0.0)
        throttle = check_number(throttle, "throttle", "seconds, at least 0", least=0.0)
        self._ros = _roslibpy()
        self._goals: dict[str, Goal] = {}
        self._closing, self._sent = False, 0
        self._lines: list[Any] = []
        for _ in range(LINES):
            if not self.lost:
                self._connect(timeout)
        if not self.lost:
            rate = round(throttle * 1e3)
            states_type = STATES_TYPE
            topic = self._ros.Topic(
                self._lines[0], self._topic, states_type, throttle_rate=rate, reconnect_on_close=False
            )
            topic.subscribe(self.tell_states)

    def _connect(self, timeout: float) -> None:
        """Open one connection without automatic reconnection."""
        try:
            # Its event loop is a thread that ends with the process; Twisted's cannot be started a second time.
            line = self._ros.Ros(self.address, transport="asyncio")
        except RuntimeError as error:
            self.lost = f"roslibpy cannot run here: {' '.join(str(error).split())[:160]}"
            return
        line.factory.maxRetries = 0  # a goal that waits for a connection would be sent unexpectedly
        line.factory.on_ready(self._guard)
        line.on("close", lambda _: self._gone())
        self._lines.append(line)
        try:
            line.run(timeout)
        except Exception:  # its own timeout, whose class depends on the version
            self.lost = f"no rosbridge answers at {self.address} within {timeout:g} s"
            self.close()

    def _guard(self, protocol: Any) -> Any:
        """Return the protocol with messages checked before roslibpy, which drops invalid ones and logs a traceback."""
        read, fragments = protocol.on_message, Fragments()

        def guarded(payload: bytes) -> None:
            message: Any = None
            try:
                message = json.loads(payload.decode("utf8"))
                if message.get("op") == "fragment":
                    whole = fragments.joined(message)
                    if whole is not None:
                        guarded(whole)
                elif message.get("op") == "status":
                    self.odd = f"rosbridge says {str(message.get('level'))[:20]}: {str(message.get('msg'))[:200]}"
                else:
                    read(payload)
            except Exception as error:  # whatever the other side sends must not end the connection's thread
                self._not_read(message, payload, error)

        protocol.on_message = guarded
        return protocol

    def _not_read(self, message: Any, payload: bytes, error: Exception) -> None:
        """Record a message that could not be read; a result ends its goal nevertheless."""
        self.odd = f"a message that cannot be read ({type(error).__name__}): {payload[:80]!r}"
        if isinstance(message, dict) and message.get("op") == "action_result":
            goal = self._goals.get(str(message.get("id")))
            if goal is not None and not goal.ended:
                goal.tell_result(None, message.get("values"))

    def _gone(self) -> None:
        if not self._closing and not self.lost:
            self.lost = f"the connection to {self.address} was closed by the other side"

    def send(self, trajectory: dict[str, Any]) -> Goal:
        """Send a goal; see `Transport.send`."""
        goal = Goal()
        if self.lost:
            goal.tell_refused(self.lost)
            return goal
        self._goals[goal.id] = goal
        message = self._ros.Message(
            {
                "op": "send_action_goal",
                "id": goal.id,
                "action": self.action,
                "action_type": ACTION_TYPE,
                "args": {"trajectory": trajectory},
                "feedback": True,
            }
        )
        line, self._sent = self._lines[self._sent % LINES], self._sent + 1

        def ended(result: Any) -> None:
            goal.tell_result(result["status"].value, result["values"])

        def failed(result: Any) -> None:
            goal.tell_refused(str(result["values"]))

        line.call_async_action(message, ended, lambda values: goal.tell_feedback(dict(values)), failed)
        return goal

    def cancel(self, goal: Goal) -> None:
        """Cancel a goal; see `Transport.cancel`."""
        if self.lost:
            return
        # By all connections: an older rosbridge reads it only from another than the goal's, a newer one only from the same.
        for line in self._lines:
            line.send_on_ready(self._ros.Message({"op": "cancel_action_goal", "id": goal.id, "action": self.action}))

    def close(self) -> None:
        """End the connections; accepted goals continue on the controller."""
        self._closing = True
        for line in self._lines:
            with contextlib.suppress(Exception):  # a connection that was never established cannot be closed
                line.factory.on_ready(lambda protocol: protocol.send_close())
        self.lost = self.lost or "the connection was closed on this side"


class Fragments:
    """The fragmented messages of one connection, sent by a rosbridge with a ``fragment_size``."""

    def __init__(self) -> None:
        self._parts: dict[Any, dict[int, str]] = {}

    def joined(self, message: dict[str, Any]) -> bytes | None:
        """Return the message whose last part arrived; None while parts are missing."""
        num, total, data = message.get("num"), message.get("total"), message.get("data")
        if not (
            isinstance(num, int)
            and isinstance(total, int | float)
            and isinstance(data, str)
            and 0 <= num < total <= MOST_FRAGMENTS
        ):
            raise InvalidInput("fragment", repr(message)[:80], "a part with num, total and data")
        parts = self._parts.setdefault(str(message.get("id")), {})
        parts[num] = data
        if len(parts) < int(total):  # older servers send a total that is not an integer; this rounds it up
            while len(self._parts) > MOST_FRAGMENTS:
                self._parts.pop(next(iter(self._parts)))
            return None
        del self._parts[str(message.get("id"))]
        whole = "".join(parts[i] for i in sorted(parts))
        if json.loads(whole).get("op") == "fragment":
            raise InvalidInput("fragment", "a part of a part", "a message")
        return whole.encode("utf8")


def check_url(url: str) -> str:
    """Check the address of a server."""
    expected = "the address of a rosbridge server, such as ws://127.0.0.1:9090"
    try:
        parts = urlsplit(url)
        good = parts.scheme in ("ws", "wss") and bool(parts.hostname) and (parts.port is None or parts.port > 0)
    except (ValueError, TypeError, AttributeError):  # a port that is no number; no text
        good = False
    if not good or not url.isprintable():
        raise InvalidInput("url", repr(url)[:80], expected)
    return url


def _roslibpy() -> Any:
    try:
        import roslibpy
    except ModuleNotFoundError:
        raise MissingDependency("roslibpy", "a drive through rosbridge", "ros2") from None
    # Without a handler of its own, Python prints what it logs on a lost connection, tracebacks included.
    logging.getLogger("roslibpy").addHandler(logging.NullHandler())
    return roslibpy
