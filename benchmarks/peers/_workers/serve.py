"""Serve one method of another package: requests on standard input, answers on standard output, one JSON value per line.

Run as ``python -I serve.py METHOD_FILE`` by the interpreter of the environment that has the package. This file and METHOD_FILE
import nothing of ours: one of the packages has the import name ``optik``, too. METHOD_FILE defines ``METHOD``, a class that is
built from a model (for IK ``urdf``, its file ``urdf_file``, and ``iterations`` or None), and raises ValueError for an arm that
it does not support, with the methods ``prepared(*problem)``, ``call``, the timed part, ``answer(raw)``, and for IK ``fk(q)``.
``answer`` returns plain data and arrays: for IK configuration or None, iterations and claim.
"""

import gc
import json
import os
import runpy
import sys
import tempfile
import time
from typing import Any, TextIO


def main() -> None:
    """Answer requests until standard input ends."""
    answers = os.fdopen(os.dup(1), "w", encoding="ascii")
    os.dup2(2, 1)  # what a package prints must not be taken for an answer
    method: Any = None
    for line in sys.stdin:
        request = json.loads(line)
        if "model" in request:
            method, reply = _build(request["model"])
            _say(answers, reply)
        for problem in request.get("problems", ()):
            _say(answers, _solve(method, request["do"], problem))


def _build(model: dict[str, Any]) -> tuple[Any, dict[str, Any]]:
    folder = tempfile.TemporaryDirectory()
    try:
        if "urdf" in model:
            model["urdf_file"] = os.path.join(folder.name, "arm.urdf")
            with open(model["urdf_file"], "w", encoding="utf-8") as stream:
                stream.write(model["urdf"])
        return runpy.run_path(sys.argv[1])["METHOD"](model), {}
    except ValueError as error:
        return None, {"refused": str(error)}
    except Exception as error:
        return None, {"error": f"{type(error).__name__}: {error}"}
    finally:
        folder.cleanup()


def _solve(method: Any, do: str, problem: list[Any]) -> dict[str, Any]:
    """Time one call, without reading the request and writing the answer."""
    clock, cpu = time.perf_counter_ns, time.process_time_ns
    given, call = (method.prepared(*problem), method.call) if do == "call" else (problem, getattr(method, do))
    gc.disable()
    begin_cpu, begin = cpu(), clock()
    try:
        raw = call(*given)
    except Exception as error:
        raw = error
    end, end_cpu = clock(), cpu()
    gc.enable()
    times = {"ns": end - begin, "cpu_ns": end_cpu - begin_cpu}
    if isinstance(raw, Exception):
        return {"error": f"{type(raw).__name__}: {raw}"[:200]} | times
    return {"answer": method.answer(raw) if do == "call" else raw} | times


def _say(answers: TextIO, value: dict[str, Any]) -> None:
    answers.write(json.dumps(value, default=lambda array: array.tolist()) + "\n")
    answers.flush()


if __name__ == "__main__":
    main()
