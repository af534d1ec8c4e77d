"""Callers that refuse, raise, crash, hang, lie or cheat: each is recorded as what it did, and the run goes on."""

from __future__ import annotations

import hashlib
import sys
import threading
import time
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import polars as pl
import pytest
from typer.testing import CliRunner

import optik
from benchmarks.blocks.block import Entry
from benchmarks.blocks.contest import Contestant, callers_of, timed_part
from benchmarks.cli.app import app
from benchmarks.peers import worker as workers
from benchmarks.peers.base import Absent, Failed
from benchmarks.peers.ik.base import Solutions, SolverPeer, WorkerSolver
from benchmarks.problems.base import ProblemSet
from benchmarks.problems.near_start import near_start
from benchmarks.suite import suite_of
from optik.errors import InvalidInput, Unsupported

ARM = optik.load("paper6r")


@cache
def problems() -> ProblemSet:
    """Six problems: drawn in a test, not where tests are collected, since kernels are compiled then."""
    return near_start(ARM, 5, count=6)


def caller(call: Callable[..., Any], answers: Any = lambda raw: raw[None], **more: Any) -> Contestant:
    more = {"about": {}, "read": lambda raw: Solutions(answers(raw))} | more
    return Contestant(Entry("x", "x", {}), call=call, **more)


def rows_of(call: Callable[..., Any], rounds: int = 3, **more: Any) -> pl.DataFrame:
    everyone = np.arange(len(problems()))
    return timed_part(ARM, problems(), everyone, [caller(call, **more)], rounds).sort("problem")


def nth(calls: list[int], n: int) -> bool:
    """Whether this is the n-th problem of a round of six."""
    calls.append(0)
    return (len(calls) - 1) % len(problems()) == n


# ---------------------------------------------------------------- outcomes


def test_an_exception_of_a_call_is_a_failed_call_and_a_refusal_is_none() -> None:
    calls: list[int] = []

    def call(target: Any, q0: Any) -> Any:
        if nth(calls, 1):
            raise ZeroDivisionError("by zero")
        if len(calls) % 6 == 4:
            raise Unsupported("task", "axis_x", '"pose"')
        return q0 if len(calls) % 6 else np.full(6, np.nan)

    rows = rows_of(call)
    assert rows["outcome"].to_list() == ["answered", "raised", "answered", "refused", "answered", "none"]
    assert rows["error"][1] == "ZeroDivisionError: by zero"
    assert "axis_x" in rows["error"][3]
    assert rows["error"].null_count() == 4
    assert (rows["ns"] > 0).all()
    assert not rows["solved"][1]


@pytest.mark.parametrize(
    "answers", [lambda raw: raw, lambda raw: [["q"]], lambda raw: 1 / 0, lambda raw: np.ones((1, 5))]
)
def test_answers_that_cannot_be_read_are_failed_calls(answers: Any) -> None:
    rows = rows_of(lambda target, q0: q0, answers=answers)
    assert set(rows["outcome"]) == {"raised"}
    assert rows["error"].null_count() == 0


def test_a_method_that_does_not_support_the_arm_is_refused_and_the_others_run() -> None:
    block = suite_of(
        "x",
        {
            "calls": [
                {
                    "id": "a", "robot": "panda", "set": "near_start",
                    "methods": [{"solver": "dls"}, {"solver": "closed_form", "options": {"backend": "eaik"}}],
                    "peers": [{"peer": "eaik", "label": "EAIK"}, {"peer": "ssik", "iterations": 3}],
                }
            ]
        },
    ).of("calls")[0]  # fmt: skip
    ready, absent = callers_of(block, optik.load("panda"))
    assert [c.label for c in ready] == ["dls"]
    assert {label: about["outcome"] for label, about in absent.items()} == dict.fromkeys(
        ("closed_form", "EAIK", "ssik"), "refused"
    )
    assert "does not support panda" in absent["EAIK"]["absent"]
    assert "iterations" in absent["ssik"]["absent"]


def test_wrong_options_are_no_refusal() -> None:
    from benchmarks.blocks.contest import build_ours

    with pytest.raises(InvalidInput, match="dampnig"):
        build_ours(Entry("x", "dls", {"dampnig": 1.0}), ARM)


# ---------------------------------------------------------------- cheats


def test_a_claim_stands_beside_our_judgement() -> None:
    rows = rows_of(lambda target, q0: q0 + 0.5, read=lambda raw: Solutions(raw[None], claimed=True))
    assert rows["claimed"].all()
    assert not rows["solved"].any()
    assert rows_of(lambda target, q0: q0)["claimed"].null_count() == 6


def test_a_caller_that_writes_into_its_arguments_gains_nothing_and_is_told() -> None:
    starts: list[Any] = []

    def call(target: Any, q0: Any) -> Any:
        starts.append(q0.copy())
        q0 += 0.25
        target[:] = ARM.fk(q0)
        return q0

    rows = rows_of(call)
    assert rows["changed_input"].all()
    assert not rows["solved"].any()
    for i in range(6):  # every round starts from the problem's own start
        assert all(np.array_equal(start, problems().starts[i]) for start in starts[i::6])
    assert not rows_of(lambda target, q0: q0)["changed_input"].any()


def test_work_that_is_put_off_until_the_answer_is_read_is_timed() -> None:
    def late(raw: Any) -> Any:
        time.sleep(0.002)
        return raw[None]

    rows = rows_of(lambda target, q0: q0, answers=late)
    assert (rows["answers_ns"] > 1_500_000).all()
    assert (rows["ns"] < rows["answers_ns"]).all()


def test_remembered_answers_show_in_the_first_time() -> None:
    known: set[bytes] = set()

    def call(target: Any, q0: Any) -> Any:
        if target.tobytes() not in known:
            known.add(target.tobytes())
            time.sleep(0.002)
        return q0

    many = near_start(ARM, 5, count=30)  # the first 20 are called before the first round
    rows = timed_part(ARM, many, np.arange(30), [caller(call)], 3).sort("problem")
    assert (rows["first_ns"][20:] > 1_500_000).all()
    assert rows["ns"].median() < 500_000  # type: ignore[operator]


def test_threads_of_a_caller_show_in_the_processor_time() -> None:
    data = bytes(4_000_000)

    def call(target: Any, q0: Any) -> Any:
        # it lets other threads run meanwhile, as compiled code does
        threading.Thread(target=lambda: hashlib.sha256(data).digest()).start()
        return q0

    alone = rows_of(lambda target, q0: q0)["cpu_ns"].max()
    assert rows_of(call)["cpu_ns"].min() > 20 * alone  # type: ignore[operator]


class Lies(SolverPeer):
    """A peer with another model of the arm."""

    distribution, package, settings = "numpy", "numpy", "none"
    shift: ClassVar[float] = 1e-3

    def __init__(self, robot: optik.Robot, *, iterations: int | None = None) -> None:
        self.robot = robot
        self.call = lambda target, q0: q0

    def read(self, raw: Any) -> Solutions:
        return Solutions(raw[None])

    def fk(self, q: Any) -> Any:
        T = self.robot.fk(q)
        T[0, 3] += self.shift
        return T


def test_a_peer_with_another_model_is_never_timed(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(Absent) as absent:
        Lies.build(ARM)
    assert absent.value.outcome == "differs"
    assert absent.value.why == "its model differs from optik's by 1.0e-03 m, and by 0.0e+00 in the rotation matrix"
    monkeypatch.setattr(Lies, "shift", 1e-11)
    assert isinstance(Lies.build(ARM), Lies)
    monkeypatch.setattr(Lies, "shift", np.nan)
    with pytest.raises(Absent, match="differs"):
        Lies.build(ARM)


# ---------------------------------------------------------------- worker processes


def test_the_command_says_how_a_peer_is_called_and_what_it_lacks(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("OPTIK_PEERS", str(tmp_path))
    said = CliRunner().invoke(app, ["bench", "peer", "placo"])
    assert said.exit_code == 0
    assert said.stdout.startswith(f"placo: no environment in {tmp_path / 'placo'}: optik bench peer placo --install\n")
    assert "KinematicsSolver" in said.stdout
    refused = CliRunner().invoke(app, ["bench", "peer", "eaik", "--install"])
    assert isinstance(refused.exception, InvalidInput)
    assert "pip install EAIK" in str(refused.exception)
    assert not list(tmp_path.iterdir())


SCRIPT = """
import os, sys, time
class Method:
    def __init__(self, model):
        if "refuse" in {mode!r}: raise ValueError("seven joints")
        if "broken" in {mode!r}: import nothing_like_that
    def prepared(self, target, q0): return target, q0
    def call(self, target, q0):
        print("noise", flush=True)
        if abs(q0[0] - 3.0) < 1e-9:
            if {mode!r} == "hang": time.sleep(60)
            if {mode!r} == "raise": raise ZeroDivisionError("by zero")
            if {mode!r} == "crash": os._exit(7)
            if {mode!r} == "crash once" and not os.path.exists({marker!r}):
                open({marker!r}, "w").close()
                os._exit(7)
        return q0
    def answer(self, raw): return raw, 4, True
    def fk(self, q):
        if "blind" in {mode!r}: raise KeyError("tool")
        return [[1.0, 0.0, 0.0, q[0]], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]]
METHOD = Method
"""


class Fake(WorkerSolver):
    """A peer whose environment is the one of the tests."""

    distribution, package, settings = "fake", "fake", "none"

    @classmethod
    def python(cls) -> Path:
        return Path(sys.executable)


def worker(tmp_path: Path, mode: str) -> Fake:
    script = tmp_path / "script.py"
    script.write_text(SCRIPT.format(mode=mode, marker=str(tmp_path / "marker")))
    Fake.environment = str(script.with_suffix(""))
    return Fake(ARM)


GIVEN = [(np.eye(4), np.full(6, float(i))) for i in range(6)]


@pytest.mark.parametrize(
    ("mode", "outcome", "starts"),
    [("none", "answered", 1), ("raise", "raised", 1), ("crash once", "answered", 2), ("crash", "crashed", 3)],
)
def test_a_worker_that_ends_costs_one_restart_and_then_one_problem(
    tmp_path: Path, mode: str, outcome: str, starts: int
) -> None:
    peer = worker(tmp_path, mode)
    found = peer.many(GIVEN)
    outcomes = [getattr(answer.raw, "outcome", "answered") for answer in found]
    assert outcomes == ["answered"] * 3 + [outcome] + ["answered"] * 2
    assert [answer.raw[0] for i, answer in enumerate(found) if i != 3] == [[float(i)] * 6 for i in (0, 1, 2, 4, 5)]
    assert all(answer.ns > 0 for answer in found)
    assert peer.worker.starts == starts
    if mode == "crash":
        assert found[3].raw.error == "its process ended with status 7"
        assert found[3].cpu_ns is None


def test_a_worker_that_hangs_is_ended(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(workers, "LONGEST_CALL", 0.3)
    found = worker(tmp_path, "hang").many(GIVEN)
    assert found[3].raw.error == "no answer for 0.3 s"
    assert found[5].raw[0] == [5.0] * 6


def test_a_worker_that_always_ends_is_not_started_for_ever(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(workers, "MOST_WORKER_CRASHES", 2)
    peer = worker(tmp_path, "crash")
    found = peer.many([GIVEN[3]] * 30)
    assert {answer.raw.outcome for answer in found} == {"crashed"}
    assert len(found) == 30
    assert peer.worker.starts == 4


def test_a_worker_says_that_it_refuses_or_is_broken(tmp_path: Path) -> None:
    with pytest.raises(InvalidInput, match="seven joints"):
        worker(tmp_path, "refuse")
    with pytest.raises(Absent, match="nothing_like_that"):
        worker(tmp_path, "broken")


def test_a_kept_worker_answers_every_peer_with_its_model_and_a_failed_call_is_an_exception(tmp_path: Path) -> None:
    peer = worker(tmp_path, "raise")
    first, again, other = (Fake.start(Fake.environment, {"n": n}, keep=True) for n in (1, 1, 2))
    assert first is again and first is not other
    assert peer.call(np.eye(4), np.full(6, 1.0)) == [[1.0] * 6, 4, True]
    with pytest.raises(Failed, match=r"^raised: ZeroDivisionError: by zero$"):
        peer.call(*GIVEN[3])
    assert peer.fk(np.full(6, 2.0)) == pytest.approx(np.eye(4) + 2.0 * np.eye(4)[[0]].T @ np.eye(4)[[3]])
    with pytest.raises(Absent, match="its forward kinematics failed: KeyError"):
        worker(tmp_path, "blind").fk(np.zeros(6))


def test_rows_of_a_worker_have_the_times_that_it_took_itself(tmp_path: Path) -> None:
    peer = worker(tmp_path, "none")
    rows = rows_of(peer.call, read=peer.read, many=peer.many)
    assert set(rows["outcome"]) == {"answered"}
    assert (rows["ns"] < 1_000_000).all()
    assert rows["claimed"].all()


# ---------------------------------------------------------------- random numbers


def test_random_numbers_are_keyed_by_problem_and_round_and_never_by_the_part() -> None:
    def shifted(target: Any, q0: Any) -> Any:
        return q0 + 1e-3 * np.random.standard_normal(6)  # noqa: NPY002

    drawn = caller(shifted, about={"random": True})
    every = np.arange(len(problems()))
    whole = timed_part(ARM, problems(), every, [drawn], 2, seed=3)["position_error"]
    parts = [timed_part(ARM, problems(), one, [drawn], 2, seed=3)["position_error"] for one in np.array_split(every, 3)]
    other = timed_part(ARM, problems(), every, [drawn], 2, seed=4)["position_error"]
    assert whole.to_list() == pl.concat(parts).to_list()
    assert (whole != other).all()
