"""A run folder is one process's at a time, knows its own tables, and refuses what is damaged, foreign or not writable."""

from __future__ import annotations

import os
import shutil
import subprocess
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import polars as pl
import pytest

from benchmarks.records import RunFolder
from benchmarks.run import run_suite
from benchmarks.suite import Suite, suite_of
from optik.errors import InvalidInput, OptikError, OutputError
from optik.file_io import LOCK, locked
from tests import forks
from tests.benchmarks.toy import TOY_COMMAND
from tests.oracles import REPOSITORY


def toy(**block: Any) -> Suite:
    return suite_of("toy", {"toy": [{"id": "squares"} | block]})


def run(out: Path, **block: Any) -> RunFolder:
    return run_suite(toy(**block), out)


def state(out: Path) -> dict[str, tuple[int, int]]:
    return {f.name: (f.stat().st_ino, f.stat().st_mtime_ns) for f in (out / "rows/toy").glob("squares--*.parquet")}


# ---------------------------------------------------------------- one process at a time


def test_two_processes_do_not_work_in_one_folder(tmp_path: Path) -> None:
    with locked(tmp_path / "run"):
        code = "from pathlib import Path; from optik.file_io import locked; locked(Path(r'{}')).__enter__()"
        done = forks.start(code.format(tmp_path / "run"))()
        assert f"another process writes to it (process {os.getpid()})" in done.stderr
        with pytest.raises(OutputError, match="another process"):
            run(tmp_path / "run")
    assert run(tmp_path / "run").manifest()["complete"], "the lock of a process that is done is gone"
    assert not (tmp_path / "run" / LOCK).exists()


def test_the_lock_of_a_dead_process_is_taken_over(tmp_path: Path) -> None:
    (tmp_path / "run").mkdir()
    (tmp_path / "run" / LOCK).write_text("1")
    assert run(tmp_path / "run").manifest()["complete"]


# ---------------------------------------------------------------- begun and continued


def test_the_folder_is_there_before_the_problem_sets(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    suite, seen = toy(), []
    monkeypatch.setattr(
        type(suite.kinds[0]), "prepare", lambda *a: seen.append(RunFolder(tmp_path / "run").manifest()["complete"])
    )
    run_suite(suite, tmp_path / "run")
    assert seen == [False]


def test_what_a_kill_leaves_is_removed_and_a_line_that_is_cut_is_no_harm(tmp_path: Path) -> None:
    out = run(tmp_path / "run").path
    before = state(out)
    (out / "rows/toy" / ".0123456789ab.part").write_bytes(b"half")
    with (out / "parts.jsonl").open("a") as ledger:
        ledger.write('["rows/toy/squares--0')
    (out / "rows/toy" / "squares--001.parquet").unlink()
    run(out)
    after = state(out)
    assert not list(out.rglob("*.part"))
    assert {name: after[name] for name in before if "001" not in name} == {
        n: s for n, s in before.items() if "001" not in n
    }
    assert RunFolder(out).rows("toy", "squares")["square"].to_list() == [float(i * i) for i in range(12)]


def test_sessions_that_are_alike_are_counted(tmp_path: Path) -> None:
    folder = run(tmp_path / "run")
    for _ in range(5):
        folder.write_json("run.json", folder.manifest() | {"complete": False})
        run(tmp_path / "run")
    continued = folder.manifest()["continued"]
    assert [one["sessions"] for one in continued] == [5]


def test_a_continued_run_names_every_session_that_worked(tmp_path: Path) -> None:
    folder = run(tmp_path / "run")
    first = folder.manifest()
    with ThreadPoolExecutor(1) as one:
        assert run_suite(toy(), folder.path, workers=3, executor=one).manifest() == first
        folder.write_json("run.json", first | {"complete": False})
        next((folder.path / "rows/toy").iterdir()).unlink()
        again = run_suite(toy(), folder.path, workers=3, executor=one).manifest()
    assert again["provenance"] == first["provenance"]
    assert [session["workers"] for session in again["continued"]] == [3]


def test_a_folder_that_was_only_just_made_is_used(tmp_path: Path) -> None:
    (tmp_path / LOCK).touch()
    (tmp_path / ".0123456789ab.part").touch()
    assert run(tmp_path).manifest()["complete"]


# ---------------------------------------------------------------- damaged and foreign tables


def flip(file: Path) -> None:
    content = bytearray(file.read_bytes())
    content[len(content) // 3] ^= 1
    file.write_bytes(content)


def cut(file: Path) -> None:
    file.write_bytes(file.read_bytes()[:40])


def text(file: Path) -> None:
    file.write_text("no Parquet")


def other_run(file: Path) -> None:
    other = run(file.parents[1].with_name("other"), bad={"3": "raises"})
    shutil.copy(other.path / "rows/toy" / file.name, file)


def beside(file: Path) -> None:
    shutil.copy(file, file.with_name("squares--099.parquet"))


@pytest.mark.parametrize("harm", [flip, cut, text, other_run, beside])
def test_a_table_that_this_run_did_not_write_is_refused_when_continued_and_when_read(
    harm: Callable[[Path], None], tmp_path: Path
) -> None:
    out = run(tmp_path / "run").path
    harm(out / "rows/toy" / "squares--000.parquet")
    before = state(out)
    for use in (lambda: run(out), lambda: RunFolder(out).rows("toy", "squares")):
        with pytest.raises(InvalidInput, match=r"squares--0(00|99)") as caught:
            use()
        assert "\n" not in str(caught.value)
    assert state(out) == before
    (out / "rows/toy" / ("squares--099.parquet" if harm is beside else "squares--000.parquet")).unlink()
    run(out)
    assert len(RunFolder(out).rows("toy", "squares")) == 12


def test_a_run_of_an_older_version_is_read_and_continued(tmp_path: Path) -> None:
    out = run(tmp_path / "run").path
    (out / "parts.jsonl").unlink()
    assert len(RunFolder(out).rows("toy", "squares")) == 12
    (out / "rows/toy" / "squares--002.parquet").unlink()
    before = state(out)
    run(out)
    assert len(RunFolder(out).rows("toy", "squares")) == 12
    assert state(out).items() >= before.items()


def test_rows_have_the_columns_of_their_problems_and_not_of_a_block_of_the_same_name(tmp_path: Path) -> None:
    folder = RunFolder(tmp_path)
    folder.write("problems/line.parquet", pl.DataFrame({"problem": [0, 1], "group": ["a", "b"]}))
    for kind, problems in (("calls", [1, 0]), ("timing", ["the line", "the line"])):
        folder.write(f"rows/{kind}/line--0000.parquet", pl.DataFrame({"method": ["lm", "dls"], "problem": problems}))
    joined, alone = folder.rows("calls", "line"), folder.rows("timing", "line")
    assert joined is not None and alone is not None
    assert joined["group"].to_list() == ["b", "a"]
    assert alone.columns == ["method", "problem"] and len(alone) == 2


# ---------------------------------------------------------------- disks


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    """A file system of 64 kB."""
    place = tmp_path / "disk"
    place.mkdir()
    if subprocess.run(["mount", "-t", "tmpfs", "-o", "size=64k", "tmpfs", str(place)], check=False).returncode != 0:
        pytest.skip("file systems cannot be mounted here")
    yield place
    subprocess.run(["umount", "-l", str(place)], check=True)


def test_a_full_disk_is_one_line_and_what_is_done_stays(small_disk: Path) -> None:
    with pytest.raises(OutputError, match="No space left on device") as caught:
        run(small_disk / "run", count=4000, part=20)
    assert "\n" not in str(caught.value)
    done = state(small_disk / "run")
    assert len(done) > 3
    assert not list(small_disk.rglob("*.part"))
    subprocess.run(["mount", "-o", "remount,size=4m", str(small_disk)], check=True)
    whole = run(small_disk / "run", count=4000, part=20)
    assert state(small_disk / "run").items() >= done.items()
    assert whole.rows("toy", "squares")["problem"].to_list() == list(range(4000))


def test_a_run_that_a_full_disk_stopped_before_its_first_rows_is_resumed(small_disk: Path) -> None:
    block = {
        "id": "a",
        "robot": "paper6r",
        "set": "near_start",
        "options": {"count": 3000},
        "methods": [{"solver": "lm"}],
    }
    suite = suite_of("full", {"calls": [block | {"rounds": 1}]})
    with pytest.raises(OutputError, match="No space left on device"):
        run_suite(suite, small_disk / "run")
    assert not list(small_disk.rglob("*.parquet")) and (small_disk / "run/run.json").is_file()
    subprocess.run(["mount", "-o", "remount,size=4m", str(small_disk)], check=True)
    assert len(run_suite(suite, small_disk / "run").rows("calls", "a")) == 3000


def test_a_disk_that_is_read_only_is_one_line(small_disk: Path) -> None:
    out = run(small_disk / "run").path
    (out / "run.json").write_text((out / "run.json").read_text().replace('"complete": true', '"complete": false'))
    subprocess.run(["mount", "-o", "remount,ro", str(small_disk)], check=True)
    for where in (out, small_disk / "new"):
        with pytest.raises(OutputError, match="Read-only file system") as caught:
            run(where)
        assert "\n" not in str(caught.value)
    assert len(RunFolder(out).rows("toy", "squares")) == 12


# ---------------------------------------------------------------- errors in parts


@pytest.mark.parametrize(("how", "why"), [("raises", "ZeroDivisionError: on purpose"), ("exits", "SystemExit: 3")])
def test_a_part_that_raises_is_recorded_and_the_run_says_so(tmp_path: Path, how: str, why: str) -> None:
    folder = run(tmp_path / "run", bad={"5": how})
    assert folder.manifest()["complete"] is True
    assert [(o["why"], o["times"]) for o in folder.manifest()["failed"]] == [(why, 1)]
    rows = folder.rows("toy", "squares")
    assert rows.filter(pl.col("square").is_infinite())["problem"].to_list() == [5]


def test_a_part_that_cannot_be_divided_leaves_the_run_incomplete_until_it_is_done(tmp_path: Path) -> None:
    suite = tmp_path / "suite.toml"
    suite.write_text('[[toy]]\nid = "squares"\ndivisible = false\nbad = { 5 = "raises" }\n')
    done = subprocess.run(
        [*TOY_COMMAND, "bench", "run", str(suite), "--out", str(tmp_path / "run")],
        capture_output=True, text=True, check=False, cwd=REPOSITORY,
    )  # fmt: skip
    assert done.returncode == 1
    assert "failed: squares (rows/toy/squares--001.parquet): ZeroDivisionError: on purpose\n" in done.stderr
    assert "Traceback" not in done.stderr
    folder = RunFolder(tmp_path / "run")
    assert folder.manifest()["complete"] is False
    assert len(folder.rows("toy", "squares")) == 8


def test_wrong_options_of_a_run_are_refused(tmp_path: Path) -> None:
    for wrong in ({"part_timeout": 0.0}, {"part_timeout": float("nan")}, {"workers": 0}):
        with pytest.raises(OptikError):
            run_suite(toy(), tmp_path / "run", **wrong)
    assert not (tmp_path / "run").exists()
