"""`optik view`: pages and a server as people ask for them, rightly and wrongly; the server as a process of its own."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from urllib.request import urlopen

import numpy as np
import pytest

from optik.errors import InvalidInput
from planners.cell.drives import Drive, make_drive
from planners.cell.view.live import Viewer
from planners.cell.view.show import show_motion
from tests.benchmarks.browser import CHROMIUM, Browser
from tests.benchmarks.conftest import hide
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


def test_a_page_needs_no_viser_and_the_server_names_the_extra(
    typed: Any, motion: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    hide(monkeypatch, "viser")
    assert typed("view", str(motion), "--html", str(tmp_path / "page.html"))[0] == 0
    status, _, said = typed("view", str(motion), "--port", "0")
    assert status == 2
    assert "optik-toolkit[view]" in said


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
    pytest.importorskip("viser")

    def drive() -> Drive:
        return make_drive("ideal", planned().robot, pace=2.0)

    made = Viewer(show_motion(planned()), port=0, plan=planned(), drive=drive)
    yield made
    made.close()


def until_done(viewer: Viewer) -> None:
    end = time.monotonic() + 60.0
    while viewer.thread is not None:
        viewer.step(0.02)
        time.sleep(0.02)
        assert time.monotonic() < end


def test_a_simulated_drive_is_followed_and_then_shown(viewer: Viewer) -> None:
    viewer.start()
    until_done(viewer)
    assert viewer.moment is not None and viewer.show.executed is not None
    np.testing.assert_allclose(viewer.moment.actual, planned().trajectory(planned().trajectory.duration), atol=1e-4)
    assert dict(viewer.show.facts)["Execution"] == "done"
    last = viewer.stage.frames[-1]
    np.testing.assert_allclose(last.position, planned().robot.fk(viewer.show.executed.q[-1])[:3, 3], atol=1e-6)
    assert viewer.url.startswith("http://127.0.0.1:")


def test_a_simulated_drive_is_stopped_on_request(viewer: Viewer) -> None:
    viewer.start()
    end = time.monotonic() + 60.0
    while viewer.moment is None or viewer.moment.t < 0.1:
        viewer.step(0.02)
        time.sleep(0.005)
        assert time.monotonic() < end
    viewer.stopped.set()
    until_done(viewer)
    assert dict(viewer.show.facts)["Execution"] == "stopped"


def test_it_plays_to_the_end(viewer: Viewer) -> None:
    viewer.play(True)
    viewer.step(0.3)
    assert viewer.time.value == pytest.approx(0.3)
    q = planned().trajectory(0.3)
    np.testing.assert_allclose(viewer.stage.frames[-1].position, planned().robot.fk(q)[:3, 3], atol=1e-6)
    viewer.step(1.0)
    assert not viewer.playing
    assert viewer.time.value == pytest.approx(viewer.show.duration)


def test_nothing_is_ever_shared_and_no_real_drive_is_run(viewer: Viewer) -> None:
    assert viewer.server.request_share_url() is None
    assert viewer.server._share_tunnel is None

    class Real:
        simulated = False

    with pytest.raises(InvalidInput, match="simulated"):
        Viewer(show_motion(planned()), port=0, plan=planned(), drive=Real)  # type: ignore[arg-type]


def test_the_server_as_a_process_shows_it_on_loopback_and_ends_with_ctrl_c(motion: Path, tmp_path: Path) -> None:
    pytest.importorskip("viser")
    command = [sys.executable, "-m", "benchmarks.cli", "view", str(motion), "--port", "0"]
    environment = os.environ | {"PYTHONPATH": str(REPOSITORY), "COLUMNS": "200"}
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=environment
    ) as process:
        try:
            assert process.stdout is not None
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
        browser.until("document.querySelector('canvas') && document.body.textContent.includes('20.00°')")
        buttons = browser.run("[...document.querySelectorAll('button')].map(b => b.textContent).filter(Boolean)")
        assert "Play" in buttons
        assert not any("share" in words.lower() for words in buttons)
        browser.run("[...document.querySelectorAll('button')].find(b => b.textContent === 'Play').click()")
        browser.until("document.body.textContent.includes('52.74°')", 30.0)  # where it ends
        assert [words for words in browser.errors if "deprecated" not in words] == []
        assert {asked for asked in browser.requests if not asked.startswith((url, "about:"))} == set()
