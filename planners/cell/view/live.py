"""A viewer in the browser: it plays a motion, and follows a simulated drive. It moves no real arm."""

from __future__ import annotations

import socket
import time
from collections.abc import Callable
from html import escape
from threading import Event, Thread
from typing import Any

import numpy as np

from optik.arm.units import unit_factors, unit_names
from optik.errors import InvalidInput, MissingDependency, OptikError
from optik.types import Array
from planners.cell.drives.base import Drive, Execution, Moment
from planners.cell.view._stage import Stage
from planners.cell.view.show import Show, show_execution
from planners.plan import Plan

VIEW_PORT = 8080
"""Default port, that of viser."""
PICTURE_PERIOD = 1.0 / 30.0
"""Interval between pictures [s]."""
PLAY_SPEEDS = ("0.1", "0.25", "0.5", "1", "2")
"""Seconds of the motion per second."""


class Viewer:
    """A viewer in the browser. Its buttons play and scrub, and run and stop a simulated drive; there are no others.

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
    MissingDependency
        viser is not installed.
    InvalidInput
        An address or port that is not available, or a drive that moves a real arm.
    """

    def __init__(
        self, show: Show, host: str = "127.0.0.1", port: int = VIEW_PORT, *, plan: Plan | None = None,
        drive: Callable[[], Drive] | None = None,
    ) -> None:  # fmt: skip
        if drive is not None and not drive().simulated:
            raise InvalidInput("drive", "one that moves a real arm", "a simulated drive")
        check_address(host, port)
        self.show, self.plan, self.drive = show, plan, drive
        self.server = _make_server(host, port)
        self.thread: Thread | None = None
        self.stopped, self.playing = Event(), False
        self.moment: Moment | None = None
        self.result: Execution | OptikError | None = None
        self._controls()
        self._present(show)

    @property
    def url(self) -> str:
        """The address of the page."""
        host = self.server.get_host()
        shown = {"0.0.0.0": "localhost", "::": "localhost"}.get(host, f"[{host}]" if ":" in host else host)
        return f"http://{shown}:{self.server.get_port()}"

    def close(self) -> None:
        """Stop the simulated drive, if it runs, and the server."""
        self.stopped.set()
        if self.thread is not None:
            self.thread.join(timeout=5.0)
        self.server.stop()

    def serve(self) -> None:
        """Draw pictures until the process is interrupted."""
        before = time.monotonic()
        while True:
            now = time.monotonic()
            self.step(now - before)
            before = now
            time.sleep(PICTURE_PERIOD)

    def step(self, passed: float) -> None:
        """Draw the next picture.

        Parameters
        ----------
        passed : float
            Time since the last picture [s].
        """
        if self.thread is not None:
            self._follow()
        elif self.playing:
            after = self.time.value + passed * float(self.speed.value)
            if after >= self.show.duration:
                self.play(False)
            self.time.value = min(after, self.show.duration)
            self._draw()
        elif self.time.value != self.drawn:
            self._draw()

    # ------------------------------------------------------------ controls

    def _controls(self) -> None:
        """Add buttons, slider and tables."""
        gui = self.server.gui
        self.title = gui.add_html("")
        self.time = gui.add_slider("Time [s]", 0.0, self.show.duration or 1.0, 1e-3, 0.0)
        self._player = gui.add_button("Play")
        self._player.on_click(lambda _: self.play(not self.playing))
        self.speed = gui.add_dropdown("Speed", PLAY_SPEEDS, initial_value="1")
        self.which = gui.add_dropdown("Arm", ("as executed", "as planned"), visible=False)
        self.which.on_update(lambda _: self._draw())
        if self.drive is not None:
            self._starter = gui.add_button("Run the simulated drive")
            self._starter.on_click(lambda _: self.start())
            self._stopper = gui.add_button("Stop the simulated drive", disabled=True)
            self._stopper.on_click(lambda _: self.stopped.set())
        self.state, self.numbers, self.facts = (gui.add_html("") for _ in range(3))

    def _present(self, show: Show) -> None:
        """Show another content from its start."""
        self.show, self.drawn = show, 0.0
        self.stage = Stage(self.server, show)
        self.time.max = show.duration or 1.0
        self.time.value = 0.0
        self.which.visible = show.executed is not None
        self.title.content = _paragraph(show.title, "bold")
        self.facts.content = _table(show.facts)
        self._draw()

    def play(self, on: bool) -> None:
        """Play from the slider's time, or pause.

        Parameters
        ----------
        on : bool
            Whether to play.
        """
        if on and self.time.value >= self.show.duration:
            self.time.value = 0.0
        self.playing = on
        self._player.label = "Pause" if on else "Play"

    def _draw(self) -> None:
        """Draw the motion at the time of the slider."""
        show, self.drawn = self.show, self.time.value
        track = show.planned if show.executed is None or self.which.value == "as planned" else show.executed
        q, dq = track.at(self.drawn)
        self.stage.place(q)
        self._write(q, dq)

    def _write(self, q: Array, dq: Array | None) -> None:
        """Write the joint values, and the tool's position and speed."""
        robot = self.show.robot
        scale, signs = unit_factors(robot), unit_names(robot)
        rows = []
        for i, name in enumerate(robot.joint_names):
            words = f"{_format(scale[i] * q[i])}{signs[i]}"
            rows.append((name, words if dq is None else f"{words}, {_format(scale[i] * dq[i])}{signs[i]}/s"))
        if np.isfinite(q).all():
            rows.append(("tool", f"{', '.join(_format(1e3 * x) for x in robot.fk(q)[:3, 3])} mm"))
            if dq is not None:
                rows.append(("tool speed", f"{1e3 * np.linalg.norm((robot.jacobian(q) @ dq)[:3]):.1f} mm/s"))
        self.numbers.content = _table(tuple(rows))

    # ------------------------------------------------------------ the simulated drive

    def start(self) -> None:
        """Start the simulated drive; the pictures follow it."""
        if self.thread is not None or self.drive is None or self.plan is None:
            return
        drive, plan = self.drive(), self.plan
        self.stopped.clear()
        self.result = self.moment = None
        self.play(False)

        def work() -> None:
            try:
                self.result = drive.execute(plan, stop=lambda _: self.stopped.is_set(), watch=self._watch)
            except OptikError as error:
                self.result = error

        self.thread = Thread(target=work, daemon=True)
        self._starter.disabled, self._stopper.disabled = True, False
        self.state.content = _paragraph("the simulated drive prepares the motion")
        self.thread.start()

    def _watch(self, moment: Moment) -> None:
        self.moment = moment

    def _follow(self) -> None:
        """Draw the simulated arm, and its executed motion after the end."""
        assert self.thread is not None
        moment, alive = self.moment, self.thread.is_alive()
        if moment is not None:
            self.stage.place(moment.actual)
            self._write(moment.actual, None)
            self.state.content = _paragraph(f"the simulated drive runs: {moment.t:.2f} s")
        if alive:
            return
        self.thread = None
        self._starter.disabled, self._stopper.disabled = False, True
        if isinstance(self.result, Execution):
            self._present(show_execution(self.result))
            self.time.value = self.show.duration
            self._draw()
            self.state.content = _paragraph(_describe_end(self.result))
        else:
            self.state.content = _paragraph(str(self.result))


def check_address(host: str, port: int) -> None:
    """Raise InvalidInput if a server cannot listen at an address; viser itself would use another port."""
    try:
        family, kind, protocol, _, address = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0]
        with socket.socket(family, kind, protocol) as probe:
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            probe.bind(address)
    except (OSError, OverflowError) as error:
        reason = getattr(error, "strerror", None) or error
        expected = "an address of this machine and a free port (host, port; --host, --port on the command line)"
        raise InvalidInput("address", f"{host}:{port} ({reason})", expected) from None


def _make_server(host: str, port: int) -> Any:
    """Return a viser server that never opens a tunnel to share its content."""
    try:
        import viser
    except ImportError:
        raise MissingDependency("viser", "the viewer in the browser", "view") from None

    class Local(viser.ViserServer):  # type: ignore[misc]
        def request_share_url(self, verbose: bool = True) -> None:
            """Request no address."""

    server = Local(host=host, port=port, verbose=False, label="optik")
    server.gui.configure_theme(show_share_button=False, show_logo=False)
    return server


def _describe_end(execution: Execution) -> str:
    """Return the end of an execution as text."""
    words = f"{execution.drive}: {str(execution.status).replace('_', ' ')}"
    return "; ".join(filter(None, (words, execution.reason, execution.advice)))


def _format(value: float) -> str:
    """Return a number with two decimals, without a sign if it is 0."""
    return f"{value:z.2f}".replace("-", "−")


def _paragraph(text: str, weight: str = "normal") -> str:
    """Return text in HTML."""
    return f'<p style="margin:4px 10px;font-weight:{weight}">{escape(text)}</p>'


def _table(rows: tuple[tuple[str, str], ...]) -> str:
    """Return rows of names and texts in HTML."""
    cell = '<td style="padding:1px 8px 1px 0;vertical-align:top">'
    body = "".join(f"<tr>{cell}{escape(name)}</td>{cell}{escape(text)}</td></tr>" for name, text in rows)
    return f'<table style="font-size:13px;margin:4px 10px">{body}</table>'
