"""A page in headless Chromium, driven over its debugging pipe: what it says, asks of the network and shows."""

from __future__ import annotations

import base64
import fcntl
import json
import os
import shutil
import subprocess
import time
from pathlib import Path
from types import TracebackType
from typing import Any

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
FLAGS = (
    "--headless", "--no-sandbox", "--disable-background-networking", "--enable-unsafe-swiftshader", "--no-first-run",
    "--disable-component-update", "--remote-debugging-pipe", "--hide-scrollbars",
)  # fmt: skip
QUIET = ("Canvas2D", "GL Driver", "WebGL")
"""Words of console messages that are of the machine, not of the page."""


def _pipe() -> tuple[int, int]:
    """Both ends of a pipe, under numbers that leave 3 and 4 free: the browser's own."""
    ends = os.pipe()
    high = tuple(fcntl.fcntl(end, fcntl.F_DUPFD, 50) for end in ends)
    for end in ends:
        os.close(end)
    return high[0], high[1]


class Browser:
    """One tab. Requests that are not of the page's own file, and messages of its console, are collected."""

    def __init__(self, scratch: Path, width: int = 1280, height: int = 900) -> None:
        down, up = _pipe(), _pipe()
        command = [str(CHROMIUM), *FLAGS, f"--user-data-dir={scratch / 'profile'}", f"--window-size={width},{height}"]
        line = f'exec "$0" "$@" 3<&{down[0]} 4>&{up[1]}'
        self.process = subprocess.Popen(
            ["bash", "-c", line, *command, "about:blank"], pass_fds=(down[0], up[1]), stderr=subprocess.DEVNULL
        )
        os.close(down[0])
        os.close(up[1])
        self.to, self.out = os.fdopen(down[1], "wb"), os.fdopen(up[0], "rb")
        self.count, self.session, self.unread = 0, "", bytearray()
        self.said: list[str] = []
        self.requests: list[str] = []
        target = next(t for t in self.send("Target.getTargets")["targetInfos"] if t["type"] == "page")
        self.session = self.send("Target.attachToTarget", targetId=target["targetId"], flatten=True)["sessionId"]
        for domain in ("Page", "Runtime", "Network", "Log"):
            self.send(f"{domain}.enable")

    def __enter__(self) -> Browser:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.to.close()  # the browser ends with its pipe
        try:
            self.process.wait(timeout=20)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()
        self.out.close()

    def send(self, method: str, **params: Any) -> Any:
        """Ask the browser, and return what it answers; events on the way are kept."""
        self.count += 1
        message: dict[str, Any] = {"id": self.count, "method": method, "params": params}
        if self.session:
            message["sessionId"] = self.session
        self.to.write(json.dumps(message).encode() + b"\0")
        self.to.flush()
        while (answer := self._next()).get("id") != self.count:
            self._note(answer)
        assert "error" not in answer, answer
        return answer["result"]

    def _next(self) -> dict[str, Any]:
        while (end := self.unread.find(b"\0")) < 0:
            more = os.read(self.out.fileno(), 1 << 20)
            assert more, "the browser is gone"
            self.unread += more
        found: dict[str, Any] = json.loads(self.unread[:end])
        del self.unread[: end + 1]
        return found

    def _note(self, event: dict[str, Any]) -> None:
        method, params = event.get("method"), event.get("params", {})
        if method == "Runtime.exceptionThrown":
            self.said.append(params["exceptionDetails"].get("exception", {}).get("description", "exception"))
        if method == "Runtime.consoleAPICalled" and params["type"] in ("error", "warning", "assert"):
            self.said.append(" ".join(str(a.get("value", "")) for a in params["args"]))
        if method == "Log.entryAdded" and params["entry"]["level"] in ("error", "warning"):
            self.said.append(params["entry"]["text"])
        if method == "Network.requestWillBeSent" and not params["request"]["url"].startswith(("data:", "blob:")):
            self.requests.append(params["request"]["url"])

    def open(self, page: Path) -> None:
        """Load a file; what it is asked next comes while it still draws."""
        self.send("Page.navigate", url=page.as_uri())

    def run(self, code: str) -> Any:
        """The value of an expression of JavaScript, awaited."""
        answer = self.send("Runtime.evaluate", expression=code, awaitPromise=True, returnByValue=True)
        assert "exceptionDetails" not in answer, answer["exceptionDetails"]
        return answer["result"].get("value")

    def until(self, code: str, seconds: float = 60.0) -> Any:
        """The first true value of an expression."""
        end = time.monotonic() + seconds
        while not (found := self.run(code)):
            assert time.monotonic() < end, f"never true: {code}"
            time.sleep(0.02)
        return found

    @property
    def errors(self) -> list[str]:
        """What the page's console was told."""
        return [words for words in self.said if not any(w in words for w in QUIET)]

    def asked(self, page: Path) -> list[str]:
        """Requests for anything but the page."""
        return [url for url in self.requests if not url.startswith(page.as_uri()) and url != "about:blank"]

    def emulate(self, media: str = "screen", scheme: str = "light", width: int = 0, height: int = 900) -> None:
        """Another medium, theme or width."""
        features = [{"name": "prefers-color-scheme", "value": scheme}]
        self.send("Emulation.setEmulatedMedia", media=media, features=features)
        if width:
            size = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": width < 600}
            self.send("Emulation.setDeviceMetricsOverride", **size)

    def pdf(self, path: Path) -> None:
        """The page as it is printed."""
        path.write_bytes(
            base64.b64decode(self.send("Page.printToPDF", printBackground=True, preferCSSPageSize=True)["data"])
        )
