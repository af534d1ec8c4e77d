"""Processes that begin as copies of one with our packages: imports are most of the time of a short process."""

import os
import sys
import tempfile
from collections.abc import Callable
from multiprocessing import get_context
from pathlib import Path
from subprocess import CompletedProcess
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
SERVER: Any = get_context("forkserver" if sys.platform.startswith("linux") else "spawn")
SERVER.set_forkserver_preload(["tests.preloaded"])
SECONDS = 120.0
"""After which a process is killed."""
COMMAND = "from benchmarks.cli.app import main; main()"
STREAMS = ("in", "out", "err")


def run_code(code: str, arguments: tuple[str, ...], folder: str, cwd: Path, env: dict[str, str], before: Any) -> None:
    """What a process does: as Python with -c, but its streams are files."""
    for number, name in enumerate(STREAMS):
        os.dup2(os.open(f"{folder}/{name}", os.O_WRONLY if number else os.O_RDONLY), number)
    os.environ.clear()
    os.environ.update(env)
    from numba.core import config

    config.reload_config()
    sys.stdin, sys.argv = os.fdopen(0, closefd=False), ["-c", *arguments]
    sys.path[:0] = ["", *filter(None, env.get("PYTHONPATH", "").split(os.pathsep))]
    os.chdir(cwd)
    if before:
        before()
    exec(compile(code, "<string>", "exec"), {"__name__": "__main__"})


def start(
    code: str, *arguments: str, cwd: Path = ROOT, env: dict[str, str] | None = None, data: bytes = b"",
    before: Callable[[], None] | None = None,
) -> Callable[[], CompletedProcess[Any]]:  # fmt: skip
    """Start a process; what is returned waits for its end. With data as input, its output is bytes, too."""
    streams = tempfile.TemporaryDirectory()
    files = [Path(streams.name) / name for name in STREAMS]
    for file in files:
        file.write_bytes(data if file.name == "in" else b"")
    given = code, arguments, streams.name, cwd, dict(os.environ if env is None else env), before
    process = SERVER.Process(target=run_code, args=given)
    process.start()

    def wait() -> CompletedProcess[Any]:
        process.join(SECONDS)
        if process.exitcode is None:
            process.kill()
            process.join()
        with streams:
            said = [file.read_bytes() for file in files[1:]]
        return CompletedProcess(arguments, process.exitcode, *(said if data else [x.decode() for x in said]))

    return wait


def command(*typed: str, **variables: str) -> CompletedProcess[Any]:
    """What a command says as it is typed, with further variables of the environment."""
    return start(COMMAND, *typed, env=os.environ | variables)()
