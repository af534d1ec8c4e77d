"""A server of the page of a motion, which can also run a simulated drive and show it meanwhile. It moves no real arm."""

from __future__ import annotations

import json
import socket
import socketserver
import time
from collections.abc import Callable
from http.server import BaseHTTPRequestHandler
from threading import Event, Thread
from typing import Any

from optik.errors import InvalidInput, OptikError
from planners.cell.drives.base import Drive, Execution, Moment
from planners.cell.view.page import make_page
from planners.cell.view.show import Show, show_execution
from planners.plan import Plan

VIEW_PORT = 8080
"""Default port."""
SAME_PAGE = "X-Optik"
"""Header of requests that change something: only scripts of the served page can send it, not those of other pages."""


class Viewer:
    """A server of the page of a motion. With a simulated drive, buttons of the page run and stop it.

    Parameters
    ----------
    show : Show
        The content.
    host : str
        Address of the server.
    port : int
        Port of the server; 0 for any free port.
    plan : Plan, optional
        The plan that the simulated drive executes.
    drive : callable, optional
        Returns a new simulated drive for every run, at the pace of real time.

    Raises
    ------
    InvalidInput
        An address or port that is not available, or a drive that moves a real arm.
    """

    def __init__(
        self, show: Show, host: str = "127.0.0.1", port: int = VIEW_PORT, *, plan: Plan | None = None,
        drive: Callable[[], Drive] | None = None,
    ) -> None:  # fmt: skip
        if drive is not None and not drive().simulated:
            raise InvalidInput("drive", "one that moves a real arm", "a simulated drive")
        self.show, self.plan, self.drive = show, plan, drive
        self.thread: Thread | None = None
        self.stopped, self.runs, self.words = Event(), 0, ""
        self.moment: Moment | None = None
        self._server = _make_server(self, host, port)
        Thread(target=self._server.serve_forever, daemon=True).start()

    @property
    def url(self) -> str:
        """Address of the page."""
        host, port = str(self._server.server_address[0]), self._server.server_address[1]
        shown = {"0.0.0.0": "localhost", "::": "localhost"}.get(host, f"[{host}]" if ":" in host else host)
        return f"http://{shown}:{port}"

    def serve(self) -> None:
        """Serve until the process is interrupted."""
        while True:
            time.sleep(1.0)

    def close(self) -> None:
        """Stop the simulated drive, if it runs, and the server."""
        self.stopped.set()
        if self.thread is not None:
            self.thread.join(timeout=5.0)
        self._server.shutdown()
        self._server.server_close()

    def start(self) -> None:
        """Start the simulated drive, unless it runs already."""
        if self.thread is not None or self.drive is None or self.plan is None:
            return
        self.stopped.clear()
        self.moment, self.words = None, "the simulated drive prepares the motion"
        self.thread = Thread(target=self._run, args=(self.drive(), self.plan), daemon=True)
        self.thread.start()

    def _run(self, drive: Drive, plan: Plan) -> None:
        """Execute the plan, and show the execution."""
        try:
            done = drive.execute(plan, stop=lambda _: self.stopped.is_set(), watch=self._watch)
            self.show, self.words = show_execution(done), _describe_end(done)
        except OptikError as error:
            self.words = str(error)
        self.runs += 1
        self.thread = None

    def _watch(self, moment: Moment) -> None:
        self.moment = moment

    def describe(self) -> dict[str, Any]:
        """Return the response to a request of the page while the simulated drive runs."""
        moment, running = self.moment, self.thread is not None
        state = {"running": running, "runs": self.runs, "words": self.words}
        return state | ({"t": moment.t, "q": moment.actual.tolist()} if moment is not None and running else {})


class _Requests(BaseHTTPRequestHandler):
    """Requests of the page."""

    server: Any

    def do_GET(self) -> None:
        """Send the page, or the state of the simulated drive."""
        viewer = self.server.viewer
        if self.path == "/":
            self._send(make_page(viewer.show, live=viewer.drive is not None), "text/html; charset=utf-8")
        elif self.path == "/state":
            self._send(json.dumps(viewer.describe()), "application/json")
        else:
            self.send_error(404)

    def do_POST(self) -> None:
        """Start or stop the simulated drive."""
        actions = {"/start": self.server.viewer.start, "/stop": self.server.viewer.stopped.set}
        if self.path not in actions or SAME_PAGE not in self.headers:
            self.send_error(403)
            return
        actions[self.path]()
        self._send("{}", "application/json")

    def _send(self, text: str, kind: str) -> None:
        content = text.encode()
        self.send_response(200)
        for name, value in (("Content-Type", kind), ("Content-Length", len(content)), ("Cache-Control", "no-store")):
            self.send_header(name, str(value))
        self.end_headers()
        self.wfile.write(content)

    def log_message(self, format: str, *args: Any) -> None:
        """Write no log."""


def _make_server(viewer: Viewer, host: str, port: int) -> socketserver.ThreadingTCPServer:
    """Return a server that listens at an address."""

    class Server(socketserver.ThreadingTCPServer):
        allow_reuse_address, daemon_threads = True, True

    try:
        Server.address_family, _, _, _, (number, *_) = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0]
        server = Server((str(number), port), _Requests)
    except (OSError, OverflowError) as error:
        reason = getattr(error, "strerror", None) or error
        expected = "an address of this machine and a free port (host, port; --host, --port on the command line)"
        raise InvalidInput("address", f"{host}:{port} ({reason})", expected) from None
    server.viewer = viewer  # type: ignore[attr-defined]
    return server


def _describe_end(execution: Execution) -> str:
    """Return the end of an execution as text."""
    words = f"{execution.drive}: {str(execution.status).replace('_', ' ')}"
    return "; ".join(filter(None, (words, execution.reason, execution.advice)))
