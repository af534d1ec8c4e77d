"""Processes that begin as copies of one with our packages: imports are most of the time of a short process."""

import os
import sys
import tempfile
from collections.abc import Callable
from multiprocessing import get_context
from pathlib import Path
from subprocess import CompletedProcess
from typing import Any

SERVER: Any = get_context("forkserver" if sys.platform.startswith("linux") else "spawn")
SERVER.set_forkserver_preload(["tests.preloaded"])


def run_code(code: str, arguments: tuple[str, ...], streams: str, cwd: Path, env: dict[str, str], before: Any) -> None:
    """What a process does: as Python with -c, but its streams are files."""
    for number, name in ((1, "out"), (2, "err")):
        os.dup2(os.open(f"{streams}/{name}", os.O_WRONLY | os.O_CREAT), number)
    os.environ.clear()
    os.environ.update(env)
    from numba.core import config

    config.reload_config()
    sys.argv, sys.path[:0] = ["-c", *arguments], ["", *env.get("PYTHONPATH", "").split(os.pathsep)]
    os.chdir(cwd)
    if before:
        before()
    exec(compile(code, "<string>", "exec"), {"__name__": "__main__"})


def start(
    code: str, *arguments: str, cwd: Path, env: dict[str, str] | None = None, before: Callable[[], None] | None = None
) -> Callable[[], CompletedProcess[str]]:
    """Start a process; what is returned waits for its end."""
    streams = tempfile.TemporaryDirectory()
    given = code, arguments, streams.name, cwd, dict(os.environ if env is None else env), before
    process = SERVER.Process(target=run_code, args=given)
    process.start()

    def wait() -> CompletedProcess[str]:
        process.join(120)
        assert process.exitcode is not None, "it does not end"
        with streams as folder:
            out, err = ((Path(folder) / name).read_text() for name in ("out", "err"))
        return CompletedProcess([*arguments], process.exitcode, out, err)

    return wait
