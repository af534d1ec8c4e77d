"""Parts are given out as there is room; what fails is tried again, divided, and recorded, in the order of its rows."""

from __future__ import annotations

import random
from collections import Counter
from collections.abc import Collection
from concurrent.futures import Executor, Future
from concurrent.futures.process import BrokenProcessPool
from typing import Any

import polars as pl
import pytest

from benchmarks.blocks.base import Shard
from benchmarks.run.pool import MOST_CRASHES, Done, Failure, Pool, solve_shards
from optik.errors import InvalidInput, OptikError
from tests.benchmarks.toy import Divisible, ToyWork


class Pretended(Pool):
    """A pool whose processes die, hang or raise as the work says, in a random order, and none is started."""

    def __init__(self, room: int, seed: int = 0) -> None:
        self.room, self.most = room, 0
        self.tried: Counter[tuple[int, ...]] = Counter()
        self._work: dict[Future[Any], ToyWork] = {}
        self._rng = random.Random(seed)

    def submit(self, function: Any, *arguments: Any) -> Future[Any]:
        future: Future[Any] = Future()
        work = self._work[future] = arguments[-1]
        self.tried[work.problems] += 1
        self.most = max(self.most, len(self._work))
        return future

    def wait(self, futures: Collection[Future[Any]]) -> Collection[Future[Any]]:
        return [self._rng.choice(list(futures))]

    def outcome(self, future: Future[Any]) -> Any:
        work = self._work.pop(future)
        how = {work.bad[p] for p in work.problems if p in work.bad}
        if "is ours" in how:
            raise InvalidInput("x", 1, "2")
        if "raises" in how:
            return Failure("ZeroDivisionError", again=False)
        if "dies" in how or ("dies once" in how and self.tried[work.problems] == 1):
            return Failure("its process ended: SIGSEGV", again=True)
        return work.solve()


def parts(count: int, size: int, bad: dict[int, str], made: type[ToyWork] = Divisible) -> list[Shard]:
    starts = range(0, count, size)
    return [Shard(str(i), made(tuple(range(i, i + size)), bad, ""), "toy", f"{i}.parquet") for i in starts]


def table(found: list[Done]) -> pl.DataFrame:
    return pl.concat([d.rows for d in sorted(found, key=lambda d: int(d.shard.file[:-8])) if d.rows is not None])


@pytest.mark.parametrize("seed", range(5))
def test_a_problem_that_kills_is_singled_out_and_all_others_keep_their_rows(seed: int) -> None:
    place = Pretended(3, seed)
    found = list(solve_shards(parts(40, 8, {11: "dies", 37: "raises"}), place))
    rows = table(found)
    assert rows["problem"].to_list() == list(range(40))
    assert [p for p, s in rows.iter_rows() if s != p * p] == [11, 37]
    assert rows.filter(pl.col("problem").is_in([11, 37]))["square"].is_infinite().all()
    assert place.tried[tuple(range(8, 16))] == 2, "one retry"
    assert place.tried[tuple(range(32, 40))] == 1, "an error comes again: no retry"
    assert max(v for k, v in place.tried.items() if k != tuple(range(8, 16))) == 1
    assert {d.shard.file: d.crashes for d in found if d.crashes} == {
        "8.parquet": ["its process ended: SIGSEGV"], "32.parquet": ["ZeroDivisionError"],
    }  # fmt: skip
    assert place.most <= 3


def test_a_process_that_dies_once_costs_one_retry_and_nothing_else() -> None:
    place = Pretended(2)
    found = list(solve_shards(parts(16, 4, {5: "dies once"}), place))
    assert table(found)["square"].is_finite().all()
    assert all(not d.crashes for d in found)
    assert sum(place.tried.values()) == 5
    assert [(d.shard.file, d.repeated) for d in found if d.repeated] == [("4.parquet", "its process ended: SIGSEGV")]


def test_a_method_that_always_dies_is_recorded_whole_after_some_problems() -> None:
    place = Pretended(1)
    found = list(solve_shards(parts(400, 100, dict.fromkeys(range(400), "dies")), place))
    rows = table(found)
    assert len(rows) == 400
    assert rows["square"].is_infinite().all()
    singled = [work for work in place.tried if len(work) == 1]
    assert len(singled) <= MOST_CRASHES + 1
    assert sum(place.tried.values()) < 60


def test_work_that_cannot_be_divided_is_lost_and_the_rest_goes_on() -> None:
    found = list(solve_shards(parts(12, 4, {5: "dies"}, ToyWork), Pretended(2)))
    assert {d.shard.file for d in found if d.rows is None} == {"4.parquet"}
    assert len(table(found)) == 8


def test_an_error_of_ours_ends_the_run() -> None:
    with pytest.raises(OptikError):
        list(solve_shards(parts(12, 4, {5: "is ours"}), Pretended(2)))


def test_an_executor_that_breaks_ends_the_run_with_what_to_do() -> None:
    class Broken(Executor):
        def submit(self, function: Any, /, *arguments: Any, **options: Any) -> Future[Any]:
            future: Future[Any] = Future()
            future.set_exception(BrokenProcessPool("a process ended"))
            return future

    with pytest.raises(OptikError, match="repeat the command"):
        list(solve_shards(parts(12, 4, {}), Pool(Broken(), 4, [])))


def test_parts_are_drawn_as_there_is_room() -> None:
    drawn: list[str] = []

    def source() -> Any:
        for shard in parts(400, 4, {}):
            drawn.append(shard.file)
            yield shard

    run = solve_shards(source(), Pretended(5))
    next(run)
    assert len(drawn) == 5
