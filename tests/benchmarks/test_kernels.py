"""`optik kernels` says what is shipped and what was compiled here, and why; its processes compile into the cache."""

import json
import os
import threading
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numba.core.registry import cpu_target

from benchmarks.cli.installation import KernelsCommand
from benchmarks.kernels import build, parts
from optik.compiled import archive, compiled
from optik.compiled.cache import VERSIONS, read_code
from optik.errors import InvalidInput, OutputError
from optik.file_io import locked
from optik.linear import cholesky_solve, copy_matrix, copy_vector
from optik.plugins.files import import_file


def test_the_list_says_why_a_kernel_was_compiled_here(
    typed: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, request: pytest.FixtureRequest
) -> None:
    request.addfinalizer(archive.open_archive.cache_clear)  # after the folder of archives is the package's again
    cache, target = tmp_path / "cache", archive.CompileTarget(*cpu_target.target_context.codegen().magic_tuple())
    monkeypatch.setattr("numba.core.config.CACHE_DIR", str(cache))
    monkeypatch.setattr(archive, "ARCHIVES", tmp_path)
    monkeypatch.setenv("OPTIK_COMPILES", "native")

    def listed() -> Any:
        archive.open_archive.cache_clear()
        return json.loads(typed("kernels", "--json")[1])

    archive.open_archive.cache_clear()
    compiled(copy_vector.py_func)(np.zeros(2), np.zeros(2))
    compiled(copy_matrix.py_func)(np.zeros((2, 2)), np.zeros((2, 2)))
    compiled(cholesky_solve.py_func)(np.eye(2), np.zeros(2))
    assert {row["why"] for row in listed()["cached"]} == {"no kernels are shipped"}
    found = [(*read_code(file).popitem(), file.name.rpartition("-")[0]) for file in sorted(cache.rglob("*.nbk"))]
    assert len(found) > 2
    (print0, code0, name0), (_, code1, name1) = found[:2]
    shipped = {print0: (name0, code0), "0" * 64: (name1, code1)}
    archive.pack_archive(tmp_path / archive.file_name(), VERSIONS, target._replace(cpu="generic"), shipped)
    out = listed()
    assert out["shipped"].startswith("2 kernels for generic")
    assert out["shipped"].endswith(" used")
    why = {row["kernel"]: row["why"] for row in out["cached"]}
    assert why.pop(name0) == "compiled here although shipped"
    assert "damaged" in why.pop(name1)
    assert set(why.values()) == {"not shipped for these arguments"}
    archive.pack_archive(tmp_path / archive.file_name(), ["numba 0.1"], target, shipped)
    out = listed()
    assert "numba 0.1" in out["shipped"]
    assert {row["why"] for row in out["cached"]} == {"the shipped kernels are not used here"}


def test_native_without_compile_is_refused() -> None:
    with pytest.raises(InvalidInput, match="--native"):
        KernelsCommand(native=True).run()


def test_a_part_that_fails_is_named() -> None:
    assert parts.run_parts(["nothing"], 2, print) == {"nothing": "KeyError: 'nothing'"}


def test_a_process_tells_what_it_compiles(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture
) -> None:
    monkeypatch.setattr("numba.core.config.CACHE_DIR", str(tmp_path))
    monkeypatch.setitem(parts.SHIPPED, "one", lambda: os.write(1, str(compiled(half)(3.0)).encode()))
    saved = os.dup(1)
    try:
        parts.main("one")
    finally:
        os.dup2(saved, 1)
    assert capfd.readouterr().out == f"{half.__module__}.half\n"
    assert len(list(tmp_path.rglob("*.nbk"))) == 1


def test_kernels_of_plug_in_files_are_not_packed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    cache, file = tmp_path / "cache", tmp_path / "linear.py"
    monkeypatch.setattr("numba.core.config.CACHE_DIR", str(cache))
    monkeypatch.setenv("OPTIK_COMPILES", "native")
    file.write_text("from optik.compiled import compiled\n\n@compiled\ndef twice(x):\n    return 2.0 * x\n")
    assert import_file(file).twice(1.5) == 3.0
    compiled(half)(3.0)
    compiled(copy_vector.py_func)(np.zeros(2), np.zeros(2))
    assert len(list(cache.rglob("*.nbk"))) == 3
    assert [name.partition("-")[0] for _, (name, _) in build._kernels(cache)] == ["linear.copy_vector"]


def half(x: float) -> float:
    return x / 2.0


def test_one_run_compiles_at_a_time(tmp_path: Path) -> None:
    order = []

    def second() -> None:
        with locked(tmp_path, wait=True):
            order.append("second")

    thread = threading.Thread(target=second)
    with locked(tmp_path):
        with pytest.raises(OutputError), locked(tmp_path):
            pass
        thread.start()
        time.sleep(0.5)
        order.append("first")
    thread.join(30)
    assert order == ["first", "second"]


def test_where_there_is_no_terminal_progress_is_a_line_now_and_then(
    capsys: pytest.CaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    now = [0.0]
    monkeypatch.setattr(time, "monotonic", lambda: now[0])
    progress = parts.Progress()
    for seconds in (1.0, 11.0, 12.0, 25.0):
        now[0] = seconds
        progress("a.kernel")
    assert progress.end() == "4 kernels in 25 s"
    assert capsys.readouterr().err.splitlines() == [
        "compiled 2 kernels in 11 s: a.kernel", "compiled 4 kernels in 25 s: a.kernel",
    ]  # fmt: skip
