"""`optik view`: pages and a server as people ask for them, rightly and wrongly; the server as a process of its own."""

from __future__ import annotations

import json
import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from urllib.error import HTTPError
from urllib.request import Request, urlopen

import numpy as np
import pytest

from optik.errors import InvalidInput
from planners.cell.drives import Drive, make_drive
from planners.cell.view.live import SAME_PAGE, Viewer
from planners.cell.view.page import make_page
from planners.cell.view.show import show_motion
from tests.benchmarks.browser import CHROMIUM, Browser
from tests.oracles import REPOSITORY
from tests.planners.motions import planned


@pytest.fixture(scope="module")
def motion(tmp_path_factory: pytest.TempPathFactory) -> Path:
    file = tmp_path_factory.mktemp("motions") / "motion.json"
    planned().save(file)
    return file


# ---------------------------------------------------------------- pages


@pytest.mark.parametrize("suffix", [".json", ".npz", ".csv"])
def test_a_page_of_a_motion_in_any_format(typed: Any, tmp_path: Path, suffix: str) -> None:
    planned().save(tmp_path / f"m{suffix}")
    status, out, said = typed("view", str(tmp_path / f"m{suffix}"), "--html", str(tmp_path / "page.html"))
    assert (status, said) == (0, "")
    assert "page.html" in out
    assert 10_000 < (tmp_path / "page.html").stat().st_size < 2_000_000


def test_a_page_of_a_simulated_execution(typed: Any, motion: Path, tmp_path: Path) -> None:
    status, _, said = typed("view", str(motion), "--drive", "ideal", "--html", str(tmp_path / "page.html"))
    assert (status, said) == (0, "")
    assert "on the drive ideal" in (tmp_path / "page.html").read_text()


def failed(folder: Path, motion: Path) -> Path:
    file = folder / "failed.json"
    file.write_text('{"format": "optik-plan/2", "reason": "joint5 comes to its end", "s": 0.5, "advice": "turn back"}')
    return file


def printed(folder: Path, motion: Path) -> Path:
    file = folder / "printed.json"
    file.write_text('{"format": "optik-plan/2", "status": "solved"}')
    return file


def real(folder: Path, motion: Path) -> Path:
    (folder / "real.py").write_text("from planners.cell.drives.ideal import IdealDrive\n\n\nclass Real(IdealDrive):\n"
                                    "    simulated = False\n\n\nMETHOD = Real\n")  # fmt: skip
    return motion


WRONG: dict[str, tuple[Any, tuple[str, ...], int, str]] = {
    "no file": (lambda folder, motion: folder / "none.json", (), 2, "No such file"),
    "a folder": (lambda folder, motion: folder, (), 2, "the folder"),
    "a report": (lambda folder, motion: REPOSITORY / "docs" / "report.png", (), 2, ".json"),
    "a failed plan": (failed, (), 1, "joint5 comes to its end"),
    "what --json printed": (printed, (), 2, "--out"),
    "a page's suffix": (lambda folder, motion: motion, ("--html", "page.txt"), 2, "--html"),
    "an unwritable page": (lambda folder, motion: motion, ("--html", "/none/page.html"), 2, "/none/page.html"),
    "another address": (lambda folder, motion: motion, ("--host", "203.0.113.7"), 2, "203.0.113.7"),
    "a real drive": (real, ("--drive", "./real.py"), 2, "simulated drive"),
    "no drive": (lambda folder, motion: motion, ("--drive", "idael"), 2, "ideal"),
}


@pytest.mark.parametrize("wrong", WRONG)
def test_what_is_wrong_is_one_line(
    typed: Any, motion: Path, tmp_path: Path, wrong: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    file, options, expected, words = WRONG[wrong]
    status, _, said = typed("view", str(file(tmp_path, motion)), *options)
    assert status == expected, said
    assert words in said
    assert said.count("\n") == 1


@pytest.mark.parametrize("wrong", ["no file", "a folder", "a failed plan", "what --json printed"])
def test_a_drive_is_given_the_same_files(typed: Any, motion: Path, tmp_path: Path, wrong: str) -> None:
    file, _, expected, words = WRONG[wrong]
    status, _, said = typed("drive", str(file(tmp_path, motion)))
    assert status == expected and words in said
    assert said.count("\n") == 1


def test_a_port_in_use_is_one_line(typed: Any, motion: Path) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        status, _, said = typed("view", str(motion), "--port", str(taken.getsockname()[1]))
    assert status == 2
    assert "in use" in said
    assert said.count("\n") == 1


# ---------------------------------------------------------------- the live viewer


@pytest.fixture
def viewer() -> Iterator[Viewer]:
    def drive() -> Drive:
        return make_drive("ideal", planned().robot, pace=0.7)  # so slow that a busy machine sees it on its way

    made = Viewer(show_motion(planned()), port=0, plan=planned(), drive=drive)
    yield made
    made.close()


def ask(viewer: Viewer, path: str, **options: Any) -> bytes:
    with urlopen(Request(f"{viewer.url}/{path}", **options), timeout=30) as answer:
        return bytes(answer.read())


def refused(viewer: Viewer, path: str, **options: Any) -> int:
    with pytest.raises(HTTPError) as error:
        ask(viewer, path, **options)
    error.value.close()
    return error.value.code


def state(viewer: Viewer) -> dict[str, Any]:
    return dict(json.loads(ask(viewer, "state")))


def press(viewer: Viewer, button: str) -> None:
    ask(viewer, button, method="POST", headers={SAME_PAGE: "1"})


def until_done(viewer: Viewer) -> list[dict[str, Any]]:
    end, seen = time.monotonic() + 60.0, [state(viewer)]
    while seen[-1]["running"]:
        time.sleep(0.02)
        seen.append(state(viewer))
        assert time.monotonic() < end
    return seen


def test_a_simulated_drive_is_followed_and_then_shown(viewer: Viewer) -> None:
    assert ask(viewer, "").decode() == make_page(viewer.show, live=True)
    press(viewer, "start")
    seen = [each for each in until_done(viewer) if "q" in each]
    assert len(seen) > 5
    for each in seen:
        np.testing.assert_allclose(each["q"], viewer.show.executed.at(each["t"])[0], atol=1e-6)
    np.testing.assert_allclose(viewer.moment.actual, planned().trajectory(planned().trajectory.duration), atol=1e-4)
    assert dict(viewer.show.facts)["Execution"] == "done"
    assert state(viewer) == {"running": False, "runs": 1, "words": "ideal: done"}
    assert b"on the drive ideal" in ask(viewer, "")
    assert viewer.url.startswith("http://127.0.0.1:")


def test_a_simulated_drive_is_stopped_on_request(viewer: Viewer) -> None:
    press(viewer, "start")
    end = time.monotonic() + 60.0
    while state(viewer).get("t", 0.0) < 0.1:
        assert time.monotonic() < end
    press(viewer, "stop")
    until_done(viewer)
    assert dict(viewer.show.facts)["Execution"] == "stopped"


def test_other_pages_cannot_run_it_and_no_real_drive_is_run(viewer: Viewer) -> None:
    for options in ({"method": "POST"}, {"method": "POST", "headers": {"Content-Type": "text/plain"}}):
        assert refused(viewer, "start", **options) == 403
    assert refused(viewer, "../etc/passwd") == 404
    assert not state(viewer)["running"] and viewer.runs == 0

    class Real:
        simulated = False

    with pytest.raises(InvalidInput, match="simulated"):
        Viewer(show_motion(planned()), port=0, plan=planned(), drive=Real)  # type: ignore[arg-type]


def test_without_a_drive_the_page_is_that_of_a_file() -> None:
    viewer = Viewer(show_motion(planned()), port=0)
    try:
        assert ask(viewer, "").decode() == make_page(show_motion(planned()))
    finally:
        viewer.close()


def test_the_page_follows_the_simulated_drive(viewer: Viewer, tmp_path: Path) -> None:
    if CHROMIUM is None:
        pytest.skip("no Chromium on this machine")
    with Browser(tmp_path) as browser:
        browser.emulate(width=1280)
        browser.send("Page.navigate", url=viewer.url)
        browser.until("window.optikView && document.getElementById('run') && !document.getElementById('run').disabled")
        browser.run("document.getElementById('run').click()")
        on_its_way = "window.optikView && optikView.shown.time > 0.1 && !document.getElementById('halt').disabled"
        browser.until(f"{on_its_way} && document.getElementById('joints').textContent.includes('–°/s')")
        browser.until("document.title.includes('ideal') && window.optikView")
        browser.until("document.getElementById('words').textContent === 'ideal: done'")
        assert browser.errors == []


def test_the_server_as_a_process_shows_it_on_loopback_and_ends_with_ctrl_c(motion: Path, tmp_path: Path) -> None:
    command = [sys.executable, "-m", "benchmarks.cli", "view", str(motion), "--port", "0"]
    environment = os.environ | {"PYTHONPATH": str(REPOSITORY), "COLUMNS": "200"}
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=environment
    ) as process:
        try:
            line = next(line for line in process.stdout if "Ctrl-C" in line)
            url = line.split()[0]
            assert url.startswith("http://127.0.0.1:")
            with urlopen(url, timeout=30) as answer:
                assert answer.status == 200
            if CHROMIUM is not None:
                seen_in_chromium(url, tmp_path)
        finally:
            process.send_signal(signal.SIGINT)
            _, said = process.communicate(timeout=30)
    assert process.returncode == 0
    assert "Traceback" not in said
    with pytest.raises(OSError, match=r"refused|reset"):
        urlopen(url, timeout=5)


def seen_in_chromium(url: str, scratch: Path) -> None:
    with Browser(scratch) as browser:
        browser.emulate(width=1280)
        browser.send("Page.navigate", url=url)
        browser.until("window.optikView && document.body.textContent.includes('20.00°')")
        assert browser.run("document.getElementById('run')") is None
        browser.run("document.getElementById('play').click()")
        browser.until("document.body.textContent.includes('52.74°')", 30.0)  # where it ends
        assert browser.errors == []
        assert {asked for asked in browser.requests if not asked.startswith((url, "about:"))} == set()
